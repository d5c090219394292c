"""What is not recorded of the telemetry: nothing that a decision would have been another for."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.ports.config import VehicleSection
from events.schema.common_pb2 import Moved
from events.schema.vehicle_pb2 import GimbalReported, PointAtAngles, PositionReported
from tests.autopilot.vehicle.vehicles import (
    LATITUDE_E7,
    LONGITUDE_E7,
    Bench,
    answer,
    at_angles,
    attitude,
    gimbal,
    heartbeat,
    position,
)
from tests.flights import Flight, point_at_angles

FULL = VehicleSection(connect="127.0.0.1:14550", gimbal_threshold_deg=1e-9)
THINNED = VehicleSection(connect="127.0.0.1:14550")
E7_A_METRE = 90  # of latitude, near enough


def positions(*steps: tuple[float, dict[str, int]], settings: VehicleSection = THINNED) -> int:
    """Return how many positions are reported of those heard at these seconds."""
    bench = Bench(settings)
    bench.hear(0, heartbeat())
    for at_s, changes in steps:
        bench.hear(at_s, heartbeat(), position(round(at_s * 1000), **changes))
    return len(bench.reported(PositionReported))


@pytest.mark.parametrize(
    ("changes", "count"),
    [
        ({}, 1),
        ({"lat": LATITUDE_E7 + E7_A_METRE}, 1),
        ({"lat": LATITUDE_E7 + 3 * E7_A_METRE}, 2),
        ({"lat": LATITUDE_E7 - 3 * E7_A_METRE}, 2),
        ({"lon": LONGITUDE_E7 + round(1.9 * 133)}, 1),
        ({"lon": LONGITUDE_E7 + round(2.1 * 133)}, 2),
        ({"alt": 518_000 + 1_900}, 1),
        ({"alt": 518_000 - 2_100}, 2),
        ({"hdg": 9_400}, 1),
        ({"hdg": 9_600}, 2),
        ({"hdg": 8_400}, 2),
        ({"hdg": 65_535}, 2),
    ],
)
def test_a_position_is_reported_when_it_is_another(changes: dict[str, int], count: int) -> None:
    """By more than what GPS wanders, or what a heading trembles."""
    assert positions((0, {}), (0.6, changes)) == count


def test_a_move_waits_for_its_period_and_one_that_stands_is_said_again() -> None:
    """At most each 0.5 s, at least each 60 s."""
    far = {"lat": LATITUDE_E7 + 1000}
    assert positions((0, {}), (0.4, far)) == 1
    assert positions((0, {}), (0.4, far), (0.5, far)) == 2
    assert positions(*((second, {}) for second in range(60))) == 1
    assert positions(*((second, {}) for second in range(122))) == 3
    across = {"lon": 1_799_999_990}, {"lon": -1_799_999_990}
    assert positions((0, across[0]), (0.6, across[1])) == 1


def test_everything_is_said_when_the_vehicle_comes_back() -> None:
    """A gap ends with the whole picture."""
    bench = Bench(VehicleSection(connect="x:1", link_timeout_s=5))
    for at_s in (0, 1, 8):
        bench.turn(at_s)
        bench.hear(at_s, heartbeat(), position(at_s * 1000), attitude(at_s * 1000, 0), gimbal(at_s * 1000, -30, 0))
    assert len(bench.reported(PositionReported)) == 2
    assert len(bench.reported(GimbalReported)) == 2


def test_a_gimbal_that_stands_is_said_again() -> None:
    """So that silence means that nothing is heard of it."""
    bench = Bench()
    for second in range(122):
        bench.hear(second, heartbeat(), attitude(second * 1000, 0), gimbal(second * 1000, -30, 0))
    assert len(bench.reported(GimbalReported)) == 3


def flown(section: VehicleSection, pitches_cdeg: Sequence[int]) -> list[tuple[int, str, str]]:
    """Return when and how the aim moved, for a gimbal that passes through these pitches, ten a second."""
    flight, bench = Flight(), Bench(section)
    flight.tell(point_at_angles("a", pitch_cdeg=-3_000, yaw_cdeg=0), 0)
    asked = flight.records[flight.effect()].message
    assert isinstance(asked, PointAtAngles)
    bench.hear(0, heartbeat(), position(0), attitude(0, 0))
    bench.perform(0, flight.effect(), at_angles(asked.pitch_cdeg, asked.yaw_cdeg))
    bench.hear(0, answer(1000))
    bench.reports.clear()
    for tenth, pitch_cdeg in enumerate(pitches_cdeg, 1):
        ms = tenth * 100
        bench.hear(tenth / 10, heartbeat(), position(ms), attitude(ms, 0), gimbal(ms, pitch_cdeg / 100, 0))
        flight.wait(100)
        for report in bench.reported(GimbalReported):
            flight.tell(report)
        bench.reports.clear()
    flight.wait(20_000)
    moves = [(record.at.flight_ns, record.message) for record in flight.records if isinstance(record.message, Moved)]
    return [(at_ns, move.from_state, move.to_state) for at_ns, move in moves if move.chart == "aim"]


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(-3_400, -2_600), min_size=1, max_size=60))
def test_thinning_changes_no_arrival(pitches_cdeg: list[int]) -> None:
    """Whatever the gimbal does, it arrives in the same moment as if every report were recorded, or misses."""
    assert flown(THINNED, pitches_cdeg) == flown(FULL, pitches_cdeg)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.integers(-30, 30), min_size=1, max_size=60), st.integers(-3_130, -2_870))
def test_nor_that_of_one_that_creeps(steps_cdeg: list[int], start_cdeg: int) -> None:
    """Below the deadband from report to report, around the tolerance."""
    pitches = [start_cdeg + sum(steps_cdeg[:index]) for index in range(len(steps_cdeg))]
    assert flown(THINNED, pitches) == flown(FULL, pitches)


def test_edge_and_core_have_one_tolerance() -> None:
    """1.004 degrees off are 100 hundredths: the edge may not keep to itself what the core takes for an arrival."""
    (arrived,) = flown(THINNED, [-3_040, -3_080])[1:]
    assert arrived[2] == "arrived"
    bench = Bench()
    bench.hear(0, heartbeat(), position(0), attitude(0, 0))
    bench.perform(0, 5, at_angles(-3_000, 0))
    bench.reports.clear()
    for tenth, pitch_deg in enumerate((-31.03, -31.004, -31.003), 1):
        bench.hear(tenth / 10, position(tenth * 100), attitude(tenth * 100, 0), gimbal(tenth * 100, pitch_deg, 0))
    told = [report.error_cdeg for report in bench.reports if isinstance(report, GimbalReported)]
    assert told == [103, 100]
