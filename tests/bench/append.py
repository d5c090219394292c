"""Append, durable: our store against raw apsw inserts of the same rows, and against `eventsourcing`.

Everyone writes to a fresh file on the same disk with WAL and synchronous=FULL, asserted before the clock
starts. Raw apsw gets the rows ready, leaf included; our store makes the leaves. The recorder of
`eventsourcing` gets its events ready; `Application.save` encodes its own, so there we encode ours as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from time import perf_counter
from uuid import UUID

import apsw
from eventsourcing.application import Application
from eventsourcing.domain import Aggregate, event
from eventsourcing.persistence import StoredEvent
from eventsourcing.sqlite import SQLiteApplicationRecorder, SQLiteDatastore

from events.chain import Chain
from events.records import NO_CAUSE, Record, make_record
from events.store.sqlite import LOADED_PAGES, SqliteStore
from tests.bench.flight import FLIGHT_ID, SECRET, message, moment, records
from tests.bench.frame import Bench, Contestant, Row, at_least, interleaved, ratio

# Records for each size of a commit: enough to pass a checkpoint, few enough for half a second.
COUNTS = {1: 2_000, 32: 16_000, 100: 16_000, 128: 19_200}
RAW_BUDGETS = {1: 0.95, 32: 0.75, 128: 0.6}
RECORDER_BUDGETS = {1: 1.1, 100: 1.15}
SAVE_BUDGETS = {1: 1.5, 100: 3.0}

_COLUMNS = """
seq INTEGER PRIMARY KEY, cause INTEGER NOT NULL, flight_ns INTEGER NOT NULL, mono_ns INTEGER NOT NULL,
boot INTEGER NOT NULL, wall_ns INTEGER NOT NULL, clock_quality INTEGER NOT NULL, kind INTEGER NOT NULL,
version INTEGER NOT NULL, body BLOB NOT NULL, leaf BLOB NOT NULL
"""
_INSERT = f"INSERT INTO record VALUES ({', '.join('?' * 11)})"
FULL = 2

Values = tuple[int | bytes, ...]


def values_of(flight: Sequence[Record]) -> list[Values]:
    """Return the rows that our store writes for these records."""
    chain = Chain(FLIGHT_ID, SECRET)
    rows: list[Values] = []
    for record in flight:
        leaf = chain.extend(record.seq, record.cause, record.at, record.kind.number, record.version, record.body)
        rows.append((record.seq, record.cause, *record.at, record.kind.number, record.version, record.body, leaf))
    return rows


def ours(flight: Sequence[Record], size: int) -> Contestant:
    """Append records that are ready; measures records a second."""

    def run(folder: Path) -> float:
        store = SqliteStore.create(folder / "flight.db", FLIGHT_ID, SECRET)
        began = perf_counter()
        for start in range(0, len(flight), size):
            store.append(flight[start : start + size])
        elapsed = perf_counter() - began
        assert store.head.seq == len(flight) - 1
        store.close()
        return len(flight) / elapsed

    return run


def ours_from_messages(flight: Sequence[Record], size: int) -> Contestant:
    """Make the records of their messages, encode and append them; measures records a second."""
    messages = [message(record.seq) for record in flight]

    def run(folder: Path) -> float:
        store = SqliteStore.create(folder / "flight.db", FLIGHT_ID, SECRET)
        began = perf_counter()
        for start in range(0, len(messages), size):
            batch = enumerate(messages[start : start + size], start)
            store.append([make_record(seq, NO_CAUSE, moment(seq), body) for seq, body in batch])
        elapsed = perf_counter() - began
        assert store.head.seq == len(messages) - 1
        store.close()
        return len(messages) / elapsed

    return run


def raw(rows: Sequence[Values], size: int) -> Contestant:
    """Insert the same rows with nothing but apsw; measures rows a second."""

    def run(folder: Path) -> float:
        connection = apsw.Connection(str(folder / "raw.db"))
        # Our store moves its WAL into the database at this size; SQLite's own way of doing the same.
        for name, value in {"journal_mode": "wal", "synchronous": FULL, "wal_autocheckpoint": LOADED_PAGES}.items():
            assert connection.pragma(name, value) in (value, None)
        assert connection.pragma("synchronous") == FULL
        connection.execute(f"CREATE TABLE record ({_COLUMNS})")
        began = perf_counter()
        for start in range(0, len(rows), size):
            with connection:
                connection.executemany(_INSERT, rows[start : start + size])
        elapsed = perf_counter() - began
        assert connection.execute("SELECT count(*) FROM record").fetchone() == (len(rows),)
        connection.close()
        return len(rows) / elapsed

    return run


def recorder(flight: Sequence[Record], size: int) -> Contestant:
    """Insert stored events that are ready with eventsourcing's recorder; measures events a second."""
    originator = UUID(bytes=FLIGHT_ID)
    stored = [StoredEvent(originator, record.seq + 1, record.kind.name, record.body) for record in flight]

    def run(folder: Path) -> float:
        store = SQLiteApplicationRecorder(SQLiteDatastore(str(folder / "recorder.db")))
        store.create_table()
        check_durable(store)
        began = perf_counter()
        for start in range(0, len(stored), size):
            store.insert_events(stored[start : start + size])
        elapsed = perf_counter() - began
        assert store.max_notification_id() == len(stored)
        store.datastore.close()
        return len(stored) / elapsed

    return run


def check_durable(store: SQLiteApplicationRecorder) -> None:
    """Check that the other side writes as durably as we do."""
    for name, wanted in {"journal_mode": "wal", "synchronous": FULL}.items():
        with store.datastore.transaction(commit=False) as cursor:
            cursor.execute(f"PRAGMA {name}")
            assert tuple(cursor.fetchone()) == (wanted,), name


class Track(Aggregate):
    """A flight as eventsourcing's users write it: an aggregate that observes."""

    @event("Observed")
    def observe(self, kind: str, flight_ns: int, mono_ns: int, wall_ns: int, body: str) -> None:
        """Take an observation; its body as text, for JSON is what is stored."""
        self.last = flight_ns


def save(flight: Sequence[Record], size: int) -> Contestant:
    """Trigger events on an aggregate and save it with Application.save; measures events a second."""
    ready = [
        (record.kind.name, record.at.flight_ns, record.at.mono_ns, record.at.wall_ns, record.body.hex())
        for record in flight
    ]

    def run(folder: Path) -> float:
        path = str(folder / "application.db")
        application: Application[UUID] = Application(
            {"PERSISTENCE_MODULE": "eventsourcing.sqlite", "SQLITE_DBNAME": path}
        )
        assert isinstance(application.recorder, SQLiteApplicationRecorder)
        check_durable(application.recorder)
        track = Track()
        application.save(track)
        began = perf_counter()
        for start in range(0, len(ready), size):
            for values in ready[start : start + size]:
                track.observe(*values)
            application.save(track)
        elapsed = perf_counter() - began
        assert application.recorder.max_notification_id() == len(ready) + 1
        application.close()
        return len(ready) / elapsed

    return run


def _row(name: str, mine: Contestant, theirs: Contestant, budget: float, against: str) -> list[Row]:
    measures = interleaved({"ours": mine, "theirs": theirs})
    return [at_least(name, ratio(measures, "ours", "theirs"), "x", budget, against)]


def against_raw(size: int) -> list[Row]:
    """Compare with raw apsw at `size` records a commit."""
    flight = records(COUNTS[size])
    mine, theirs = ours(flight, size), raw(values_of(flight), size)
    return _row(f"append, {size} a commit", mine, theirs, RAW_BUDGETS[size], "raw apsw inserts of the same rows")


def against_recorder(size: int) -> list[Row]:
    """Compare with eventsourcing's recorder at `size` events a commit."""
    flight = records(COUNTS[size])
    mine, theirs = ours(flight, size), recorder(flight, size)
    return _row(f"append, {size} a commit, recorder", mine, theirs, RECORDER_BUDGETS[size], "eventsourcing's recorder")


def against_save(size: int) -> list[Row]:
    """Compare with eventsourcing's Application.save at `size` events a commit."""
    flight = records(COUNTS[size])
    mine, theirs = ours_from_messages(flight, size), save(flight, size)
    return _row(f"append, {size} a commit, save", mine, theirs, SAVE_BUDGETS[size], "eventsourcing's Application.save")


BENCHES = (
    *(Bench(f"append/raw/{size}", partial(against_raw, size)) for size in RAW_BUDGETS),
    *(Bench(f"append/recorder/{size}", partial(against_recorder, size)) for size in RECORDER_BUDGETS),
    *(Bench(f"append/save/{size}", partial(against_save, size)) for size in SAVE_BUDGETS),
)
