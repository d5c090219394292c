"""Records: what the log holds, as values.

A record carries its message twice: as the bytes that are hashed and stored, and as the message they
were made from or decode to. The bytes are the truth; a message is never changed after it was recorded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from google.protobuf.message import DecodeError, Message

from events.kinds import Kind, UnknownKind, kind_numbered, kind_of
from events.upcasts import lift

NO_CAUSE = -1


class BodyBroken(ValueError):
    """A stored body does not decode as its kind."""


class BodyRemoved(BodyBroken):
    """The body is not in this redacted copy of the flight; a hash stands in its place."""


class Moment(NamedTuple):
    """When something was recorded. A decision has the moment of its observation."""

    flight_ns: int  # time of this flight; never goes back, the only time that the core reads
    mono_ns: int  # monotonic clock of this boot
    boot: int  # number of the boot within the node's life
    wall_ns: int  # wall clock, nanoseconds since 1970; for people
    clock_quality: int  # flight_pb2.ClockQuality


@dataclass(frozen=True, slots=True)
class Record:
    """One line of the log. Order is by seq, never by time."""

    seq: int
    cause: int  # seq of the record that led to this one, NO_CAUSE for an observation from outside
    at: Moment
    kind: Kind
    version: int  # version of the body as it was recorded
    body: bytes
    message: Message  # of the present version, whatever the body is of


class Stored(NamedTuple):
    """A record as the store holds it: nothing decoded, nothing believed."""

    seq: int
    cause: int
    at: Moment
    kind_number: int
    version: int
    body: bytes  # b"" where it was removed
    leaf: bytes
    salt: bytes = b""  # where the log is a redacted copy, which has no secret to derive it from
    removed: bytes = b""  # SHA-256(salt || body) in place of both, where a redacted copy lacks them


def encode(message: Message) -> bytes:
    """Encode a message as it will be hashed. Called once for each record; the bytes are kept."""
    return message.SerializeToString(deterministic=True)


def make_record(seq: int, cause: int, at: Moment, message: Message) -> Record:
    """Make a record of a fresh message. Raises UnknownKind for a message that is only a part."""
    kind = kind_of(message)
    return Record(seq, cause, at, kind, kind.version, encode(message), message)


def read_record(stored: Stored) -> Record:
    """Make a record of stored bytes, which stay what they are.

    Raises UnknownKind, BodyBroken, and BodyRemoved where a redacted copy lacks it.
    """
    kind = kind_numbered(stored.kind_number)
    if stored.removed:
        raise BodyRemoved(f"the body of record {stored.seq} ({kind.name}) was removed from this copy of the flight")
    if not 1 <= stored.version <= kind.version:
        raise UnknownKind(f"record {stored.seq} is {kind.name} version {stored.version}; known is {kind.version}")
    try:
        message = lift(kind, stored.version, stored.body)
    except DecodeError as error:
        raise BodyBroken(f"the body of record {stored.seq} is no {kind.name}: {error}") from error
    return Record(stored.seq, stored.cause, stored.at, kind, stored.version, stored.body, message)
