"""The chart `mission` where others have a say: a silent vehicle, failsafes, whoever takes the vehicle, another plan."""

from __future__ import annotations

from typing import Any

import pytest

from statecharts.charts.mission import MAY_BEGIN, MAY_PAUSE, MAY_RESUME, OVER, STATES
from tests.checks import check_chart, check_equal, seen
from tests.statecharts.charts.test_mission import AIR, GROUND, story
from tests.statecharts.charts.test_mission_following import followed


@pytest.mark.parametrize(
    ("before", "words", "state"),
    [
        ("uploaded", "did-not", "-"),
        ("uploaded", "did 4", "-"),
        ("uploaded", "mode guided disarmed=1", "1 arming"),
        ("uploaded", "order x abort", "1 aborted"),
        ("vehicle up", "not-uploaded", "-"),
        ("vehicle up", "uploaded", "1 readying"),
    ],
)
def test_nothing_is_asked_of_a_silent_vehicle(before: str, words: str, state: str) -> None:
    """Whatever happens then; nothing is waited for, and what is due is asked as soon as it is heard."""
    tale = story(GROUND)
    for line in (before, "vehicle down"):
        tale.tell(line)
    found = seen(tale, "mission", tale.tell(words))
    check_equal((found["state"], found["say"], tale.flight.state.waiting("mission")), (state, "-", ()))
    asks = {"readying": "go guided", "arming": "arm", "uploading": "upload 4", "aborted": "-"}
    now = tale.flight.state.missions[1].state
    check_equal(seen(tale, "mission", tale.tell("vehicle up"))["say"], asks[now])


def test_an_aborted_flight_on_a_link_that_comes_and_goes() -> None:
    """The return is asked when the vehicle is heard, unless it complied when it was last heard."""
    check_chart(
        "mission",
        """
        at_s | observe       | state      | say       | why
        8    | vehicle down  | -          | -         | -
        9    | order x abort | 1 aborting | -         | an operator aborts it
        60   | vehicle up    | 1 aborting | go return | the vehicle is heard again: asked anew
        61   | mode return   | -          | -         | -
        62   | vehicle down  | -          | -         | -
        63   | vehicle up    | -          | -         | -
        64   | mode loiter   | -          | -         | -
        74   | time          | 1 aborting | go return | it does not comply: asked again
        """,
        story(AIR),
    )


def test_a_flight_is_over_also_where_the_vehicle_falls_silent() -> None:
    """Once it is down nothing is asked of it, so nothing waits for it."""
    check_chart(
        "mission",
        """
        at_s | observe      | state     | say            | why
        8    | disarmed     | 1 landed  | -              | disarmed
        9    | vehicle down | -         | -              | -
        10   | start        | -         | -              | -
        18   | time         | 1 syncing | push m in 60 s | over: what was seen goes to the mission office
        """,
        story(AIR),
    )


def test_pausing_and_resuming_need_a_vehicle_that_is_heard() -> None:
    """Else a wish would wait for a vehicle that somebody has taken meanwhile; a mission without a plan needs none."""
    tale = story(AIR)
    for line in ("vehicle down", "order p pause"):
        tale.tell(line)
    check_equal(tale.flight.state.orders["alpha/p"].detail, "no vehicle is heard")
    check_equal(tale.flight.state.missions[1].state, "flying")


def test_a_mission_that_a_pilot_flies_is_not_stopped_by_a_pause_that_is_not_about_it() -> None:
    """He flies what is in the vehicle, while the node is busy with a mission that never flew."""
    check_chart(
        "mission",
        """
        at_s | observe      | state    | say | why
        5    | mode mission | -        | -   | -
        6    | uploaded     | 1 paused | -   | armed already: somebody has it
        30   | at 1         | -        | -   | -
        """,
        story(GROUND),
    )
    check_chart(
        "mission",
        """
        at_s | observe       | state    | say | why
        5    | mode mission  | -        | -   | -
        6    | order p pause | 1 paused | -   | an operator pauses it
        30   | at 1          | -        | -   | -
        """,
        story(GROUND),
    )
    check_chart(
        "mission",
        """
        at_s | observe           | state    | say | why
        0    | mode mission       | -        | -   | -
        1    | no-mission final=1 | 1 paused | -  | no mission can be had
        """,
        story(),
    )


def test_a_mission_is_not_begun_with_a_vehicle_that_somebody_else_has() -> None:
    """Armed before it began: the order is refused, what begins by itself waits, and an upload ends paused."""
    tale = story(GROUND.replace("2    | order a begin | 1 uploading | upload 4 | a person lets it begin", "").rstrip())
    tale.tell("armed")
    tale.tell("order a begin")
    check_equal(tale.flight.state.orders["alpha/a"].detail, "the vehicle is armed: somebody has it")
    check_chart(
        "mission",
        """
        at_s | observe       | state       | say      | why
        0    | armed         | -           | -        | -
        1    | planned       | 1 selftest  | -        | planned
        2    | report pass   | 1 ready     | -        | fit to fly: waits for an order
        3    | disarmed      | -           | -        | -
        4    | order a begin | 1 uploading | upload 4 | a person lets it begin
        5    | armed         | -           | -        | -
        6    | uploaded      | 1 paused    | -        | armed already: somebody has it
        7    | order r resume | 1 ready    | -        | an operator lets it go on: waits for an order
        8    | disarmed      | -           | -        | -
        9    | order b begin | 1 uploading | upload 4 | a person lets it begin
        """,
        story(mission_begun_by_order=False),
    )


def test_what_is_resumed_was_begun_by_somebody() -> None:
    """A mission that was paused before anybody began it waits for that order still."""
    check_chart(
        "mission",
        """
        at_s | observe            | state       | say   | why
        0    | no-mission final=1 | 1 paused    | -     | no mission can be had
        1    | planned            | -           | -     | -
        2    | report pass        | -           | -     | -
        3    | order r resume     | 1 ready     | -     | an operator lets it go on: waits for an order
        4    | order b begin      | 1 uploading | upload 4 | a person lets it begin
        """,
        story(),
    )


def test_a_failsafe_comes_first() -> None:
    """While one has the vehicle the mission asks for nothing, is neither paused nor resumed, and follows it home."""
    tale = check_chart(
        "mission",
        """
        at_s | observe        | state       | say       | why
        3    | uploaded       | 1 readying  | go guided | the vehicle has the plan, read back
        4    | did 0          | 1 arming    | arm       | the vehicle holds
        4    | battery 20     | -           | -         | -
        5    | armed          | 1 engaging, 1 returning | return: battery at 20 % | a failsafe sends the vehicle home
        6    | order p pause  | -           | -         | -
        7    | mode return    | -           | -         | -
        """,
        story(GROUND, battery_return_percent=25, failsafe_again_ms=5_000, override_longest_ms=60_000),
    )
    check_equal(tale.flight.state.orders["alpha/p"].detail, "a failsafe has the vehicle: it must be held off first")
    tale.tell("order o override battery for=60 roles=flight")
    check_chart(
        "mission",
        """
        at_s | observe        | state    | say | why
        7    | time           | -           | -         | -
        7    | order q pause  | 1 paused    | go loiter | an operator pauses it
        """,
        tale,
    )


def test_the_vehicle_flies_the_newest_plan() -> None:
    """One that changes before the arming goes up again first; one in the air, when the vehicle flies the mission."""
    check_chart(
        "mission",
        """
        at_s | observe        | state       | say                | why
        3    | planned rev=b items=takeoff,go,home | 1 uploading | upload 3 | the plan has changed
        4    | uploaded 1     | -           | -                  | -
        5    | uploaded       | 1 readying  | go guided          | the vehicle has the plan, read back
        6    | planned rev=c  | 1 uploading | upload 4           | the plan has changed
        7    | uploaded       | 1 readying  | go guided          | the vehicle has the plan, read back
        8    | did 0          | 1 arming    | arm                | the vehicle holds
        9    | planned rev=d  | 1 uploading | upload 4           | the plan has changed
        """,
        story(GROUND),
    )
    check_chart(
        "mission",
        """
        at_s | observe        | state       | say                | why
        8    | order p pause  | 1 paused    | go loiter          | an operator pauses it
        9    | planned rev=b  | -           | -                  | -
        10   | mode loiter    | -           | -                  | -
        11   | order r resume | 1 uploading | upload 4           | an operator lets it go on by the changed plan
        12   | mode loiter    | -           | -                  | -
        13   | uploaded       | 1 engaging  | item 0; go mission | the vehicle has the plan, in the air
        14   | planned rev=c  | -           | -                  | -
        15   | mode mission   | 1 flying    | -                  | goes on with the mission
        16   | mode mission   | 1 uploading | upload 4           | the plan has changed meanwhile
        17   | mode loiter    | 1 paused    | -                  | somebody took the vehicle out of the mission
        """,
        story(AIR),
    )


def test_a_plan_that_changes_while_something_is_followed() -> None:
    """It goes up when the following is over; whoever takes the vehicle meanwhile has it."""
    for words, expected in (
        ("order t turn by=bravo", ("1 uploading", "upload 4")),
        ("mode guided", ("1 paused", "-")),
        ("mode none", ("1 paused", "-")),
    ):
        tale = followed()
        for told in ("order f follow p1 by=bravo", "planned rev=b items=takeoff,go,go,go,home", "uploaded"):
            tale.tell(told)
        for told in ("mode mission", "at 3 reached=2", "mode loiter", "planned rev=c"):
            tale.tell(told)
        found = seen(tale, "mission", tale.tell(words))
        check_equal((words, found["state"], found["say"]), (words, *expected))


@pytest.mark.parametrize(
    ("words", "state", "why"),
    [
        ("mode loiter", "1 paused", "somebody took the vehicle out of the mission"),
        ("mode return", "1 returning", "the vehicle goes home by itself"),
        ("disarmed", "1 paused", "disarmed before it began"),
        ("mode mission", "-", "-"),
    ],
)
def test_whoever_takes_it_before_it_has_begun_has_it(words: str, state: str, why: str) -> None:
    """From when the vehicle was in the mission's mode; nothing is commanded against it."""
    check_chart(
        "mission",
        f"""
        at_s | observe | state | say | why
        7    | {words} | {state} | - | {why}
        """,
        story(AIR[: AIR.index("    7    | did 0")]),
    )


@pytest.mark.parametrize("verb", ["begin", "pause", "resume", "abort"])
def test_what_may_be_asked_and_when(verb: str) -> None:
    """Elsewhere the order is refused with a reason, and the mission does not move."""
    may = {"begin": MAY_BEGIN, "pause": MAY_PAUSE, "resume": MAY_RESUME}.get(verb)
    for state in STATES:
        tale = story()
        tale.tell("planned")
        tale.flight.state.missions.put(1, tale.flight.state.missions[1]._replace(state=state))
        tale.tell(f"order a {verb}")
        answer = tale.flight.state.orders["alpha/a"]
        allowed = state in may if may is not None else state not in OVER
        expected = ("accepted", "recorded") if allowed else ("rejected", "the mission is not at that")
        check_equal((state, answer.state, answer.detail), (state, *expected))


def test_who_may_order_it() -> None:
    """A role of the flight; a camera's is not enough; and a node that flies no missions says so."""
    cases: tuple[tuple[dict[str, Any], str, str], ...] = (
        ({}, "order a begin roles=camera", "unauthorised"),
        ({}, "order a begin", "accepted"),
        ({"mission_enabled": False}, "order a begin", "unsupported"),
        ({"flight_enabled": False}, "order a begin", "accepted"),
        ({"flight_enabled": False, "mission_enabled": False}, "order a fly", "unsupported"),
    )
    for changes, words, expected in cases:
        tale = story(**changes)
        tale.tell(words)
        check_equal(tale.flight.state.orders["alpha/a"].state, expected)


def test_a_pause_that_was_not_heard() -> None:
    """The vehicle is asked again until it says that it does something else; a silent one is not."""
    check_chart(
        "mission",
        """
        at_s | observe       | state    | say       | why
        9    | order p pause | 1 paused | go loiter | an operator pauses it
        10   | did-not       | -        | -         | -
        19   | time          | 1 paused | go loiter | it does not hold: asked again
        29   | time          | 1 paused | go loiter | it does not hold: asked again
        30   | mode loiter   | -        | -         | -
        """,
        story(AIR),
    )
    check_chart(
        "mission",
        """
        at_s | observe       | state    | say       | why
        9    | order p pause | 1 paused | go loiter | an operator pauses it
        10   | vehicle down  | -        | -         | -
        60   | vehicle up    | -        | -         | -
        """,
        story(AIR),
    )
