"""When a decision that was recorded and one that was replayed are the same, and why a difference may be meant.

Equal bytes are equal fields. A body of an older version is lifted first, and what it then says is encoded and compared
byte for byte: no tolerance, no field that is ignored.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from google.protobuf.message import DecodeError

from events import BodyBroken, Record, UnknownKind, encode, kind_numbered, read_record
from events.records import Stored
from statecharts import logic
from statecharts.logic import Change


def same(stored: Stored, record: Record) -> bool:
    """Whether number, cause, moment, kind, version and body are the same; a body that was removed is not looked at."""
    return (
        (stored.body == record.body or stored.removed != b"")
        and stored.kind_number == record.kind.number
        and stored.seq == record.seq
        and stored.cause == record.cause
        and stored.at == record.at
        and stored.version == record.version
    ) or _same_when_lifted(stored, record)


def said(decision: Stored | Record) -> tuple[int, bytes]:
    """Return kind and body as the present versions say them; one that can't be lifted stays as it is."""
    if isinstance(decision, Record):
        return decision.kind.number, decision.body
    try:
        record = read_record(decision)
    except (UnknownKind, BodyBroken):
        return decision.kind_number, decision.body
    current = record.version == record.kind.version
    return record.kind.number, decision.body if current else encode(record.message)


def meant(recorded_logic: int, recorded: Sequence[Stored], replayed: Sequence[Record]) -> Change | None:
    """Return the change of logic by which the decisions of two steps may differ; None: they may not."""
    if recorded_logic >= logic.LOGIC:
        return None
    mine, theirs = Counter(map(said, recorded[1:])), Counter(map(said, replayed[1:]))
    differing = [*(mine - theirs), *(theirs - mine)]
    try:
        messages = [kind_numbered(number).message.FromString(body) for number, body in differing]
    except DecodeError:  # no message of its kind: forged
        return None
    return logic.since(recorded_logic, messages) if messages else None


def _same_when_lifted(stored: Stored, record: Record) -> bool:
    return (
        0 < stored.version < record.version
        and (stored.seq, stored.cause, stored.at) == (record.seq, record.cause, record.at)
        and said(stored) == said(record)
    )
