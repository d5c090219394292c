"""What the camera has seen: outlines that a detector's own projection agrees with, and the part of a region."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.geo import LocalFrame, image_point
from autopilot.sim.aircraft import HOME
from autopilot.sim.footprints import Footprint, Footprints, coverage, region_m
from autopilot.sim.gimbal import Angles, Gimbal
from autopilot.sim.vehicle import Vehicle
from autopilot.sim.world import FIELD_OF_VIEW_DEG, HEIGHT_PX, WIDTH_PX
from tests.autopilot.sim.ground import ARM, MODE, START, Ground, Row, at, row

DOWN = Footprint(
    east_m=10,
    north_m=20,
    height_m=50,
    camera_yaw_deg=0,
    camera_pitch_deg=-90,
    field_of_view_deg=60,
    width_px=1280,
    height_px=720,
)
ACROSS_M = 2 * 50 * math.tan(math.radians(30))


def square(side_m: float, east_m: float = 0.0, north_m: float = 0.0) -> list[tuple[float, float]]:
    half_m = side_m / 2
    corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    return [(east_m + east * half_m, north_m + north * half_m) for east, north in corners]


def test_straight_down_it_is_a_rectangle() -> None:
    outline = shapely.Polygon(DOWN.outline())
    assert outline.bounds == pytest.approx(
        (10 - ACROSS_M / 2, 20 - ACROSS_M * 9 / 32, 10 + ACROSS_M / 2, 20 + ACROSS_M * 9 / 32)
    )


def test_without_ground_there_is_none() -> None:
    assert replace(DOWN, camera_pitch_deg=40.0).outline() == []
    assert replace(DOWN, height_m=0.0).outline() == []


@given(st.floats(-90, 10), st.floats(0, 360), st.floats(5, 200), st.floats(-400, 400), st.floats(-400, 400))
@settings(max_examples=100, deadline=None, derandomize=True)
def test_a_point_is_inside_exactly_when_the_camera_sees_it(
    pitch_deg: float, yaw_deg: float, height_m: float, east_m: float, north_m: float
) -> None:
    view = replace(DOWN, camera_pitch_deg=pitch_deg, camera_yaw_deg=yaw_deg, height_m=height_m)
    outline = view.outline(300)
    seen = image_point(view, east_m, north_m, 60, 1280, 720)
    in_image = seen is not None and all(0.01 < part < 0.99 for part in seen)
    beside = seen is None or not all(-0.01 <= part <= 1.01 for part in seen)
    point = shapely.Point(view.east_m + east_m, view.north_m + north_m)
    inside = len(outline) >= 3 and shapely.Polygon(outline).buffer(0).contains(point)
    if in_image and math.hypot(east_m, north_m) < 280:
        assert inside
    if beside or math.hypot(east_m, north_m) > 301:
        assert not inside


@pytest.mark.parametrize(
    ("region", "share"),
    [
        (square(20, 10, 20), 1.0),
        (square(20, 10 + ACROSS_M / 2, 20), 0.5),
        (square(20, 300, 300), 0.0),
        (square(ACROSS_M, 10, 20), 9 / 16),
    ],
)
def test_the_part_of_a_region(region: list[tuple[float, float]], share: float) -> None:
    assert coverage(region, [DOWN]) == pytest.approx(share, abs=1e-6)
    assert coverage(region, [DOWN, DOWN, replace(DOWN, camera_pitch_deg=60)]) == pytest.approx(share, abs=1e-6)


def test_nothing_seen_is_nothing() -> None:
    assert coverage(square(10), []) == 0


@pytest.mark.parametrize("region", [[(0, 0), (1, 1), (0, 1), (1, 0)], [(0, 0), (1, 1), (2, 2)]])
def test_a_region_that_is_none(region: list[tuple[float, float]]) -> None:
    with pytest.raises(ValueError, match="no simple polygon"):
        coverage(region, [DOWN])


def test_corners_on_the_earth_in_metres() -> None:
    corners = [(x / 1e7, y / 1e7) for x, y in (at(0, 0), at(100, 0), at(100, 50))]
    found = region_m(LocalFrame(*HOME), corners)
    assert [(round(east, 1), round(north, 1)) for east, north in found] == [(0, 0), (100, 0), (100, 50)]


def test_frames_that_repeat_are_not_kept() -> None:
    vehicle, seen = Vehicle(1), Footprints(FIELD_OF_VIEW_DEG, WIDTH_PX, HEIGHT_PX)
    gimbal = Gimbal(pitch_deg=-90)
    for _ in range(10):
        seen.add(vehicle.motion, gimbal)
    vehicle.flight.body.north_m += 1
    seen.add(vehicle.motion, gimbal)
    gimbal.yaw_deg += 1
    seen.add(vehicle.motion, gimbal)
    gimbal.pitch_deg += 1
    seen.add(vehicle.motion, gimbal)
    assert len(seen.seen) == 4


def test_a_flown_sweep_covers_its_region() -> None:
    """Three legs 40 m apart at 50 m, looking down: all of the region is seen, and half of one twice as wide isn't."""
    vehicle, seen = Vehicle(1), Footprints(FIELD_OF_VIEW_DEG, WIDTH_PX, HEIGHT_PX)
    vehicle.gimbal.aim = Angles(-90, 0, False)
    station = Ground(vehicle)
    rows = [row(16, 0, 0, 0), row(22, 0, 0, 50)]
    for number in range(3):
        ends = (-60, 60) if number % 2 == 0 else (60, -60)
        rows += [row(16, 40.0 * number, end, 50) for end in ends]
    assert station.upload([*rows, Row(20)]) == 0
    station.long(MODE, 1, 4)
    station.long(ARM, 1)
    station.long(START)
    while vehicle.flight.runner.current < len(rows):
        station.pass_time(0.25)
        if vehicle.flight.runner.current >= 3:
            seen.add(vehicle.motion, vehicle.gimbal)
    assert coverage(square(120, 40, 0), seen.seen) > 0.99
    assert coverage(square(240, 100, 0), seen.seen) < 0.6
