"""Many cuts of one life: after every operation, what may be left is laid out, started on, and held to the promises."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from random import Random
from shutil import rmtree

from tests.disk.cuts import cuts_of
from tests.disk.lives import folder
from tests.disk.model import Disk, Image, Op, digest, write_out
from tests.disk.promises import Outcome, Promised, broken
from tests.disk.recovery import start_on
from tests.disk.trace import Setting, Trace, record

# Choices that are drawn for one state that is wanted: many are equal where little is on its way.
DRAWS = 3


@dataclass(slots=True)
class Tally:
    """What came of many states. A state is a point of a life and what a cut there left; equal ones count once."""

    lives: int = 0
    points: int = 0
    states: int = 0
    images: int = 0
    acknowledged: int = 0  # records, SYNC and GROUP, summed over states
    synced: int = 0  # of these, class SYNC and effects
    effects: int = 0  # that had left, summed over states
    actions: Counter[str] = field(default_factory=Counter)
    broken: Counter[str] = field(default_factory=Counter)
    examples: list[str] = field(default_factory=list)

    def add(self, other: Tally) -> None:
        """Take in what came of other lives."""
        for name in ("lives", "points", "states", "images", "acknowledged", "synced", "effects"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.actions += other.actions
        self.broken += other.broken
        self.examples = (self.examples + other.examples)[:5]


@dataclass(slots=True)
class _Life:
    """One life that is cut off again and again."""

    trace: Trace
    root: Path
    tearing: bool
    chance: Random
    tally: Tally = field(default_factory=lambda: Tally(lives=1))
    outcomes: dict[bytes, Outcome] = field(default_factory=dict)

    def cut_at_every_point(self, states: int) -> None:
        """Cut `states` times between any two operations, where there are so many ways."""
        disk, promised = Disk(self.trace.base), self.trace.before.copy()
        for entry in self.trace.entries:
            if isinstance(entry, Op):
                self._cut(disk, promised, states)
                disk.do(entry)
            else:
                promised.add(entry)
        self._cut(disk, promised, states)

    def _cut(self, disk: Disk, promised: Promised, states: int) -> None:
        self.tally.points += 1
        seen: set[bytes] = set()
        choices = cuts_of(disk, self.chance, tearing=self.tearing)
        for choice in islice(choices, states * DRAWS):
            image = disk.after(choice)
            told = digest(image)
            if told in seen:
                continue
            seen.add(told)
            self._judge(image, told, promised, disk.done)
            if len(seen) == states:
                return

    def _judge(self, image: Image, told: bytes, promised: Promised, point: int) -> None:
        tally = self.tally
        if told not in self.outcomes:
            self.outcomes[told] = self._start(image)
            tally.images += 1
        outcome = self.outcomes[told]
        tally.states += 1
        tally.acknowledged += sum(map(len, promised.logs.values())) // 8
        tally.synced += promised.synced
        tally.effects += len(promised.performed)
        tally.actions.update(outcome.actions or ("there is no log",))
        for one in set(broken(promised, outcome)):
            tally.broken[one.partition(":")[0]] += 1
            tally.examples.append(f"operation {point}: {one}")

    def _start(self, image: Image) -> Outcome:
        place = self.root / "disk"
        place.mkdir()
        write_out(image, place)
        try:
            return start_on(place)
        finally:
            rmtree(place)


def cut_life(seed: int, states: int, *, setting: Setting | None = None, tearing: bool = False) -> Tally:
    """Cut one life off at every point; every other life begins on what a cut of an earlier one has left."""
    trace = _second(seed, tearing) if seed % 2 else record(seed, setting)
    with folder() as root:
        life = _Life(trace, root, tearing, Random(f"cut {seed}"))
        life.cut_at_every_point(states)
    life.tally.examples = [f"life {seed}, {one}" for one in life.tally.examples[:5]]
    return life.tally


def _second(seed: int, tearing: bool) -> Trace:
    """Return a life on a disk that was cut off in another one: its first start is a recovery, and is cut too."""
    first, chance = record(seed - 1), Random(f"second {seed}")
    at = chance.randrange(len(first.entries))
    disk, promised = Disk(first.base), first.before.copy()
    for number, entry in enumerate(first.entries):
        if isinstance(entry, Op):
            if number > at and len(disk.pending()) > 1:
                break
            disk.do(entry)
        else:
            promised.add(entry)
    *_, cut = islice(cuts_of(disk, chance, tearing=tearing), 2, 6)
    return record(seed, base=disk.after(cut), before=promised)
