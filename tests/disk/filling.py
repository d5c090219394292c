"""A disk that is full, to the block, at the moment in which a flight is to be closed.

Space is counted in blocks of 4 KiB, by the size of files; folders, names and shared memory cost nothing. A write that
does not fit is refused whole, before anything of it is written.
"""

from __future__ import annotations

import errno
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from events.records import read_record
from events.schema.flight_pb2 import CloseReason, FlightClosed
from events.store import StoreFailed, flights_in, read_flight
from tests.autopilot.node.nodes import FakeClock, vehicle_state
from tests.disk.lives import Life, folder, live, witnessed
from tests.disk.model import Do, Op
from tests.disk.promises import Promise, Promised, broken
from tests.disk.recovery import start_on
from tests.disk.seams import meeting
from tests.flights import position

BLOCK = 4096
# How a flight ends: some time after landing; by a stop on the ground; and landed on a disk that was full in the air.
WAYS = LANDED, STOPPED, ALOFT = "landed", "stopped", "aloft"
NOT_CLOSED = "the flight has no end"
NOT_SEALED = "the end of the flight is not signed"


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
    signed: bool  # all of it
    broken: tuple[str, ...]

    @property
    def whole(self) -> bool:
        """The flight has its end, and the end is signed."""
        return bool(self.closed) and self.signed


def end(how: str, free: int, *, reserved: bool, bounded: bool = True) -> Ending:
    """Fly, fill the disk but for `free` blocks, end the flight, and hold what is left to what was promised."""
    promises: list[Promise] = []
    space = Space(reserved, bounded)
    with folder() as root, witnessed(promises.append), meeting(root, space):
        life = Life(root, FakeClock(), Random("a full disk"), promises.append, "one").start()
        said = _fly(life, space, how, free)
        space.free = None
        life.let_go()
        closed, signed = _last(root)
        found = _judged(said, closed, signed=signed, reserved=reserved)
        promised = Promised()
        for promise in promises:
            promised.add(promise)
        found += broken(promised, start_on(root))
    return Ending(said, space.lowest, closed, signed, tuple(found))


def _fly(life: Life, space: Space, how: str, free: int) -> str:
    """Fly and end the flight, the disk filled on the way; return how the node failed, "" where it did not."""
    live(life, life.random, [1, 2, 3])
    life.tell(*life.outcomes("vehicle", "mesh"), after_ms=30)
    life.tell(*life.outcomes("mesh"), after_ms=30)
    try:
        if how == ALOFT:
            space.free = free
            for seen in range(20):
                life.tell(position(100 * seen, 200), after_ms=110)
        life.tell(vehicle_state(armed=False), after_ms=30)
        life.turn(200)
        if how != ALOFT:
            space.free = free
        if how == STOPPED:
            life.stop()
        else:
            life.turn(6_000)
            life.turn(200)
    except StoreFailed as error:
        return str(error)
    return ""


def _last(root: Path) -> tuple[str, bool]:
    """Return why the first flight ended, "" where it has no end, and whether all of it is signed."""
    reader = read_flight(flights_in(root)[0].folder)
    (last,) = map(read_record, reader.stored(reader.head.seq))
    signed = reader.checkpoints()[-1][0] == reader.head.seq + 1
    reader.close()
    message = last.message
    return CloseReason.Name(message.reason) if isinstance(message, FlightClosed) else "", signed


def _judged(said: str, closed: str, *, signed: bool, reserved: bool) -> list[str]:
    """Return what is wrong with an end. With space reserved it is whole; without, it is whole or the node says so."""
    if not closed and (reserved or not said):
        return [NOT_CLOSED]
    if closed and not signed and (reserved or not said):
        return [NOT_SEALED]
    return []
