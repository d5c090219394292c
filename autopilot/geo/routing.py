"""The shortest way between two points that keeps clear of the fences: a visibility graph, and Dijkstra in it.

A shortest way among polygons bends only at their reflex corners (Lozano-Pérez and Wesley, 1979), here those of the
room that keeps the margin. A start or an end that lies within the margin (home beside a fence) is left on legs that
the fences allow; everything between keeps the margin.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator
from functools import cached_property
from itertools import combinations, pairwise

from shapely.geometry import Polygon
from shapely.geometry.polygon import orient

from autopilot.geo.airspace import Airspace, Metres

CORNERS_MAX = 400  # the graph has half the square of it in edges: more would take minutes on a small computer


class TooManyCorners(Exception):
    """The fences have more reflex corners than a way is looked for among."""


class Router:
    """Finds ways in one airspace; what it worked out is kept for the next."""

    def __init__(self, airspace: Airspace) -> None:
        self._airspace = airspace

    def between(self, start: Metres, end: Metres) -> tuple[Metres, ...] | None:
        """Return the points between start and end, none where the straight leg will do; None: there is no way.

        Raises `TooManyCorners` for fences that are too intricate to look.
        """
        if self._visible(start, end):
            return ()
        corners = self._corners
        begin, finish = len(corners), len(corners) + 1
        graph = {node: list(reached) for node, reached in self._graph.items()}
        graph[begin], graph[finish] = [], []
        for node, place in ((begin, start), (finish, end)):
            for index, corner in enumerate(corners):
                if self._visible(place, corner):
                    graph[node].append((index, math.dist(place, corner)))
                    graph[index].append((node, math.dist(place, corner)))
        way = _shortest(graph, begin, finish)
        return None if way is None else tuple(corners[index] for index in way[1:-1])

    def length_m(self, start: Metres, end: Metres) -> float:
        """Return the length of the way; infinite where there is none."""
        between = self.between(start, end)
        return math.inf if between is None else path_length_m((start, *between, end))

    def _visible(self, one: Metres, other: Metres) -> bool:
        airspace = self._airspace
        if airspace.keeps_margin(one, other):
            return True
        beside_a_fence = not (airspace.keeps_margin(one) and airspace.keeps_margin(other))
        return beside_a_fence and airspace.allows(one, other)

    @cached_property
    def _corners(self) -> tuple[Metres, ...]:
        corners = tuple(dict.fromkeys(corner for part in self._airspace.flyable.geoms for corner in _reflex(part)))
        if len(corners) > CORNERS_MAX:
            raise TooManyCorners(f"the fences have {len(corners)} corners to fly around, more than {CORNERS_MAX}")
        return corners

    @cached_property
    def _graph(self) -> dict[int, list[tuple[int, float]]]:
        corners = self._corners
        pairs = list(combinations(range(len(corners)), 2))
        clear = self._airspace.all_keep_margin([(corners[one], corners[other]) for one, other in pairs])
        graph: dict[int, list[tuple[int, float]]] = {index: [] for index in range(len(corners))}
        for (one, other), is_clear in zip(pairs, clear, strict=True):
            if is_clear:
                length_m = math.dist(corners[one], corners[other])
                graph[one].append((other, length_m))
                graph[other].append((one, length_m))
        return graph


def path_length_m(path: tuple[Metres, ...]) -> float:
    """Return the length of the straight legs through these points."""
    return sum(math.dist(one, other) for one, other in pairwise(path))


def _reflex(part: Polygon) -> Iterator[Metres]:
    """Yield the corners around which a way may bend: with the room on the left hand, those that turn right."""
    room = orient(part)  # the rim goes round left, holes go round right
    for ring in (room.exterior, *room.interiors):
        corners = [(float(east), float(north)) for east, north in list(ring.coords)[:-1]]
        for index, (east, north) in enumerate(corners):
            before, after = corners[index - 1], corners[(index + 1) % len(corners)]
            turn = (east - before[0]) * (after[1] - north) - (north - before[1]) * (after[0] - east)
            if turn < 0:
                yield (east, north)


def _shortest(graph: dict[int, list[tuple[int, float]]], begin: int, finish: int) -> list[int] | None:
    """Return the nodes of the shortest way, both ends included (Dijkstra, 1959)."""
    best, queue = {begin: 0.0}, [(0.0, begin)]
    before: dict[int, int] = {}
    while queue:
        length_m, node = heapq.heappop(queue)
        if node == finish:
            way = [finish]
            while way[-1] != begin:
                way.append(before[way[-1]])
            return way[::-1]
        if length_m > best[node]:
            continue
        for reached, further_m in graph[node]:
            total_m = length_m + further_m
            if total_m < best.get(reached, math.inf):
                best[reached], before[reached] = total_m, node
                heapq.heappush(queue, (total_m, reached))
    return None
