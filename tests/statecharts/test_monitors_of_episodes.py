"""The alarm about failsafes that command too often: what ends an episode for it, and what does not."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import TimePassed
from events.schema.safety_pb2 import FLIGHT_MODE_RETURN, SetVehicleMode
from tests.checks import check_equal
from tests.monitors import complaints
from tests.statecharts.test_monitors import Flight, changed, other, steps
from tests.statecharts.test_monitors_of_flight import changed_at
from tests.stories import Story
from tests.stories_of_safety import SAFE_LIMITS

OBEYED = (
    (0, "spot 200,0"),
    (400, "flies return"),
    (1_000, "spot 0,0"),
    (1_200, "flies mission"),
    (1_300, "spot 200,0"),
)
CALMED = ((0, "spot 200,0"), (500, "spot 0,0"), (1_500, "spot 201,0"))
LOW = ((0, "battery 20"), (500, "battery 30"), (1_500, "start"), (1_600, "vehicle up"), (1_700, "battery 20"))
GROUNDED = ((0, "battery 20"), (100, "grounded"), (200, "flies mission"))


def told(*words: tuple[int, str]) -> Flight:
    """Return a flight with a fence in which these words are told, in milliseconds."""
    story = Story(**SAFE_LIMITS | {"operator_lost_ms": 0})
    story.tell("fence in=-100,-100,100,100")
    for at_ms, one in words:
        story.at(at_ms)
        story.tell(one)
    return steps(story.flight.records)


def number_of(flight: Flight, at_ms: int) -> int:
    """Return the step at this time."""
    return next(number for number, step in enumerate(flight) if step[0].at.flight_ns == at_ms * 1_000_000)


def taken(at_ms: int) -> Callable[[Flight], None]:
    """Let what was reported at this time never have been; what was decided then stays."""

    def change(flight: Flight) -> None:
        number = number_of(flight, at_ms)
        flight[number][0] = changed(flight[number][0], TimePassed())

    return change


def at_another_time(at_ms: int, to_ns: int) -> Callable[[Flight], None]:
    """Let a step have been at another time."""

    def change(flight: Flight) -> None:
        number = number_of(flight, at_ms)
        flight[number] = [changed_at(record, to_ns) for record in flight[number]]

    return change


@pytest.mark.parametrize(
    ("words", "change", "complains"),
    [
        (OBEYED, None, False),
        (OBEYED, taken(400), True),
        (OBEYED, taken(1_000), True),
        (CALMED, None, False),
        (CALMED, at_another_time(500, 500_000_001), True),
        (CALMED, taken(500), True),
        (LOW, None, False),
        (LOW, at_another_time(500, 700_000_001), True),
        (GROUNDED, None, False),
        (GROUNDED, taken(100), True),
    ],
)
def test_what_may_be_commanded_again_at_once(
    words: tuple[tuple[int, str], ...], change: Callable[[Flight], None] | None, complains: bool
) -> None:
    """Where the command before is done with: obeyed, or nothing was demanded for a second; and that was reported."""
    flight = told(*words)
    check_equal(sum(record.kind.name == "set_vehicle_mode" for step in flight for record in step), 2)
    if change is not None:
        change(flight)
    check_equal("failsafes_wait" in {one.split(":")[0] for one in complaints(flight)}, complains)


@pytest.mark.parametrize("unseen", ["vehicle down", "start"])
def test_a_fence_that_nobody_sees_is_not_kept(unseen: str) -> None:
    """A chart that says so is doubted, however long ago it did."""
    flight = told((0, "spot 200,0"), (100, unseen), (200, "vehicle up"), (1_500, "spot 200,0"))
    check_equal(complaints(flight), [])
    other("moved", {"to_state": "ok"}, chart="safety", to_state="unreachable")(flight)
    command_at_the_end(flight)
    check_equal("failsafes_wait" in {one.split(":")[0] for one in complaints(flight)}, True)


def command_at_the_end(flight: Flight) -> None:
    """Let a fence's failsafe command in the last step."""
    observed = flight[-1][0]
    again = Moved(chart="safety", instance="1/fence", from_state="ok", to_state="returning")
    command = SetVehicleMode(vehicle=1, mode=FLIGHT_MODE_RETURN)
    flight[-1] = [observed, *(changed(observed, one) for one in (again, command))]


@pytest.mark.parametrize(
    "words",
    [
        ((500, "spot 0,0"), (900, "spot 99,0 speed=20,0"), (1_600, "spot 99,0 speed=20,0")),
        ((500, "spot 0,0"), (1_600, "start"), (1_700, "vehicle up"), (1_800, "spot 200,0")),
        ((500, "spot 0,0"), (1_600, "vehicle down"), (1_700, "vehicle up"), (1_800, "spot 200,0")),
    ],
)
def test_a_second_that_was_interrupted_is_none(words: tuple[tuple[int, str], ...]) -> None:
    """By what the chart sees ahead, or by nobody having seen its end."""
    flight = told((0, "spot 200,0"), *words)
    check_equal(complaints(flight), [])
    command_at_the_end(flight)
    check_equal("failsafes_wait" in {one.split(":")[0] for one in complaints(flight)}, True)
