"""The chart `mission` as tables: from the link to the landing, and everything that can come between."""

from __future__ import annotations

from typing import Any

import pytest

from events.schema.common_pb2 import Moved
from events.schema.mission_pb2 import WaypointPosted
from statecharts.carry import carry_over
from statecharts.charts.opening import load_carried
from statecharts.state import State
from tests import flights, flying
from tests.checks import check_chart, check_equal, seen
from tests.stories import Story

GROUND = """
    at_s | observe       | state       | say      | why
    0    | planned       | 1 selftest  | -        | planned
    1    | report pass   | 1 ready     | -        | fit to fly: waits for an order
    2    | order a begin | 1 uploading | upload 4 | a person lets it begin
"""
AIR = f"""
    {GROUND.strip()}
    3    | uploaded            | 1 readying | go guided  | the vehicle has the plan, read back
    4    | did 0               | 1 arming   | arm        | the vehicle holds
    5    | armed               | 1 engaging | go mission | armed
    6    | mode mission        | 1 starting | start      | the vehicle is in the mission's mode
    7    | did 0               | 1 flying   | -          | the mission has begun
    7.1  | gimbal newest error=0 | -        | -          | -
"""


def story(table: str = "", **changes: Any) -> Story:
    """Return a story of a node that flies missions, told as far as `table`."""
    tale = Story(*flying.opening(**changes))
    return check_chart("mission", table, tale) if table else tale


def test_from_the_link_to_the_landing() -> None:
    """Every step waits for what the vehicle says; the end is seen, not assumed; it is flown once."""
    tale = check_chart(
        "mission",
        """
        at_s | observe        | state       | say | why
        8    | at 0           | -           | -   | -
        60   | at 2 reached=1 | -           | -   | -
        90   | at 3 reached=2 | 1 returning | -   | the mission is on its way home
        91   | mode mission   | -           | -   | -
        99   | disarmed       | 1 landed    | -   | disarmed
        109  | time           | 1 done      | -   | the flight of the mission is over
        """,
        story(AIR),
    )
    check_equal(tale.flight.state.missions[1].flown_revision, "a")


def test_it_looks_for_the_vehicle_first() -> None:
    """No mission is asked for before the vehicle is heard; one that is there is not waited for."""
    tale = story()
    moves = [record.message for record in tale.flight.records if isinstance(record.message, Moved)]
    check_equal([move.to_state for move in moves if move.chart == "mission"], ["linking", "checking"])


@pytest.mark.parametrize(("words", "answer"), [("did 4", "MAV_RESULT_FAILED"), ("did-not", "no answer")])
def test_a_step_is_tried_so_often(words: str, answer: str) -> None:
    """A refusal waits for the step's time, and after the last a person has to look; what is in progress is awaited."""
    check_chart(
        "mission",
        f"""
        at_s | observe  | state      | say       | why
        3    | uploaded | 1 readying | go guided | the vehicle has the plan, read back
        4    | did 5    | -          | -         | -
        5    | {words}  | -          | -         | -
        6    | {words}  | -          | -         | -
        13   | time     | 1 readying | go guided | the vehicle did not do it: tried again
        14   | {words}  | -          | -         | -
        23   | time     | 1 readying | go guided | the vehicle did not do it: tried again
        24   | {words}  | 1 paused   | -         | the vehicle did not do it, as often as it may be tried: {answer}
        """,
        story(GROUND),
    )


def test_a_refusal_is_of_one_try() -> None:
    """What came after a refusal counts: the vehicle did it, or nothing came of the next try."""
    check_chart(
        "mission",
        """
        at_s | observe  | state      | say       | why
        3    | uploaded | 1 readying | go guided | the vehicle has the plan, read back
        4    | did 4    | -          | -         | -
        13   | time     | 1 readying | go guided | the vehicle did not do it: tried again
        14   | did 5    | -          | -         | -
        23   | time     | 1 readying | go guided | nothing came of it: tried again
        24   | did 99   | 1 paused   | -         | the vehicle did not do it, as often as it may be tried: MAV_RESULT 99
        25   | order r resume | 1 uploading | upload 4 | an operator lets it go on
        26   | uploaded | 1 readying | go guided | the vehicle has the plan, read back
        27   | did 4    | -          | -         | -
        28   | mode loiter disarmed=1 | 1 arming | arm | the vehicle holds
        29   | did 4    | -          | -         | -
        30   | armed    | 1 engaging | go mission | armed
        40   | time     | 1 engaging | go mission | nothing came of it: tried again
        """,
        story(GROUND),
    )


def test_silence_is_tried_again_too() -> None:
    """Ten seconds a step; an armed vehicle that goes no further is stopped where it is."""
    check_chart(
        "mission",
        """
        at_s | observe  | state      | say       | why
        3    | uploaded | 1 readying | go guided | the vehicle has the plan, read back
        13   | time     | 1 readying | go guided | nothing came of it: tried again
        14   | mode loiter disarmed=1 | 1 arming | arm | the vehicle holds
        15   | did 0    | -          | -         | -
        24   | time     | 1 arming   | arm       | nothing came of it: tried again
        34   | time     | 1 arming   | arm       | nothing came of it: tried again
        44   | time     | 1 paused   | -         | nothing came of it, as often as it may be tried
        """,
        story(GROUND),
    )


def test_nothing_is_armed_before_the_plan_was_read_back() -> None:
    """A failed upload is begun again, whole; then it is paused, and an operator may let it go on."""
    often = "the vehicle did not take the plan, as often as it may be tried: refused"
    check_chart(
        "mission",
        f"""
        at_s | observe        | state       | say       | why
        3    | uploaded 1     | -           | -         | -
        4    | not-uploaded   | -           | -         | -
        14   | time           | 1 uploading | upload 4  | the vehicle did not take the plan: tried again
        79   | time           | 1 uploading | upload 4  | no word of the upload: tried again
        80   | not-uploaded   | 1 paused    | -         | {often}
        81   | order r resume | 1 uploading | upload 4  | an operator lets it go on
        82   | uploaded       | 1 readying  | go guided | the vehicle has the plan, read back
        """,
        story(GROUND),
    )


def test_a_pilot_starts_it() -> None:
    """A fixed wing always; the node waits until it sees it, and commands nothing."""
    check_chart(
        "mission",
        """
        at_s | observe               | state               | say      | why
        0    | planned wing=1        | 1 selftest          | -        | planned
        1    | order a begin         | -                   | -        | -
        2    | report pass           | 1 uploading         | upload 4 | fit to fly
        3    | uploaded              | 1 waiting_for_pilot | -        | the vehicle has the plan: a pilot starts it
        9    | armed                 | -                   | -        | -
        10   | mode mission          | 1 flying            | -        | a pilot has started it
        """,
        story(),
    )


def test_it_may_begin_by_itself_and_then_once() -> None:
    """Where no order is needed; the same revision is not flown again, by a later flight neither."""
    tale = story(mission_begun_by_order=False)
    check_chart(
        "mission",
        """
        at_s | observe     | state       | say      | why
        0    | planned     | 1 selftest  | -        | planned
        1    | report pass | 1 uploading | upload 4 | fit to fly
        """,
        tale,
    )
    state = State()
    flown = story(AIR)
    check_chart(
        "mission",
        """
        at_s | observe  | state    | say | why
        9    | disarmed | 1 landed | -   | disarmed
        19   | time     | 1 done   | -   | the flight of the mission is over
        """,
        flown,
    )
    carried = carry_over(flown.flight.state, flown.flight.now_ns)
    load_carried(state, carried, 0)
    check_equal((state.missions[1].state, state.missions[1].flown_revision), ("idle", "a"))
    following = Story(*flying.opening(mission_begun_by_order=False))
    following.flight.state.missions.put(1, following.flight.state.missions[1]._replace(flown_revision="a"))
    check_chart(
        "mission",
        """
        at_s | observe       | state      | say   | why
        0    | planned       | 1 done     | -     | flown already; begins again only by order
        1    | order a begin | 1 checking | fetch | a person lets it begin again
        2    | planned       | 1 selftest | -     | planned
        """,
        following,
    )


@pytest.mark.parametrize(
    ("words", "state", "why"),
    [
        ("mode loiter", "1 paused", "somebody took the vehicle out of the mission"),
        ("mode none", "1 paused", "somebody took the vehicle out of the mission"),
        ("mode return", "1 returning", "the vehicle goes home by itself"),
        ("mode land", "1 returning", "the vehicle goes home by itself"),
        ("disarmed", "1 landed", "disarmed"),
        ("mode mission", "-", "-"),
    ],
)
def test_what_the_vehicle_does_by_itself(words: str, state: str, why: str) -> None:
    """It is followed; nothing is commanded against whoever took the vehicle."""
    check_chart(
        "mission",
        f"""
        at_s | observe | state   | say | why
        8    | {words} | {state} | -   | {why}
        """,
        story(AIR),
    )


def test_paused_and_resumed() -> None:
    """The vehicle is held; it goes on with the item that it was at; a pilot's own return is respected."""
    check_chart(
        "mission",
        """
        at_s | observe        | state       | say                | why
        8    | at 2 reached=1 | -           | -                  | -
        9    | order p pause  | 1 paused    | go loiter          | an operator pauses it
        10   | mode loiter    | -           | -                  | -
        11   | order q pause  | -           | -                  | -
        12   | order r resume | 1 engaging  | item 2; go mission | an operator lets it go on
        13   | mode mission   | 1 flying    | -                  | goes on with the mission
        14   | mode loiter    | 1 paused    | -                  | somebody took the vehicle out of the mission
        15   | mode mission   | 1 flying    | -                  | somebody put it back into the mission
        16   | mode loiter    | 1 paused    | -                  | somebody took the vehicle out of the mission
        17   | mode return    | 1 returning | -                  | the vehicle goes home
        18   | mode loiter    | 1 paused    | -                  | somebody stopped the return
        19   | disarmed       | 1 landed    | -                  | disarmed
        """,
        story(AIR),
    )


def test_aborted() -> None:
    """The return is asked until the vehicle is seen to comply; on the ground nothing needs to be asked."""
    check_chart(
        "mission",
        """
        at_s | observe       | state      | say       | why
        8    | order x abort | 1 aborting | go return | an operator aborts it
        18   | time          | 1 aborting | go return | it does not comply: asked again
        19   | mode return   | -          | -         | -
        30   | mode guided   | -          | -         | -
        31   | mode loiter   | -          | -         | -
        40   | time          | 1 aborting | go return | it does not comply: asked again
        41   | mode land     | -          | -         | -
        60   | disarmed      | 1 aborted  | -         | disarmed
        70   | order b begin | 1 checking | fetch     | a person lets it begin again
        """,
        story(AIR),
    )
    check_chart(
        "mission",
        """
        at_s | observe       | state     | say | why
        3    | order x abort | 1 aborted | -   | an operator aborts it
        """,
        story(GROUND),
    )


def test_no_mission_to_be_had() -> None:
    """The adapter goes on trying; when it gives up a person has to look; a start asks again."""
    check_chart(
        "mission",
        """
        at_s | observe            | state      | say   | why
        0    | no-mission         | -          | -     | -
        1    | start              | 1 checking | fetch | started again: fetched again
        2    | no-mission final=1 | 1 paused   | -     | no mission can be had
        3    | order r resume     | 1 checking | fetch | an operator lets it go on
        """,
        story(),
    )


def test_a_start_in_the_middle_of_it() -> None:
    """On the ground nothing goes on without an order that is given after it; in the air it watches."""
    check_chart(
        "mission",
        """
        at_s | observe       | state       | say       | why
        3    | start         | 1 ready     | -         | started again on the ground: waits for an order anew
        7203 | vehicle up    | -           | -         | -
        7204 | order b begin | 1 uploading | upload 4  | a person lets it begin
        7205 | uploaded      | 1 readying  | go guided | the vehicle has the plan, read back
        7206 | start         | 1 ready     | -         | started again on the ground: waits for an order anew
        7207 | vehicle up    | -           | -         | -
        7208 | order c begin | 1 uploading | upload 4  | a person lets it begin
        7209 | uploaded      | 1 readying  | go guided | the vehicle has the plan, read back
        7210 | did 0         | 1 arming    | arm       | the vehicle holds
        7211 | start         | 1 ready     | -         | started again on the ground: waits for an order anew
        7212 | vehicle up    | -           | -         | -
        7213 | mode loiter disarmed=1 | -  | -         | -
        """,
        story(GROUND),
    )
    check_chart(
        "mission",
        """
        at_s | observe       | state      | say | why
        0    | planned       | 1 selftest | -   | planned
        1    | order a begin | -          | -   | -
        2    | start         | -          | -   | -
        3    | vehicle up    | -          | -   | -
        4    | report pass   | 1 ready    | -   | fit to fly: waits for an order
        """,
        story(),
    )
    check_chart(
        "mission",
        """
        at_s | observe    | state    | say | why
        8    | start      | -        | -   | -
        9    | vehicle up | -        | -   | -
        10   | disarmed   | 1 landed | -   | disarmed
        """,
        story(AIR),
    )


def test_progress_where_the_vehicle_does_not_name_every_item() -> None:
    """What is flown to says that what lies before it is done; the farther one counts, and a mission begun anew."""
    tale = story(AIR)
    for words, expected in (("at 1", 1), ("at 1 reached=1", 2), ("at 3 reached=1", 3), ("at 0", 0), ("at", 0)):
        tale.tell(words)
        check_equal(tale.flight.state.missions[1].next_item, expected)


def followed(items: str = "takeoff,go,go,home") -> Story:
    """Return a story in the air, with a finding that a person has confirmed."""
    tale = Story(*flying.opening(sightings_to_ask=1, frame_rate_floor_mhz=0))
    planned, uploads = f"| planned items={items}", f"upload {items.count(',') + 1} "
    tale = check_chart("mission", AIR.replace("| planned", planned, 1).replace("upload 4 ", uploads), tale)
    for words in ("frame person@5,5", "time", "order c confirm p1 by=bravo", "at 2 reached=1"):
        tale.tell(words)
    return tale


def test_what_is_followed_gets_a_waypoint() -> None:
    """The office is asked, the changed plan is uploaded in the air, the vehicle waits there, and goes on behind it."""
    check_chart(
        "mission",
        """
        at_s | observe                    | state       | say                   | why
        10   | order f follow p1 by=bravo | 1 flying | post before 2 at 30 m | asks for a waypoint at what is followed
        11   | posted                     | -           | -                     | -
        12   | planned rev=b items=takeoff,go,go,go,home | 1 uploading | upload 5 | the plan has changed
        13   | mode mission               | -           | -                     | -
        14   | uploaded                   | 1 engaging  | item 2; go mission    | the vehicle has the plan, in the air
        15   | mode mission               | 1 flying    | -                     | goes on with the mission
        20   | time                       | -           | -                     | -
        20   | at 2                       | -           | -                     | -
        21   | at 3 reached=2             | 1 following | go loiter             | waits at what is followed
        22   | mode loiter                | -           | -                     | -
        30   | order t turn by=bravo      | 1 engaging  | item 3; go mission    | goes on where it left the mission
        31   | mode mission               | 1 flying    | -                     | goes on with the mission
        """,
        followed(),
    )


def test_a_waypoint_that_comes_late_is_turned_back_for() -> None:
    """Where the vehicle is past its number already, by the plan before: that is not waiting at it."""
    check_chart(
        "mission",
        """
        at_s | observe                    | state       | say                   | why
        10   | order f follow p1 by=bravo | 1 flying | post before 2 at 30 m | asks for a waypoint at what is followed
        11   | at 3 reached=2             | -           | -                     | -
        12   | posted                     | -           | -                     | -
        13   | at 4 reached=3             | -           | -                     | -
        14   | planned rev=b items=takeoff,go,go,go,go,go,go,home | 1 uploading | upload 8 | the plan has changed
        15   | at 5 reached=4             | -           | -                     | -
        16   | uploaded                   | 1 engaging  | item 2; go mission    | the vehicle has the plan, in the air
        17   | at 5                       | -           | -                     | -
        18   | mode mission               | 1 flying    | -                     | goes on with the mission
        20   | time                       | -           | -                     | -
        20   | at 6 reached=5             | -           | -                     | -
        21   | at 2                       | -           | -                     | -
        22   | at 3 reached=2             | 1 following | go loiter             | waits at what is followed
        """,
        followed("takeoff,go,go,go,go,go,home"),
    )


def test_a_plan_of_somebody_else_has_no_such_waypoint() -> None:
    """Nor the plan of before: only the one that came of the asking, once the vehicle holds it."""
    tale = followed("takeoff,go,go,go,home")
    for words in ("order f follow p1 by=bravo", "at 3 reached=2", "planned rev=c items=takeoff,go,go,go,home of=7"):
        tale.tell(words)
    for words in ("uploaded", "mode mission", "at 2", "at 3"):
        tale.tell(words)
    check_equal(tale.flight.state.missions[1].state, "flying")
    for words, state in (("planned rev=d items=takeoff,go,go,go,go,home", "uploading"), ("at 2", "uploading")):
        tale.tell(words)
        check_equal((words, tale.flight.state.missions[1].state), (words, state))
    for words, state in (("uploaded", "engaging"), ("mode mission", "flying"), ("at 3", "following")):
        tale.tell(words)
        check_equal((words, tale.flight.state.missions[1].state), (words, state))


def test_what_was_passed_while_nobody_looked_is_not_waited_at_later() -> None:
    """Past the waypoint before the mission goes on: the camera follows, the vehicle goes its way."""
    tale = followed("takeoff,go,go,go,home")
    for words in ("order f follow p1 by=bravo", "planned rev=b items=takeoff,go,go,go,go,home", "uploaded", "at 3"):
        tale.tell(words)
    for words in ("mode mission", "at 4"):
        tale.tell(words)
        check_equal((words, tale.flight.state.missions[1].state), (words, "flying"))


def test_the_plan_is_not_the_vehicles_before_it_holds_it() -> None:
    """A second waypoint, of which the plan is known and not uploaded: nothing is waited at, though one was before."""
    tale = followed("takeoff,go,go,go,go,home")
    first = (
        "order f follow p1 by=bravo",
        "planned rev=b items=takeoff,go,go,go,go,go,home",
        "uploaded",
        "mode mission",
    )
    for words in (
        *first,
        "at 3 reached=2",
        "order t turn by=bravo",
        "mode mission",
        "at 3",
        "order g follow p1 by=bravo",
    ):
        tale.tell(words)
    check_equal(tale.flight.state.missions[1].middle_item, 3)
    for words in (
        "at 3",
        "order p pause",
        "mode loiter",
        "planned rev=c items=takeoff,go,go,go,go,go,go,home",
        "mode mission",
    ):
        tale.tell(words)
    for words, state in (("at 3", "flying"), ("at 4 reached=3", "flying"), ("mode mission", "uploading")):
        tale.tell(words)
        check_equal((words, tale.flight.state.missions[1].state), (words, state))
    for words, state in (
        ("uploaded", "engaging"),
        ("mode mission", "flying"),
        ("at 3", "flying"),
        ("at 4", "following"),
    ):
        tale.tell(words)
        check_equal((words, tale.flight.state.missions[1].state), (words, state))


def test_a_vehicle_that_is_before_the_waypoint_goes_on_where_it_is() -> None:
    """Nothing of the mission is left out on the way to it."""
    tale = followed()
    for words in ("order f follow p1 by=bravo", "at 1", "planned rev=b items=takeoff,go,go,go,home"):
        tale.tell(words)
    check_equal(seen(tale, "mission", tale.tell("uploaded"))["say"], "item 1; go mission")


def test_what_the_office_said_to_an_older_question_is_not_about_this_one() -> None:
    """The waypoint that was asked for last is still to come."""
    tale = followed()
    tale.tell("order f follow p1 by=bravo")
    for seq, left in ((3, 2), (flying.newest(tale.flight.records, "post_waypoint"), -1)):
        tale.flight.tell(WaypointPosted(effect_seq=seq, failure="too late"))
        check_equal(tale.flight.state.missions[1].middle_item, left)


def test_an_answer_to_another_effect_refuses_nothing() -> None:
    """The item was refused, the mode was not answered: that is what is said of the step."""
    tale = story(AIR)
    for words in ("order p pause", "mode loiter", "order r resume"):
        tale.tell(words)
    tale.flight.tell(flights.answered(flying.newest(tale.flight.records, "set_mission_item"), 3))
    tale.at((tale.flight.due or 0) // 1_000_000)
    check_equal(seen(tale, "mission", tale.tell("time"))["why"], "nothing came of it: tried again")


def test_it_is_waited_once_at_a_waypoint() -> None:
    """Whoever resumes a mission that was paused there lets it go on behind it, though the camera follows on."""
    tale = followed("takeoff,go,go,go,home")
    for words in ("order f follow p1 by=bravo", "planned rev=b items=takeoff,go,go,go,go,home", "uploaded"):
        tale.tell(words)
    for words in ("mode mission", "at 3 reached=2", "mode loiter", "order p pause", "order r resume", "mode mission"):
        tale.tell(words)
    for words in ("at 3 reached=2", "at 4"):
        tale.tell(words)
        check_equal((words, tale.flight.state.missions[1].state), (words, "flying"))
    check_equal([one.state for one in tale.flight.state.scans.values()], ["following"])


@pytest.mark.parametrize(("told", "left"), [("", -1), ("posted", -1), ("planned rev=b", 2)])
def test_a_start_waits_for_no_waypoint_that_was_asked_for_before(told: str, left: int) -> None:
    """Who asked the office died with the process; a waypoint that came is kept. Another may be asked for later."""
    tale = followed()
    for words in ("order f follow p1 by=bravo", told, "start"):
        if words:
            tale.tell(words)
    check_equal(tale.flight.state.missions[1].middle_item, left)


def test_following_without_a_waypoint() -> None:
    """The office refuses, or nobody wants one: the camera follows and the vehicle goes its way."""
    tale = check_chart(
        "mission",
        """
        at_s | observe                    | state    | say                   | why
        10   | order f follow p1 by=bravo | 1 flying | post before 2 at 30 m | asks for a waypoint at what is followed
        11   | posted no such mission     | -        | -                     | -
        12   | at 3 reached=2             | 1 returning | -                  | the mission is on its way home
        13   | order t turn by=bravo      | -        | -                     | -
        """,
        followed(),
    )
    check_equal(tale.flight.state.missions[1].middle_item, -1)
    tale = followed()
    tale.flight.state.flight.limits.follow_by_waypoint = False
    check_chart(
        "mission",
        """
        at_s | observe                    | state | say | why
        10   | order f follow p1 by=bravo | -     | -   | -
        """,
        tale,
    )


@pytest.mark.parametrize(
    ("words", "state", "say"),
    [
        ("order p pause", "1 paused", "go loiter"),
        ("order x abort", "1 aborting", "go return"),
        ("mode return", "1 returning", "-"),
        ("disarmed", "1 landed", "-"),
        ("mode loiter", "-", "-"),
    ],
)
def test_while_it_waits_at_what_is_followed(words: str, state: str, say: str) -> None:
    """Whatever comes there ends it as in the mission itself."""
    tale = followed()
    for told in ("order f follow p1 by=bravo", "planned rev=b items=takeoff,go,go,go,home", "uploaded"):
        tale.tell(told)
    for told in ("mode mission", "at 3 reached=2", "mode mission"):
        tale.tell(told)
    found = seen(tale, "mission", tale.tell(words))
    check_equal((found["state"], found["say"]), (state, say))
