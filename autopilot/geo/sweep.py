"""A region searched in lanes, to and fro: which way they run, how far apart, and how much of the region is seen.

Which way. Of the directions that a lane could take, the least flying time is had along an edge of the region's hull
(the fewest rows lie along one: Huang, 2001), or along the wind's axis: there a fixed wing has no crab, so its picture
stays square to the track and the rows may lie farther apart. So these are tried, each with its rows, its ground
speeds against and with the wind and its turns, and the quickest is taken. A multirotor holds its speed over ground
and points its nose along the track, so to it the wind's axis is one direction like any other.

The region is what the fences leave of it. Every lane and every way between lanes keeps the margin.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from autopilot.geo.airspace import Airspace, Metres, parts
from autopilot.geo.footprint import Footprint, Lane, crabbed, seen_from
from autopilot.geo.lanes import parallel_lanes, patches, rows_of
from autopilot.geo.ordering import in_order
from autopilot.geo.routing import Router, path_length_m
from autopilot.geo.wind import Wind, on_track

HEADINGS_MAX = 12  # edges of a hull that are tried, the longest first
ROWS_MAX = 1000  # more rows than a battery can fly, and than a small computer plans in a minute

_NO_ROOM = "no lane in it keeps the margin from the fences; lower fence_margin_m, or change the fences"


@dataclass(frozen=True, slots=True, kw_only=True)
class Flying:
    """What of an aircraft matters to a sweep."""

    speed_mps: float  # over ground for a multirotor, through the air for a fixed wing
    turn_s: float  # from the end of a lane to the start of the next, besides the way
    crabs: bool  # a fixed wing: the nose, and with it the picture, turns into the wind
    run_in_m: float = 0.0  # flown straight before and behind a lane, where the fences leave room


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """A region as it is searched."""

    heading_deg: float  # of the rows, 0 to 180
    spacing_m: float  # between rows
    seen: Footprint  # what counts as seen around the foot
    crab_deg: float  # the largest on the rows
    region: MultiPolygon  # what the fences leave of what was asked for
    unseen: BaseGeometry  # what of that is not seen
    outside_m2: float  # what of the region the fences took away
    lanes: tuple[tuple[Metres, Metres], ...]  # in the order and direction of flight
    path: tuple[Metres, ...]  # the whole way, from the start's first step to the last lane's end
    time_s: float  # for the path, turns included

    @property
    def coverage(self) -> float:
        """Return the part of the region that is seen, 0 to 1."""
        return 1.0 - self.unseen.area / self.region.area

    @property
    def length_m(self) -> float:
        """Return the length of the path."""
        return path_length_m(self.path)


class NoSweep(Exception):
    """A region that can't be searched; the words say why and what to do."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Course:
    """One way to lay the rows."""

    heading_deg: float
    seen: Footprint
    spacing_m: float
    crab_deg: float
    time_s: float  # estimated, of rows and turns


def sweep(
    region: Polygon,
    airspace: Airspace,
    router: Router,
    start: Metres,
    level: Footprint,
    side_overlap: float,
    flying: Flying,
    wind: Wind,
) -> Sweep:
    """Plan the search of a region from `start`. Raises `NoSweep` where it can't be flown."""
    ground = MultiPolygon(parts(region.intersection(airspace.allowed)))
    if ground.is_empty:
        raise NoSweep("the fences leave nothing of it; move the region, or change the fences")
    course = _quickest(ground, level, side_overlap, flying, wind)
    room = _within_reach(airspace, router, start)
    if room.is_empty:
        raise NoSweep(_NO_ROOM)
    lanes = parallel_lanes(ground, room, course.heading_deg, course.spacing_m)
    lanes += patches(ground, room, lanes, course.seen)
    if not lanes:
        raise NoSweep(_NO_ROOM)
    order = in_order([_run_in(lane, flying, airspace) for lane in lanes], start, router)
    path = tuple(_joined(order, start, router))
    return Sweep(
        heading_deg=course.heading_deg,
        spacing_m=course.spacing_m,
        seen=course.seen,
        crab_deg=course.crab_deg,
        region=ground,
        unseen=ground.difference(seen_from(lanes, course.seen)),
        outside_m2=max(region.area - ground.area, 0.0),
        lanes=tuple(order),
        path=path,
        time_s=path_time_s((start, *path), flying, wind) + flying.turn_s * len(order),
    )


def _within_reach(airspace: Airspace, router: Router, start: Metres) -> MultiPolygon:
    """Return the parts of the flyable room that there is a way to: fences may cut it up."""
    points = [(part, part.representative_point()) for part in airspace.flyable.geoms]
    return MultiPolygon([part for part, at in points if router.between(start, (at.x, at.y)) is not None])


def path_time_s(path: tuple[Metres, ...], flying: Flying, wind: Wind) -> float:
    """Return how long straight legs take; a leg that the wind forbids counts as flown at a tenth of the speed."""
    return sum(
        math.dist(one, other) / _ground_speed_mps(one, other, flying, wind)
        for one, other in pairwise(path)
        if one != other
    )


def _ground_speed_mps(one: Metres, other: Metres, flying: Flying, wind: Wind) -> float:
    if not flying.crabs:
        return flying.speed_mps
    track_deg = math.degrees(math.atan2(other[0] - one[0], other[1] - one[1]))
    flown = on_track(track_deg, flying.speed_mps, wind)
    return flying.speed_mps / 10 if flown is None else flown.ground_speed_mps


def _quickest(ground: MultiPolygon, level: Footprint, side_overlap: float, flying: Flying, wind: Wind) -> _Course:
    courses = [
        course
        for heading_deg in _headings(ground, wind)
        if (course := _course(ground, heading_deg, level, side_overlap, flying, wind)) is not None
    ]
    if not courses:
        raise NoSweep(
            f"the wind of {wind.speed_mps:g} m/s is too strong to fly lanes at {flying.speed_mps:g} m/s; "
            "fly faster, or wait"
        )
    best = min(courses, key=lambda course: course.time_s)
    if (rows := rows_of(ground, best.heading_deg, best.spacing_m)) > ROWS_MAX:
        raise NoSweep(f"it takes {rows} lanes, more than {ROWS_MAX}; search from higher up, or split the region")
    return best


def _headings(ground: MultiPolygon, wind: Wind) -> Iterator[float]:
    """Yield the wind's axis, where there is wind, and the longest edges of the hull."""
    if wind.speed_mps > 0:
        yield wind.from_deg % 180
    corners = list(getattr(ground.convex_hull, "exterior").coords)  # noqa: B009 - the hull of an area is a polygon
    edges = sorted(pairwise(corners), key=lambda edge: -math.dist(*edge))
    for (east, north), (to_east, to_north) in edges[:HEADINGS_MAX]:
        yield math.degrees(math.atan2(to_east - east, to_north - north)) % 180


def _course(
    ground: MultiPolygon, heading_deg: float, level: Footprint, side_overlap: float, flying: Flying, wind: Wind
) -> _Course | None:
    """Return the rows on one heading with their time, or None where the wind or the picture forbids it."""
    out = back = flying.speed_mps
    crab_deg, seen = 0.0, level
    if flying.crabs:
        there = on_track(heading_deg, flying.speed_mps, wind)
        home = on_track(heading_deg + 180, flying.speed_mps, wind)
        if there is None or home is None:
            return None
        out, back, crab_deg = there.ground_speed_mps, home.ground_speed_mps, abs(there.crab_deg)
        turned = crabbed(level, crab_deg)
        if turned is None:
            return None
        seen = turned
    spacing_m = seen.across_m * (1 - side_overlap)
    rows = rows_of(ground, heading_deg, spacing_m)
    length_m = ground.area / (spacing_m or 1.0)
    time_s = length_m / 2 / out + length_m / 2 / back + rows * flying.turn_s
    return _Course(heading_deg=heading_deg, seen=seen, spacing_m=spacing_m, crab_deg=crab_deg, time_s=time_s)


def _run_in(lane: Lane, flying: Flying, airspace: Airspace) -> Lane:
    """Return the lane with room to settle before and behind it, where there is some."""
    length_m = math.dist(lane.start, lane.end)
    if flying.run_in_m <= 0 or length_m <= 0:
        return lane
    (east, north), (to_east, to_north) = lane.start, lane.end
    step = (flying.run_in_m * (to_east - east) / length_m, flying.run_in_m * (to_north - north) / length_m)
    before, behind = (east - step[0], north - step[1]), (to_east + step[0], to_north + step[1])
    start = before if airspace.keeps_margin(before, lane.start) else lane.start
    end = behind if airspace.keeps_margin(lane.end, behind) else lane.end
    return Lane(row=lane.row, start=start, end=end, along_m=lane.along_m)


def _joined(order: list[tuple[Metres, Metres]], start: Metres, router: Router) -> Iterator[Metres]:
    """Yield the way through all lanes."""
    here = start
    for begin, end in order:
        yield from router.between(here, begin) or ()  # there is one: the lanes lie within reach
        yield begin
        if end != begin:
            yield end
        here = end
