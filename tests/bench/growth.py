"""How much a flight writes: bytes beside the body, and what an hour in the air and a day on the ground come to.

Settled is the database after the log was closed and its WAL moved into it; the WAL beside it is bounded
(LOADED_PAGES) and does not grow with the flight. Checkpoints are counted in, as often as the node signs them. A day is
what some minutes of it are, taken on; what comes once a flight is counted once. docs/growth.md has the reasons.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path
from uuid import UUID

from eventsourcing.persistence import StoredEvent
from eventsourcing.sqlite import SQLiteApplicationRecorder, SQLiteDatastore

from autopilot.node.sealing import EVERY_NS, EVERY_RECORDS
from events.records import Record
from events.store.sqlite import SqliteStore
from tests.bench.days import MINUTES, Day, config, recorded
from tests.bench.flight import FLIGHT_ID, SECRET, records
from tests.bench.frame import Bench, Row, at_most, fresh_folder

BESIDE_BUDGET_B = 90
COMMIT = 3  # records in one commit at 27 observations a second
COUNT = 40_000
NOTE = "n" * 300  # a checkpoint as a signed note, near enough
# What may be written: what is measured, minutes to measure, minutes that count, MB in these.
DAYS = {
    "an hour in the air": (Day(flying=True, camera=True), MINUTES, 60, 16.0),
    "a day on the ground, camera on": (Day(flying=False, camera=True), MINUTES, 24 * 60, 16.0),
    "a day on the ground, camera off": (Day(flying=False, camera=False), 6 * MINUTES, 24 * 60, 1.0),
}
FULL = "thinned by the clock alone"


def settled(log: Sequence[Record], folder: Path, *, signed: bool) -> int:
    """Write a log as a node does; return the size of its database in bytes."""
    path = folder / "flight.db"
    store = SqliteStore.create(path, FLIGHT_ID, SECRET)
    last_ns = last_size = 0
    for start in range(0, len(log), COMMIT):
        store.append(log[start : start + COMMIT])
        now_ns, size = log[start].at.flight_ns, store.head.seq + 1
        if signed and (now_ns - last_ns >= EVERY_NS or size - last_size >= EVERY_RECORDS):
            store.add_checkpoint(size, NOTE)
            last_ns, last_size = now_ns, size
        store.idle()
    store.close()
    return path.stat().st_size


def beside() -> list[Row]:
    """Measure bytes beside the body of each record, against the recorder of `eventsourcing`."""
    log = records(COUNT)
    body = sum(len(record.body) for record in log)
    with fresh_folder() as folder:
        ours = (settled(log, folder, signed=False) - body) / len(log)
        wal = (folder / "flight.db-wal").exists()
    with fresh_folder() as folder:
        theirs = (_recorder(log, folder) - body) / len(log)
    assert not wal
    against = f"eventsourcing's recorder: {theirs:.0f} B"
    return [at_most("bytes beside the body, a record", ours, "B", BESIDE_BUDGET_B, against)]


def _recorder(log: Sequence[Record], folder: Path) -> int:
    path = folder / "recorder.db"
    store = SQLiteApplicationRecorder(SQLiteDatastore(str(path)))
    store.create_table()
    originator = UUID(bytes=FLIGHT_ID)
    stored = [StoredEvent(originator, record.seq + 1, record.kind.name, record.body) for record in log]
    for start in range(0, len(stored), 1000):
        store.insert_events(stored[start : start + 1000])
    with store.datastore.transaction(commit=False) as cursor:
        cursor.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    store.datastore.close()
    return path.stat().st_size


@cache
def _minutes(name: str, thinned: bool) -> float:
    """Return the MB that a sort of day comes to."""
    day, minutes, counted, _ = DAYS[name]
    log, times = recorded(day, config(thinned), minutes), counted / minutes
    with fresh_folder() as folder:
        once = settled(log[:1], folder, signed=False)  # what even an empty flight takes
    with fresh_folder() as folder:
        return ((settled(log, folder, signed=True) - once) * times + once) / 1e6


def stretch(name: str) -> list[Row]:
    """Measure one sort of day against its budget, beside what it would be without thinning."""
    against = f"{FULL}: {_minutes(name, thinned=False):.0f} MB"
    return [at_most(f"written in {name}", _minutes(name, thinned=True), "MB", DAYS[name][3], against)]


BENCHES = (
    Bench("growth/beside", beside),
    *(Bench(f"growth/{name}", partial(stretch, name)) for name in DAYS),
)
