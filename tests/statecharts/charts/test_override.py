"""Chart `override`, and the order that begins one."""

from __future__ import annotations

import pytest

from events.schema.flight_pb2 import BaselineCarried
from statecharts import carry_over
from tests.checks import check_chart, check_equal
from tests.flights import opened_well
from tests.stories import Story
from tests.stories_of_safety import SAFE_LIMITS


def flight(**changes: object) -> Story:
    """Return a flight in which failsafes may be held off."""
    return Story(**SAFE_LIMITS | changes)


def test_the_life_of_an_override() -> None:
    """It begins with a name and a reason, gives way to a later one, and ends by itself."""
    check_chart(
        "override",
        """
at_s | observe | state | say
0 | order a override battery for=2 because=x | 1/battery_return holding | ALPHA holds battery 2 s: x
1 | order b override battery for=9 by=bravo | 1/battery_return holding | battery: replaced; BRAVO holds battery 9 s: why
2 | order c override link for=3 | 1/link_return holding | ALPHA holds link 3 s: why
4 | again a | - | -
5 | time | 1/link_return idle | link: its time is over
10 | time | 1/battery_return idle | battery: its time is over
11 | again a | - | -
        """,
        flight(operator_lost_ms=0),
    )


def test_an_unknown_outage_ends_it() -> None:
    """A known one does not."""
    check_chart(
        "override",
        """
        at_s | observe | state | say
        0 | order a override fence | 1/fence_return holding | ALPHA holds fence 60 s: why
        1 | start | - | -
        2 | start no clock | 1/fence_return idle | fence: off for an unknown time
        3 | start no clock | - | -
        """,
        flight(operator_lost_ms=0),
    )


@pytest.mark.parametrize(
    ("words", "changes", "answer", "why"),
    [
        ("battery", {}, "a accepted", "held off"),
        ("battery for=600", {}, "a accepted", "held off"),
        ("battery for=600.001", {}, "a rejected", "held for no time, or for longer than allowed"),
        ("battery for=0", {}, "a rejected", "held for no time, or for longer than allowed"),
        ("battery because=", {}, "a rejected", "a reason is needed"),
        ("landing", {}, "a unsupported", "nothing that can be held off"),
        ("battery roles=camera", {}, "a unauthorised", "role not permitted"),
        ("battery", {"flight_roles": []}, "a unauthorised", "role not permitted"),
        ("battery", {"flight_enabled": False}, "a unsupported", "this node commands no failsafes"),
        ("battery", {"flight_enabled": False, "mission_enabled": True}, "a accepted", "held off"),
        ("battery overdue=3600001", {}, "a unauthorised", "revocation stale"),
        ("battery life=0", {}, "a rejected", "expired"),
    ],
)
def test_who_may_hold_off_what(words: str, changes: dict[str, object], answer: str, why: str) -> None:
    """A role of the flight, with a reason, for no longer than anybody may; and what is refused begins nothing."""
    story = flight(**changes)
    table = f"at_s | observe | say | why\n0 | order a override {words} | {answer} | {why}"
    check_chart("command", table, story)
    check_equal(len(story.flight.state.overrides), int(answer == "a accepted"))


def test_no_vehicle_is_needed() -> None:
    """It is a word to this node."""
    story = flight()
    story.tell("vehicle down")
    check_chart("command", "at_s | observe | say\n0 | order a override link | a accepted", story)


def test_the_next_flight_knows_it() -> None:
    """With what is left of it, and the fences; the link and what was commanded begin anew."""
    story = flight()
    story.tell("fence in=0,0,9,9 out=1,1,2,2")
    story.tell("order a override battery for=10 because=x")
    story.tell("battery 10")
    old = story.flight.state
    carried = carry_over(old, 4_000_500_000)
    manifest, *_rest = opened_well(old.flight.limits)
    new = Story(manifest, BaselineCarried(state=carried)).flight
    check_equal(dict(new.state.fences.items()), dict(old.fences.items()))
    before, after = old.overrides[1, 1], new.state.overrides[1, 1]
    check_equal(after, before._replace(until_ns=5_999_000_000))
    check_equal(new.state.deadlines.get(("override", "1/battery_return")), 5_999_000_000)
    check_equal((len(new.state.links), len(new.state.failsafes)), (0, 0))
    check_equal([len(carry_over(old, now_ns).overrides) for now_ns in (9_999_000_000, 9_999_000_001)], [1, 0])
