"""Fences in integers: a point against a polygon, a leg against a polygon, both against many fences.

The frame is the flight's own: whole millimetres east and north of its origin, on a plane (geo.frame makes them). All
tests are exact, for they only multiply, add and compare integers. A polygon is its corners in order, closed by itself;
one that crosses itself is judged by the even-odd rule. A boundary belongs to the unsafe side: on the edge of an
inclusion is outside, on the edge of an exclusion is inside. Of several inclusions all hold, as for the planner and
for ArduPilot unless told otherwise. It knows neither heights nor who flies.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
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


def keeps_inside(start: Point, end: Point, polygon: Polygon) -> bool:
    """Whether every point of a leg lies strictly inside a polygon: it begins there and meets no edge."""
    return is_strictly_inside(start, polygon) and not any(
        _meet(start, end, one, other) for one, other in _edges(polygon)
    )


def judge(fences: Iterable[Fence], at: Point, ahead: Point) -> str:
    """Return OK, or how the way from `at` to `ahead` breaks a fence; a place alone is a way to itself.

    The way must be inside every inclusion and clear of every exclusion. Without fences everything is OK.
    """
    found = OK
    for fence in fences:
        if not fence.inclusion and touches(at, ahead, fence.vertices):
            return EXCLUSION_ENTRY
        if fence.inclusion and not keeps_inside(at, ahead, fence.vertices):
            found = INCLUSION_EXIT
    return found


def enters_once(fences: Sequence[Fence], at: Point, ahead: Point) -> bool:
    """Whether a way leads over each fence once at most, and inwards: it ends where none is broken.

    It must meet each boundary at one edge alone; at a corner it meets two, and is taken for one that grazes.
    """
    crossings = (sum(_meet(at, ahead, one, other) for one, other in _edges(fence.vertices)) for fence in fences)
    return judge(fences, ahead, ahead) == OK and all(crossed <= 1 for crossed in crossings)
