"""How a power cut chooses among what was on its way: a few ways that are likely to hurt, and chance.

`nothing` and `everything` are the ends; `prefix` is a disk that keeps the order and may tear the write it was at;
`without` and `alone` are a disk that keeps none; `anything` draws each sector and each name for itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from random import Random

from tests.disk.model import Disk

SECTORS = (512, 4096)
_ALL = 1 << 60


@dataclass(slots=True)
class Chosen:
    """One choice. `limit` is the number up to which things arrive, `exceptions` what is otherwise."""

    sector: int
    zeros: bool
    limit: int = _ALL
    missing: int | None = None
    alone: int | None = None
    chance: Random | None = None
    tear: tuple[int, int] | None = None
    _drawn: dict[tuple[int, int], int] = field(default_factory=dict)

    def version(self, file: int, sector: int, numbers: list[int]) -> int:
        """See `model.Cut`."""
        if self.chance is not None:
            return self._drawn.setdefault((file, sector), self.chance.choice([0, *numbers]))
        if self.missing in numbers:
            return numbers[numbers.index(self.missing) - 1] if self.missing != numbers[0] else 0
        if self.alone is not None:
            return self.alone if self.alone in numbers else 0
        return self.limit

    def has(self, number: int) -> bool:
        """See `model.Cut`."""
        if self.chance is not None:
            return self._drawn.setdefault((-1, number), self.chance.randrange(2)) == 1
        if self.alone is not None:
            return number == self.alone
        return number <= self.limit and number != self.missing

    def torn(self, number: int) -> int | None:
        """See `model.Cut`."""
        return self.tear[1] if self.tear is not None and self.tear[0] == number else None


Way = Callable[[Disk, Random, int, bool], Chosen]


def nothing(_disk: Disk, _chance: Random, sector: int, zeros: bool) -> Chosen:
    """Lose all that was on its way."""
    return Chosen(sector, zeros, limit=0)


def everything(_disk: Disk, _chance: Random, sector: int, zeros: bool) -> Chosen:
    """Lose nothing: the process was killed."""
    return Chosen(sector, zeros)


def prefix(disk: Disk, chance: Random, sector: int, zeros: bool) -> Chosen:
    """Keep what was first, and of the next write some whole sectors."""
    at = chance.choice(disk.pending())
    chosen, write = Chosen(sector, zeros, limit=at - 1), disk.write(at)
    if write is not None:
        start, size = write.offset % sector, len(write.data)
        chosen.tear = at, chance.choice([0, *range(sector - start, size, sector)])
    return chosen


def torn(disk: Disk, chance: Random, sector: int, zeros: bool) -> Chosen:
    """Keep what was first, and of the next write any number of bytes."""
    at = chance.choice(disk.pending())
    chosen, write = Chosen(sector, zeros, limit=at - 1), disk.write(at)
    if write is not None:
        chosen.tear = at, chance.randrange(len(write.data) + 1)
    return chosen


def without(disk: Disk, chance: Random, sector: int, zeros: bool) -> Chosen:
    """Lose one operation."""
    return Chosen(sector, zeros, missing=chance.choice(disk.pending()))


def alone(disk: Disk, chance: Random, sector: int, zeros: bool) -> Chosen:
    """Keep one operation."""
    return Chosen(sector, zeros, alone=chance.choice(disk.pending()))


def anything(_disk: Disk, chance: Random, sector: int, zeros: bool) -> Chosen:
    """Draw everything."""
    return Chosen(sector, zeros, chance=chance)


_WAYS: tuple[Way, ...] = (anything, prefix, anything, without, anything, alone)


def cuts_of(disk: Disk, chance: Random, *, tearing: bool) -> Iterator[Chosen]:
    """Yield choices for ever, the ends first; one where nothing is on its way. `tearing`: a sector too may be torn."""
    yield nothing(disk, chance, SECTORS[0], False)
    if not disk.pending():
        return
    yield everything(disk, chance, SECTORS[0], False)
    ways = (*_WAYS, torn, torn) if tearing else _WAYS
    while True:
        for way in ways:
            yield way(disk, chance, chance.choice(SECTORS), chance.randrange(4) == 0)
