"""The alarms about a mission's patience are tested: each is shown a mission that must not be, and what may be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import NodeStarted, StepFailed
from events.schema.mission_pb2 import MissionPlanned, MissionUploaded, UploadMission
from events.schema.vehicle_pb2 import VehicleLinkChanged, VehicleStateReported
from statecharts.monitors import Watch
from tests import flying
from tests.checks import check_equal
from tests.monitors import complaints
from tests.statecharts.charts.test_mission import AIR, GROUND, story
from tests.statecharts.charts.test_mission_following import followed
from tests.statecharts.test_monitors import Flight, changed, cut, limit, other, steps, where
from tests.stories import Story

NAMES = {"tries_take_their_time", "a_pause_is_kept", "waits_at_its_waypoint"}


def told(tale: Story, *lines: str) -> Story:
    """Tell a story on, a second a line; `time` at the moment that the core asked for."""
    for words in lines:
        due_ns = tale.flight.due
        tale.at(due_ns // 1_000_000 if words == "time" and due_ns else tale.flight.now_ns // 1_000_000 + 1_000)
        tale.tell(words)
    return tale


def named(flight: Flight) -> set[str]:
    """Return which of the three properties a flight breaks."""
    return {complaint.split(":")[0] for complaint in complaints(flight)} & NAMES


def at_once(flight: Flight) -> None:
    """Let the last step, a second try, come a second after the first."""
    first = flight[-2][0].at
    flight[-1][:] = [replace(one, at=first._replace(flight_ns=first.flight_ns + 1)) for one in flight[-1]]


REFUSED = ("uploaded", "did 4", "time")


@pytest.mark.parametrize(
    ("lines", "change", "expected"),
    [
        (REFUSED, lambda flight: None, set()),
        (REFUSED, at_once, {"tries_take_their_time"}),
        (REFUSED, limit(mission_step_ms=10_001), {"tries_take_their_time"}),
        (("not-uploaded", "time"), limit(mission_step_ms=10_001), set()),
        (("not-uploaded", "time"), limit(mission_step_ms=11_001), {"tries_take_their_time"}),
        (("uploaded", "vehicle down", "vehicle up"), lambda flight: None, set()),
        (("planned rev=b",), lambda flight: None, set()),
        (("uploaded", "did 4"), lambda flight: None, set()),
    ],
)
def test_a_try_takes_its_time(lines: tuple[str, ...], change: Callable[[Flight], None], expected: set[str]) -> None:
    """Unless the vehicle is heard again, or another plan has come."""
    flight = steps(told(story(GROUND), *lines).flight.records)
    change(flight)
    check_equal((lines, named(flight)), (lines, expected))


def undone(*targets: str) -> Callable[[Flight], None]:
    """Let the mission leave its pause in the last step."""

    def change(flight: Flight) -> None:
        before = "paused"
        for target in targets:
            move = Moved(chart="mission", instance="1", from_state=before, to_state=target)
            flight[-1].append(changed(flight[-1][0], move))
            before = target

    return change


STOPPED = ("mode return", "order p pause")
AGAIN = ("time", "time")


@pytest.mark.parametrize(
    ("lines", "targets", "expected"),
    [
        ((*STOPPED, "mode return"), ("returning",), {"a_pause_is_kept"}),
        ((*STOPPED, "mode return"), ("flying",), {"a_pause_is_kept"}),
        ((*STOPPED, "mode return"), ("engaging",), set()),
        ((*STOPPED, "mode loiter"), ("returning",), set()),
        ((*STOPPED, "vehicle down"), ("returning",), set()),
        ((*STOPPED, "start"), ("returning",), set()),
        ((*STOPPED, "time"), ("returning",), {"a_pause_is_kept"}),
        ((*STOPPED, *AGAIN), ("returning",), set()),
        ((*STOPPED, *AGAIN), ("flying",), {"a_pause_is_kept"}),
        ((*STOPPED, "battery 20"), ("returning",), set()),
        ((*STOPPED, "battery 20"), ("flying",), {"a_pause_is_kept"}),
        ((*STOPPED, "battery 20", "battery 90"), ("returning",), {"a_pause_is_kept"}),
        (("order p pause", "at 2"), ("flying",), {"a_pause_is_kept"}),
        (("mode loiter", "at 2"), ("flying",), set()),
        (("mode land", "order p pause"), ("returning",), set()),
        (("order p pause", "mode mission"), (), set()),
        ((*STOPPED, "order r resume", "order q pause"), ("returning",), {"a_pause_is_kept"}),
        ((*STOPPED, *AGAIN, "time", "order q pause"), ("returning",), {"a_pause_is_kept"}),
    ],
)
def test_a_pause_is_kept(lines: tuple[str, ...], targets: tuple[str, ...], expected: set[str]) -> None:
    """Until the vehicle was seen in another mode, or not heard, or asked often enough, or a failsafe has it."""
    limits = {"battery_return_percent": 25, "failsafe_again_ms": 5_000}
    flight = steps(told(story(AIR, **limits), *lines).flight.records)
    check_equal(named(flight), set())
    undone(*targets)(flight)
    check_equal((lines, targets, named(flight)), (lines, targets, expected))


def test_a_failed_step_says_nothing() -> None:
    """A report that no chart could take is no word of the vehicle."""
    flight = steps(told(story(AIR), *STOPPED).flight.records)
    report = VehicleStateReported(vehicle=1, armed=True)
    flight.append(
        [changed(flight[-1][0], report), changed(flight[-1][0], StepFailed(chart="evolve", error="KeyError"))]
    )
    flight.append([changed(flight[-1][0], VehicleLinkChanged(vehicle=2))])
    undone("returning")(flight)
    check_equal(named(flight), {"a_pause_is_kept"})


def waiting() -> Flight:
    """Return a flight that waits at what is followed."""
    lines = ("order f follow p1 by=bravo", "planned rev=b items=takeoff,go,go,go,home", "uploaded", "mode mission")
    return steps(told(followed(), *lines, "time", "at 3 reached=2").flight.records)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda flight: None, set()),
        (cut("post_waypoint"), {"waits_at_its_waypoint"}),
        (other("mission_planned", {"effect_seq": 3}, revision="b"), {"waits_at_its_waypoint"}),
    ],
)
def test_it_waits_at_its_waypoint(change: Callable[[Flight], None], expected: set[str]) -> None:
    """The plan that has it came of the asking."""
    flight = waiting()
    change(flight)
    check_equal(named(flight), expected)


def test_it_waits_by_the_plan_that_the_vehicle_holds() -> None:
    """Read back: another upload, or another plan, undoes that."""
    flight = waiting()
    number = next(at for at, step in reversed(list(enumerate(flight))) if step[0].kind.name == "mission_uploaded")
    flight[number][0] = changed(flight[number][0], NodeStarted(boot_id="boot", start=2))
    check_equal(named(flight), {"waits_at_its_waypoint"})
    flight = waiting()
    flight[number][0] = changed(flight[number][0], MissionUploaded(effect_seq=3))
    check_equal(named(flight), {"waits_at_its_waypoint"})
    for undoing in (MissionPlanned(vehicle=1, effect_seq=_posted(flight)), UploadMission(vehicle=1)):
        flight = waiting()
        flight[-1].insert(1, changed(flight[-1][0], undoing))
        check_equal(named(flight), {"waits_at_its_waypoint"})


def test_a_failsafe_of_another_vehicle_is_none_of_this_one() -> None:
    """Each has its own."""
    for vehicle, expected in ((2, {"a_pause_is_kept"}), (1, set())):
        flight = steps(told(story(AIR), *STOPPED).flight.records)
        safety = Moved(chart="safety", instance=f"{vehicle}/battery", from_state="ok", to_state="complying")
        flight[-1].append(changed(flight[-1][0], safety))
        undone("returning")(flight)
        check_equal((vehicle, named(flight)), (vehicle, expected))


def _posted(flight: Flight) -> int:
    number, place = where(flight, "post_waypoint")
    return flight[number][place].seq


def test_a_watch_that_begins_at_a_start_knows_what_it_finds() -> None:
    """Plan, post and upload of before the start; a failsafe that is at work; and a step begun before counts as old."""
    tale = followed()
    lines = ("order f follow p1 by=bravo", "planned rev=b items=takeoff,go,go,go,home", "uploaded", "mode mission")
    for end, expected in ((4, set()), (2, {"waits_at_its_waypoint"}), (1, {"waits_at_its_waypoint"})):
        tale = told(followed(), *lines[:end])
        watch, begun = Watch(tale.flight.state), len(tale.flight.records)
        flight = steps(told(tale, "heard alpha").flight.records[begun:])
        flight[-1].append(changed(flight[-1][0], Moved(chart="mission", instance="1", to_state="following")))
        check_equal((end, {one.name for step in flight for one in watch.see(step)} & NAMES), (end, expected))
    tale = told(followed(), *lines[:2])
    watch, begun = Watch(tale.flight.state), len(tale.flight.records)
    flight = steps(told(tale, *lines[2:], "time", "at 3 reached=2").flight.records[begun:])
    check_equal({one.name for step in flight for one in watch.see(step)} & NAMES, set())
    tale = told(Story(*flying.opening()), "planned", "report pass", "order a begin", "uploaded")
    watch, begun = Watch(tale.flight.state), len(tale.flight.records)
    flight = steps(told(tale, "heard alpha").flight.records[begun:])
    move = Moved(chart="mission", instance="1", from_state="readying", to_state="readying")
    flight[-1].append(changed(flight[-1][0], move))
    check_equal({one.name for step in flight for one in watch.see(step)} & NAMES, set())


def test_a_watch_that_begins_at_a_start_knows_of_failsafes_and_the_mode() -> None:
    """The mode and the motors as they were last told, though a start believes anew what it hears."""
    for percent, expected in ((20, set()), (90, {"a_pause_is_kept"})):
        tale = story(AIR, battery_return_percent=25, failsafe_again_ms=5_000)
        tale = told(tale, "mode return", f"battery {percent}")
        watch, begun = Watch(tale.flight.state), len(tale.flight.records)
        flight = steps(told(tale, "heard alpha").flight.records[begun:])
        flight[-1].append(
            changed(flight[-1][0], Moved(chart="mission", instance="1", from_state="returning", to_state="paused"))
        )
        undone("returning")(flight)
        found = {one.name for step in flight for one in watch.see(step)} & NAMES
        check_equal((percent, found), (percent, expected))
