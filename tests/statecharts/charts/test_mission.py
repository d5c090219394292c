"""The chart `mission` as tables: from the link to the landing, and everything that can come between."""

from __future__ import annotations

from typing import Any

import pytest

from events.schema.common_pb2 import Moved
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
        109  | time           | 1 syncing   | push m in 60 s | over: what was seen goes to the mission office
        110  | pushed         | 1 done      | -   | what was seen is with the mission office
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
        9    | disarmed | 1 landed  | -              | disarmed
        19   | time     | 1 syncing | push m in 60 s | over: what was seen goes to the mission office
        20   | pushed   | 1 done    | -              | what was seen is with the mission office
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


def test_an_answer_to_another_effect_refuses_nothing() -> None:
    """The item was refused, the mode was not answered: that is what is said of the step."""
    tale = story(AIR)
    for words in ("order p pause", "mode loiter", "order r resume"):
        tale.tell(words)
    tale.flight.tell(flights.answered(flying.newest(tale.flight.records, "set_mission_item"), 3))
    tale.at((tale.flight.due or 0) // 1_000_000)
    check_equal(seen(tale, "mission", tale.tell("time"))["why"], "nothing came of it: tried again")
