"""Buffered telemetry: interpolation, the short way round, and None where there is no honest answer."""

from __future__ import annotations

import pytest
from geographiclib.geodesic import Geodesic
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.adapters.vehicle.heard import Attitude, GimbalAttitude, Position, Sender
from autopilot.adapters.vehicle.pointing import Direction, angle_between, direction_to
from autopilot.adapters.vehicle.poses import SAMPLES, Poses, Sample, Track, VehicleTime

S = 1_000_000_000
MS = 1_000_000
SENDER = Sender(system=1, component=1)


def position(latitude_e7: int = 473_977_000, longitude_e7: int = 85_456_000, **changes: int) -> Position:
    fields = {"boot_ms": 0, "altitude_mm": 518_000, "height_mm": 30_000, "north_cm_s": 0, "east_cm_s": 0}
    fields |= {"down_cm_s": 0} | changes
    return Position(sender=SENDER, latitude_e7=latitude_e7, longitude_e7=longitude_e7, heading_cdeg=None, **fields)


def attitude(yaw_deg: float, rate_deg_s: float = 0.0) -> Attitude:
    return Attitude(sender=SENDER, boot_ms=0, yaw_deg=yaw_deg, yaw_rate_deg_s=rate_deg_s)


def view(pitch_deg: float, yaw_deg: float, from_north: bool = False) -> GimbalAttitude:
    return GimbalAttitude(sender=SENDER, boot_ms=0, pitch_deg=pitch_deg, yaw_deg=yaw_deg, from_north=from_north)


def standing(pitch_deg: float = -30.0, yaw_deg: float = 0.0) -> Poses:
    """Return a second of a hovering aircraft that looks somewhere."""
    poses = Poses()
    for tenth in range(11):
        poses.add_position(tenth * 100 * MS, position())
        poses.add_attitude(tenth * 100 * MS, attitude(90))
        poses.add_view(tenth * 100 * MS, view(pitch_deg, yaw_deg))
    return poses


def check_track(turns: bool, samples: list[tuple[int, float]], at_ms: int, expected: float | None) -> None:
    track = Track((turns,), 500 * MS)
    for ms, value in samples:
        track.add(Sample(ms * MS, (value,), (0.0,)))
    found = track.at(at_ms * MS)
    values = [] if found is None else [found[0] % 360]
    assert values == pytest.approx([value for value in [expected] if value is not None])


def test_between_two_samples() -> None:
    check_track(False, [(0, 10), (100, 20)], 25, 12.5)
    check_track(False, [(0, 10), (100, 20), (200, 0)], 150, 10)
    check_track(False, [(0, 10), (100, 20)], 100, 20)


def test_the_short_way_round() -> None:
    check_track(True, [(0, 350), (100, 10)], 50, 0)
    check_track(True, [(0, -170), (100, 170)], 25, 185)


def test_where_nobody_knows() -> None:
    check_track(False, [], 0, None)
    check_track(False, [(100, 1)], 99, None)
    check_track(False, [(0, 1), (2_001, 2)], 1_000, None)
    check_track(False, [(0, 1)], 501, None)
    check_track(False, [(0, 1)], 500, 1)


def test_samples_out_of_order() -> None:
    check_track(False, [(0, 1), (100, 2), (50, 9)], 50, 1.5)
    check_track(False, [(9_000, 1), (100, 2)], 100, 2)


def test_the_buffer_is_bounded() -> None:
    track = Track((False,), S)
    for number in range(10 * SAMPLES):
        track.add(Sample(number, (0.0,), (0.0,)))
    assert len(track._samples) == SAMPLES


def test_a_pose() -> None:
    pose = standing(-30, 100).pose_at(950 * MS)
    assert pose is not None
    assert pose.mono_ns == 950 * MS
    assert (pose.latitude_deg, pose.longitude_deg) == pytest.approx((47.3977, 8.5456))
    assert (pose.altitude_m, pose.height_m) == (518, 30)
    assert (pose.camera_pitch_deg, pose.camera_yaw_deg, pose.camera_roll_deg) == pytest.approx((-30, -170, 0))


def test_a_view_from_north_needs_no_heading_added() -> None:
    poses = standing()
    poses.add_view(1_100 * MS, view(-30, 100, from_north=True))
    pose = poses.pose_at(1_100 * MS)
    assert pose is not None
    assert pose.camera_yaw_deg == 100
    assert poses.pose_at(1_000 * MS) is None


def test_a_position_goes_on_by_its_speed() -> None:
    poses = standing()
    poses.add_position(1_100 * MS, position(north_cm_s=1_000, east_cm_s=-500, down_cm_s=-200))
    vehicle = poses.vehicle_at(1_500 * MS)
    assert vehicle is not None
    assert (vehicle.latitude_deg - 47.3977) * 111_200 == pytest.approx(4, abs=0.02)
    assert (vehicle.longitude_deg - 8.5456) * 75_400 == pytest.approx(-2, abs=0.02)
    assert vehicle.height_m == pytest.approx(30.8)
    assert vehicle.altitude_m == pytest.approx(518.8)


def test_a_heading_goes_on_by_its_rate() -> None:
    poses = standing()
    poses.add_attitude(1_100 * MS, attitude(100, -20))
    vehicle = poses.vehicle_at(1_350 * MS)
    assert vehicle is not None
    assert vehicle.yaw_deg == pytest.approx(95)


def test_a_moving_gimbal_is_not_known_beyond_its_last_sample() -> None:
    poses = standing()
    assert poses.pose_at(1_100 * MS) is not None
    poses.add_view(1_100 * MS, view(-36, 0))
    assert poses.pose_at(1_150 * MS) is None
    between = poses.pose_at(1_050 * MS)
    assert between is not None
    assert between.camera_pitch_deg == pytest.approx(-33)


def test_a_gimbal_that_keeps_turning_slowly_is_followed() -> None:
    poses = standing()
    poses.add_view(1_100 * MS, view(-32, 1))
    pose = poses.pose_at(1_150 * MS)
    assert pose is not None
    assert (pose.camera_pitch_deg, pose.camera_yaw_deg) == pytest.approx((-33, 91.5))
    assert poses.pose_at(1_401 * MS) is None


def test_nothing_without_a_gimbal_or_a_position() -> None:
    poses = Poses()
    assert poses.pose_at(0) is None
    poses.add_position(0, position())
    poses.add_attitude(0, attitude(0))
    assert poses.pose_at(0) is None
    assert poses.vehicle_at(0) is not None


def check_stamps(arrivals: list[tuple[int, int]], expected_ms: list[int]) -> None:
    """Arrival and boot time in ms; where the stamp falls."""
    times = VehicleTime()
    assert [times.stamp(arrival * MS, boot) / MS for arrival, boot in arrivals] == pytest.approx(expected_ms, abs=0.5)


def test_a_late_datagram_does_not_move_the_aircraft() -> None:
    check_stamps([(1000, 0), (1100, 100), (1350, 200), (1351, 300), (1400, 400)], [1000, 1100, 1200, 1300, 1400])


def test_a_quicker_one_mends_the_offset() -> None:
    check_stamps([(1050, 0), (1100, 100), (1200, 200)], [1050, 1100, 1200])


def test_a_vehicle_that_restarts_counts_afresh() -> None:
    check_stamps([(60_000, 50_000), (60_100, 50_100), (63_000, 10), (63_100, 110)], [60_000, 60_100, 63_000, 63_100])


@given(st.lists(st.tuples(st.integers(0, 10**15), st.integers(0, 2**32 - 1)), max_size=20))
@settings(max_examples=100, deadline=None, derandomize=True)
def test_a_stamp_is_never_later_than_its_arrival(pairs: list[tuple[int, int]]) -> None:
    times = VehicleTime()
    for arrival_ns, boot_ms in sorted(pairs):
        assert times.stamp(arrival_ns, boot_ms) <= arrival_ns


HERE = (47.3977, 8.5456, 500.0)


@pytest.mark.parametrize(
    ("bearing_deg", "distance_m", "to_altitude_m", "pitch_deg"),
    [(0, 100, 400, -45), (90, 100, 500, 0), (225, 30, 530, 45), (359, 5_000, 500, -0.0225), (180, 0, 400, -90)],
)
def test_the_direction_to_a_place(
    bearing_deg: float, distance_m: float, to_altitude_m: float, pitch_deg: float
) -> None:
    end = Geodesic.WGS84.Direct(HERE[0], HERE[1], bearing_deg, distance_m)
    found = direction_to(HERE, (end["lat2"], end["lon2"], to_altitude_m))
    assert angle_between(found, Direction(pitch_deg, bearing_deg)) < 0.01


@pytest.mark.parametrize(
    ("one", "other", "angle_deg"),
    [
        (Direction(0, 0), Direction(0, 360), 0),
        (Direction(0, 179), Direction(0, -179), 2),
        (Direction(-90, 0), Direction(-90, 120), 0),
        (Direction(-60, 0), Direction(-60, 180), 60),
        (Direction(10, 30), Direction(10.01, 30), 0.01),
        (Direction(0, 0), Direction(0, 180), 180),
    ],
)
def test_the_angle_between_directions(one: Direction, other: Direction, angle_deg: float) -> None:
    assert angle_between(one, other) == pytest.approx(angle_deg, abs=1e-6)
