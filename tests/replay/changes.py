"""Flights that somebody changed, and the doors that tests of replay go through. Reads and changes no file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from google.protobuf.message import Message

from events import Record, make_record
from events.records import Stored
from events.store import MemoryStore
from events.store.protocol import Head, Reader
from replay.verdict import Divergence, Outcome, Verdict
from replay.verify import verify
from tests.flights import (
    Flight,
    answered,
    gimbal,
    point_at_place,
    resealed,
    sent,
)


class Tampered:
    """A store in which rows were changed without the chain being made again."""

    def __init__(self, store: MemoryStore, rows: list[Stored], head: Head | None = None) -> None:
        self.flight_id, self.secret = store.flight_id, store.secret
        self.head = head or store.head
        self._rows = rows

    def checkpoints(self) -> list[tuple[int, str]]:
        """Nothing was signed."""
        return []

    def stored(self, start: int = 0, stop: int | None = None) -> Iterator[Stored]:
        """Yield the rows as they lie."""
        yield from self._rows[start:stop]

    def close(self) -> None:
        """Nothing is open."""


def small() -> Flight:
    """Return a flight of a few steps: an order, its outcome, an arrival."""
    flight = Flight()
    flight.tell(point_at_place("a", 20_000, 30_000), 100)
    effect = flight.effect()
    flight.tell(sent(effect), 5)
    flight.tell(answered(effect), 20)
    flight.tell(gimbal(-2_000, 3_000, effect, 40), 900)
    return flight


def check_identical(reader: Reader, records: int) -> Verdict:
    """Check that a flight replays identically, all of it."""
    verdict = verify(reader)
    assert (verdict.words(), verdict.records) == (verdict.words(), records)
    assert verdict.outcome is Outcome.IDENTICAL, verdict.words()
    return verdict


def check_diverges(records: Sequence[Record], seq: int, what: str, field: str = "", further: int = 0) -> Divergence:
    """Check where a log that was changed and sealed again diverges first."""
    verdict = verify(resealed(records))
    assert verdict.outcome is Outcome.DIVERGES, verdict.words()
    first = verdict.first
    assert first is not None
    assert (first.seq, first.what, first.field, verdict.further) == (seq, what, field, further), verdict.words()
    return first


def check_ends(reader: Reader, outcome: Outcome, seq: int, detail: str) -> None:
    """Check that a log can't be followed beyond `seq`."""
    verdict = verify(reader)
    assert (verdict.outcome, verdict.seq) == (outcome, seq), verdict.words()
    assert detail in verdict.detail


def changed(records: Sequence[Record], seq: int, message: Message) -> list[Record]:
    """Return the records with another message in one of them."""
    old = records[seq]
    return [*records[:seq], make_record(seq, old.cause, old.at, message), *records[seq + 1 :]]


def forged(flight: Flight, seq: int, **fields: object) -> list[Record]:
    """Return the flight's records with other values in fields of one of them; None takes a field away."""
    message = type(flight.records[seq].message)()
    message.CopyFrom(flight.records[seq].message)
    for name, value in fields.items():
        if value is None:
            message.ClearField(name)
        else:
            setattr(message, name, value)
    return changed(flight.records, seq, message)


def renumbered(records: Sequence[Record], from_seq: int, by: int) -> list[Record]:
    """Return the records with seqs and causes at and behind `from_seq` moved, so that there is no gap."""
    return [
        replace(one, seq=one.seq + by * (one.seq >= from_seq), cause=one.cause + by * (one.cause >= from_seq))
        for one in records
    ]


def at(flight: Flight, kind: str, nth: int = 0) -> int:
    """Return the seq of the nth record of a kind."""
    return [one.seq for one in flight.records if one.kind.name == kind][nth]
