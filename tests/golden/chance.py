"""Flights by chance that are the same everywhere: numbers come from SHA-256 over a seed, not from a generator.

`random` promises the same numbers for one version of Python only. Nothing here checks anything.
"""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256
from typing import TypeVar

from tests.flights import Flight
from tests.stories import Story

T = TypeVar("T")

PAUSES_MS = (20, 20, 20, 150, 150, 4_000, 61_000)
VERBS = ("point", "point", "turn", "release", "confirm p{0}", "decline p{0}", "confirm p{1}", "dance")
PEOPLE = ("by=alpha", "by=bravo", "by=viewer roles=viewer", "by=carol life=200")
CLASSES = ("person", "car", "truck", "dog")
LINES = (
    *("frame {0} {1}", "frame {0} {1} {2}", "frame {0} {1} {2}", "frame {0} camera=2", "frame"),
    *("order", "order", "order", "again o{number}", "again o{number} body=abcd"),
    *("sent newest", "answered newest {result}", "answered newest {result}", "unanswered newest no answer"),
    *("gimbal newest error={result}0", "gimbal newest error=900", "published o{number}", "vehicle {link}"),
    *("start", "malformed m{number}", "answered own {result}", "published o{number} failure=gone"),
)


class Chance:
    """Numbers that follow from a seed."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._drawn = 0

    def below(self, limit: int) -> int:
        """Return the next number, at least 0 and below the limit."""
        self._drawn += 1
        return int.from_bytes(sha256(f"{self._seed}/{self._drawn}".encode()).digest()[:8]) % limit

    def of(self, choices: Sequence[T]) -> T:
        """Return one of these."""
        return choices[self.below(len(choices))]


def by_chance(seed: int, lines: int = 60) -> Flight:
    """Return the flight of a seed: the node may look by itself, and asks after two sightings."""
    chance, story = (
        Chance(seed),
        Story(
            scan_enabled=True, sightings_to_ask=2, frame_rate_floor_mhz=1_000, asks_per_minute=2, dedup_keep_ms=90_000
        ),
    )
    names: list[str] = []
    for _ in range(lines):
        story.flight.wait(chance.of(PAUSES_MS))
        story.tell(_line(chance, names))
    story.tell("close")
    return story.flight


def _line(chance: Chance, names: list[str]) -> str:
    line = chance.of(LINES)
    if line == "order" or not names:
        names.append(f"o{len(names)}")
        about = chance.of(VERBS).format(1 + chance.below(4), 1 + chance.below(9))
        return f"order {names[-1]} {about} {chance.of(PEOPLE)}"
    things = [f"{chance.of(CLASSES)}@{chance.below(60)},{chance.below(30)}:{30 + chance.below(70)}" for _ in range(3)]
    number, link = chance.below(len(names)), chance.of(("up", "up", "down"))
    return line.format(*things, number=number, link=link, result=chance.of((0, 0, 5, 3, 4)))
