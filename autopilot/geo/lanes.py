"""Parallel lanes over a region, and single ones for what parallel lanes cannot reach.

Rows lie evenly across the region, no farther apart than asked. A row is flown as far as any part of its strip of the
region reaches, so strips between slanted edges are seen whole; where a fence's margin cuts it, it has several lanes.
What such cuts leave unseen along slanted fences is searched for and gets lanes of its own (`patches`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import shapely
from shapely.affinity import affine_transform
from shapely.geometry import LineString, MultiPolygon, Point
from shapely.geometry.base import BaseGeometry
from shapely.ops import nearest_points

from autopilot.geo.airspace import TOUCH_M, Metres, parts
from autopilot.geo.footprint import SPOT_M, Footprint, Lane, seen_from

PATCHES_MAX = 60
PATCHED_ENOUGH = 0.998  # of the region; below it another look may be worth its way
_WORTH_M2 = 1.0  # a patch that shows less is not flown


@dataclass(frozen=True, slots=True)
class Axes:
    """Metres along a heading and to the left of it, instead of east and north."""

    heading_deg: float

    def turned(self, shape: BaseGeometry) -> BaseGeometry:
        """Return a shape in these axes."""
        sine, cosine = self._sides
        return affine_transform(shape, [sine, cosine, -cosine, sine, 0.0, 0.0])

    def back(self, along_m: float, left_m: float) -> Metres:
        """Return a point of these axes as east and north."""
        sine, cosine = self._sides
        return along_m * sine - left_m * cosine, along_m * cosine + left_m * sine

    @property
    def _sides(self) -> tuple[float, float]:
        heading = math.radians(self.heading_deg)
        return math.sin(heading), math.cos(heading)


def rows_of(region: MultiPolygon, heading_deg: float, spacing_m: float) -> int:
    """Return how many rows a region takes."""
    _, low_m, _, high_m = Axes(heading_deg).turned(region).bounds
    return max(1, math.ceil((high_m - low_m) / spacing_m))


def parallel_lanes(region: MultiPolygon, flyable: MultiPolygon, heading_deg: float, spacing_m: float) -> list[Lane]:
    """Return the lanes of every row, from the right of the heading to its left."""
    axes = Axes(heading_deg)
    turned, room = axes.turned(region), axes.turned(flyable)
    west_m, low_m, east_m, high_m = turned.bounds
    count = rows_of(region, heading_deg, spacing_m)
    pitch_m = (high_m - low_m) / count
    edges = [(low_m + row * pitch_m, low_m + (row + 1) * pitch_m) for row in range(count)]
    strips = shapely.intersection(turned, [shapely.box(west_m - 1, low, east_m + 1, high) for low, high in edges])
    lanes: list[Lane] = []
    for row, ((low, high), strip) in enumerate(zip(edges, strips, strict=True)):
        left_m = (low + high) / 2
        for reach in _merged(parts(strip)):
            lanes += [
                Lane(
                    row=row,
                    start=axes.back(begin, left_m),
                    end=axes.back(end, left_m),
                    along_m=(begin, end),
                )
                for begin, end in _flown(room, reach, left_m)
            ]
    return lanes


def patches(region: MultiPolygon, flyable: MultiPolygon, lanes: Sequence[Lane], seen: Footprint) -> list[Lane]:
    """Return lanes of their own for what `lanes` leave unseen, the largest pieces first."""
    unseen = region.difference(seen_from(lanes, seen))
    added: list[Lane] = []
    given_up: list[BaseGeometry] = []
    while len(added) < PATCHES_MAX and unseen.area > (1 - PATCHED_ENOUGH) * region.area:
        open_parts = [part for part in parts(unseen) if not any(part.intersects(past) for past in given_up)]
        if not open_parts:
            break
        largest = max(open_parts, key=lambda part: part.area)
        best = max(_looks_at(largest, flyable), key=lambda lane: _gain(lane, unseen, seen), default=None)
        if best is None or _gain(best, unseen, seen) < _WORTH_M2:
            given_up.append(largest.buffer(-TOUCH_M))
            continue
        added.append(best)
        unseen = unseen.difference(seen_from([best], seen))
    return added


def _merged(pieces: Sequence[BaseGeometry]) -> list[tuple[float, float]]:
    """Return the reaches of the pieces along the row, those that overlap as one."""
    merged: list[tuple[float, float]] = []
    for begin, end in sorted((piece.bounds[0], piece.bounds[2]) for piece in pieces):
        if merged and begin <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(end, merged[-1][1]))
        else:
            merged.append((begin, end))
    return merged


def _flown(room: BaseGeometry, reach: tuple[float, float], left_m: float) -> Iterator[tuple[float, float]]:
    """Yield what of a row's reach keeps the margin."""
    cut = room.intersection(LineString([(reach[0], left_m), (reach[1], left_m)]))
    for piece in getattr(cut, "geoms", (cut,)):
        if isinstance(piece, LineString) and piece.length > 0:
            yield piece.bounds[0], piece.bounds[2]


def _looks_at(part: BaseGeometry, flyable: MultiPolygon) -> Iterator[Lane]:
    """Yield lanes that may see a piece of ground: along it through its middle, and along the margin beside it."""
    box = part.minimum_rotated_rectangle
    corners = list(getattr(box, "exterior", box).coords)
    sides = [(one, other) for one, other in pairwise(corners[:3]) if math.dist(one, other) > 0]
    inner = part.representative_point()
    anchors = [part.centroid, nearest_points(flyable, part.centroid)[0], nearest_points(flyable, inner)[0]]
    for one, other in sides:
        length_m = math.dist(one, other)
        step = ((other[0] - one[0]) / length_m, (other[1] - one[1]) / length_m)
        for anchor in anchors:
            yield from _through(anchor, step, length_m, flyable)
    beside = part.buffer(2 * SPOT_M).intersection(flyable.boundary)
    for edge in getattr(beside, "geoms", (beside,)):
        if isinstance(edge, LineString) and edge.length > 0:
            yield from (_lane(one, other) for one, other in pairwise(edge.coords))
    spot = anchors[1]
    yield _lane((spot.x, spot.y), (spot.x, spot.y))


def _through(anchor: Point, step: Metres, length_m: float, flyable: MultiPolygon) -> Iterator[Lane]:
    half_m = length_m / 2
    line = LineString(
        [
            (anchor.x - half_m * step[0], anchor.y - half_m * step[1]),
            (anchor.x + half_m * step[0], anchor.y + half_m * step[1]),
        ]
    )
    cut = line.intersection(flyable.buffer(TOUCH_M / 2))
    for piece in getattr(cut, "geoms", (cut,)):
        if isinstance(piece, LineString) and piece.length > 0:
            yield _lane(piece.coords[0], piece.coords[-1])


def _lane(start: Sequence[float], end: Sequence[float]) -> Lane:
    begin, finish = (float(start[0]), float(start[1])), (float(end[0]), float(end[1]))
    return Lane(row=-1, start=begin, end=finish, along_m=(0.0, math.dist(begin, finish)))


def _gain(lane: Lane, unseen: BaseGeometry, seen: Footprint) -> float:
    return float(unseen.intersection(seen_from([lane], seen)).area)
