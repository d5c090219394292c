"""In which order lanes are flown, and which way.

Lanes that lie beside each other without a hole between are one cell, flown to and fro (the boustrophedon
decomposition: Choset and Pignon, 1997). Cells are taken nearest first; where a fence stands in the straight way, the
way around it counts. That is no shortest tour, but one whose next step can be seen on the picture.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from autopilot.geo.airspace import Metres
from autopilot.geo.footprint import Lane
from autopilot.geo.routing import Router

_ROUTED = 3  # so many of the nearest are asked for their way around fences

Cell = tuple[Lane, ...]
Stretch = tuple[Metres, Metres]


def in_order(lanes: Sequence[Lane], start: Metres, router: Router) -> list[Stretch]:
    """Return the lanes as they are flown from `start`, each from its begin to its end."""
    left, here, flown = cells_of(lanes), start, []
    while left:
        ways = [(cell, way) for cell in left for way in _ways_through(cell)]
        ways.sort(key=lambda one: math.dist(here, one[1][0][0]))
        at = here
        cell, way = min(ways[:_ROUTED], key=lambda one: router.length_m(at, one[1][0][0]))
        left.remove(cell)
        flown += way
        here = way[-1][1]
    return flown


def cells_of(lanes: Sequence[Lane]) -> list[Cell]:
    """Return the lanes in cells: each lane but a cell's last has one lane beside it, and that one no other."""
    rows: dict[int, list[Lane]] = {}
    for lane in lanes:
        rows.setdefault(lane.row, []).append(lane)
    cells: list[list[Lane]] = [[lane] for lane in rows.pop(-1, [])]
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
