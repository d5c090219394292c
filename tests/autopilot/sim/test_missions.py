"""A mission as it is flown: each kind of item, where it counts its height from, and going on after an interruption."""

from __future__ import annotations

import math

import pytest

from autopilot.sim.aircraft import HOME
from tests.autopilot.sim.ground import ARM, MODE, START, Ground, Row, at, ground, row

HOME_UP_M = HOME[2]
TAKE_OFF = row(22, 0, 0, 20)


def started(*rows: Row) -> Ground:
    """Return a station whose copter has begun a mission behind a take-off to 20 m."""
    station = ground()
    assert station.upload([row(16, 0, 0, 0), TAKE_OFF, *rows]) == 0
    assert station.long(MODE, 1, 4) + station.long(ARM, 1) + station.long(START) == [0, 0, 0]
    return station


def reached(station: Ground, seq: int) -> float:
    """Let time pass until an item is told as reached; return when."""
    station.until(lambda: seq in [message.seq for message in station.of("MISSION_ITEM_REACHED")], 300)
    return station.vehicle.time_s


@pytest.mark.parametrize(
    ("item", "waits_s"),
    [
        (row(16, 50, 0, 20), 0),
        (row(16, 50, 0, 20, p1=8), 8),
        (row(19, 50, 0, 20, p1=12), 12),
        (row(18, 50, 0, 20, p1=1), 20),
        (row(82, 50, 0, 20), 0),
    ],
)
def test_how_long_an_item_stays(item: Row, waits_s: float) -> None:
    station = started(item, row(16, 50, 50, 20))
    station.until(lambda: station.vehicle.flight.body.east_m > 49)
    near_s = station.vehicle.time_s
    waited_s = reached(station, 2) - near_s
    assert waited_s == pytest.approx(waits_s, abs=1.5)
    assert station.vehicle.flight.body.east_m == pytest.approx(50, abs=1.5)


def test_a_delay_stays_where_it_is() -> None:
    station = started(Row(93, p1=10), row(16, 50, 0, 20))
    began_s = reached(station, 1)
    assert reached(station, 2) - began_s == pytest.approx(10, abs=0.3)
    assert abs(station.vehicle.flight.body.east_m) < 0.5


def test_loitering_for_ever_never_ends() -> None:
    station = started(row(17, 30, 0, 20), row(16, 50, 50, 20))
    station.pass_time(120)
    assert station.vehicle.flight.runner.current == 2
    assert station.vehicle.flight.body.east_m == pytest.approx(30, abs=0.5)


@pytest.mark.parametrize(("frame", "z"), [(3, 35.0), (6, 35.0), (0, HOME_UP_M + 35), (5, HOME_UP_M + 35), (10, 35.0)])
def test_what_heights_count_from(frame: int, z: float) -> None:
    station = started(row(16, 5, 0, z, frame=frame), row(17, 30, 0, z, frame=frame))
    reached(station, 2)
    assert station.vehicle.flight.body.up_m == pytest.approx(35, abs=1.2)


def test_a_waypoint_is_reached_at_its_height_only() -> None:
    station = started(row(16, 2, 0, 60))
    reached(station, 2)
    assert station.vehicle.flight.body.up_m == pytest.approx(60, abs=1.1)


def test_a_place_of_zeros_is_here() -> None:
    station = started(row(16, 40, 0, 20), Row(16, z=30.0), Row(21))
    station.until(lambda: not station.vehicle.flight.armed)
    assert station.vehicle.flight.body.east_m == pytest.approx(40, abs=1.5)


def test_landing_at_a_place() -> None:
    station = started(row(16, 40, 0, 20), row(21, 40, 30, 0))
    station.until(lambda: not station.vehicle.flight.armed)
    body = station.vehicle.flight.body
    assert (body.east_m, body.north_m) == pytest.approx((40, 30), abs=1)


def test_returning_climbs_first_where_it_is_low() -> None:
    station = started(row(16, 60, 0, 5), Row(20))
    reached(station, 2)
    heights_m = []
    while station.vehicle.flight.armed:
        station.pass_time(0.5)
        if 10 < station.vehicle.flight.body.east_m < 55:
            heights_m.append(station.vehicle.flight.body.up_m)
    assert min(heights_m) > 14
    assert math.hypot(station.vehicle.flight.body.east_m, station.vehicle.flight.body.north_m) < 1


def test_an_interrupted_mission_goes_on_with_its_item() -> None:
    station = started(row(16, 60, 0, 20), row(16, 60, 60, 20), row(16, 0, 60, 20))
    reached(station, 2)
    assert station.long(MODE, 1, 5) == [0]
    station.pass_time(5)
    assert station.long(MODE, 1, 3) == [0]
    assert station.vehicle.flight.runner.current == 3
    reached(station, 3)
    assert [message.seq for message in station.of("MISSION_ITEM_REACHED")] == [1, 2, 3]


def test_speed_of_a_mission_is_forgotten_in_another_mode() -> None:
    station = started(Row(178, p2=3), row(16, 300, 0, 20))
    station.until(lambda: station.vehicle.flight.body.east_m > 30)
    assert station.vehicle.flight.body.east_m_s == pytest.approx(3, abs=0.2)
    assert station.long(MODE, 1, 5) + station.long(MODE, 1, 3) == [0, 0]
    station.pass_time(6)
    assert station.vehicle.flight.body.east_m_s == pytest.approx(8, abs=0.2)


def test_an_interrupted_mission_is_told_as_such_and_goes_on_from_where_it_is() -> None:
    """Not along the line of the leg that it left: straight from where it was put meanwhile."""
    station = started(row(16, 60, 0, 20), row(16, 60, 100, 20))
    states = []
    station.until(lambda: station.vehicle.flight.body.north_m > 10)
    for mode in (3, 4, 3):
        assert station.long(MODE, 1, mode) == [0]
        if mode == 4:
            assert station.by_int(192, 3, *at(-40, 10), 20) == [0]
            station.pass_time(25)
        assert station.long(512, 42) == [0]
        states.append(station.of("MISSION_CURRENT")[-1].mission_state)
    assert states == [3, 4, 3]
    station.until(lambda: station.vehicle.flight.body.north_m > 55)
    assert station.vehicle.flight.body.east_m == pytest.approx(10, abs=3)


def test_an_upload_while_another_mode_flies_moves_nothing() -> None:
    station = started(row(16, 60, 0, 20), row(16, 60, 100, 20))
    reached(station, 2)
    assert station.long(MODE, 1, 5) == [0]
    aim = station.vehicle.gimbal.aim
    assert station.upload([row(16, 0, 0, 0), row(195, 5, 5, 0), row(16, 0, 0, 20)]) == 0
    station.pass_time(1)
    assert station.vehicle.gimbal.aim == aim


def test_a_second_return_is_a_whole_one() -> None:
    station = started(row(16, 30, 0, 20))
    reached(station, 2)
    assert station.long(20) == [0]
    station.until(lambda: station.vehicle.flight.landed_state == 4)
    assert station.by_int(192, 3, *at(30, 0), 5, -1, 1) == [0]
    station.pass_time(12)
    assert station.long(20) == [0]
    station.until(lambda: station.vehicle.flight.body.up_m > 14, 30)
    station.until(lambda: not station.vehicle.flight.armed)
    assert station.vehicle.flight.body.east_m == pytest.approx(0, abs=0.5)
