"""The flights that lie in a folder, as their logs and papers say: for a list, and for who decides what may go.

Each log is opened to read only, for as long as it takes; one that can't be read is in the list with the reason.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from autopilot.node.receipts import Receipt, read_receipt
from autopilot.node.retention import Candidate
from autopilot.trust.notes import NoteInvalid
from autopilot.trust.replayed import read_verdict
from events.kinds import UnknownKind
from events.records import NO_CAUSE, BodyBroken, Stored, read_record
from events.schema.flight_pb2 import CloseReason, FlightClosed, FlightOpened
from events.store import Flight, Reader, StoreFailed, StoreMissing, flights_in, read_flight
from events.store.protocol import Head

NS_PER_MS = 1_000_000
_NOTHING = Head(-1, b"")


@dataclass(frozen=True, slots=True, kw_only=True)
class Stocked:
    """A flight on this disk."""

    flight: Flight
    size_bytes: int
    flight_id: bytes = b""
    head: Head = _NOTHING
    began_ms: int = 0  # wall clock of its first record, milliseconds since 1970
    ended_ms: int = 0  # and of its last
    closed: CloseReason.ValueType | None = None
    verdict: str = ""  # as the node signed it
    receipt: Receipt | None = None  # that names this very head
    unreadable: str = ""

    def candidate(self) -> Candidate:
        """Return what a decision to delete it needs."""
        return Candidate(
            self.flight.number, self.closed is not None, self.receipt is not None, self.ended_ms, self.size_bytes
        )


def stock_of(root: Path) -> Iterator[Stocked]:
    """Yield the flights below `root`, oldest first."""
    for flight in flights_in(root):
        yield stocked(flight)


def stocked(flight: Flight) -> Stocked:
    """Return what is known of one flight."""
    size_bytes = sum(file.stat().st_size for file in flight.folder.rglob("*") if file.is_file())
    try:
        reader = read_flight(flight.folder)
        try:
            return _read(flight, size_bytes, reader)
        finally:
            reader.close()
    except (StoreMissing, StoreFailed, UnknownKind, BodyBroken) as error:
        return Stocked(flight=flight, size_bytes=size_bytes, unreadable=str(error))


def _read(flight: Flight, size_bytes: int, reader: Reader) -> Stocked:
    head, receipt = reader.head, read_receipt(flight.folder)
    if head.seq < 0:
        return Stocked(flight=flight, size_bytes=size_bytes, unreadable="nothing was recorded in it")
    first, last = _row(reader, 0), _row(reader, head.seq)
    opened = read_record(first).message
    closing = read_record(last if last.cause == NO_CAUSE else _row(reader, last.cause)).message
    return Stocked(
        flight=flight,
        size_bytes=size_bytes,
        flight_id=reader.flight_id,
        head=head,
        began_ms=first.at.wall_ns // NS_PER_MS,
        ended_ms=last.at.wall_ns // NS_PER_MS,
        closed=closing.reason if isinstance(closing, FlightClosed) else None,
        verdict=_verdict(flight.folder, opened) if isinstance(opened, FlightOpened) else "",
        receipt=receipt if receipt is not None and receipt.names(reader.flight_id, head) else None,
    )


def _row(reader: Reader, seq: int) -> Stored:
    row = next(iter(reader.stored(seq, seq + 1)), None)
    if row is None:
        raise BodyBroken(f"record {seq} is missing")
    return row


def _verdict(folder: Path, opened: FlightOpened) -> str:
    try:
        signed = read_verdict(folder, opened.node_public_key, f"waypoint/{opened.deployment_id}/{opened.node}")
    except NoteInvalid:
        return "not to be believed"
    return "" if signed is None else signed.verdict
