"""Where the camera has looked, in truth: the ground that each frame saw, and how much of a region that is.

A footprint is the outline of a frame on the flat ground, in metres east and north of home, cut off at
`RANGE_M` from the camera's foot, where nothing is told apart any more. It is the truth of the world, made
of the true pose; what a node believes to have seen is another thing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import shapely

from autopilot.geo import GroundPoint, LocalFrame, ground_point
from autopilot.sim.gimbal import Gimbal
from autopilot.sim.route import Motion

RANGE_M = 1_000.0
COLUMNS = 9  # of an outline that ends at the range, which is a curve
HALVINGS = 20  # to find where a column meets the range
MOVED_M, TURNED_DEG = 0.5, 0.5  # less than this gives no new footprint


@dataclass(frozen=True, slots=True, kw_only=True)
class Footprint:
    """The pose and lens of a frame; `height_m` is above the flat ground."""

    east_m: float
    north_m: float
    height_m: float
    camera_yaw_deg: float
    camera_pitch_deg: float
    camera_roll_deg: float = 0.0
    field_of_view_deg: float
    width_px: int
    height_px: int

    def outline(self, range_m: float = RANGE_M) -> list[tuple[float, float]]:
        """Return its corners in metres from home, counter-clockwise or clockwise; none where it saw no ground."""
        corners = [self._ground(x, y, range_m) for x, y in ((0, 1), (1, 1), (1, 0), (0, 0))]
        if all(corner is not None for corner in corners):
            return [corner for corner in corners if corner is not None]
        columns = [number / (COLUMNS - 1) for number in range(COLUMNS)]
        lower = [(x, self._ground(x, 1.0, range_m)) for x in columns]
        seen = [(x, low) for x, low in lower if low is not None]
        return [low for _, low in seen] + [self._highest(x, low, range_m) for x, low in reversed(seen)]

    def _highest(self, x: float, low: tuple[float, float], range_m: float) -> tuple[float, float]:
        """Return the farthest point of a column that is within the range."""
        above, below, best = 0.0, 1.0, low
        for _ in range(HALVINGS):
            middle = (above + below) / 2
            point = self._ground(x, middle, range_m)
            above, below, best = (middle, below, best) if point is None else (above, middle, point)
        return best

    def _ground(self, x: float, y: float, range_m: float) -> tuple[float, float] | None:
        point = ground_point(self, x, y, self.field_of_view_deg, self.width_px, self.height_px, range_m)
        if not isinstance(point, GroundPoint):
            return None
        return self.east_m + point.east_m, self.north_m + point.north_m


@dataclass(slots=True)
class Footprints:
    """All footprints of a flight, without those that repeat the one before."""

    field_of_view_deg: float
    width_px: int
    height_px: int
    seen: list[Footprint] = field(default_factory=list)

    def add(self, motion: Motion, gimbal: Gimbal) -> None:
        """Take the pose of a frame that is captured now."""
        new = Footprint(
            east_m=motion.east_m,
            north_m=motion.north_m,
            height_m=motion.up_m,
            camera_yaw_deg=motion.yaw_deg + gimbal.yaw_deg,
            camera_pitch_deg=gimbal.pitch_deg,
            field_of_view_deg=self.field_of_view_deg,
            width_px=self.width_px,
            height_px=self.height_px,
        )
        if not self.seen or _differs(self.seen[-1], new):
            self.seen.append(new)


def coverage(region: Sequence[tuple[float, float]], footprints: Iterable[Footprint], range_m: float = RANGE_M) -> float:
    """Return which part of a region was seen, 0 to 1.

    The region's corners are metres east and north of home. Raises ValueError for one without area.
    """
    whole = shapely.Polygon(region)
    if not whole.is_valid or whole.area <= 0:
        raise ValueError("the region is no simple polygon with an area")
    outlines = [outline for footprint in footprints if len(outline := footprint.outline(range_m)) >= 3]
    polygons = [shapely.Polygon(outline) for outline in outlines]
    union = shapely.union_all([polygon for polygon in polygons if polygon.is_valid])
    return float(union.intersection(whole).area / whole.area)


def region_m(home: LocalFrame, corners_deg: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return corners given as latitude and longitude in metres from home. Raises ValueError off the Earth."""
    places = [home.place(latitude_deg, longitude_deg, 0.0) for latitude_deg, longitude_deg in corners_deg]
    return [(place.east_mm / 1000, place.north_mm / 1000) for place in places]


def _differs(old: Footprint, new: Footprint) -> bool:
    moved_m = math.dist((old.east_m, old.north_m, old.height_m), (new.east_m, new.north_m, new.height_m))
    turned_deg = abs((new.camera_yaw_deg - old.camera_yaw_deg + 180) % 360 - 180)
    tilted_deg = abs(new.camera_pitch_deg - old.camera_pitch_deg)
    return moved_m >= MOVED_M or turned_deg >= TURNED_DEG or tilted_deg >= TURNED_DEG
