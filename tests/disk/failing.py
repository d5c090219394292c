"""A run in which the n-th operation fails, once or every one from there on, and what is left of it afterwards.

A sync that fails takes with it what it should have made durable, as Linux does: whoever syncs again is lied to.
"""

from __future__ import annotations

import errno
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from events.store import StoreFailed
from tests.autopilot.node.nodes import FakeClock, vehicle_state
from tests.disk.cuts import everything, nothing
from tests.disk.lives import Life, folder, land, live, small, witnessed
from tests.disk.model import Disk, Op, write_out
from tests.disk.promises import Promise, Promised, broken
from tests.disk.recovery import start_on
from tests.disk.seams import meeting

WENT_ON, ENDED = "went on", "ended"
DEFECT = "it ended by a defect"
AFTER = "something was acknowledged or performed after a failure that ended the run"


@dataclass(slots=True)
class FailingDisk:
    """Follows operations and refuses the n-th, or that and all after it."""

    at: int
    stays: bool
    disk: Disk = field(default_factory=Disk)
    seen: list[Op] = field(default_factory=list)
    failed: Op | None = None
    promised: list[Promise] = field(default_factory=list)
    before: int = 0  # promises that had been made when it failed first

    def __call__(self, op: Op) -> None:
        """Take an operation, or refuse it. Raises OSError."""
        self.seen.append(op)
        number = len(self.seen)
        if number == self.at or (self.stays and number > self.at > 0):
            if self.failed is None:
                self.failed, self.before = op, len(self.promised)
            self.disk.fail(op)
            raise OSError(errno.EIO, "this disk fails, for a test")
        self.disk.do(op)


@dataclass(frozen=True, slots=True)
class Run:
    """What came of one run."""

    operations: int
    failed: Op | None
    end: str
    broken: tuple[str, ...]


def run(at: int, *, stays: bool = False) -> Run:
    """Fly a short flight on a disk whose operation `at` (from 1; 0: none) fails, and hold it to what it promised."""
    watch = FailingDisk(at, stays)
    with folder() as root, small():
        place = root / "flights"
        place.mkdir()
        lives: list[Life] = []
        with witnessed(watch.promised.append), meeting(place, watch):
            end, found = _end_of(place, watch, lives)
        for life in lives:
            life.let_go()
        found += [f"as it lies: {one}" for one in _judged(place, watch)]
        for way in (nothing, everything):
            left = root / way.__name__
            left.mkdir()
            write_out(watch.disk.after(way(watch.disk, Random(0), 512, False)), left)
            found += [f"after a power cut, {way.__name__}: {one}" for one in _judged(left, watch)]
    return Run(len(watch.seen), watch.failed, end, tuple(found))


def _end_of(place: Path, watch: FailingDisk, lives: list[Life]) -> tuple[str, list[str]]:
    try:
        lives.extend(_fly(place, watch))
    except StoreFailed:
        return ENDED, [AFTER] if len(watch.promised) > watch.before else []
    except Exception as error:  # noqa: BLE001 - whatever it is, it is what is looked for
        return DEFECT, [f"{DEFECT}: {error!r}"]
    return WENT_ON, []


def _fly(place: Path, watch: FailingDisk) -> Iterator[Life]:
    """Start, take orders, land, begin another flight, stop and start again."""
    chance, clock = Random("a run that fails"), FakeClock()
    first = Life(place, clock, chance, watch.promised.append, "one")
    yield first
    first.start()
    live(first, chance, [1, 2])
    land(first, chance)
    live(first, chance, [3])
    first.tell(vehicle_state(armed=True), after_ms=40)
    first.stop()
    second = Life(place, clock, chance, watch.promised.append, "one")
    yield second
    second.start()
    second.tell(vehicle_state(armed=False), after_ms=40)
    second.stop()


def _judged(place: Path, watch: FailingDisk) -> list[str]:
    promised = Promised()
    for promise in watch.promised:
        promised.add(promise)
    return list(broken(promised, start_on(place)))
