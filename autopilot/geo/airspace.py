"""Where a vehicle may be, on a plane in metres: inside every inclusion, outside every exclusion.

Points are (east, north) in metres from the origin of a local frame. Height plays no part: a fence of seed 004 stands
at every height. `allowed` is what the fences say; `flyable` keeps a margin from them, for a vehicle does not fly on a
line. Nothing here knows degrees, missions or vehicles.
"""

from __future__ import annotations

from collections.abc import Sequence

import shapely
from shapely.geometry import LineString, MultiPolygon, Point, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.validation import explain_validity

Metres = tuple[float, float]  # east, north

TOUCH_M = 0.01  # a line along an edge is inside it: coordinates are floats
_DISC_SEGMENTS = 16  # of a quarter of the disc that stands for "anywhere"


def polygon_fault(corners: Sequence[Metres]) -> str:
    """Return why these corners are no polygon that has one inside, in words; empty where they are one."""
    if len(set(corners)) < 3:
        return "has fewer than 3 different corners"
    shape = Polygon(corners)
    if not shape.is_valid:
        return "crosses or touches itself" if "Self-intersection" in explain_validity(shape) else "has no single inside"
    return "has no area" if shape.area < 1.0 else ""


def parts(shape: BaseGeometry) -> tuple[Polygon, ...]:
    """Return the polygons of any shape; lines and points that an intersection left over are dropped."""
    if isinstance(shape, Polygon):
        return () if shape.is_empty else (shape,)
    inside = getattr(shape, "geoms", ())
    return tuple(part for piece in inside for part in parts(piece))


class Airspace:
    """The room that fences leave.

    `reach_m` bounds it where no inclusion does: a disc around the origin. Fences must be valid polygons
    (`polygon_fault`).
    """

    def __init__(
        self,
        inclusions: Sequence[Polygon],
        exclusions: Sequence[Polygon],
        margin_m: float,
        reach_m: float,
    ) -> None:
        room: BaseGeometry = Point(0, 0).buffer(reach_m, quad_segs=_DISC_SEGMENTS)
        for inside in inclusions:
            room = room.intersection(inside)
        room = room.difference(shapely.union_all(list(exclusions)))
        self.margin_m = margin_m
        self.allowed = MultiPolygon(parts(room))
        self.flyable = MultiPolygon(parts(room.buffer(-margin_m, join_style="mitre")))
        self._allowed_touch = self.allowed.buffer(TOUCH_M)
        self._flyable_touch = self.flyable.buffer(TOUCH_M)
        shapely.prepare(self._allowed_touch)
        shapely.prepare(self._flyable_touch)

    def allows(self, *path: Metres) -> bool:
        """Whether a point, or the straight legs through points, lie in what the fences allow."""
        return bool(self._allowed_touch.covers(_shape(path)))

    def keeps_margin(self, *path: Metres) -> bool:
        """Whether a point, or the straight legs through points, keep the margin from every fence."""
        return bool(self._flyable_touch.covers(_shape(path)))

    def all_keep_margin(self, legs: Sequence[tuple[Metres, Metres]]) -> list[bool]:
        """Say of each leg whether it keeps the margin; much faster than one by one."""
        if not legs:
            return []
        kept: list[bool] = self._flyable_touch.covers(shapely.linestrings(list(legs))).tolist()
        return kept


def _shape(path: Sequence[Metres]) -> BaseGeometry:
    return Point(path[0]) if len(set(path)) == 1 else LineString(path)
