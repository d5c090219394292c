"""Fences in integers: a point against a polygon, a leg against a polygon, both against many fences.

The frame is the flight's own: whole millimetres east and north of its origin, on a plane (geo.frame makes them). All
tests are exact, for they only multiply, add and compare integers. A polygon is its corners in order, closed by itself;
one that crosses itself is judged by the even-odd rule. A boundary belongs to the unsafe side: on the edge of an
inclusion is outside, on the edge of an exclusion is inside. It knows neither heights nor who flies.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple

Point = tuple[int, int]  # east, north
Polygon = tuple[Point, ...]

OK = "ok"
INCLUSION_EXIT = "inclusion_exit"
EXCLUSION_ENTRY = "exclusion_entry"


class Fence(NamedTuple):
    """A polygon to stay inside of, or outside of."""

    inclusion: bool
    vertices: Polygon  # millimetres


class _Share(NamedTuple):
    """A part of a leg: over / under, under being positive."""

    over: int
    under: int


def _edges(polygon: Polygon) -> Iterator[tuple[Point, Point]]:
    if polygon:
        yield from pairwise((*polygon, polygon[0]))


def _turn(start: Point, end: Point, point: Point) -> int:
    """Return the cross product: positive where the point lies left of the way from start to end, 0 on its line."""
    return (end[0] - start[0]) * (point[1] - start[1]) - (end[1] - start[1]) * (point[0] - start[0])


def _is_between(start: Point, end: Point, point: Point) -> bool:
    """Whether a point on the line through start and end lies between them, both included."""
    return min(start[0], end[0]) <= point[0] <= max(start[0], end[0]) and min(start[1], end[1]) <= point[1] <= max(
        start[1], end[1]
    )


def on_boundary(point: Point, polygon: Polygon) -> bool:
    """Whether a point lies on an edge or a corner of a polygon."""
    return any(_turn(start, end, point) == 0 and _is_between(start, end, point) for start, end in _edges(polygon))


def is_strictly_inside(point: Point, polygon: Polygon) -> bool:
    """Whether a point lies in a polygon and on none of its edges: a ray towards east crosses its edges an odd time."""
    if on_boundary(point, polygon):
        return False
    inside = False
    for start, end in _edges(polygon):
        if (start[1] > point[1]) != (end[1] > point[1]):
            upwards = end[1] > start[1]
            inside ^= (_turn(start, end, point) > 0) == upwards
    return inside


def touches(start: Point, end: Point, polygon: Polygon) -> bool:
    """Whether a leg has a point in common with a polygon, its boundary included."""
    if is_strictly_inside(start, polygon):
        return True
    return any(_meet(start, end, one, other) for one, other in _edges(polygon))


def _meet(start: Point, end: Point, one: Point, other: Point) -> bool:
    """Whether two segments have a point in common, their ends included."""
    sides = _turn(start, end, one), _turn(start, end, other), _turn(one, other, start), _turn(one, other, end)
    if (sides[0] > 0) != (sides[1] > 0) and (sides[2] > 0) != (sides[3] > 0):
        return True
    ends = (start, end, one), (start, end, other), (one, other, start), (one, other, end)
    return any(side == 0 and _is_between(*three) for side, three in zip(sides, ends, strict=True))


def is_covered(start: Point, end: Point, polygons: tuple[Polygon, ...]) -> bool:
    """Whether every point of a leg lies strictly inside one of the polygons.

    The leg may go from one into another where they overlap; polygons that only touch are not joined. It is cut where
    it meets an edge: a polygon that a cut lies strictly inside of goes on to the next cut, so the cuts are looked at.
    """
    cuts = [_Share(0, 1), _Share(1, 1)]
    for polygon in polygons:
        for one, other in _edges(polygon):
            if _meet(start, end, one, other):
                cuts.extend(_cuts(start, end, one, other))
    under = 1
    for cut in cuts:
        under *= cut.under
    overs = sorted(dict.fromkeys(cut.over * (under // cut.under) for cut in cuts))
    return all(_is_in_one(start, end, _Share(over, under), polygons) for over in overs)


def _cuts(start: Point, end: Point, one: Point, other: Point) -> Iterator[_Share]:
    """Yield how far along the leg it meets a segment that it is known to meet: once, or from one to another."""
    way = end[0] - start[0], end[1] - start[1]
    edge = other[0] - one[0], other[1] - one[1]
    to = one[0] - start[0], one[1] - start[1]
    across = way[0] * edge[1] - way[1] * edge[0]
    if across:
        over = to[0] * edge[1] - to[1] * edge[0]
        yield _Share(over, across) if across > 0 else _Share(-over, -across)
        return
    length = way[0] * way[0] + way[1] * way[1]
    for point in (one, other) if length else ():
        over = (point[0] - start[0]) * way[0] + (point[1] - start[1]) * way[1]
        if 0 <= over <= length:
            yield _Share(over, length)


def _is_in_one(start: Point, end: Point, share: _Share, polygons: tuple[Polygon, ...]) -> bool:
    """Whether the point so far along the leg lies strictly inside a polygon; all is scaled to keep integers."""
    by = share.under
    point = (
        start[0] * by + (end[0] - start[0]) * share.over,
        start[1] * by + (end[1] - start[1]) * share.over,
    )
    return any(is_strictly_inside(point, tuple((east * by, north * by) for east, north in one)) for one in polygons)


def judge(fences: Iterable[Fence], at: Point, ahead: Point) -> str:
    """Return OK, or how the way from `at` to `ahead` breaks a fence; a place alone is a way to itself.

    Where there are inclusions, being inside any of them is enough. An exclusion holds inside them, too. Without fences
    everything is OK.
    """
    inclusions: list[Polygon] = []
    exclusions: list[Polygon] = []
    for fence in fences:
        (inclusions if fence.inclusion else exclusions).append(fence.vertices)
    if any(touches(at, ahead, polygon) for polygon in exclusions):
        return EXCLUSION_ENTRY
    if inclusions and not is_covered(at, ahead, tuple(inclusions)):
        return INCLUSION_EXIT
    return OK
