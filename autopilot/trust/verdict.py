"""What the gate says of a message: opened, malformed or rejected, and what is known of it then.

Values only; how they are come by is the gate's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

from events.schema.waypoint_pb2 import PrincipalKind

T = TypeVar("T")


class Unreadable(Exception):
    """A reader's word on an opened content that can't be used; the text names the field."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sender:
    """Who signed, as the Directory's token says it."""

    principal_id: str
    callsign: str
    kind: PrincipalKind.ValueType
    roles: tuple[str, ...]
    public_key: bytes
    device_key_id: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Sealed:
    """A message that was authenticated and opened. Times are milliseconds, wall or left from now."""

    sender: Sender
    key_expr: str
    nonce: bytes
    issued_at_ms: int
    ttl_ms: int
    life_ms: int  # what is left of the message's own life; 0 inside the allowance for skew
    nonce_life_ms: int  # for how long the nonce must be remembered
    digest: bytes  # BLAKE2b-256 of the signature input; an answer names it
    in_reply_to: bytes
    revocation_version: int
    time_uncertain: bool = False  # it was fresh by the receiver's challenge; the time was not known
    overdue_ms: int = 0  # how long the receiver's revocation list had been overdue
    before_memory: bool = False  # it may repeat what was sent before a start that remembers nothing
    plaintext: bytes  # salt and sealed body; its SHA-256 is in the signed header
    envelope: bytes


@dataclass(frozen=True, slots=True)
class Opened(Generic[T]):
    """Passed; `value` is what the reader made of `content`."""

    message: Sealed
    order_seq: int
    content: bytes
    value: T


@dataclass(frozen=True, slots=True)
class Malformed:
    """Authentic, but its content can't be read. The only failure that may be answered."""

    message: Sealed
    because: str


@dataclass(frozen=True, slots=True)
class Rejected:
    """Dropped in silence; `reason` is the counter's name."""

    reason: str
