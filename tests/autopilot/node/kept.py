"""Closed flights in a folder, for the tests of what is deleted; nothing here checks anything."""

from __future__ import annotations

from pathlib import Path

from google.protobuf.message import Message

from autopilot.node.receipts import Receipt, write_receipt
from autopilot.node.stock import Stocked, stock_of
from events import Record
from events.records import Moment
from events.store import create_flight
from tests.flights import Flight, closed, opened_well

DAY_MS = 86_400_000


def keep(root: Path, number: int, *told: Message, began_ms: int, is_closed: bool = True) -> None:
    """Record a short flight below a folder, by wall clock at `began_ms`, in which this was observed."""
    flight_id = bytes([number]) * 16
    opening = opened_well()
    opening[0].flight_id = flight_id  # type: ignore[attr-defined]
    opening[0].flight_number = number  # type: ignore[attr-defined]
    flown = Flight(*opening)
    for observation in told:
        flown.tell(observation, after_ms=100)
    if is_closed:
        flown.tell(closed(), after_ms=1000)
    _, store = create_flight(root, number, flight_id, bytes(32))
    store.append([at_wall(record, began_ms) for record in flown.records])
    store.close()


def at_wall(record: Record, began_ms: int) -> Record:
    """Return a record as it would be under another wall clock."""
    at = record.at
    moved = Moment(at.flight_ns, at.mono_ns, at.boot, began_ms * 1_000_000 + at.flight_ns, at.clock_quality)
    return Record(record.seq, record.cause, moved, record.kind, record.version, record.body, record.message)


def push(one: Stocked, to: str = "archive") -> Receipt:
    """Lay down the receipt of a flight and return it."""
    receipt = Receipt(
        flight_number=one.flight.number,
        flight_id=one.flight_id.hex(),
        last_seq=one.head.seq,
        last_leaf=one.head.leaf.hex(),
        to=to,
        at_ms=5,
    )
    write_receipt(one.flight.folder, receipt)
    return receipt


def stock(root: Path) -> dict[int, Stocked]:
    """Return the flights by number."""
    return {one.flight.number: one for one in stock_of(root)}
