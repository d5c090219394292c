"""The chart `command` as tables: what an issuer is told, the ladder up to the last word, and repeats."""

from __future__ import annotations

from events import Record
from events.schema.orders_pb2 import ACK_ACCEPTED, SendAck
from tests.checks import check_chart, check_equal, is_rung
from tests.stories import Story


def is_answer(record: Record) -> bool:
    """Say whether a record answers an order or a repeat, and does not only tell how far an order got."""
    return record.kind.name == "send_ack" and not is_rung(record)


def test_repeats() -> None:
    """Received while it is undecided, the stored result afterwards, another body never, and nothing changes."""
    story = check_chart(
        "command",
        """
        at_s | observe           | state      | say              | why
        0    | order a point     | a intended | look 1,1         | all gates passed
        1    | again a           | -          | a received again | answered: not decided yet
        1    | again a body=evil | -          | a rejected       | command_id reuse: another body under the same id
        2    | answered a 0      | a accepted | a accepted       | COMMAND_ACK: MAV_RESULT_ACCEPTED
        3    | again a           | -          | a accepted again | COMMAND_ACK: MAV_RESULT_ACCEPTED
        3    | again a body=evil | -          | a rejected       | command_id reuse: another body under the same id
        4    | again a           | -          | a accepted again | COMMAND_ACK: MAV_RESULT_ACCEPTED
        """,
    )
    acks = [record.message for record in story.flight.records if is_answer(record)]
    check_equal([ack.final for ack in acks], [False, True, True, True, True, True])  # type: ignore[attr-defined]
    check_equal(len({ack.in_reply_to for ack in acks}), 6)  # type: ignore[attr-defined]


def test_a_stored_result_is_the_whole_result() -> None:
    """A repeat is told the vehicle's own answer too, also one that came before silence."""
    story = check_chart(
        "command",
        """
        at_s | observe                | state         | say              | why
        0    | order a point          | a intended    | look 1,1         | all gates passed
        1    | answered a 1           | a rejected    | a rejected       | COMMAND_ACK: MAV_RESULT_TEMPORARILY_REJECTED
        2    | again a                | -             | a rejected again | COMMAND_ACK: MAV_RESULT_TEMPORARILY_REJECTED
        3    | order b point          | b intended    | look 1,1         | all gates passed
        3.1  | answered b 5           | b in_progress | -                | the vehicle is at it
        4    | unanswered b no answer | b timeout     | b timeout        | no answer from the vehicle: no answer
        5    | again b                | -             | b timeout again  | no answer from the vehicle: no answer
        6    | order c point life=0   | c rejected    | c rejected       | expired
        """,
    )
    acks = [record.message for record in story.flight.records if is_answer(record)]
    check_equal([ack.mav_result for ack in acks], [1, 1, 5, 5, 0])  # type: ignore[attr-defined]
    check_equal([ack.HasField("mav_result") for ack in acks], [True, True, True, True, False])


def test_the_ladder() -> None:
    """Received, sent, in progress, each once and in this order, then the last word; nothing of it after that."""
    story = check_chart(
        "command",
        """
        at_s | observe       | state         | rung          | say
        0    | order a point | a intended    | a received    | look 1,1
        0.1  | sent a        | a sent        | a sent        | -
        0.2  | answered a 5  | a in_progress | a in progress | -
        0.3  | answered a 5  | -             | -             | -
        0.4  | answered a 0  | a accepted    | -             | a accepted
        0.5  | sent a        | -             | -             | -
        1    | order b turn  | b intended    | b received    | turn -30,90
        1.1  | answered b 5  | b in_progress | b in progress | -
        1.2  | sent b        | -             | -             | -
        1.3  | answered b 4  | b rejected    | -             | b rejected
        2    | order c dance | c unsupported | -             | c unsupported
        3    | order d point | d intended    | d received    | look 1,1
        3.1  | sent d        | d sent        | d sent        | -
        3.2  | again d       | -             | -             | d sent again
        3.3  | answered d 5  | d in_progress | d in progress | -
        3.4  | again d       | -             | -             | d in progress again
        """,
    )
    acks = [record.message for record in story.flight.records if record.kind.name == "send_ack"]
    rungs = [ack for ack in acks if isinstance(ack, SendAck) and ack.stage]
    check_equal({(ack.final, ack.result, ack.HasField("mav_result")) for ack in rungs}, {(False, ACK_ACCEPTED, False)})
    order = story.flight.state.orders["alpha/d"]
    check_equal([ack.in_reply_to == order.in_reply_to for ack in rungs[-4:]], [True, False, True, False])
    last = [ack for ack in acks if isinstance(ack, SendAck) and ack.final]
    check_equal({ack.HasField("stage") for ack in last}, {False})


def test_repeats_are_answered_twice_a_second() -> None:
    """An id, not an issuer, by the time of the log; a repeat with another body counts as well."""
    check_chart(
        "command",
        """
        at_s  | observe           | say              | why
        0     | order a dance     | a unsupported    | unknown kind of order
        0     | order b point     | look 1,1         | all gates passed
        0.1   | again a           | a unsupported again | unknown kind of order
        0.2   | again a           | a unsupported again | unknown kind of order
        0.3   | again a           | -                | -
        0.3   | again a body=evil | -                | -
        0.3   | again b           | b received again | answered: not decided yet
        0.4   | again b body=evil | b rejected       | command_id reuse: another body under the same id
        0.5   | again b           | -                | -
        0.6   | answered b 0      | b accepted       | COMMAND_ACK: MAV_RESULT_ACCEPTED
        1.099 | again a           | -                | -
        1.1   | again a           | a unsupported again | unknown kind of order
        1.199 | again a           | -                | -
        1.2   | again a           | a unsupported again | unknown kind of order
        1.3   | again b           | b accepted again | COMMAND_ACK: MAV_RESULT_ACCEPTED
        """,
    )


def test_the_first_of_ten_thousand_orders_is_still_known() -> None:
    """So many ids of another issuer push nothing out: its stored result is the answer, and nothing is sent again."""
    story = Story(arrival_patience_ms=1_000_000)
    check_chart("command", "at_s | observe | say\n0 | order a point | look 1,1\n0 | answered a 0 | a accepted", story)
    for number in range(10_000):
        story.at(1 + number)
        story.tell(f"order n{number} dance by=bravo")
    check_chart("command", "at_s | observe | say\n15 | again a | a accepted again", story)
    effects = [record for record in story.flight.records if record.kind.port == "vehicle"]
    check_equal((len(effects), len(story.flight.state.orders)), (1, 10_001))
