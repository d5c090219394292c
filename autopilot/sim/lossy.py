"""A link that loses, repeats, reorders and delays, by a seed; time is an argument, and there is no socket.

One `Lossy` is one direction. `put` what is sent, take what has arrived with `due`: bytes, or a pair of
address and bytes, or anything else. The same seed and the same calls give the same misfortunes.
"""

from __future__ import annotations

import heapq
import random
from dataclasses import dataclass
from typing import Generic, TypeVar

Thing = TypeVar("Thing")

OVERTAKEN_S = 0.3  # as much later at most comes what is overtaken


@dataclass(slots=True)
class Weather:
    """How bad the link is: probabilities for each thing that is sent, and seconds. Edit it at any time."""

    lost: float = 0.0
    twice: float = 0.0
    overtaken: float = 0.0  # others that are sent later arrive before it
    late_s: float = 0.0  # everything comes late by a random part of this, in order
    least_s: float = 0.0  # and by at least this


class Lossy(Generic[Thing]):
    """One direction of a bad link."""

    def __init__(self, seed: str, weather: Weather | None = None) -> None:
        self.weather = weather or Weather()
        self._chance = random.Random(f"lossy {seed}")
        self._under_way: list[tuple[float, int, Thing]] = []
        self._count = 0
        self._last_s = 0.0

    def put(self, now_s: float, thing: Thing) -> None:
        """Send a thing."""
        weather, chance = self.weather, self._chance
        if chance.random() < weather.lost:
            return
        arrives_s = max(now_s + weather.least_s + chance.random() * weather.late_s, self._last_s)
        if chance.random() < weather.overtaken:
            self._push(arrives_s + chance.random() * OVERTAKEN_S, thing)
        else:
            self._last_s = arrives_s
            self._push(arrives_s, thing)
        if chance.random() < weather.twice:
            self._push(arrives_s + chance.random() * OVERTAKEN_S, thing)

    def due(self, now_s: float) -> list[Thing]:
        """Return what has arrived until now, in the order of arrival."""
        arrived = []
        while self._under_way and self._under_way[0][0] <= now_s:
            arrived.append(heapq.heappop(self._under_way)[2])
        return arrived

    def next_s(self) -> float | None:
        """Return when the next thing arrives, None where nothing is under way."""
        return self._under_way[0][0] if self._under_way else None

    def _push(self, at_s: float, thing: Thing) -> None:
        heapq.heappush(self._under_way, (at_s, self._count, thing))
        self._count += 1
