"""What led to a record and what it led to.

A decision names the observation that it was made on (`cause`). An outcome from outside names the effect that it
answers (`effect_seq`), so a chain goes on through the world: gimbal reported <- point at place <- order received.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from events import KINDS, NO_CAUSE, BodyBroken, BodyRemoved, UnknownKind, kind_numbered, read_record
from events.records import Stored
from events.store import Reader
from projections.describe import describe

REMOVED = "removed from this copy"
_ANSWERS = {kind.number for kind in KINDS if "effect_seq" in kind.message.DESCRIPTOR.fields_by_name}


@dataclass(frozen=True, slots=True)
class Line:
    """A record for people."""

    seq: int
    kind: str
    text: str


def line(stored: Stored) -> Line:
    """Return a stored record as a line; one that can't be read says so."""
    try:
        record = read_record(stored)
    except BodyRemoved:
        return Line(stored.seq, kind_numbered(stored.kind_number).name, REMOVED)
    except (UnknownKind, BodyBroken) as error:
        return Line(stored.seq, f"kind {stored.kind_number}", str(error))
    return Line(record.seq, record.kind.name, describe(record))


def led_from(stored: Stored) -> int:
    """Return the seq of what led to this record, NO_CAUSE where it came from outside by itself.

    What an outcome answers is in its body: one whose body was removed answers nothing that is known.
    """
    if stored.cause != NO_CAUSE or stored.kind_number not in _ANSWERS:
        return stored.cause
    try:
        message = read_record(stored).message
    except (UnknownKind, BodyBroken):
        return NO_CAUSE
    return int(message.effect_seq) if message.HasField("effect_seq") else NO_CAUSE  # type: ignore[attr-defined]


def chain(reader: Reader, seq: int) -> tuple[Line, ...]:
    """Return record `seq` and what led to it, back to the first observation. Raises LookupError, StoreFailed."""
    found: list[Line] = []
    while seq != NO_CAUSE:
        stored = next(iter(reader.stored(seq, seq + 1)), None)
        if stored is None:
            raise LookupError(f"the flight has no record {seq}")
        found.append(line(stored))
        before = led_from(stored)
        seq = before if before < seq else NO_CAUSE  # a cause lies before; what claims otherwise ends the chain
    return tuple(found)


def consequences(reader: Reader, seq: int) -> Iterator[Line]:
    """Yield everything that record `seq` led to, in the order of the log. Raises StoreFailed."""
    led = {seq}
    for stored in reader.stored(seq + 1):
        if led_from(stored) in led:
            led.add(stored.seq)
            yield line(stored)
