"""Chart `safety`: what each failsafe demands, when it commands, and when it holds its tongue."""

from __future__ import annotations

import pytest

from events.schema.common_pb2 import Moved
from statecharts.facts import Scan
from tests.checks import check_chart, check_equal
from tests.stories import Story
from tests.stories_of_safety import SAFE_LIMITS

SQUARE = "fence in=-100,-100,100,100"


def flight(*words: str, **changes: object) -> Story:
    """Return an armed flight in which failsafes may command, after these words."""
    story = Story(**SAFE_LIMITS | {"operator_lost_ms": 0} | changes)
    for one in words:
        story.tell(one)
    return story


def watched() -> Story:
    """Return an armed flight whose operators' link is watched."""
    return Story(**SAFE_LIMITS)


def test_battery_sags() -> None:
    """Return at 25 %, again while it does not comply, land at 15 % at once, and nothing above or when it complies."""
    check_chart(
        "safety",
        """
        at_s | observe      | state                | say
        0    | battery 26   | -                    | -
        1    | battery 25   | 1/battery returning  | return: battery at 25 %
        2    | battery 24   | -                    | -
        6    | time         | 1/battery returning  | return: battery at 24 %
        7    | flies return | 1/battery complying  | -
        8    | battery 23   | -                    | -
        20   | battery 16   | -                    | -
        21   | battery 15   | 1/battery landing    | land: battery at 15 %
        26   | time         | 1/battery landing    | land: battery at 15 %
        27   | flies land   | 1/battery complying  | -
        30   | battery -    | -                    | -
        40   | grounded     | 1/battery ok         | -
        41   | battery 3    | -                    | -
        """,
        flight(),
    )


def test_the_landing_need_not_wait_for_a_return() -> None:
    """It is stronger; a return waits for a landing that was commanded a moment ago, and a landing for a landing."""
    check_chart(
        "safety",
        """
        at_s | observe      | state               | say
        0    | battery 25   | 1/battery returning | return: battery at 25 %
        1    | battery 15   | 1/battery landing   | land: battery at 15 %
        2    | battery 16   | -                   | -
        3    | battery 15   | -                   | -
        4    | battery 16   | -                   | -
        6    | time         | 1/battery returning | return: battery at 16 %
        7    | flies guided | -                   | -
        8    | battery 30   | 1/battery settling  | -
        8.9  | battery 20   | 1/battery pending   | -
        11   | time         | 1/battery returning | return: battery at 20 %
        """,
        flight(),
    )


def test_a_person_holds_the_return_off() -> None:
    """Until its time is over, to the step; the landing nobody holds off."""
    check_chart(
        "safety",
        """
        at_s | observe                      | state               | say
        0    | battery 25                   | 1/battery returning | return: battery at 25 %
        1    | order a override battery     | -                   | -
        1    | time                         | 1/battery held_off  | -
        30   | battery 20                   | -                   | -
        61   | time                         | 1/battery returning | return: battery at 20 %
        62   | order b override battery     | -                   | -
        62   | time                         | 1/battery held_off  | -
        70   | battery 15                   | 1/battery landing   | land: battery at 15 %
        71   | order c override battery     | -                   | -
        75   | time                         | 1/battery landing   | land: battery at 15 %
        """,
        flight(),
    )


def test_a_scope_is_one_failsafe() -> None:
    """Who holds the battery's return off holds no other off."""
    for scope, state in (
        ("battery", "1/fence returning"),
        ("link", "1/fence returning"),
        ("fence", "1/fence held_off"),
    ):
        story = flight(SQUARE, f"order a override {scope}")
        check_chart("safety", f"at_s | observe | state\n1 | spot 200,0 | {state}", story)


def test_fence_at_speed_out_of_an_inclusion() -> None:
    """The way over the next 2 s counts: at 20 m/s that is 40 m before the edge."""
    check_chart(
        "safety",
        """
        at_s | observe              | state              | say
        0    | spot 0,0 speed=20,0    | -                  | -
        1    | spot 59.9 speed=20,0   | -                  | -
        1.5  | spot 60,0 speed=20,0   | 1/fence returning  | return: on the way out of an inclusion fence
        2    | spot 75,0 speed=15,0   | -                  | -
        2.5  | flies return         | 1/fence complying  | -
        3    | spot 101,0 speed=5,0   | -                  | -
        5    | spot 80,0 speed=-20,0  | 1/fence ok         | -
        """.replace("spot 59.9 ", "spot 59.9,0 "),
        flight(SQUARE),
    )


def test_fence_at_speed_into_an_exclusion() -> None:
    """Across a corner too, and also when it would be out again at the end of the look ahead."""
    check_chart(
        "safety",
        """
        at_s | observe               | state             | say
        0    | spot 0,-50 speed=20,0   | -                 | -
        1    | spot 29,0 speed=20,0    | -                 | -
        2    | spot 39,0 speed=20,0    | 1/fence returning | return: on the way into an exclusion fence
        3    | spot 75,0 speed=0,0     | -                 | -
        7    | time                  | 1/fence returning | return: inside an exclusion fence
        8    | spot 95,0 speed=0,0     | 1/fence settling  | -
        8.5  | spot 65,-12 speed=10,10 | 1/fence pending   | -
        12   | time                  | 1/fence returning | return: on the way into an exclusion fence
        """,
        flight("fence in=-500,-500,500,500 out=70,-10,80,10"),
    )


def test_fence_by_place_alone() -> None:
    """A place without a speed, and where nothing is looked ahead for."""
    check_chart(
        "safety",
        """
        at_s | observe              | state             | say
        0    | spot 99,0 speed=90,0   | -                 | -
        1    | spot 100,0             | 1/fence returning | return: outside an inclusion fence
        2    | fence in=0,0,500,500 | -                 | -
        3    | fence in=0,-9,500,5  | 1/fence settling  | -
        3.5  | fence out=99,-1,101,1 | 1/fence pending  | -
        4    | fence                | 1/fence settling  | -
        5    | time                 | 1/fence ok        | -
        """,
        flight(SQUARE, fence_ahead_ms=0),
    )


@pytest.mark.parametrize(("gone_s", "states"), [(4, []), (6, []), (31, ["returning"]), (70, ["returning"] * 9)])
def test_the_operators_are_gone(gone_s: int, states: list[str]) -> None:
    """4 and 6 s are nothing to the flight, at 30 s it returns, and goes on commanding what does not comply."""
    story = watched()
    story.tell("heard alpha")
    check_equal(moves(story, gone_s), states)
    story.tell("heard alpha")
    check_equal(
        [story.flight.state.failsafes[key].state for key, _ in story.flight.state.failsafes.items()],
        ["settling"] * (1 if states else 0),
    )


@pytest.mark.parametrize(("gone_s", "states"), [(4, []), (6, []), (31, []), (70, ["returning"] * 3)])
def test_the_operators_are_gone_while_something_is_followed(gone_s: int, states: list[str]) -> None:
    """The return waits for 30 s more."""
    story = watched()
    story.flight.state.scans.put("1/1", Scan(state="following"))
    story.tell("heard alpha")
    check_equal(moves(story, gone_s), states)


def moves(story: Story, until_s: int) -> list[str]:
    """Let time pass; return where the link's failsafe moved."""
    told = [record.message for record in story.flight.wait(until_s * 1000)]
    moved = [one for one in told if isinstance(one, Moved)]
    return [one.to_state for one in moved if (one.chart, one.instance) == ("safety", "1/link")]


def test_the_vehicle_is_not_heard() -> None:
    """Nothing is said to it, whatever holds; when it is heard again, what still holds is commanded."""
    check_chart(
        "safety",
        """
        at_s | observe        | state                  | say
        0    | battery 20     | 1/battery returning    | return: battery at 20 %
        1    | vehicle down   | 1/battery unreachable  | -
        9    | battery 14     | -                      | -
        10   | vehicle up     | 1/battery landing      | land: battery at 14 %
        11   | vehicle down   | 1/battery unreachable  | -
        12   | vehicle up     | 1/battery pending      | -
        15   | time           | 1/battery landing      | land: battery at 14 %
        """,
        flight(),
    )


def test_a_place_from_before_a_silence_is_not_believed() -> None:
    """The vehicle says anew where it is, and that is judged."""
    check_chart(
        "safety",
        """
        at_s | observe        | state             | say
        0    | spot 200,0       | 1/fence returning | return: outside an inclusion fence
        1    | vehicle down   | 1/fence unreachable | -
        10   | vehicle up     | -                 | -
        11   | spot 190,0       | 1/fence returning | return: outside an inclusion fence
        """,
        flight(SQUARE),
    )


def test_a_crash_between_record_and_send() -> None:
    """The command is in the log, and nobody knows whether it left: it is given again, not sooner than its rate."""
    check_chart(
        "safety",
        """
        at_s | observe        | state                  | say
        0    | battery 20     | 1/battery returning    | return: battery at 20 %
        1    | start          | 1/battery unreachable  | -
        2    | vehicle up     | 1/battery pending      | -
        5    | time           | 1/battery returning    | return: battery at 20 %
        6    | start no clock | 1/battery unreachable  | -
        20   | vehicle up     | 1/battery returning    | return: battery at 20 %
        """,
        flight(),
    )


def test_the_landing_is_stronger_than_every_return() -> None:
    """Whoever is outside a fence with an empty battery lands there."""
    check_chart(
        "safety",
        """
        at_s | observe      | state                                   | say
        0    | spot 200,0     | 1/fence returning                       | return: outside an inclusion fence
        1    | battery 15   | 1/fence overruled, 1/battery landing    | land: battery at 15 %
        6    | time         | 1/battery landing                       | land: battery at 15 %
        7    | flies land   | 1/battery complying                     | -
        8    | battery 16   | 1/fence complying                       | -
        """,
        flight(SQUARE),
    )


def test_a_vehicle_that_does_not_comply_is_commanded_for_ever() -> None:
    """Also after it did for a while; and not while it is disarmed."""
    check_chart(
        "safety",
        """
        at_s | observe      | state               | say
        0    | battery 20   | 1/battery returning | return: battery at 20 %
        1    | flies return | 1/battery complying | -
        2    | flies loiter | 1/battery pending   | -
        5    | time         | 1/battery returning | return: battery at 20 %
        6    | flies land   | 1/battery complying | -
        60   | flies guided | 1/battery returning | return: battery at 20 %
        61   | grounded     | 1/battery ok        | -
        62   | flies        | 1/battery returning | return: battery at 20 %
        63   | flies return | 1/battery complying | -
        """,
        flight(),
    )


@pytest.mark.parametrize(
    ("before", "state"),
    [
        (("battery 20",), "1/battery held_off"),
        (("battery 20", "flies return"), "1/battery held_off"),
        (("battery 20", "flies return", "flies loiter"), "1/battery held_off"),
        (("battery 20", "vehicle down"), "1/battery held_off"),
        (("battery 90",), "-"),
        (("battery 20", "battery 90"), "-"),
        (("battery 20", "order z override battery for=9", "time"), "-"),
        (("battery 15",), "-"),
        (("battery 20", "battery 15"), "-"),
        (("battery 15", "flies land"), "-"),
        (("spot 200,0",), "-"),
    ],
)
def test_what_is_held_off_is_looked_at_at_once(before: tuple[str, ...], state: str) -> None:
    """A deadline in the step of the order, where it changes something; what must land is not asked out of its turn."""
    story = flight(SQUARE, *before, "order a override battery")
    check_equal(is_due(story), state != "-")
    moved = [one for one in (record.message for record in story.tell("time")) if isinstance(one, Moved)]
    check_equal([f"{one.instance} {one.to_state}" for one in moved] or ["-"], [state])
    check_equal(is_due(story), False)


def is_due(story: Story) -> bool:
    """Whether the core asks to be called now."""
    return story.flight.due is not None and story.flight.due <= story.flight.now_ns


def test_a_rate_that_nobody_can_follow_is_not_believed() -> None:
    """At most once a second, whatever the manifest says."""
    table = "at_s | observe | state\n0 | battery 20 | 1/battery returning\n1 | time | 1/battery returning"
    check_chart("safety", table, flight(failsafe_again_ms=0))


@pytest.mark.parametrize(
    ("changes", "commands"),
    [
        ({}, 3),
        ({"flight_enabled": False}, 0),
        ({"flight_enabled": False, "mission_enabled": True}, 3),
        ({"battery_return_percent": 0, "battery_land_percent": 0, "operator_lost_ms": 0}, 1),
    ],
)
def test_who_may_not_command_does_not(changes: dict[str, object], commands: int) -> None:
    """Nothing at all where neither flight nor mission is switched on, and nothing that is not configured."""
    story = Story(**SAFE_LIMITS | changes)
    for at_ms, words in (
        (0, SQUARE),
        (0, "spot 200,0"),
        (1, "battery 20"),
        (2, "start no clock"),
        (40_000, "vehicle up"),
    ):
        story.at(at_ms)
        story.tell(words)
    story.tell("spot 200,0")
    said = [record for record in story.flight.records if record.kind.name == "set_vehicle_mode"]
    check_equal(len({one.message.because for one in said}), commands)  # type: ignore[attr-defined]


def test_it_runs_on_in_safe_mode() -> None:
    """A node that no longer trusts itself still returns and lands, and still judges the link."""
    story = watched()
    story.flight.state.health.set("safe_mode")
    story.tell("heard alpha")
    check_equal(moves(story, 31), ["returning"])
    check_chart("safety", "at_s | observe | state\n31 | battery 15 | 1/battery landing, 1/link overruled", story)


def test_a_charge_that_is_not_known() -> None:
    """It stays what it was: a charge does not come back by not being known, and is not none either."""
    check_chart(
        "safety",
        """
        at_s | observe    | state               | say
        0    | battery -  | -                   | -
        1    | battery 20 | 1/battery returning | return: battery at 20 %
        2    | battery -  | -                   | -
        6    | time       | 1/battery returning | return: battery at 20 %
        """,
        flight(),
    )


def test_an_empty_battery_where_nothing_is_configured() -> None:
    """0 means never, also at 0 %."""
    bounds = {"battery_return_percent": 0, "battery_land_percent": 0}
    check_chart("safety", "at_s | observe | state\n0 | battery 0 | -", flight(**bounds))
