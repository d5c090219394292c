"""In which order lanes are flown, and which way.

Lanes that lie beside each other without a hole between are one cell, flown to and fro (the boustrophedon
decomposition: Choset and Pignon, 1997). Cells are taken nearest first, where the way around fences counts; with few
cells every way to begin is tried, and the shortest tour kept. Single lanes that patch what the rows leave are put in
where they cost the least.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import cache

from autopilot.geo.airspace import Metres
from autopilot.geo.footprint import Lane
from autopilot.geo.routing import Router

_ALL_BEGINNINGS = 10  # up to so many cells; there are four beginnings a cell, each with a tour behind it
_ROUTED = 4  # so many of the nearest are asked for their way around fences

Cell = tuple[Lane, ...]
Stretch = tuple[Metres, Metres]
LengthM = Callable[[Metres, Metres], float]


def in_order(lanes: Sequence[Lane], start: Metres, router: Router) -> list[Stretch]:
    """Return the lanes as they are flown from `start`, each from its begin to its end."""
    length_m = cache(router.length_m)
    cells = cells_of([lane for lane in lanes if lane.row >= 0])
    beginnings = [(cell, way) for cell in cells for way in _ways_through(cell)]
    if len(cells) > _ALL_BEGINNINGS:
        beginnings = sorted(beginnings, key=lambda one: math.dist(start, one[1][0][0]))[:1]
    tours = [_tour(cells, cell, way, length_m) for cell, way in beginnings]
    flown = min(tours, key=lambda tour: _between_m(start, tour, length_m), default=[])
    for lane in lanes:
        if lane.row < 0:
            flown = _with(flown, lane, start, length_m)
    return flown


def cells_of(lanes: Sequence[Lane]) -> list[Cell]:
    """Return the lanes in cells: each lane but a cell's last has one lane beside it, and that one no other."""
    rows: dict[int, list[Lane]] = {}
    for lane in lanes:
        rows.setdefault(lane.row, []).append(lane)
    cells: list[list[Lane]] = []
    growing: dict[Lane, list[Lane]] = {}
    for row in sorted(rows):
        before, here = rows.get(row - 1, []), rows[row]
        grown: dict[Lane, list[Lane]] = {}
        for lane in here:
            beside = [other for other in before if _overlap(lane, other)]
            lonely = len(beside) == 1 and sum(_overlap(beside[0], other) for other in here) == 1
            cell = growing[beside[0]] if lonely else []
            if not lonely:
                cells.append(cell)
            cell.append(lane)
            grown[lane] = cell
        growing = grown
    return [tuple(cell) for cell in cells]


def _tour(cells: Sequence[Cell], first: Cell, way: list[Stretch], length_m: LengthM) -> list[Stretch]:
    """Return all cells from a beginning on, the nearest next."""
    left, flown = [cell for cell in cells if cell is not first], list(way)
    while left:
        here = flown[-1][1]
        ways = [(cell, way) for cell in left for way in _ways_through(cell)]
        ways.sort(key=lambda one: math.dist(here, one[1][0][0]))
        cell, nearest = min(ways[:_ROUTED], key=lambda one: length_m(here, one[1][0][0]))
        left.remove(cell)
        flown += nearest
    return flown


def _with(flown: list[Stretch], lane: Lane, start: Metres, length_m: LengthM) -> list[Stretch]:
    """Return the tour with one more lane, where and in the direction that it costs the least."""
    ends = [start, *(end for _, end in flown)]
    begins: list[Metres | None] = [*(begin for begin, _ in flown), None]

    def detour_m(place: int, stretch: Stretch, between: LengthM) -> float:
        before, after = ends[place], begins[place]
        there_m = between(before, stretch[0])
        return there_m if after is None else there_m + between(stretch[1], after) - between(before, after)

    ways = [(place, way) for place in range(len(ends)) for way in ((lane.start, lane.end), (lane.end, lane.start))]
    ways.sort(key=lambda one: detour_m(one[0], one[1], math.dist))
    place, way = min(ways[:_ROUTED], key=lambda one: detour_m(one[0], one[1], length_m))
    return [*flown[:place], way, *flown[place:]]


def _between_m(start: Metres, tour: Sequence[Stretch], length_m: LengthM) -> float:
    """Return the length of all ways between the lanes."""
    ends = [start, *(end for _, end in tour)]
    return sum(length_m(end, begin) for end, (begin, _) in zip(ends, tour, strict=False))


def _overlap(one: Lane, other: Lane) -> bool:
    return one.along_m[0] < other.along_m[1] and other.along_m[0] < one.along_m[1]


def _ways_through(cell: Cell) -> Iterator[list[Stretch]]:
    """Yield the four ways to fly a cell: from its first or last lane, and from either end of it."""
    for lanes in (cell, cell[::-1]):
        for first_back in (0, 1):
            yield [
                (lane.end, lane.start) if (index + first_back) % 2 else (lane.start, lane.end)
                for index, lane in enumerate(lanes)
            ]
