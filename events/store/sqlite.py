"""The log of one flight in SQLite, through apsw: WAL, synchronous=FULL, one writing connection.

In this process no other SQLite library and no plain open() may ever touch the file: closing a foreign
descriptor drops POSIX locks. Pragmas are set and then asserted, for a compiled default is not a promise.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import apsw

from events.chain import FIRST_LEAF_BEFORE, FLIGHT_ID_BYTES, SECRET_BYTES, Chain
from events.records import Moment, Record, Stored
from events.store.head import HeadFile
from events.store.protocol import Head, StoreFailed, StoreMissing
from events.store.reserve import Reserve
from events.store.structure import misfit
from events.store.tables import COPY, LOG, REDACTED

# The WAL-reset race (3.7.0 to 3.51.2) corrupts a database that has two connections, and readers have their own.
OLDEST_SQLITE = 3_051_003
# Moved into the database while idle, from this many pages on; 256 pages are 1 MiB.
IDLE_PAGES = 256
# Moved into the database even under load: a WAL of 16 MiB still opens in well under a second.
LOADED_PAGES = 4096

_INSERT = "INSERT INTO record VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"
_HEADER = "seq, cause, flight_ns, mono_ns, boot, wall_ns, clock_quality, kind, version"
_RANGE = "FROM record WHERE seq >= ? AND seq < ? ORDER BY seq"
_SELECT = f"SELECT {_HEADER}, body, leaf {_RANGE}"
# Of a redacted copy (events/store/redacted.py): a removed body and its salt are NULL, and so is the hash of one that is
# there.
_SELECT_REDACTED = f"SELECT {_HEADER}, coalesce(body, x''), leaf, coalesce(salt, x''), coalesce(removed, x'') {_RANGE}"
_END = (1 << 63) - 1

_PRAGMAS = {
    "journal_mode": "wal",
    "synchronous": 2,  # FULL: a commit is durable when it returns
    "foreign_keys": 1,
    "trusted_schema": 0,
    "mmap_size": 0,  # a write error must be an error, not a signal
    "wal_autocheckpoint": 0,  # checkpoints happen where we say, not in an order's commit
}


class SqliteReader:
    """Reads a flight's database through a read-only connection of its own."""

    def __init__(self, path: Path) -> None:
        """Open `path` read-only. Raises StoreMissing and StoreFailed."""
        if not path.exists():
            raise StoreMissing(f"there is no log at {path}")
        self._connection = _connect(path, apsw.SQLITE_OPEN_READONLY)
        with _opening(self._connection, path):
            self.flight_id, self.secret = _identity(self._connection)

    @property
    def head(self) -> Head:
        """The last durable record's seq and leaf."""
        return _head(self._connection)

    def stored(self, start: int = 0, stop: int | None = None) -> Iterator[Stored]:
        """Yield the rows with start <= seq < stop."""
        return _stored(self._connection, start, stop, _SELECT if self.secret else _SELECT_REDACTED)

    def checkpoints(self) -> list[tuple[int, str]]:
        """Return size and signed note of every checkpoint, oldest first."""
        return _checkpoints(self._connection)

    def misfit(self) -> str:
        """Return what is wrong with the file beside its records, "" where nothing is. Raises StoreFailed."""
        try:
            return misfit(self._connection, LOG if self.secret else COPY)
        except (apsw.Error, UnicodeDecodeError) as error:
            raise StoreFailed(f"the log could not be read: {error}") from error

    def close(self) -> None:
        """Close the connection. Raises StoreFailed."""
        _close(self._connection)


class SqliteStore:
    """The one writer of a flight's database. Belongs to the thread that made it."""

    def __init__(self, path: Path) -> None:
        """Open an existing database for writing. Raises StoreMissing and StoreFailed."""
        if not path.exists():
            raise StoreMissing(f"there is no log at {path}")
        self._connection = _connect(path, apsw.SQLITE_OPEN_READWRITE)
        self._broken = False
        self._wal_pages = 0
        with _opening(self._connection, path):
            self.flight_id, self.secret = _identity(self._connection)
            if not self.secret:
                raise StoreFailed(f"{path} is a redacted copy: nothing more is recorded in it")
            _set_pragmas(self._connection)
            self._connection.set_wal_hook(self._committed)
            self._begin_wal_anew()
            self.head = _head(self._connection)
            self._signed = max((size for size, _ in _checkpoints(self._connection)), default=0)
            self._head_file = self._open_head_file(path.parent)
        self._reserve = Reserve(path.parent)
        self._chain = Chain(self.flight_id, self.secret, self.head.leaf)

    @classmethod
    def create(cls, path: Path, flight_id: bytes, secret: bytes) -> SqliteStore:
        """Make the database of a new flight. Raises StoreFailed, also where the file exists.

        It gets its name when it is whole: a start that is cut short leaves no log that can't be opened.
        """
        if path.exists():
            raise StoreFailed(f"{path} is there already: a flight is never written over")
        unfinished = path.with_name(f"{path.name}.new")
        connection = _connect(unfinished, apsw.SQLITE_OPEN_READWRITE | apsw.SQLITE_OPEN_CREATE)
        with _opening(connection, path):
            _set_pragmas(connection)
            with connection:
                connection.execute(LOG)
                meta = {"flight_id": flight_id, "secret": secret}
                connection.executemany("INSERT INTO meta VALUES (?, ?)", meta.items())
            connection.close()
            os.rename(unfinished, path)
            sync_folder(path.parent)
        return cls(path)

    def append(self, records: Sequence[Record]) -> Head:
        """Commit the records in one durable transaction. Raises ValueError on a gap or a misfit, StoreFailed."""
        if self._broken:
            raise StoreFailed("the store failed before and takes nothing more")
        try:
            rows = list(self._rows_of(records))
            self._commit(_INSERT, rows)
        except (struct.error, OverflowError) as error:
            self._chain.leaf = self.head.leaf
            raise ValueError(f"a record does not fit its columns: {error}") from error
        except (apsw.Error, OSError) as error:
            self._broken = True
            first = error.__context__ or error  # a full disk ends the transaction, and rolling it back then fails too
            raise StoreFailed(f"the log could not be written: {first}") from error
        self.head = Head(self.head.seq + len(rows), self._chain.leaf)
        if rows:
            self._write_head()
        if self._wal_pages >= LOADED_PAGES:
            self._checkpoint()
        return self.head

    def stored(self, start: int = 0, stop: int | None = None) -> Iterator[Stored]:
        """Yield the rows with start <= seq < stop."""
        return _stored(self._connection, start, stop)

    def checkpoints(self) -> list[tuple[int, str]]:
        """Return size and signed note of every checkpoint, oldest first."""
        return _checkpoints(self._connection)

    def add_checkpoint(self, size: int, note: str) -> None:
        """Commit a signed checkpoint. Raises StoreFailed."""
        if self._broken:
            raise StoreFailed("the store failed before and takes nothing more")
        try:
            self._commit("INSERT OR REPLACE INTO checkpoint VALUES (?, ?)", [(size, note)])
        except apsw.Error as error:
            self._broken = True
            raise StoreFailed(f"a checkpoint could not be written: {error}") from error
        self._signed = max(self._signed, size)
        self._write_head()

    def idle(self) -> None:
        """Move the WAL into the database when it has grown."""
        if self._wal_pages >= IDLE_PAGES and not self._broken:
            self._checkpoint()

    def close(self) -> None:
        """Close the connection; SQLite moves the WAL into the database. Raises StoreFailed."""
        self._reserve.release()  # before the WAL is moved, which takes space
        try:
            _close(self._connection)
        finally:
            self._close_head_file()

    @property
    def reserve_spent(self) -> bool:
        """The disk was full, and the space that was reserved for the end has been given up."""
        return self._reserve.spent

    def _commit(self, statement: str, rows: Sequence[tuple[int | bytes | str, ...]]) -> None:
        """Commit the rows. A transaction that found the disk full was undone whole, so it may be tried once more."""
        try:
            with self._connection:
                self._connection.executemany(statement, rows)
        except apsw.Error as error:
            if not isinstance(error.__context__ or error, apsw.FullError) or not self._reserve.give_up():
                raise
            with self._connection:
                self._connection.executemany(statement, rows)

    def _open_head_file(self, folder: Path) -> HeadFile:
        """Return the head file. A new one gets its name for good: else a power cut could take it, hours later too."""
        head_file = HeadFile(folder)
        if head_file.fresh:
            head_file.write(self.head, self._signed)
            head_file.sync()
            sync_folder(folder)
        return head_file

    def _write_head(self) -> None:
        try:
            self._head_file.write(self.head, self._signed)
        except OSError as error:
            self._broken = True
            raise StoreFailed(f"the head file could not be written: {error}") from error

    def _close_head_file(self) -> None:
        try:
            self._head_file.close()
        except OSError as error:
            raise StoreFailed(f"the head file could not be written: {error}") from error

    def _begin_wal_anew(self) -> None:
        """Empty the WAL: frames that a torn tail left could be taken later for a commit after a bad frame."""
        with suppress(apsw.BusyError):  # somebody reads: then the tail stays where it is
            self._connection.wal_checkpoint(mode=apsw.SQLITE_CHECKPOINT_TRUNCATE)

    def _rows_of(self, records: Sequence[Record]) -> Iterator[tuple[int | bytes, ...]]:
        expected = self.head.seq
        for record in records:
            expected += 1
            if record.seq != expected:
                self._chain.leaf = self.head.leaf
                raise ValueError(f"record {record.seq} does not follow: the log goes on at seq {expected}")
            at, number = record.at, record.kind.number
            leaf = self._chain.extend(record.seq, record.cause, at, number, record.version, record.body)
            yield (record.seq, record.cause, *at, number, record.version, record.body, leaf)

    def _committed(self, _connection: apsw.Connection, _name: str, pages: int) -> int:
        self._wal_pages = pages
        return apsw.SQLITE_OK

    def _checkpoint(self) -> None:
        try:
            self._connection.wal_checkpoint(mode=apsw.SQLITE_CHECKPOINT_PASSIVE)
            self._head_file.sync()
        except apsw.FullError:
            self._reserve.give_up()  # nothing is lost: what could not be moved is durable where it lies
        except (apsw.Error, OSError) as error:
            self._broken = True
            raise StoreFailed(f"the log could not be moved out of its WAL: {error}") from error
        self._wal_pages = 0


def _connect(path: Path, flags: int) -> apsw.Connection:
    if apsw.SQLITE_VERSION_NUMBER < OLDEST_SQLITE:
        raise StoreFailed(f"SQLite {apsw.sqlite_lib_version()} has the WAL-reset bug; 3.51.3 or newer is needed")
    try:
        connection = apsw.Connection(str(path), flags=flags)
        connection.set_busy_timeout(2000)
    except apsw.Error as error:
        raise StoreFailed(f"{path}: {error}") from error
    return connection


@contextmanager
def _opening(connection: apsw.Connection, path: Path) -> Iterator[None]:
    """Let go of the file where opening it goes wrong, and say so. Raises StoreFailed."""
    try:
        yield
    except (apsw.Error, OSError) as error:
        with suppress(StoreFailed):
            _close(connection)
        if isinstance(error, StoreFailed):
            raise
        raise StoreFailed(f"{path}: {error}") from error


def _close(connection: apsw.Connection) -> None:
    try:
        connection.close()
    except apsw.Error as error:
        raise StoreFailed(f"the log could not be closed: {error}") from error


def sync_folder(folder: Path) -> None:
    """Make the names in a folder durable: without this a power cut takes the whole file. Raises OSError."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _set_pragmas(connection: apsw.Connection) -> None:
    for name, wanted in _PRAGMAS.items():
        connection.pragma(name, wanted)
        if (found := connection.pragma(name)) != wanted:
            raise StoreFailed(f"PRAGMA {name} is {found!r} and can't be made {wanted!r} on this file system")


def _identity(connection: apsw.Connection) -> tuple[bytes, bytes]:
    try:
        meta: dict[str, Any] = dict(connection.execute("SELECT name, value FROM meta"))
        flight_id, secret = meta["flight_id"], b"" if REDACTED in meta else meta["secret"]
        if _length(flight_id) != FLIGHT_ID_BYTES or (_length(secret) != SECRET_BYTES and REDACTED not in meta):
            raise ValueError("its id or its secret is damaged")
        return flight_id, secret
    except (apsw.Error, KeyError, ValueError) as error:
        raise StoreFailed(f"this is not the log of a flight: {error}") from error


def _length(value: object) -> int:
    return len(value) if isinstance(value, bytes) else -1


def _head(connection: apsw.Connection) -> Head:
    try:
        row = connection.execute("SELECT seq, leaf FROM record ORDER BY seq DESC LIMIT 1").fetchone()
        if row is not None and not isinstance(row[1], bytes):
            raise ValueError("its last leaf is damaged")
    except (apsw.Error, ValueError) as error:
        raise StoreFailed(f"the log could not be read: {error}") from error
    return Head(-1, FIRST_LEAF_BEFORE) if row is None else Head(row[0], row[1])


def _stored(connection: apsw.Connection, start: int, stop: int | None, select: str = _SELECT) -> Iterator[Stored]:
    try:
        for row in connection.execute(select, (start, _END if stop is None else stop)):
            yield Stored(row[0], row[1], Moment(*row[2:7]), *row[7:])
    except (apsw.Error, UnicodeDecodeError) as error:
        raise StoreFailed(f"the log could not be read: {error}") from error


def _checkpoints(connection: apsw.Connection) -> list[tuple[int, str]]:
    try:
        if connection.execute("SELECT 1 FROM sqlite_schema WHERE name = 'checkpoint'").fetchone() is None:
            return []
        rows: Any = connection.execute("SELECT size, note FROM checkpoint ORDER BY size").fetchall()
        if not all(isinstance(size, int) and isinstance(note, str) for size, note in rows):
            raise ValueError("a column is damaged")
        return [(size, note) for size, note in rows]
    except (apsw.Error, ValueError) as error:
        raise StoreFailed(f"the checkpoints could not be read: {error}") from error
