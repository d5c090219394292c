"""What a camera that looks straight down sees of flat ground while it is flown along a lane.

The picture is a rectangle on the ground, its wide side across the nose. On a gimbal that is held level it stays one;
where wind turns the nose away from the track, the rectangle turns with it, and only the band that it fills without
gaps counts. Everything here errs to the side of seeing less.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import shapely
from shapely.geometry import Point, Polygon
from shapely.geometry.base import BaseGeometry

from autopilot.geo.airspace import Metres

SPOT_M = 1.0  # a shorter lane is one look, and which way the nose points there is not known


@dataclass(frozen=True, slots=True, kw_only=True)
class Footprint:
    """What is surely seen around the camera's foot."""

    across_m: float  # at right angles to the track
    along_m: float  # along the track


@dataclass(frozen=True, slots=True, kw_only=True)
class Lane:
    """A straight stretch that is flown for what the camera sees."""

    row: int  # its place among the parallel ones, from the right; -1 where it is none of them
    start: Metres
    end: Metres
    along_m: tuple[float, float]  # where it starts and ends on the axis of its row


def footprint(height_m: float, field_of_view_deg: float, aspect: float) -> Footprint:
    """Return what a level picture covers; `field_of_view_deg` is horizontal, `aspect` is width to height."""
    across_m = 2 * height_m * math.tan(math.radians(field_of_view_deg) / 2)
    return Footprint(across_m=across_m, along_m=across_m / aspect)


def crabbed(level: Footprint, crab_deg: float) -> Footprint | None:
    """Return what is left of a picture that is turned against the track; None where no gapless band is left.

    The band is where the turned rectangle still has both its long sides: W cos b - L sin b wide. At a lane's end the
    slanted edge takes away what the band's far corner lacks.
    """
    turn = math.radians(abs(crab_deg))
    across_m = level.across_m * math.cos(turn) - level.along_m * math.sin(turn)
    if across_m <= 0:
        return None
    along_m = level.along_m / math.cos(turn) - across_m * math.tan(turn)
    return Footprint(across_m=across_m, along_m=max(along_m, 0.0))


def seen_from(lanes: Iterable[Lane], seen: Footprint) -> BaseGeometry:
    """Return the ground that is seen while these lanes are flown."""
    return shapely.union_all([_swath(lane, seen) for lane in lanes])


def _swath(lane: Lane, seen: Footprint) -> Polygon:
    (east, north), (to_east, to_north) = lane.start, lane.end
    length_m = math.dist(lane.start, lane.end)
    if length_m < SPOT_M:
        return Point(lane.start).buffer(min(seen.across_m, seen.along_m) / 2)
    ahead_east, ahead_north = (to_east - east) / length_m, (to_north - north) / length_m
    reach_m, half_m = seen.along_m / 2, seen.across_m / 2
    back = (east - reach_m * ahead_east, north - reach_m * ahead_north)
    front = (to_east + reach_m * ahead_east, to_north + reach_m * ahead_north)
    side = (-half_m * ahead_north, half_m * ahead_east)
    return Polygon(
        [
            (back[0] + side[0], back[1] + side[1]),
            (front[0] + side[0], front[1] + side[1]),
            (front[0] - side[0], front[1] - side[1]),
            (back[0] - side[0], back[1] - side[1]),
        ]
    )
