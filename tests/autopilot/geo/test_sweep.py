"""A region in lanes: how much is seen, that the margin is kept, which way the lanes run, and in which order."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import MultiPolygon, Polygon

from autopilot.geo import image_point
from autopilot.geo import sweep as sweeping
from autopilot.geo.airspace import Airspace, Metres
from autopilot.geo.footprint import Footprint, Lane, crabbed, footprint, seen_from
from autopilot.geo.lanes import parallel_lanes
from autopilot.geo.ordering import cells_of, in_order
from autopilot.geo.routing import Router
from autopilot.geo.sweep import Flying, NoSweep, Sweep, sweep
from autopilot.geo.wind import Wind, on_track
from autopilot.sim.world import CameraView
from tests.autopilot.geo.grounds import airspace, holes, part_seen, regions

COPTER = Flying(speed_mps=8, turn_s=4, crabs=False)
PLANE = Flying(speed_mps=16, turn_s=8, crabs=True)
CALM = Wind()
LEVEL = footprint(50, 60, 16 / 9)  # 58 m by 32 m
OBLONG = Polygon([(0, 0), (400, 0), (400, 150), (0, 150)])


def searched(
    region: Polygon,
    room: Airspace,
    flying: Flying = COPTER,
    wind: Wind = CALM,
    overlap: float = 0.2,
    start: Metres = (0, 0),
) -> Sweep:
    """Search a region."""
    return sweep(region, room, Router(room), start, LEVEL, overlap, flying, wind)


def check_searched(region: Polygon, room: Airspace, flying: Flying, wind: Wind, overlap: float, start: Metres) -> Sweep:
    """Search a region; what is seen is enough and is what is said, and every leg keeps the margin."""
    found = searched(region, room, flying, wind, overlap, start)
    airspeed_mps = flying.speed_mps if flying.crabs else None
    beside = room.flyable.buffer(min(LEVEL.along_m, LEVEL.across_m) / 4)
    in_reach = MultiPolygon(_polygons(found.region.intersection(beside)))
    assert part_seen(in_reach, found.lanes, LEVEL, wind, airspeed_mps) >= 0.98
    assert part_seen(found.region, found.lanes, LEVEL, wind, airspeed_mps) >= found.coverage - 0.005
    assert room.keeps_margin(start) is False or room.keeps_margin(start, *found.path)
    assert room.keeps_margin(*found.path)
    assert all(lane in set(zip(found.path, found.path[1:], strict=False)) for lane in found.lanes if lane[0] != lane[1])
    return found


def _polygons(shape: object) -> list[Polygon]:
    return [shape] if isinstance(shape, Polygon) else [part for part in getattr(shape, "geoms", ()) if part.area > 0]


@settings(max_examples=25, deadline=None)
@given(regions(), holes(), st.sampled_from([0.1, 0.2, 0.4]))
def test_a_copter_sees_all_but_what_is_forbidden(region: Polygon, keep_out: list[Polygon], overlap: float) -> None:
    """98 % of any region where it has room around it; what lies in an exclusion does not count."""
    room = airspace(exclusions=keep_out)
    found = check_searched(region, room, COPTER, CALM, overlap, (1000.0, 0.0))
    assert found.coverage >= 0.98


@settings(max_examples=15, deadline=None)
@given(regions(), holes(), st.integers(0, 359), st.sampled_from([0.0, 4.0, 9.0]))
def test_a_plane_in_the_wind_sees_it_too(region: Polygon, keep_out: list[Polygon], from_deg: int, mps: float) -> None:
    """Though its nose, and with it its picture, is turned against the track."""
    room = airspace(exclusions=keep_out)
    found = check_searched(region, room, PLANE, Wind(from_deg=from_deg, speed_mps=mps), 0.2, (1000.0, 0.0))
    assert found.coverage >= 0.98


@settings(max_examples=15, deadline=None)
@given(regions(), holes())
def test_a_fence_on_the_rim_costs_only_what_cannot_be_seen_from_inside(
    region: Polygon, keep_out: list[Polygon]
) -> None:
    """The inclusion is the region itself: lanes stay inside by the margin, and see over it."""
    room = airspace([region], keep_out)
    parts = [part for part in room.flyable.geoms if part.area > 100]
    if len(room.flyable.geoms) != 1 or not parts:
        return  # cut up: what can't be reached is another test
    start = parts[0].representative_point()
    check_searched(region, room, COPTER, CALM, 0.2, (start.x, start.y))


def test_a_wide_lane_needs_few() -> None:
    """Rows lie evenly and no farther apart than asked: 150 m in lanes of 58 m with a fifth of overlap are four."""
    found = searched(OBLONG, airspace())
    assert (round(found.heading_deg), len(found.lanes), round(found.spacing_m, 1)) == (90, 4, 46.2)
    norths = sorted({round(north, 2) for lane in found.lanes for _, north in lane})
    assert norths == [18.75, 56.25, 93.75, 131.25]
    assert {round(east) for lane in found.lanes for east, _ in lane} == {0, 400}
    assert found.coverage == pytest.approx(1.0)


def test_no_overlap_is_needed_to_see_all() -> None:
    """With none, rows are a whole lane apart."""
    assert len(searched(OBLONG, airspace(), overlap=0.0).lanes) == 3
    assert len(searched(OBLONG, airspace(), overlap=0.5).lanes) == 6


def test_lanes_run_along_a_copters_longest_edge_whatever_the_wind() -> None:
    """It holds its speed over ground and its nose along the track."""
    for from_deg in (0, 45, 90):
        assert round(searched(OBLONG, airspace(), wind=Wind(from_deg=from_deg, speed_mps=6)).heading_deg) == 90


def test_a_plane_takes_the_winds_axis_where_that_is_quicker() -> None:
    """In a square the wind's axis needs no crab; a long strip is flown along itself all the same."""
    square = Polygon([(0, 0), (900, 0), (900, 900), (0, 900)])
    wind = Wind(from_deg=360, speed_mps=9)
    found = searched(square, airspace(), PLANE, wind)
    assert (round(found.heading_deg) % 180, round(found.crab_deg)) == (0, 0)
    strip = Polygon([(0, 0), (3000, 0), (3000, 60), (0, 60)])
    found = searched(strip, airspace(), PLANE, wind)
    assert round(found.heading_deg) == 90
    assert found.crab_deg == pytest.approx(math.degrees(math.asin(9 / 16)))
    assert found.seen.across_m < LEVEL.across_m


def test_time_is_longer_against_the_wind() -> None:
    """There and back at 16 m/s in 8 m/s takes a third more than in a calm, and turns are counted."""
    calm, windy = (
        searched(OBLONG, airspace(), PLANE, Wind(from_deg=90, speed_mps=mps), start=(0, 18.75)) for mps in (0.0, 8.0)
    )
    turns_s = PLANE.turn_s * 4
    assert calm.time_s - turns_s == pytest.approx(calm.length_m / 16, rel=0.01)
    assert (windy.time_s - turns_s) / (calm.time_s - turns_s) == pytest.approx(4 / 3, rel=0.1)


def check_refused(words: str, region: Polygon, room: Airspace, flying: Flying = COPTER, wind: Wind = CALM) -> None:
    """Check that a region can't be searched, and what is said."""
    with pytest.raises(NoSweep, match=words):
        searched(region, room, flying, wind)


def test_what_cannot_be_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each reason, with what to do."""
    elsewhere = Polygon([(1000, 1000), (1100, 1000), (1100, 1100)])
    check_refused("the fences leave nothing of it; move", OBLONG, airspace([elsewhere]))
    narrow = Polygon([(0, 0), (400, 0), (400, 15), (0, 15)])
    check_refused("no lane in it keeps the margin", narrow, airspace([narrow]))
    check_refused(
        "the wind of 20 m/s is too strong to fly lanes at 16 m/s", OBLONG, airspace(), PLANE, Wind(speed_mps=20)
    )
    monkeypatch.setattr(sweeping, "ROWS_MAX", 3)
    check_refused("it takes 4 lanes, more than 3; search from higher up", OBLONG, airspace())


def test_what_the_fences_take_does_not_count() -> None:
    """The half outside the inclusion is said, and not searched."""
    half = Polygon([(-50, -50), (200, -50), (200, 200), (-50, 200)])
    found = searched(OBLONG, airspace([half]))
    assert (round(found.region.area), round(found.outside_m2)) == (200 * 150, 200 * 150)
    assert found.coverage == pytest.approx(1.0)


def test_what_cannot_be_reached_is_not_flown() -> None:
    """Behind a wall from side to side the region stays unseen, and the coverage says so."""
    wall = Polygon([(195, -100), (205, -100), (205, 300), (195, 300)])
    yard = Polygon([(-50, -50), (450, -50), (450, 200), (-50, 200)])
    found = searched(OBLONG, airspace([yard], [wall]))
    assert max(east for east, _ in found.path) <= 185.1
    assert found.coverage == pytest.approx(0.54, abs=0.03)


def test_a_region_smaller_than_the_picture_is_one_look() -> None:
    """One lane, however small."""
    found = searched(Polygon([(0, 0), (10, 0), (10, 10), (0, 10)]), airspace())
    assert (len(found.lanes), round(found.coverage, 3)) == (1, 1.0)


def test_a_plane_has_room_to_settle_where_the_fences_leave_it() -> None:
    """Lanes are longer by the run-in on both sides, but not across the margin."""
    settled = Flying(speed_mps=16, turn_s=8, crabs=True, run_in_m=60)
    free = searched(OBLONG, airspace(), settled)
    assert {round(east) for lane in free.lanes for east, _ in lane} == {-60, 460}
    yard = Polygon([(-40, -100), (600, -100), (600, 300), (-40, 300)])
    assert {round(east) for lane in searched(OBLONG, airspace([yard]), settled).lanes for east, _ in lane} == {0, 460}


def test_the_footprint_is_what_the_pinhole_sees() -> None:
    """A point on its rim lies on the rim of the picture."""
    view = CameraView(height_m=50, camera_yaw_deg=0, camera_pitch_deg=-90)
    for east_m, north_m, expected in (
        (LEVEL.across_m / 2, 0.0, (1.0, 0.5)),
        (0.0, LEVEL.along_m / 2, (0.5, 0.0)),
        (-LEVEL.across_m / 2, -LEVEL.along_m / 2, (0.0, 1.0)),
    ):
        assert image_point(view, east_m, north_m, 60, 1600, 900) == pytest.approx(expected, abs=1e-9)


def test_a_turned_picture_shows_a_narrower_band() -> None:
    """W cos - L sin across; turned so far that no band is left, nothing counts."""
    wide = Footprint(across_m=100, along_m=40)
    assert crabbed(wide, 0) == wide
    for turn_deg in (20, -20):
        turned = crabbed(wide, turn_deg)
        assert turned is not None
        assert turned.across_m == pytest.approx(100 * math.cos(math.radians(20)) - 40 * math.sin(math.radians(20)))
        assert 0 <= turned.along_m < 40
    assert crabbed(wide, 70) is None


def test_the_wind_triangle() -> None:
    """Head, tail and cross wind, and a wind that is too strong."""
    found = [on_track(0, 10, Wind(from_deg=from_deg, speed_mps=6)) for from_deg in (0, 180, 90, 270)]
    assert [(round(it.ground_speed_mps, 3), round(it.crab_deg, 1)) for it in found if it] == [
        (4, 0),
        (16, 0),
        (8, 36.9),
        (8, -36.9),
    ]
    assert on_track(0, 10, Wind(from_deg=90, speed_mps=10)) is None
    assert on_track(0, 10, Wind(from_deg=0, speed_mps=10)) is None


def lane(row: int, begin_m: float, end_m: float) -> Lane:
    """Return a lane from west to east, 10 m north a row."""
    return Lane(row=row, start=(begin_m, 10.0 * row), end=(end_m, 10.0 * row), along_m=(begin_m, end_m))


def test_lanes_beside_each_other_are_a_cell() -> None:
    """A hole parts the rows beside it into two cells, and below and above it are cells of their own."""
    lanes = [lane(0, 0, 100), lane(1, 0, 40), lane(1, 60, 100), lane(2, 0, 40), lane(2, 60, 100), lane(3, 0, 100)]
    assert [[(it.row, it.along_m[0]) for it in cell] for cell in cells_of(lanes)] == [
        [(0, 0)],
        [(1, 0), (2, 0)],
        [(1, 60), (2, 60)],
        [(3, 0)],
    ]


def test_rows_are_flown_to_and_fro() -> None:
    """From the nearer side, turning at each end; a patch is put where it is near."""
    rows = [lane(row, 0, 100) for row in range(4)]
    patch = Lane(row=-1, start=(105, 25), end=(105, 20), along_m=(0, 5))
    flown = in_order([*rows, patch], (-50, 40), Router(airspace()))
    assert flown == [
        ((0, 30), (100, 30)),
        ((105, 25), (105, 20)),
        ((100, 20), (0, 20)),
        ((0, 10), (100, 10)),
        ((100, 0), (0, 0)),
    ]


def test_a_lane_sees_a_rectangle_around_it() -> None:
    """Half a picture before and behind, and one look sees a circle."""
    level = Footprint(across_m=40, along_m=20)
    assert seen_from([lane(0, 0, 100)], level).bounds == pytest.approx((-10, -20, 110, 20))
    assert seen_from([lane(0, 0, 0)], level).bounds == pytest.approx((-10, -10, 10, 10))


def test_rows_reach_as_far_as_their_strip() -> None:
    """In a triangle each row is as long as the widest of its strip, so slanted edges are seen."""
    triangle = MultiPolygon([Polygon([(0, 0), (100, 0), (0, 100)])])
    found = parallel_lanes(triangle, airspace().flyable, 90, 50)
    assert [(round(it.start[1]), round(it.along_m[1] - it.along_m[0])) for it in found] == [(25, 100), (75, 50)]
