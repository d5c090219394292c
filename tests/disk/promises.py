"""What a node promised before a cut, and whether the next start keeps it.

Every commit that returned is a promise, of a SYNC record or not; so is each effect that left, and each checkpoint
that was stored. `broken` holds them against what a start found and did.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from hashlib import blake2b
from typing import NamedTuple

from events.records import Record, Stored
from statecharts.charts.command import FINAL

PRINT_BYTES = 8
# What a cut log held beyond what was promised: durable, but the power went before its commit returned.
_UNPROMISED = b"\0"


class Committed(NamedTuple):
    """A commit returned."""

    flight: bytes
    first: int
    prints: bytes
    synced: int  # how many of them are of class SYNC


class Performed(NamedTuple):
    """An effect left."""

    flight: bytes
    seq: int
    print: bytes
    order: str | None  # the order that it serves; None for what may be repeated


class Sealed(NamedTuple):
    """A checkpoint was stored."""

    flight: bytes
    size: int


Promise = Committed | Performed | Sealed


@dataclass(slots=True)
class Promised:
    """All promises so far."""

    logs: dict[bytes, bytes] = field(default_factory=dict)
    performed: list[Performed] = field(default_factory=list)
    sealed: set[Sealed] = field(default_factory=set)
    synced: int = 0

    def add(self, promise: Promise) -> None:
        """Take one more."""
        match promise:
            case Committed(flight, first, prints, synced):
                known = self.logs.get(flight, b"")
                assert len(known) <= first * PRINT_BYTES, f"a commit begins at {first}"
                self.logs[flight] = known.ljust(first * PRINT_BYTES, _UNPROMISED) + prints
                self.synced += synced
            case Performed():
                self.performed.append(promise)
            case Sealed():
                self.sealed.add(promise)

    def copy(self) -> Promised:
        """Return them as they are now."""
        return deepcopy(self)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What the next start found, and what it did."""

    actions: tuple[str, ...] = ()  # of the examinations
    logs: dict[bytes, bytes] = field(default_factory=dict)
    sealed: frozenset[Sealed] = frozenset()
    performed: tuple[Performed, ...] = ()
    orders: dict[str, str] = field(default_factory=dict)  # their states
    failure: str = ""


def print_of(record: Record | Stored) -> bytes:
    """Return what tells a record from every other that could stand in its place."""
    kind = record.kind.number if isinstance(record, Record) else record.kind_number
    told = repr((record.seq, record.cause, tuple(record.at), kind, record.version)).encode()
    return blake2b(told + record.body, digest_size=PRINT_BYTES).digest()


LOST = "a record that was acknowledged is lost"
REPLACED = "a record that was acknowledged is another one"
UNRECORDED = "an effect had left without its record"
TWICE = "an effect was performed twice"
OPEN = "an order that had been performed is left open"
UNSEALED = "a checkpoint that was stored is lost"
ALARM = "a power cut is taken for damage"
FAILED = "the next start fails"


def broken(promised: Promised, outcome: Outcome) -> Iterator[str]:
    """Yield the promises that are not kept."""
    if outcome.failure:
        yield f"{FAILED}: {outcome.failure}"
        return
    if any(action.startswith("keep") for action in outcome.actions):
        yield ALARM
    for flight, prints in promised.logs.items():
        found = outcome.logs.get(flight, b"")
        if len(found) < len(prints):
            yield LOST
        if not prints.startswith(found[: len(prints)]) and _replaced(prints, found):
            yield REPLACED
    yield from _of_effects(promised, outcome)
    if not promised.sealed <= outcome.sealed:
        yield UNSEALED


def _replaced(prints: bytes, found: bytes) -> bool:
    pairs = (
        (prints[at : at + PRINT_BYTES], found[at : at + PRINT_BYTES])
        for at in range(0, min(len(prints), len(found)), PRINT_BYTES)
    )
    return any(mine != theirs and mine != _UNPROMISED * PRINT_BYTES for mine, theirs in pairs)


def _of_effects(promised: Promised, outcome: Outcome) -> Iterator[str]:
    done = {(one.flight, one.seq) for one in outcome.performed}
    served = {one.order for one in outcome.performed if one.order}
    for one in promised.performed:
        at = one.seq * PRINT_BYTES
        if outcome.logs.get(one.flight, b"")[at : at + PRINT_BYTES] != one.print:
            yield UNRECORDED
        if one.order is None:
            continue
        if (one.flight, one.seq) in done or one.order in served:
            yield TWICE
        if one.order and outcome.orders.get(one.order) not in FINAL:
            yield OPEN
