"""The chart `command` as tables: gates in their order, the five answers, repeats, restarts, answers that are owed."""

from __future__ import annotations

from tests.checks import check_chart, check_equal
from tests.flights import opened_well
from tests.stories import Story


def test_an_order_is_carried_out() -> None:
    """Intended, sent, in progress, accepted; each step once, the answer last; then only the stored result."""
    check_chart(
        "command",
        """
        at_s | observe                | state         | say              | why
        0    | order a point          | a intended    | look 1,1         | all gates passed
        0.1  | sent a                 | a sent        | -                | the bytes left
        0.2  | sent a                 | -             | -                | -
        0.3  | answered a 5           | a in_progress | -                | the vehicle is at it
        0.4  | answered a 5           | -             | -                | -
        0.5  | sent a                 | -             | -                | -
        0.6  | answered a 0           | a accepted    | a accepted       | COMMAND_ACK: MAV_RESULT_ACCEPTED
        0.7  | answered a 4           | -             | -                | -
        0.8  | unanswered a no answer | -             | -                | -
        0.9  | sent a                 | -             | -                | -
        1.0  | again a                | -             | a accepted again | COMMAND_ACK: MAV_RESULT_ACCEPTED
        1.1  | order b turn           | b intended    | turn -30,90      | all gates passed
        1.2  | answered b 0           | b accepted    | b accepted       | COMMAND_ACK: MAV_RESULT_ACCEPTED
        1.3  | order c release        | c intended    | let go           | all gates passed
        1.4  | answered c 0           | c accepted    | c accepted       | COMMAND_ACK: MAV_RESULT_ACCEPTED
        """,
    )


def test_what_the_vehicle_says_is_the_answer() -> None:
    """Every MAV_RESULT, and silence in its four kinds, from `intended` and from `in_progress`."""
    check_chart(
        "command",
        """
        at_s | observe                    | say           | why
        0    | order a point              | look 1,1      | all gates passed
        0.1  | answered a 1               | a rejected    | COMMAND_ACK: MAV_RESULT_TEMPORARILY_REJECTED
        1    | order b point              | look 1,1      | all gates passed
        1.1  | answered b 2               | b rejected    | COMMAND_ACK: MAV_RESULT_DENIED
        2    | order c point              | look 1,1      | all gates passed
        2.1  | answered c 3               | c unsupported | COMMAND_ACK: MAV_RESULT_UNSUPPORTED
        3    | order d point              | look 1,1      | all gates passed
        3.1  | answered d 7               | d unsupported | COMMAND_ACK: MAV_RESULT_COMMAND_LONG_ONLY
        4    | order e point              | look 1,1      | all gates passed
        4.1  | answered e 9               | e unsupported | COMMAND_ACK: MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME
        5    | order f point              | look 1,1      | all gates passed
        5.1  | answered f 5               | -             | the vehicle is at it
        5.2  | answered f 6               | f rejected    | COMMAND_ACK: MAV_RESULT_CANCELLED
        6    | order g point              | look 1,1      | all gates passed
        6.1  | answered g 77              | g rejected    | COMMAND_ACK: MAV_RESULT 77
        7    | order h point              | look 1,1      | all gates passed
        7.1  | unanswered h no answer     | h timeout     | no answer from the vehicle: no answer
        8    | order i point              | look 1,1      | all gates passed
        8.1  | unanswered i expired early | i timeout     | no answer from the vehicle: expired early
        9    | order j point              | look 1,1      | all gates passed
        9.1  | unanswered j no vehicle    | j rejected    | could not be sent: no vehicle
        10   | order k point              | look 1,1      | all gates passed
        10.1 | unanswered k not encodable | k rejected    | could not be sent: not encodable
        11   | order l point              | look 1,1      | all gates passed
        11.1 | unanswered l superseded    | l rejected    | could not be sent: superseded
        12   | order m point              | look 1,1      | all gates passed
        12.1 | answered m 8               | m unsupported | COMMAND_ACK: MAV_RESULT_COMMAND_INT_ONLY
        13   | order n point              | look 1,1      | all gates passed
        13.1 | answered n 10              | n rejected    | COMMAND_ACK: MAV_RESULT_NOT_IN_CONTROL
        """,
    )


def test_nothing_is_heard_of_an_order() -> None:
    """Five seconds after the order's life the core stops waiting; what comes later changes nothing."""
    check_chart(
        "command",
        """
        at_s | observe                 | state         | say             | why
        0    | order a point life=9000 | a intended    | look 1,1        | all gates passed
        1    | answered a 5            | a in_progress | -               | the vehicle is at it
        10   | time                    | -             | -               | -
        14   | time                    | a timeout     | a timeout       | no outcome within the order's life
        14.5 | answered a 0            | -             | -               | -
        15   | again a                 | -             | a timeout again | no outcome within the order's life
        """,
    )


def test_the_gates_in_their_order() -> None:
    """Each line breaks one gate less than the line before: the earliest gate answers."""
    check_chart(
        "command",
        """
        at_s | observe                                            | say            | why
        0    | order z dance nonce=n seq=5 life=1                 | z unsupported  | unknown kind of order
        1    | order a dance nonce=n seq=5 life=0 roles= target=x | a unauthorised | not for this node
        1    | order b dance nonce=n seq=5 life=0 roles=          | b unauthorised | role not permitted
        1    | order c dance nonce=n seq=5 life=0                 | c rejected     | replayed
        1    | order d dance seq=5 life=0                         | d rejected     | stale: a newer order came first
        1    | order e dance life=0                               | e rejected     | expired
        1    | order f dance                                      | f unsupported  | unknown kind of order
        1    | vehicle down                                       | -              | -
        1    | order g point camera=7 at=null                     | g rejected     | no such camera, or nothing turns it
        1    | order h point camera=2 at=null                     | h rejected     | no such camera, or nothing turns it
        1    | order i release camera=2                           | i rejected     | no such camera, or nothing turns it
        1    | order j point at=null                              | j rejected     | 0, 0, 0 is no place to look at
        1    | order k confirm p9                                 | k rejected     | unknown_poi_id
        1    | order l point                                      | l rejected     | no vehicle is heard
        1    | vehicle up                                         | -              | -
        1    | order m point                                      | look 1,1       | all gates passed
        """,
    )


def test_orders_are_switched_off() -> None:
    """Unsupported for whoever may not either; but an order for another node is not this node's to refuse."""
    check_chart(
        "command",
        """
        at_s | observe                          | say                 | why
        0    | order a point target=x           | a unauthorised      | not for this node
        0    | order b point roles=viewer seq=1 | b unsupported       | orders are switched off on this node
        0    | order c point                    | c unsupported       | orders are switched off on this node
        0    | again c                          | c unsupported again | orders are switched off on this node
        """,
        command_enabled=False,
    )


def test_an_empty_list_of_roles_allows_nobody() -> None:
    """Also not somebody without roles."""
    check_chart(
        "command",
        """
        at_s | observe              | state          | say            | why
        0    | order a point        | a unauthorised | a unauthorised | role not permitted
        0    | order b point roles= | b unauthorised | b unauthorised | role not permitted
        """,
        camera_roles=[],
    )


def test_one_role_of_several_is_enough() -> None:
    """Seed 000: the check is an intersection."""
    check_chart(
        "command",
        """
        at_s | observe                          | state          | say            | why
        0    | order a point roles=viewer,admin | a intended     | look 1,1       | all gates passed
        0    | order b point roles=viewer,owner | b unauthorised | b unauthorised | role not permitted
        """,
        camera_roles=["operator", "admin"],
    )


def test_safe_mode_refuses_after_role_and_sequence() -> None:
    """In safe mode an order without a role is still unauthorised, a stale one stale, and the rest is refused."""
    story = Story()
    story.flight.state.health.set("safe_mode")
    check_chart(
        "command",
        """
        at_s | observe              | state          | say            | why
        0    | order a point roles= | a unauthorised | a unauthorised | role not permitted
        0    | order b point seq=1  | b rejected     | b rejected     | stale: a newer order came first
        0    | order c point life=0 | c rejected     | c rejected     | the node is in safe mode
        0    | order d release      | d rejected     | d rejected     | the node is in safe mode
        """,
        story,
    )


def test_the_id_of_an_order_is_its_issuers_own() -> None:
    """Another operator's order under the same id is another order; sequences count for a device alone."""
    story = check_chart(
        "command",
        """
        at_s | observe                     | state      | say         | why
        0    | order a point seq=9         | a intended | look 1,1    | all gates passed
        1    | order a turn by=bravo seq=2 | a intended | turn -30,90 | all gates passed
        2    | order b turn by=bravo seq=2 | b rejected | b rejected  | stale: a newer order came first
        3    | order c turn by=bravo seq=3 | c intended | turn -30,90 | all gates passed
        4    | order d turn seq=9          | d rejected | d rejected  | stale: a newer order came first
        """,
    )
    check_equal(sorted(story.flight.state.orders._rows), ["alpha/a", "alpha/d", "bravo/a", "bravo/b", "bravo/c"])


def test_a_refused_order_uses_up_its_number() -> None:
    """Whatever an order was answered, an older one must not come after it."""
    check_chart(
        "command",
        """
        at_s | observe                    | state          | say            | why
        0    | order a point seq=7 roles= | a unauthorised | a unauthorised | role not permitted
        0    | order b point seq=6        | b rejected     | b rejected     | stale: a newer order came first
        0    | order e point seq=7        | e rejected     | e rejected     | stale: a newer order came first
        0    | order c point seq=8        | c intended     | look 1,1       | all gates passed
        0    | order d point seq=8        | d rejected     | d rejected     | stale: a newer order came first
        """,
    )


def test_a_place_before_the_origin() -> None:
    """Nothing has a place yet: refused once and for good; a direction needs none."""
    opening = [message for message in opened_well() if message.DESCRIPTOR.name != "OriginSet"]
    check_chart(
        "command",
        """
        at_s | observe       | say              | why
        0    | order a point | a rejected       | this node has no position yet
        0    | again a       | a rejected again | this node has no position yet
        0    | order b turn  | turn -30,90      | all gates passed
        """,
        Story(*opening),
    )


def test_a_restart() -> None:
    """What was under way is unknown; what was answered is said again only where it is not known to have left."""
    check_chart(
        "command",
        """
        at_s | observe       | state                | say
        0    | order a point | a intended           | look 1,1
        1    | order b point | b intended           | look 1,1
        1    | sent b        | b sent               | -
        1    | answered b 5  | b in_progress        | -
        2    | order c point | c intended           | look 1,1
        2    | answered c 0  | c accepted           | c accepted
        2    | published c   | -                    | -
        2    | order d dance | d unsupported        | d unsupported
        3    | start         | a timeout, b timeout | a timeout; b timeout; d unsupported
        4    | answered a 0  | -                    | -
        4    | published a   | -                    | -
        4    | published d   | -                    | -
        5    | start         | -                    | b timeout
        5    | published b   | -                    | -
        6    | start         | -                    | -
        7    | again a       | -                    | a timeout again
        """,
    )


def test_an_answer_that_could_not_leave_is_still_owed() -> None:
    """A failed publication is none, and a refused reuse of the id does not take the answer's place."""
    check_chart(
        "command",
        """
        at_s | observe                    | say           | why
        0    | order a dance              | a unsupported | unknown kind of order
        1    | published a failure=nolink | -             | -
        2    | start                      | a unsupported | unknown kind of order
        3    | again a body=evil          | a rejected    | command_id reuse: another body under the same id
        3    | published a                | -             | -
        4    | start                      | a unsupported | unknown kind of order
        4    | published a                | -             | -
        5    | start                      | -             | -
        """,
    )


def test_results_are_kept_for_their_time() -> None:
    """Afterwards an old order is a stranger, and stale; a late answer of the vehicle finds nobody and is no error."""
    check_chart(
        "command",
        """
        at_s   | observe                 | state         | say             | why
        0      | order a point life=1000 | a intended    | look 1,1        | all gates passed
        6      | time                    | a timeout     | a timeout       | no outcome within the order's life
        19.999 | again a                 | -             | a timeout again | no outcome within the order's life
        30     | order b dance           | b unsupported | b unsupported   | unknown kind of order
        31     | answered a 0            | -             | -               | -
        32     | again a                 | a rejected    | a rejected      | stale: a newer order came first
        """,
        dedup_keep_ms=20_000,
        arrival_patience_ms=1_000_000,
        operator_hold_ms=1_000_000,
    )


def test_an_undecided_order_is_never_forgotten() -> None:
    """However short results are kept: what is under way stays until it has an answer."""
    check_chart(
        "command",
        """
        at_s | observe       | state         | say           | why
        0    | order a point | a intended    | look 1,1      | all gates passed
        11   | order b dance | b unsupported | b unsupported | unknown kind of order
        12   | answered a 0  | a accepted    | a accepted    | COMMAND_ACK: MAV_RESULT_ACCEPTED
        23   | order c dance | c unsupported | c unsupported | unknown kind of order
        """,
        story := Story(dedup_keep_ms=1_000, arrival_patience_ms=1_000_000),
    )
    check_equal([order.command_id for order in story.flight.state.orders.values()], ["c"])


def test_an_order_that_is_in_progress_is_still_heard_after_the_next() -> None:
    """Only effects whose outcome is in are forgotten; what an effect may take is what is left of the order's life."""
    story = check_chart(
        "command",
        """
        at_s | observe                 | state         | say         | why
        0    | order a point life=7654 | a intended    | look 1,1    | all gates passed
        1    | answered a 5            | a in_progress | -           | the vehicle is at it
        2    | order b turn life=4321  | b intended    | turn -30,90 | all gates passed
        3    | answered a 0            | a accepted    | a accepted  | COMMAND_ACK: MAV_RESULT_ACCEPTED
        3    | unanswered b no answer  | b timeout     | b timeout   | no answer from the vehicle: no answer
        4    | order c release         | c intended    | let go      | all gates passed
        """,
    )
    check_equal([effect.order for effect in story.flight.state.effects.values()], ["alpha/c"])
    effects = [record.message for record in story.flight.records if record.kind.port == "vehicle"]
    check_equal([effect.life_ms for effect in effects], [7_654, 4_321, 15_000])  # type: ignore[attr-defined]
    asked = {(effect.vehicle, effect.camera, effect.gimbal) for effect in effects}  # type: ignore[attr-defined]
    check_equal(asked, {(1, 1, 1)})


def test_outcomes_of_nothing_are_nothing() -> None:
    """An outcome that names no effect of this flight, or one of the node's own, moves no order."""
    check_chart(
        "command",
        """
        at_s | observe                   | state | say | why
        0    | sent 4711                 | -     | -   | -
        0    | answered 4711 0           | -     | -   | -
        0    | unanswered 4711 no answer | -     | -   | -
        0    | published nobody          | -     | -   | -
        """,
    )
