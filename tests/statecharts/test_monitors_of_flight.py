"""The alarms of the flight are tested: each monitor is shown a flight in danger that must not be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given, settings
from shapely import Point, Polygon

from events import Record
from events.schema.common_pb2 import Moved
from events.schema.mission_pb2 import ArmVehicle
from events.schema.safety_pb2 import FlyToPlace, SetVehicleMode
from statecharts.monitors import Watch
from statecharts.monitors.failsafes import is_outside, winding
from tests.checks import check_equal
from tests.monitors import complaints
from tests.statecharts.test_geometry import SMALL, polygons, spots
from tests.statecharts.test_monitors import Flight, changed, cut, limit, other, steps, where
from tests.stories import Story
from tests.stories_of_safety import SAFE_LIMITS

TOLD = (
    (0, "fence in=-100,-100,100,100"),
    (0, "order a override fence for=10"),
    (1_000, "spot 200,0"),
    (10_000, "time"),
    (15_000, "time"),
    (16_500, "spot 201,0"),
    (17_000, "flies return"),
    (18_000, "spot 0,0"),
    (20_000, "battery 14"),
    (25_000, "time"),
    (26_500, "spot 0,2"),
    (27_000, "flies land"),
    (40_000, "spot 0,1"),
)


def endangered() -> Story:
    """Return a flight that leaves its fence while that is held off, returns, and lands with an empty battery."""
    story = Story(**SAFE_LIMITS | {"operator_lost_ms": 0})
    for at_ms, words in TOLD:
        story.at(at_ms)
        story.tell(words)
    return story


def without(words: str) -> Callable[[Flight], None]:
    """Let a failsafe never have commanded: the moves and its commands are gone, whatever their numbers."""

    def change(flight: Flight) -> None:
        for step in flight:
            step[1:] = [record for record in step[1:] if not _commands(record, words)]

    return change


def _commands(record: Record, words: str) -> bool:
    message = record.message
    if isinstance(message, Moved):
        return message.chart == "safety" and message.to_state in ("landing", "returning")
    return isinstance(message, SetVehicleMode) and message.because.startswith(words)


def changed_at(record: Record, flight_ns: int) -> Record:
    """Return a record at another time."""
    return replace(record, at=record.at._replace(flight_ns=flight_ns))


def added(message: object, place: int = 1) -> Callable[[Flight], None]:
    """Put an effect into the step in which a place is reported."""

    def change(flight: Flight) -> None:
        number, _ = where(flight, "position_reported")
        flight[number].insert(place, changed(flight[number][0], message))  # type: ignore[arg-type]

    return change


def silent(flight: Flight) -> None:
    """Let the vehicle have been silent all along."""
    number, _ = where(flight, "vehicle_link_changed")
    del flight[number]


def safe_mode(flight: Flight) -> None:
    """Let an order of the flight be served in safe mode."""
    flight[1].append(changed(flight[1][0], Moved(chart="health", instance="node", to_state="safe_mode")))
    added(FlyToPlace(vehicle=1, order="alpha/z"))(flight)


@pytest.mark.parametrize(
    ("monitor", "change"),
    [
        ("flight_is_off", limit(flight_enabled=False)),
        ("silent_vehicle_is_left_alone", silent),
        ("nobody_else_flies", added(ArmVehicle(vehicle=1))),
        ("nobody_else_flies", cut("moved", chart="safety", to_state="returning")),
        ("effects_are_intended", added(FlyToPlace(vehicle=1, order="alpha/z"))),
        ("effects_are_intended", other("set_vehicle_mode", {"order": "alpha/z"})),
        ("safe_mode_is_quiet", safe_mode),
        ("failsafes_command", cut("set_vehicle_mode")),
        ("failsafes_command", other("set_vehicle_mode", {"mode": 5}, mode=4)),
        ("failsafes_wait", limit(failsafe_again_ms=5_001)),
        ("overrides_hold", other("override_begun", {"held_for_ms": 10_001})),
        ("landing_is_stronger", other("moved", {"to_state": "returning"}, chart="safety", to_state="landing")),
        ("lands_when_empty", without("battery")),
        ("returns_at_fence", without("outside")),
    ],
)
def test_a_monitor_of_the_flight_speaks_up(monitor: str, change: Callable[[Flight], None]) -> None:
    """One thing in the flight is not as it must be, and its monitor says so."""
    flight = steps(endangered().flight.records)
    check_equal(complaints(flight), [])
    change(flight)
    found = {complaint.split(":")[0] for complaint in complaints(flight)}
    check_equal(monitor in found, True)


def astray(*told: str, **limits: int) -> Flight:
    """Return a flight with these words at its beginning, or at "SECOND: words", and a look each second, for 68 s."""
    story = Story(**SAFE_LIMITS | limits)
    for second in range(69):
        story.at(1_000 * second)
        timed = (words.rpartition(": ") for words in told)
        for words in [words for at, _, words in timed if int(at or 0) == second] or ["spot 0,0"]:
            story.tell(words)
    return steps(story.flight.records)


@pytest.mark.parametrize(
    ("monitor", "told", "limits", "because"),
    [
        ("returns_when_low", ("battery 25",), {"operator_lost_ms": 0}, "battery"),
        ("returns_unheard", ("heard alpha", "flies mission"), {}, "no operator"),
        ("returns_unheard", ("flies mission",), {}, "no operator"),
        ("returns_unheard", ("heard alpha", "40: grounded", "41: flies mission"), {}, "no operator"),
        ("", ("heard alpha", "9: heard alpha"), {}, ""),
        ("", ("grounded", "40: flies mission"), {}, ""),
        ("", ("battery 26",), {"operator_lost_ms": 0}, ""),
        ("", ("battery 25", "order a override battery for=99"), {"operator_lost_ms": 0}, ""),
        ("", ("battery 25", "flies return"), {"operator_lost_ms": 0}, ""),
        ("", ("battery 25", "flies land"), {"operator_lost_ms": 0}, ""),
        ("", ("battery 25", "grounded"), {"operator_lost_ms": 0}, ""),
        ("", ("battery 0",), {"operator_lost_ms": 0, "battery_return_percent": 0, "battery_land_percent": 0}, ""),
        ("", ("heard alpha",), {"operator_lost_ms": 0}, ""),
        ("", ("heard alpha",), {"operator_lost_following_ms": 33_000}, ""),
        ("", ("heard alpha", "order a override link for=99"), {}, ""),
        ("", ("grounded",), {}, ""),
    ],
)
def test_a_return_that_is_due_and_not_commanded(
    monitor: str, told: tuple[str, ...], limits: dict[str, int], because: str
) -> None:
    """Low charge and silent operators, each by itself; not where it is held off, complied with, or switched off."""
    flight = astray(*told, **limits)
    check_equal(complaints(flight), [])
    without(because)(flight)
    found = {complaint.split(":")[0] for complaint in complaints(flight)}
    check_equal({name for name in found if name.startswith("returns_")}, {monitor} - {""})


def test_a_condition_is_a_breach_when_it_was_overdue_for_long() -> None:
    """After the time that failsafes may wait and a second for a shell that is late, to the nanosecond."""
    for late_ns, expected in ((0, False), (1, True)):
        flight = steps(endangered().flight.records)
        without("")(flight)
        number, _ = where(flight, "battery_reported")
        tail = flight[number + 1]
        when_ns = flight[number][0].at.flight_ns + 6_000_000_000 + late_ns
        flight[number + 1] = [changed_at(tail[0], when_ns)]
        found = [one for one in complaints(flight[: number + 2]) if one.startswith("lands_when_empty")]
        check_equal((late_ns, bool(found)), (late_ns, expected))


def test_a_watch_that_begins_at_a_start_knows_enough() -> None:
    """It takes fences, overrides and charge from the state; the link and places are told anew."""
    story = Story(**SAFE_LIMITS | {"operator_lost_ms": 0})
    for words in ("fence in=-9,-9,9,9", "order a override fence for=10", "battery 14", "start"):
        story.tell(words)
    watch, *others = [Watch(story.flight.state) for _ in range(3)]
    begun = len(story.flight.records)
    told = ((0, "vehicle up"), (1_000, "spot 20,0"), (5_000, "time"), (6_500, "spot 20,1"), (9_000, "battery 30"))
    for at_ms, words in (*told, (10_000, "time")):
        story.at(at_ms)
        story.tell(words)
    flight = steps(story.flight.records[begun:])
    check_equal([breach for step in flight for breach in watch.see(step)], [])
    changes = ((without("battery"), "lands_when_empty"), (without("outside"), "returns_at_fence"))
    for (change, name), other_watch in zip(changes, others, strict=True):
        forged = steps(story.flight.records[begun:])
        change(forged)
        forged.append([changed_at(forged[-1][0], 17_000_000_000)])
        check_equal(name in {breach.name for step in forged for breach in other_watch.see(step)}, True)


def test_a_watch_that_begins_at_a_start_knows_how_long_operators_are_silent() -> None:
    """An outage that is known counts as silence."""
    story = Story(**SAFE_LIMITS)
    for words in ("heard alpha", "start"):
        story.tell(words)
    watch, begun = Watch(story.flight.state), len(story.flight.records)
    for second, words in ((1, "vehicle up"), (61, "spot 0,0"), (68, "spot 0,1")):
        story.at(1_000 * second)
        story.tell(words)
    flight = steps(story.flight.records[begun:])
    without("no operator")(flight)
    check_equal("returns_unheard" in {breach.name for step in flight for breach in watch.see(step)}, True)


def test_a_watch_that_begins_at_a_start_knows_what_is_held_off() -> None:
    """The order came before it; until its time is over nothing is missing."""
    story = Story(**SAFE_LIMITS | {"operator_lost_ms": 0})
    for words in ("fence in=-9,-9,9,9", "order a override fence for=60", "start"):
        story.tell(words)
    watch, begun = Watch(story.flight.state), len(story.flight.records)
    for at_ms, words in ((0, "vehicle up"), (1_000, "spot 20,0"), (30_000, "spot 20,1")):
        story.at(at_ms)
        story.tell(words)
    check_equal([breach for step in steps(story.flight.records[begun:]) for breach in watch.see(step)], [])


@settings(max_examples=150, deadline=None)
@given(polygons(SMALL), spots(SMALL))
def test_the_monitors_see_fences_as_shapely_does(polygon: tuple[tuple[int, int], ...], spot: tuple[int, int]) -> None:
    """Computed otherwise than the charts do, and by a third."""
    shape, point = Polygon(polygon), Point(spot)
    on_it = shape.boundary.intersects(point)
    check_equal(winding(spot, polygon) is None, on_it)
    check_equal(is_outside(spot, [(True, polygon)]), not shape.contains(point))
    check_equal(is_outside(spot, [(False, polygon)]), shape.intersects(point))
    check_equal(is_outside(spot, []), False)
    other = ((-2, -2), (3, -2), (3, 3), (-2, 3))
    check_equal(
        is_outside(spot, [(True, polygon), (True, other)]),
        not (shape.contains(point) and Polygon(other).contains(point)),
    )
