"""`projections.db`: the rows of all projections, kept through sqlite-utils. Disposable: delete it and it comes back.

Rows and reader position move in one transaction. It reads flights through the reader that it is given and never
opens a log itself; it holds one flight, and another flight, another version of a fold or a log that no longer has
the record it stopped at makes it begin again. Only this file knows sqlite-utils.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from sqlite_utils import Database
from sqlite_utils.utils import sqlite3  # type: ignore[attr-defined]  # whichever SQLite it found

from events.records import Record, Stored, read_record
from events.store.protocol import Reader
from projections import audit, objects, pois, status
from projections.picture import Status
from projections.rows import Projection, Table

FORMAT = 1  # of the database itself
RECORDS_A_TRANSACTION = 4096  # bounds memory and the time that a reader of the file waits
BUSY_MS = 5000

_POSITION = {"name": str, "version": int, "flight_id": str, "seq": int, "leaf": str}


@dataclass(frozen=True, slots=True)
class _StatusRow:
    name: str
    body: str  # `status.plain` as JSON


class _Kept:
    """The status as a table of one row; it is text only when it is written."""

    def __init__(self) -> None:
        self.status = Status()

    def apply(self, record: Record) -> _Kept:
        self.status = status.apply(self.status, record)
        return self

    def tables(self) -> Mapping[str, Table[Any, Any]]:
        table: Table[str, _StatusRow] = Table(_StatusRow, "name")
        table.put("status", _StatusRow("status", json.dumps(status.plain(self.status), sort_keys=True)))
        return {"status": table}


PROJECTIONS = (
    audit.PROJECTION,
    objects.PROJECTION,
    pois.PROJECTION,
    Projection(status.NAME, status.VERSION, _Kept, _Kept.apply, _Kept.tables),
)


class Unreadable(OSError):
    """There is no projections.db at a path, or nothing in it."""


class Projector:
    """Keeps projections.db in step with a flight. Belongs to the thread that made it."""

    def __init__(self, path: Path) -> None:
        """Open or make the database; one that can't be read is made anew. Raises OSError and sqlite3.Error."""
        path.parent.mkdir(parents=True, exist_ok=True)
        self._database = _open(path)
        self._flight_id = b""
        self._next = 0
        self._states: dict[str, Any] = {}
        self._kept: dict[str, int] = {}  # by projection: record up to which an earlier run kept its rows

    def catch_up(self, reader: Reader) -> int:
        """Fold what is new in a flight and keep it; return how many records were read.

        Raises StoreFailed, UnknownKind and BodyBroken from reading; after those, what was kept before stands.
        """
        end = reader.head.seq + 1
        if reader.flight_id != self._flight_id or end < self._next:
            self._begin(reader)
        first = self._next
        while self._next < end:
            self._chunk(reader, min(self._next + RECORDS_A_TRANSACTION, end))
        return end - first

    def close(self) -> None:
        """Close the database."""
        self._database.close()

    def _begin(self, reader: Reader) -> None:
        """Fold from the start; rows that an earlier run kept of this very log stand."""
        self._flight_id, self._next = reader.flight_id, 0
        self._states = {one.name: one.start() for one in PROJECTIONS}
        self._kept = {one.name: self._kept_before(one, reader) for one in PROJECTIONS}
        with self._database.atomic():
            for one in PROJECTIONS:
                if self._kept[one.name] < 0:
                    self._clear(one)

    def _kept_before(self, one: Projection, reader: Reader) -> int:
        """Return the record up to which the rows are of this very log; -1 where they are not."""
        kept = next(iter(self._database.table("position").rows_where("name = ?", [one.name])), None)
        if kept is None or kept["version"] != one.version or kept["flight_id"] != reader.flight_id.hex():
            return -1
        seq = int(kept["seq"])
        there = next(iter(reader.stored(seq, seq + 1)), None)
        return seq if there is not None and there.leaf.hex() == kept["leaf"] else -1

    def _clear(self, one: Projection) -> None:
        for name, table in one.tables(one.start()).items():
            self._database.table(name).drop(ignore=True)
            self._database.table(name).create(_columns(table.row_type), pk=table.key)
        self._database.table("position").delete_where("name = ?", [one.name])

    def _chunk(self, reader: Reader, end: int) -> None:
        last = None
        for stored in reader.stored(self._next, end):
            record, last = read_record(stored), stored
            for one in PROJECTIONS:
                self._states[one.name] = one.apply(self._states[one.name], record)
            self._next = stored.seq + 1
        if last is None:
            raise Unreadable(f"record {self._next} is missing from the log")
        with self._database.atomic():
            for one in PROJECTIONS:
                if last.seq > self._kept[one.name]:
                    self._keep(one, last)
        for one in PROJECTIONS:
            for table in one.tables(self._states[one.name]).values():
                table.settle()

    def _keep(self, one: Projection, last: Stored) -> None:
        for name, table in one.tables(self._states[one.name]).items():
            rows = map(_plain, table.changed())
            self._database.table(name).insert_all(rows, pk=table.key, replace=True)
        self._database.table("position").insert(
            {
                "name": one.name,
                "version": one.version,
                "flight_id": self._flight_id.hex(),
                "seq": last.seq,
                "leaf": last.leaf.hex(),
            },
            pk="name",
            replace=True,
        )


def read_status(path: Path) -> dict[str, Any]:
    """Return the status that `path` holds, as `status.plain` made it. Raises Unreadable."""
    if not path.exists():
        raise Unreadable(f"there is no projections database at {path}: has the node run?")
    try:
        database = Database(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True))
        try:
            rows = list(database["status"].rows)
        finally:
            database.close()
    except sqlite3.Error as error:
        raise Unreadable(f"{path} can't be read as a projections database: {error}") from error
    if not rows:
        raise Unreadable(f"{path} holds no status yet: has a flight been opened?")
    read: dict[str, Any] = json.loads(rows[0]["body"])
    return read


def _open(path: Path) -> Database:
    try:
        return _prepared(path)
    except sqlite3.DatabaseError as error:
        if isinstance(error, sqlite3.OperationalError):
            raise  # locked, no room, not permitted: nothing is wrong with the file
        for name in (path.name, f"{path.name}-wal", f"{path.name}-shm"):
            path.with_name(name).unlink(missing_ok=True)
        return _prepared(path)


def _prepared(path: Path) -> Database:
    database = Database(path)
    try:
        database.enable_wal()  # `status` reads while the node writes
        database.execute("PRAGMA synchronous = OFF")  # it comes back by itself
        database.execute(f"PRAGMA busy_timeout = {BUSY_MS}")
        if database.execute("PRAGMA user_version").fetchone()[0] != FORMAT:
            for table in database.tables:
                table.drop()
            database.execute(f"PRAGMA user_version = {FORMAT}")
        database.table("position").create(_POSITION, pk="name", if_not_exists=True)
    except sqlite3.Error:
        database.close()
        raise
    return database


def _columns(row_type: type[Any]) -> dict[str, type[int] | type[str]]:
    return {one.name: int if str(one.type).startswith(("int", "bool")) else str for one in fields(row_type)}


def _plain(row: Any) -> dict[str, int | str | None]:
    return {name: _value(value) for name, value in asdict(row).items()}


def _value(value: Any) -> int | str | None:
    if isinstance(value, tuple):
        return ",".join(map(str, value))
    kept: int | str | None = value
    return kept
