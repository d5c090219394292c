"""Grounds to search for tests, and what a camera truly sees of them, worked out point by point and without polygons."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from hypothesis import strategies as st
from shapely.geometry import MultiPolygon, Polygon

from autopilot.geo.airspace import Airspace, Metres, polygon_fault
from autopilot.geo.footprint import SPOT_M, Footprint
from autopilot.geo.wind import Wind, on_track

MARGIN_M = 10.0
REACH_M = 5000.0
STEP_M = 4.0  # between the points that are looked at


def star(radii_m: Sequence[float], centre: Metres = (0.0, 0.0), turn: float = 0.0) -> list[Metres]:
    """Return a polygon with corners at these distances, evenly around its centre."""
    angles = [turn + math.tau * corner / len(radii_m) for corner in range(len(radii_m))]
    return [
        (centre[0] + radius_m * math.sin(angle), centre[1] + radius_m * math.cos(angle))
        for radius_m, angle in zip(radii_m, angles, strict=True)
    ]


@st.composite
def regions(draw: st.DrawFn) -> Polygon:
    """Draw a region, convex or not."""
    radii = draw(st.lists(st.integers(120, 420), min_size=3, max_size=9))
    corners = star([float(radius) for radius in radii], turn=draw(st.floats(0, math.tau)))
    assert polygon_fault(corners) == ""
    return Polygon(corners)


@st.composite
def holes(draw: st.DrawFn) -> list[Polygon]:
    """Draw up to three places to keep out of, somewhere in the region or beside it."""
    made = []
    for _ in range(draw(st.integers(0, 3))):
        centre = (float(draw(st.integers(-250, 250))), float(draw(st.integers(-250, 250))))
        radius_m = float(draw(st.integers(15, 80)))
        corners = draw(st.integers(4, 8))
        made.append(Polygon(star([radius_m] * corners, centre, draw(st.floats(0, math.tau)))))
    return made


def airspace(
    inclusions: Sequence[Polygon] = (), exclusions: Sequence[Polygon] = (), margin_m: float = MARGIN_M
) -> Airspace:
    """Return the room that fences leave."""
    return Airspace(list(inclusions), list(exclusions), margin_m, REACH_M)


def part_seen(
    ground: MultiPolygon,
    lanes: Sequence[tuple[Metres, Metres]],
    level: Footprint,
    wind: Wind,
    airspeed_mps: float | None,
) -> float:
    """Return the part of the ground that is seen from the lanes, 0 to 1.

    The picture is a rectangle under the aircraft whose long side lies across the nose. With an airspeed the nose turns
    into the wind. A lane that is one look shows the circle that any heading shows.
    """
    west_m, south_m, east_m, north_m = ground.bounds
    easts, norths = np.meshgrid(
        np.arange(west_m + STEP_M / 2, east_m, STEP_M), np.arange(south_m + STEP_M / 2, north_m, STEP_M)
    )
    east, north = easts.ravel(), norths.ravel()
    inside = shapely.contains_xy(ground, east, north)
    east, north = east[inside], north[inside]
    seen = np.zeros(east.shape, dtype=bool)
    for start, end in lanes:
        seen |= _seen(east - start[0], north - start[1], start, end, level, wind, airspeed_mps)
    return float(seen.mean())


def _seen(
    east: Any, north: Any, start: Metres, end: Metres, level: Footprint, wind: Wind, airspeed_mps: float | None
) -> Any:
    length_m = math.dist(start, end)
    if length_m < SPOT_M:
        return np.hypot(east, north) <= min(level.across_m, level.along_m) / 2
    track = math.atan2(end[0] - start[0], end[1] - start[1])
    flown = None if airspeed_mps is None else on_track(math.degrees(track), airspeed_mps, wind)
    crab = 0.0 if flown is None else math.radians(flown.crab_deg)
    along = east * math.sin(track) + north * math.cos(track)
    right = east * math.cos(track) - north * math.sin(track)
    # Flown s metres, the point lies `along - s` ahead and `right` to the right of the track; in the picture it is
    # ahead' = (along - s) cos + right sin and right' = right cos - (along - s) sin. Which s show it?
    low, high = along - length_m, along.copy()
    low, high = _within(low, high, math.cos(crab), right * math.sin(crab), level.along_m / 2)
    low, high = _within(low, high, -math.sin(crab), right * math.cos(crab), level.across_m / 2)
    return low <= high


def _within(low: Any, high: Any, factor: float, offset: Any, most: float) -> tuple[Any, Any]:
    """Narrow an interval of x to where |factor x + offset| <= most."""
    if abs(factor) < 1e-12:
        out = np.abs(offset) > most
        return np.where(out, np.inf, low), np.where(out, -np.inf, high)
    one, other = (-most - offset) / factor, (most - offset) / factor
    return np.maximum(low, np.minimum(one, other)), np.minimum(high, np.maximum(one, other))
