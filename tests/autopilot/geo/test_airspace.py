"""The room that fences leave, and ways in it."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import Polygon

from autopilot.geo import routing
from autopilot.geo.airspace import Metres, polygon_fault
from autopilot.geo.routing import Router, TooManyCorners, path_length_m
from tests.autopilot.geo.grounds import airspace, holes, star

YARD = Polygon([(-200, -200), (200, -200), (200, 200), (-200, 200)])
WALL = Polygon([(-10, -150), (10, -150), (10, 100), (-10, 100)])


@pytest.mark.parametrize(
    ("corners", "fault"),
    [
        ([(0, 0), (10, 0), (10, 10), (0, 10)], ""),
        ([(0, 0), (10, 0), (0, 0), (10, 0)], "has fewer than 3 different corners"),
        ([(0, 0), (10, 10), (10, 0), (0, 10)], "crosses or touches itself"),
        ([(0, 0), (10, 0), (20, 0)], "crosses or touches itself"),
        ([(0, 0), (0.5, 0), (0.5, 0.5), (0, 0.5)], "has no area"),
        ([(0, 0), (10, 0), (10, 10), (5, 0), (0, 10)], "crosses or touches itself"),
    ],
)
def test_what_is_a_polygon(corners: list[Metres], fault: str) -> None:
    """Its rim meets itself nowhere, and something lies in it."""
    found = polygon_fault([(float(east), float(north)) for east, north in corners])
    assert found == fault


def test_inside_every_inclusion_and_outside_every_exclusion() -> None:
    """Two inclusions leave what both allow; the rim is allowed, beyond it is not."""
    other = Polygon([(-100, -300), (300, -300), (300, 300), (-100, 300)])
    room = airspace([YARD, other], [WALL])
    for point, allowed, margin in (
        ((-50.0, 0.0), True, True),
        ((-100.0, 0.0), True, False),
        ((-101.0, 0.0), False, False),
        ((201.0, 0.0), False, False),
        ((0.0, 0.0), False, False),
        ((-10.0, 0.0), True, False),
        ((-19.0, 0.0), True, False),
        ((-21.0, 0.0), True, True),
    ):
        assert (room.allows(point), room.keeps_margin(point)) == (allowed, margin), point


def test_without_an_inclusion_the_reach_bounds() -> None:
    """Far, but not for ever."""
    assert airspace().allows((3000.0, 0.0))
    assert not airspace().allows((5100.0, 0.0))


def check_way(start: Metres, end: Metres, expected: tuple[Metres, ...] | None) -> None:
    """Check the points of a way past the wall in the yard, to the metre."""
    between = Router(airspace([YARD], [WALL])).between(start, end)
    rounded = None if between is None else tuple((round(east), round(north)) for east, north in between)
    assert rounded == expected


def test_ways() -> None:
    """Straight where it can be, around the nearer end of the wall where not, none out of the yard."""
    check_way((-100, 150), (100, 150), ())
    check_way((-100, 0), (100, 0), ((-20, 110), (20, 110)))
    check_way((-100, 60), (100, 130), ((-20, 110),))
    check_way((-100, 105), (100, 105), ((-20, 110), (20, 110)))
    check_way((-100, 0), (300, 0), None)


def test_a_wall_from_side_to_side_leaves_no_way() -> None:
    """Nor one that leaves less than the margin."""
    for north_m in (-200, -185):
        wall = Polygon([(-10, north_m), (10, north_m), (10, 200), (-10, 200)])
        assert Router(airspace([YARD], [wall])).between((-100, 0), (100, 0)) is None
        assert Router(airspace([YARD], [wall])).length_m((-100, 0), (100, 0)) == math.inf


def test_home_beside_a_fence_can_be_left() -> None:
    """From within the margin, straight to where it is kept; but not along the fence."""
    router = Router(airspace([YARD], [WALL]))
    assert router.between((-15, 0), (-100, 0)) == ()
    between = router.between((-15, 0), (100, 0))
    assert between is not None
    assert [(round(east), round(north)) for east, north in between] == [(-20, 110), (20, 110)]


def test_fences_that_are_too_intricate_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rather than looked at for minutes."""
    monkeypatch.setattr(routing, "CORNERS_MAX", 3)
    with pytest.raises(TooManyCorners, match="4 corners to fly around, more than 3"):
        Router(airspace([YARD], [WALL])).between((-100, 0), (100, 0))


@settings(max_examples=60, deadline=None)
@given(holes(), st.integers(0, 7), st.integers(0, 7))
def test_every_way_keeps_the_margin_and_is_no_longer_than_another(fences: list[Polygon], one: int, other: int) -> None:
    """Against the length that rubber would take: never under the straight line, never over a way by a third point."""
    room = airspace(exclusions=fences)
    places = star([600.0] * 8)
    start, end = places[one], places[other]
    router = Router(room)
    between = router.between(start, end)
    assert between is not None
    path = (start, *between, end)
    assert start == end or room.keeps_margin(*path)
    assert path_length_m(path) >= math.dist(start, end) - 1e-6
    third = places[(one + 3) % 8]
    assert path_length_m(path) <= router.length_m(start, third) + router.length_m(third, end) + 1e-6
