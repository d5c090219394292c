"""The alarms of the mission are tested: each monitor is shown a mission that must not be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from events.schema.flight_pb2 import StepFailed
from events.schema.mission_pb2 import ArmVehicle, SetMissionItem, StartMission
from events.schema.safety_pb2 import FLIGHT_MODE_LOITER, SetVehicleMode
from statecharts.monitors import Watch
from tests import flying
from tests.checks import check_equal
from tests.monitors import complaints
from tests.statecharts.test_monitors import Flight, changed, cut, limit, other, steps, where
from tests.stories import Story

TOLD = (
    *("planned", "report pass", "order a begin", "uploaded", "did 0", "armed", "mode mission", "did 0", "at 1"),
    *("mode loiter", "at 2"),
)


def flown(*told: str) -> Story:
    """Return a flight whose mission is begun by order, flown, and taken by somebody."""
    story = Story(*flying.opening())
    for words in told or TOLD:
        story.tell(words)
    return story


def last(flight: Flight, message: object) -> None:
    """Put an effect behind the last record of a flight."""
    flight[-1].append(changed(flight[-1][0], message))  # type: ignore[arg-type]


def commanded(*messages: object) -> Callable[[Flight], None]:
    """Let a vehicle that somebody took be commanded by the mission."""

    def change(flight: Flight) -> None:
        number, place = where(flight, "moved", chart="mission", to_state="paused")
        for message in messages:
            flight[number].insert(place + 1, changed(flight[number][0], message))  # type: ignore[arg-type]

    return change


def planned_late(flight: Flight) -> None:
    """Let another plan have come just before the arming, which nobody uploaded."""
    number, _ = where(flight, "arm_vehicle")
    plan = flight[where(flight, "mission_planned")[0]][0]
    flight.insert(number, [replace(plan, seq=flight[number][0].seq)])


def uploaded_before(flight: Flight) -> None:
    """Let the upload that was read back be one of before the plan."""
    for kind in ("upload_mission", "mission_uploaded"):
        number, place = where(flight, kind)
        record = flight[number][place]
        if kind == "upload_mission":
            flight[number][place] = replace(record, seq=1)
        else:
            message = type(record.message)()
            message.CopyFrom(record.message)
            message.effect_seq = 1  # type: ignore[attr-defined]
            flight[number][place] = changed(record, message)


def fetched_only(flight: Flight) -> None:
    """Let a node that flies none have fetched a mission."""
    limit(mission_enabled=False)(flight)
    del flight[where(flight, "mission_planned")[0] :]


def uploaded_again(flight: Flight) -> None:
    """Let another upload have begun before the arming, of which no end is known."""
    number, place = where(flight, "upload_mission")
    again = flight[number][place]
    first = flight[where(flight, "arm_vehicle")[0]]
    first.insert(1, replace(again, seq=first[0].seq))


@pytest.mark.parametrize(
    ("monitor", "change"),
    [
        ("mission_is_off", limit(mission_enabled=False)),
        ("mission_is_off", fetched_only),
        ("checked_before_arming", uploaded_again),
        ("checked_before_arming", cut("mission_uploaded")),
        ("checked_before_arming", other("mission_uploaded", {"effect_seq": 2})),
        ("checked_before_arming", planned_late),
        ("checked_before_arming", uploaded_before),
        ("checked_before_arming", cut("moved", chart="selftest", to_state="passed")),
        ("checked_before_arming", other("moved", {"to_state": "failed"}, chart="selftest", to_state="passed")),
        ("begun_by_order", cut("order_received")),
        ("begun_by_order", other("moved", {"to_state": "rejected"}, chart="command", to_state="accepted")),
        ("taken_is_left_alone", commanded(SetVehicleMode(vehicle=1, mode=FLIGHT_MODE_LOITER))),
        ("taken_is_left_alone", commanded(StartMission(vehicle=1))),
        ("taken_is_left_alone", commanded(SetMissionItem(vehicle=1))),
        ("taken_is_left_alone", commanded(ArmVehicle(vehicle=1))),
    ],
)
def test_a_monitor_of_the_mission_speaks_up(monitor: str, change: Callable[[Flight], None]) -> None:
    """One thing in the flight is not as it must be, and its monitor says so."""
    flight = steps(flown().flight.records)
    check_equal(complaints(flight), [])
    change(flight)
    found = {complaint.split(":")[0] for complaint in complaints(flight)}
    check_equal((monitor, monitor in found), (monitor, True))


@pytest.mark.parametrize(
    ("told", "effect", "expected"),
    [
        ("mode mission|order p pause", SetMissionItem(vehicle=1), set()),
        ("order b abort", ArmVehicle(vehicle=1), set()),
        ("order b abort|disarmed", ArmVehicle(vehicle=1), {"begun_by_order"}),
        ("mode mission", SetMissionItem(vehicle=1), set()),
        ("order p resume", SetMissionItem(vehicle=1), set()),
        ("at 3", SetMissionItem(vehicle=1), {"taken_is_left_alone"}),
    ],
)
def test_how_long_a_word_counts(told: str, effect: object, expected: set[str]) -> None:
    """An order to begin counts until the mission is over; a vehicle is somebody's until it flies the mission again."""
    story = flown()
    for words in told.split("|"):
        story.tell(words)
    flight = steps(story.flight.records)
    last(flight, effect)
    found = {complaint.split(":")[0] for complaint in complaints(flight)}
    check_equal((told, found & {"begun_by_order", "taken_is_left_alone", "checked_before_arming"}), (told, expected))


def test_another_word_of_a_person_is_no_order_to_begin() -> None:
    """Nor is a word on the self-test."""
    story = flown("planned", "report pass,degraded")
    story.tell(f"order a acknowledge {story.flight.state.selftests[1].effect_seq}")
    check_equal(story.flight.state.orders["alpha/a"].state, "accepted")
    flight = steps(story.flight.records)
    last(flight, ArmVehicle(vehicle=1))
    check_equal("begun_by_order" in {complaint.split(":")[0] for complaint in complaints(flight)}, True)


def test_where_no_order_is_needed_none_is_missed() -> None:
    """A mission that begins by itself."""
    story = Story(*flying.opening(mission_begun_by_order=False))
    for words in ("planned", "report pass", *TOLD[3:]):
        story.tell(words)
    check_equal(complaints(steps(story.flight.records)), [])


def test_a_failsafe_and_an_order_command_whom_they_like() -> None:
    """What somebody took is left alone by the mission only."""
    flight = steps(flown().flight.records)
    number, place = where(flight, "moved", chart="mission", to_state="paused")
    ordered = SetVehicleMode(vehicle=1, mode=FLIGHT_MODE_LOITER, order="alpha/z")
    flight[number].insert(place + 1, changed(flight[number][0], ordered))
    move = type(flight[number][place].message)()
    move.CopyFrom(flight[number][place].message)
    move.chart, move.instance = "safety", "1/battery"  # type: ignore[attr-defined]
    flight[-1] += [changed(flight[-1][0], one) for one in (move, SetVehicleMode(vehicle=1))]
    names = {complaint.split(":")[0] for complaint in complaints(flight)}
    check_equal("taken_is_left_alone" in names, False)


def test_a_watch_that_begins_at_a_start_knows_how_far_the_mission_is() -> None:
    """Plan, upload and self-test of before the start count, an order to begin does not; what is not there is missed."""
    missed = {"begun_by_order"}
    for told, expected in ((TOLD[:4], missed), (TOLD[:3], missed | {"checked_before_arming"}), (TOLD[:2], missed)):
        story = flown(*told, "start")
        watch, begun = Watch(story.flight.state), len(story.flight.records)
        story.tell("heard alpha")
        flight = steps(story.flight.records[begun:])
        last(flight, ArmVehicle(vehicle=1))
        found = {breach.name for step in flight for breach in watch.see(step)}
        check_equal((told, found & {"checked_before_arming", "begun_by_order"} >= expected), (told, True))
        check_equal((told, "checked_before_arming" in found), (told, told != TOLD[:4]))


def test_a_plan_that_no_chart_could_take_changes_nothing() -> None:
    """The step failed: the vehicle still holds the newest plan."""
    story = flown(*TOLD[:4])
    plan = steps(story.flight.records)[where(steps(story.flight.records), "mission_planned")[0]][0]
    story.tell("did 0")
    flight = steps(story.flight.records)
    number, _ = where(flight, "arm_vehicle")
    flight.insert(number, [plan, changed(plan, StepFailed(chart="evolve", error="KeyError"))])
    names = {complaint.split(":")[0] for complaint in complaints(flight)}
    check_equal("checked_before_arming" in names, False)
