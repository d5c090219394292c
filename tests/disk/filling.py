"""A disk that is full, to the block, at the moment in which a flight is to be closed.

Space is counted in blocks of 4 KiB, by the size of files; folders, names and shared memory cost nothing. A write that
does not fit is refused whole, before anything of it is written.
"""

from __future__ import annotations

import errno
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from autopilot.node.loop import Stop
from events.records import read_record
from events.store import StoreFailed, flights_in, read_flight
from tests.autopilot.node.nodes import FakeClock, vehicle_state
from tests.disk.lives import Life, folder, live, witnessed
from tests.disk.model import Do, Op
from tests.disk.promises import Promise, Promised, broken
from tests.disk.recovery import start_on
from tests.disk.seams import meeting

BLOCK = 4096
LANDED, STOPPED = "landed", "stopped"
NOT_CLOSED = "the flight has no end"
NOT_SEALED = "the end of the flight is not signed"
UNSAID = "the flight has no end, and nobody said so"


@dataclass(slots=True)
class Space:
    """Counts blocks, and refuses what needs more than there are."""

    reserves: bool  # whether space can be set aside
    bounded: bool  # False: it only counts
    free: int | None = None  # None: there is always room
    sizes: dict[str, int] = field(default_factory=dict)
    lowest: int = 0  # how many blocks were free at worst

    def __call__(self, op: Op) -> None:
        """Take an operation, or refuse it. Raises OSError."""
        if op.do is Do.GROW and not self.reserves:
            raise OSError(errno.EOPNOTSUPP, "this file system sets no space aside, for a test")
        before = self._blocks()
        sizes, self.sizes = self.sizes, self.sizes | self._after(op)
        if op.do in (Do.DELETE, Do.RENAME):
            self.sizes.pop(op.path, None)
        grown = self._blocks() - before
        if self.free is None:
            return
        if grown > self.free and grown > 0 and self.bounded:
            self.sizes = sizes
            raise OSError(errno.ENOSPC, "this disk is full, for a test")
        self.free -= grown
        self.lowest = min(self.lowest, self.free)

    def _after(self, op: Op) -> dict[str, int]:
        size = self.sizes.get(op.path, 0)
        match op.do:
            case Do.WRITE:
                return {op.path: max(size, op.offset + len(op.data))}
            case Do.SIZE:
                return {op.path: op.offset}
            case Do.GROW:
                return {op.path: max(size, op.offset)}
            case Do.RENAME:
                return {op.target: size}
        return {}

    def _blocks(self) -> int:
        return sum(-(-size // BLOCK) for size in self.sizes.values())


@dataclass(frozen=True, slots=True)
class Ending:
    """What came of one end."""

    said: str  # the failure; "" where there was none
    lowest: int
    closed: str  # the reason that the log gives; "" where it has no end
    broken: tuple[str, ...]


def end(how: str, free: int, *, reserved: bool, bounded: bool = True) -> Ending:
    """Fly, fill the disk but for `free` blocks, end the flight, and hold what is left to what was promised."""
    promises: list[Promise] = []
    space = Space(reserved, bounded)
    with folder() as root, witnessed(promises.append), meeting(root, space):
        life = Life(root, FakeClock(), chance := Random("a full disk"), promises.append, "one").start()
        live(life, chance, [1, 2, 3])
        life.tell(*life.outcomes("vehicle", "mesh"), after_ms=30)
        life.tell(*life.outcomes("mesh"), after_ms=30)
        life.tell(vehicle_state(armed=False), after_ms=30)
        life.turn(200)
        space.free = free
        said = _end(life, how)
        space.free = None
        life.let_go()
        closed, found = _judged(root, said, reserved=reserved)
        promised = Promised()
        for promise in promises:
            promised.add(promise)
        found += broken(promised, start_on(root))
    return Ending(said, space.lowest, closed, tuple(found))


def _end(life: Life, how: str) -> str:
    try:
        if how == LANDED:
            life.turn(6_000)
            life.turn(200)
        else:
            life.loop._finish(life.session, Stop())
    except StoreFailed as error:
        return str(error)
    return ""


def _judged(root: Path, said: str, *, reserved: bool) -> tuple[str, list[str]]:
    """Return why the first flight ended, and what is wrong with its end."""
    reader = read_flight(flights_in(root)[0].folder)
    last = [read_record(stored) for stored in reader.stored(reader.head.seq)][0]
    signed = reader.checkpoints()[-1][0] == reader.head.seq + 1
    reader.close()
    if last.kind.name != "flight_closed":
        return "", [NOT_CLOSED] if reserved else [] if said else [UNSAID]
    return str(last.message), [] if signed or (said and not reserved) else [NOT_SEALED]
