"""Fences in integers, held against Shapely, which computes the same in floats with exact predicates."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from statecharts import geometry
from statecharts.geometry import EXCLUSION_ENTRY, INCLUSION_EXIT, OK, Fence
from tests.checks import check_equal

SQUARE = ((0, 0), (10, 0), (10, 10), (0, 10))
NEXT = ((8, 0), (20, 0), (20, 10), (8, 10))
BAY = ((0, 0), (30, 0), (30, 30), (20, 30), (20, 10), (10, 10), (10, 30), (0, 30))
BOW = ((0, 0), (10, 10), (10, 0), (0, 10))
BOW_IN = (False, False, True, True)

SMALL = st.integers(-6, 6)
WIDE = st.integers(-50_000_000, 50_000_000)
Spot = tuple[int, int]


def check_leg(start: Spot, end: Spot, expected: str, *fences: Fence) -> None:
    """Check a leg, there and back."""
    check_equal((geometry.judge(fences, start, end), geometry.judge(fences, end, start)), (expected, expected))


def star(corners: list[Spot]) -> tuple[Spot, ...]:
    """Return these corners as a polygon that does not cross itself: sorted by their angle around their middle."""
    east, north = (sum(one[axis] for one in corners) / len(corners) for axis in (0, 1))
    around = sorted(
        dict.fromkeys(corners),
        key=lambda one: (
            math.atan2(one[1] - north, one[0] - east),
            math.hypot(one[0] - east, one[1] - north),
        ),
    )
    return tuple(around)


def polygons(numbers: st.SearchStrategy[int]) -> st.SearchStrategy[tuple[Spot, ...]]:
    """Return polygons that Shapely calls valid."""
    corners = st.lists(st.tuples(numbers, numbers), min_size=3, max_size=9, unique=True)
    return corners.map(star).filter(lambda one: len(one) > 2 and Polygon(one).is_valid)


def spots(numbers: st.SearchStrategy[int]) -> st.SearchStrategy[Spot]:
    """Return points."""
    return st.tuples(numbers, numbers)


def shaped(start: Spot, end: Spot) -> BaseGeometry:
    """Return a leg as Shapely has it."""
    return Point(start) if start == end else LineString([start, end])


@pytest.mark.parametrize(
    ("point", "inside"),
    [
        ((5, 5), True),
        ((0, 0), False),
        ((10, 5), False),
        ((5, 0), False),
        ((5, 10), False),
        ((9, 9), True),
        ((-1, 0), False),
        ((11, 10), False),
        ((-3, 10), False),
    ],
)
def test_a_boundary_is_the_unsafe_side(point: Spot, inside: bool) -> None:
    """On the edge of an inclusion is out, on the edge of an exclusion is in."""
    check_equal(geometry.is_strictly_inside(point, SQUARE), inside)
    check_leg(point, point, OK if inside else INCLUSION_EXIT, Fence(True, SQUARE))
    shut = Point(point).intersects(Polygon(SQUARE))
    check_leg(point, point, EXCLUSION_ENTRY if shut else OK, Fence(False, SQUARE))


def test_no_fences_are_ok() -> None:
    """Where nothing is fenced, nothing is broken; an exclusion alone leaves the rest free."""
    check_leg((0, 0), (10**9, 0), OK)
    check_leg((20, 20), (30, 20), OK, Fence(False, SQUARE))


def test_a_leg_across() -> None:
    """Ends that are fine do not make a leg fine."""
    check_leg((-5, 5), (15, 5), EXCLUSION_ENTRY, Fence(False, SQUARE))
    check_leg((5, 20), (25, 20), INCLUSION_EXIT, Fence(True, BAY))
    check_leg((5, 5), (25, 5), OK, Fence(True, BAY))
    check_leg((-5, 0), (5, -5), OK, Fence(False, SQUARE))
    check_leg((-5, 5), (5, -5), EXCLUSION_ENTRY, Fence(False, SQUARE))
    check_leg((-5, 0), (-1, 0), OK, Fence(False, SQUARE))
    check_leg((-5, 0), (0, 0), EXCLUSION_ENTRY, Fence(False, SQUARE))
    check_leg((-5, 10), (30, 10), EXCLUSION_ENTRY, Fence(False, SQUARE))
    check_leg((12, 4), (12, 40), EXCLUSION_ENTRY, Fence(False, BAY))
    check_leg((15, 20), (15, 40), OK, Fence(False, BAY))


def test_inside_every_inclusion() -> None:
    """A way must keep them all: what lies in one of them only is out, and so is what leaves where they overlap."""
    check_leg((9, 5), (9, 6), OK, Fence(True, SQUARE), Fence(True, NEXT))
    check_leg((9, 5), (7, 5), INCLUSION_EXIT, Fence(True, SQUARE), Fence(True, NEXT))
    check_leg((9, 5), (10, 5), INCLUSION_EXIT, Fence(True, SQUARE), Fence(True, NEXT))
    check_leg((5, 5), (5, 5), INCLUSION_EXIT, Fence(True, SQUARE), Fence(True, NEXT))
    check_leg((15, 5), (15, 5), INCLUSION_EXIT, Fence(True, SQUARE), Fence(True, NEXT))
    check_leg((9, 5), (9, 6), EXCLUSION_ENTRY, Fence(True, SQUARE), Fence(True, NEXT), Fence(False, NEXT))


def test_an_exclusion_is_named_first() -> None:
    """Whatever the order of the fences, and whether or not an inclusion is left as well."""
    for fences in ((Fence(True, SQUARE), Fence(False, NEXT)), (Fence(False, NEXT), Fence(True, SQUARE))):
        check_leg((15, 5), (15, 5), EXCLUSION_ENTRY, *fences)
        check_leg((25, 5), (25, 5), INCLUSION_EXIT, *fences)


def test_odd_polygons() -> None:
    """One that crosses itself is judged by the even-odd rule; one without an area holds nothing but its line."""
    check_equal([geometry.is_strictly_inside(point, BOW) for point in ((5, 2), (5, 8), (2, 5), (8, 5))], list(BOW_IN))
    for polygon in ((), ((0, 0),), ((0, 0), (10, 0)), ((0, 0), (5, 0), (10, 0))):
        check_leg((5, 5), (5, 5), INCLUSION_EXIT, Fence(True, polygon))
        check_leg((5, 5), (6, 6), OK, Fence(False, polygon))
    check_leg((5, 5), (5, -5), EXCLUSION_ENTRY, Fence(False, ((0, 0), (10, 0))))


@settings(max_examples=150, deadline=None)
@given(st.one_of([st.tuples(polygons(n), spots(n), spots(n)) for n in (SMALL, WIDE)]))
def test_one_fence_as_shapely_has_it(drawn: tuple[tuple[Spot, ...], Spot, Spot]) -> None:
    """A leg in an inclusion is properly contained; a leg clear of an exclusion has no point in common with it."""
    polygon, start, end = drawn
    shape, leg = Polygon(polygon), shaped(start, end)
    check_leg(start, end, OK if shape.contains_properly(leg) else INCLUSION_EXIT, Fence(True, polygon))
    check_leg(start, end, EXCLUSION_ENTRY if shape.intersects(leg) else OK, Fence(False, polygon))


@settings(max_examples=150, deadline=None)
@given(st.lists(polygons(SMALL), min_size=2, max_size=4), spots(SMALL), spots(SMALL))
def test_several_inclusions_as_shapely_has_them(areas: list[tuple[Spot, ...]], start: Spot, end: Spot) -> None:
    """A leg is kept where each of them properly contains it."""
    leg = shaped(start, end)
    kept = all(Polygon(area).contains_properly(leg) for area in areas)
    check_leg(start, end, OK if kept else INCLUSION_EXIT, *(Fence(True, area) for area in areas))


@settings(max_examples=300, deadline=None)
@given(st.booleans(), polygons(SMALL), spots(SMALL), spots(SMALL))
def test_a_way_that_enters_once_as_shapely_has_it(
    inclusion: bool, polygon: tuple[Spot, ...], at: Spot, to: Spot
) -> None:
    """Allowed, it is unsafe at its beginning alone; and every such way is, but one at a corner or begun on an edge."""
    shape, leg, found = Polygon(polygon), shaped(at, to), geometry.enters_once((Fence(inclusion, polygon),), at, to)
    unsafe = leg.difference(shape) if inclusion else leg.intersection(shape)
    ends_well = shape.contains_properly(Point(to)) if inclusion else not shape.intersects(Point(to))
    one_piece = unsafe.is_empty or (unsafe.geom_type in ("Point", "LineString") and unsafe.intersects(Point(at)))
    corners = any(leg.intersects(Point(corner)) for corner in polygon) or shape.boundary.intersects(Point(at))
    check_equal(found and not (ends_well and one_piece), False)
    if not corners:
        check_equal(found, ends_well and one_piece)


def test_a_way_over_several_fences() -> None:
    """Each once; one fence that is crossed twice, or at a corner, is one too many."""
    both = (Fence(True, SQUARE), Fence(False, NEXT))
    check_equal(geometry.enters_once((), (0, 0), (5, 5)), True)
    check_equal(geometry.enters_once(both, (12, 5), (5, 5)), True)
    check_equal(geometry.enters_once(both, (25, 5), (5, 5)), False)
    check_equal(geometry.enters_once(both, (-5, 5), (5, 5)), True)
    check_equal(geometry.enters_once(both, (-5, -5), (5, 5)), False)
    check_equal(geometry.enters_once(both, (12, 5), (9, 5)), False)
    check_equal(geometry.enters_once((Fence(True, BAY),), (15, 40), (25, 20)), False)
    check_equal(geometry.enters_once((Fence(True, BAY),), (5, 20), (25, 20)), False)
