"""The book of trust in a running node: what it learns of the log at a start, and what it does by the clock.

Judging documents and time is `autopilot.trust`'s; here is only what joins it to log and folder.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from autopilot.node.flights import Session
from autopilot.ports.edges import Clock
from autopilot.trust.book import TrustBook
from autopilot.trust.freshness import TrustClock
from autopilot.trust.judging import Floors, Known
from autopilot.trust.keys import sync_folder, write_file
from events.records import Record

TURN_S = 1.0
SETTLE_S = 0.002  # the log takes about as long
# Lies beside the keys from the first start on: a node that has this but no log has lost its log.
RECORDED_FILE = "recorded"


@dataclass(frozen=True, slots=True)
class Believed:
    """What the log remembers of trust; read on the thread that owns the state."""

    floors: Floors
    time_floor_ms: int
    log_lost: bool  # a part of the log before this start can't be read
    log_begins: bool  # there is no log from before this start


def believed(session: Session) -> Believed:
    """Read it. On the node's thread, before what was recorded at the start is let go of."""
    trusted = session.state.trusted.value
    lists = {key: Known(version, digest) for key, (version, digest) in session.state.lists.items()}
    root = Known(trusted.root_version, b"")
    kinds = {record.kind.name for record in session.fresh}
    return Believed(
        floors=Floors(lists, trusted.epoch_id, root),
        time_floor_ms=trusted.time_floor_ms,
        log_lost="log_damaged" in kinds,
        log_begins="flight_opened" in kinds and session.flight.number == 1,
    )


def ear_for_gps(clock: Clock) -> Callable[[int], None]:
    """Return what is to be told each time that a vehicle says, ms since 1970; a clock that is right needs none."""
    return clock.hear_gps if isinstance(clock, TrustClock) else lambda _: None


def remembers_all(memory: Believed, keys: Path) -> bool:
    """Say whether everything that this identity ever recorded and that matters yet is remembered.

    A node that starts for the first time has nothing to remember. That it has started once is noted beside its keys;
    where nothing can be written there, a log that is lost can't be told from one that never was.
    """
    mark = keys / RECORDED_FILE
    lost = memory.log_lost or (memory.log_begins and mark.exists())
    if not mark.exists():
        with suppress(OSError):
            write_file(mark, b"")
            sync_folder(keys)
    return not lost


def put_into_force(book: TrustBook, records: tuple[Record, ...]) -> None:
    """Give the book what is durable. On the node's thread."""
    if book.settled:
        return  # as ever, but for moments
    for record in records:
        if record.kind.name in ("revocations_taken", "epoch_taken", "root_taken"):
            book.recorded(record.message)


async def settle(book: TrustBook, over: asyncio.Event) -> None:
    """Wait until the log has what a start found: no order is taken before."""
    while not book.settled and not over.is_set():
        await asyncio.sleep(SETTLE_S)


async def keep_up(book: TrustBook) -> None:
    """Ask for what is missing, let go of keys that are over, record what was learned; for ever."""
    while True:
        await asyncio.to_thread(book.turn)
        await asyncio.sleep(TURN_S)
