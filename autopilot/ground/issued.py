"""The issuer's own store: a row before an order leaves, a row when its last word is believed.

Rows are only added. A `pending` row is durable before the first byte of its order may leave, and it holds the order's
number, so the numbers of a device grow over restarts and between two shells without any that were reserved ahead. A
`final` row is written before anybody is told of the answer, once for each order. `unanswered` says that no last word
came in the order's time; a final row may still follow it.

It is a small SQLite database beside the keys, through apsw, WAL and synchronous=FULL.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import apsw

FILE = "orders.db"
# A store that is new knows nothing of what left before it: its numbers begin so far ahead of the wall clock's
# milliseconds that neither a clock that was a quarter of an hour fast nor a burst of orders has used them.
JUMP = 1 << 20
GRACE_MS = 2_000  # how long after an order's life its last word may come
BUSY_MS = 5_000  # another shell's row takes a fsync

_SCHEMA = """
CREATE TABLE IF NOT EXISTS audit (
    id INTEGER PRIMARY KEY,
    of INTEGER NOT NULL,
    state TEXT NOT NULL,
    at_ms INTEGER NOT NULL,
    ends_ms INTEGER NOT NULL,
    principal_id TEXT NOT NULL,
    node TEXT NOT NULL,
    command_id TEXT NOT NULL,
    order_seq INTEGER NOT NULL,
    content BLOB NOT NULL,
    result TEXT NOT NULL,
    detail TEXT NOT NULL,
    UNIQUE (of, state)
);
CREATE INDEX IF NOT EXISTS by_number ON audit (order_seq);
"""
_INSERT = "INSERT INTO audit VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"
_AFTER = """
INSERT INTO audit
SELECT NULL, of, :state, :at_ms, ends_ms, principal_id, node, command_id, order_seq, content, :result, :detail
FROM audit WHERE id = :of
ON CONFLICT (of, state) DO NOTHING
"""
_LEFT_OPEN = """
SELECT of FROM audit GROUP BY of HAVING count(*) = 1 AND max(ends_ms) < ? ORDER BY of
"""
_ROWS = "SELECT id, of, state, at_ms, node, command_id, order_seq, content, result, detail FROM audit ORDER BY id"


class NotRecorded(Exception):
    """A row could not be written, so the order does not leave; the text says why."""


@dataclass(frozen=True, slots=True)
class AuditRow:
    """A row of the store."""

    id: int
    of: int  # id of the pending row
    state: str  # "pending", "final", "unanswered"
    at_ms: int  # wall clock, milliseconds since 1970
    node: str
    command_id: str
    order_seq: int
    content: bytes  # the DeviceCommand
    result: str  # one of the five answers, or "failed"; "" where there is none
    detail: str


class Begun(NamedTuple):
    """A pending row that is durable."""

    row: int
    order_seq: int


class IssuedStore:
    """The rows of one identity. May be used from several threads, and by several processes at once."""

    def __init__(self, folder: Path) -> None:
        """Name the store beside the keys in `folder`; it is opened when it is first asked."""
        self._path = folder / FILE
        self._lock = threading.Lock()
        self._opened: apsw.Connection | None = None
        self._tidied = False  # whether orders that an earlier process left were looked at

    def begin(self, node: str, command_id: str, content: bytes, principal_id: str, at_ms: int, life_ms: int) -> Begun:
        """Write the pending row of an order with the next number. Raises NotRecorded.

        The first one of a process says of orders that an earlier process left open that they were not answered.
        """
        with self._writing() as connection:
            if not self._tidied:
                _close_left_open(connection, at_ms)
            newest = _one(connection, "SELECT max(order_seq) FROM audit")
            number = at_ms + JUMP if newest is None else max(newest + 1, at_ms)
            begun = _begin(connection, (principal_id, node, command_id, number, content), at_ms, life_ms)
        self._tidied = True
        return begun

    def again(self, of: int, at_ms: int, life_ms: int) -> Begun:
        """Write the pending row of an order that is sent once more under its number. Raises NotRecorded."""
        kept = "SELECT principal_id, node, command_id, order_seq, content FROM audit WHERE id = ?"
        with self._writing() as connection:
            return _begin(connection, next(connection.execute(kept, (of,))), at_ms, life_ms)

    def end(self, of: int, state: str, *, at_ms: int, result: str = "", detail: str = "") -> None:
        """Write what came of an order; a second row of the same state is none. Raises NotRecorded."""
        with self._writing() as connection:
            connection.execute(_AFTER, {"of": of, "state": state, "at_ms": at_ms, "result": result, "detail": detail})

    def rows(self) -> tuple[AuditRow, ...]:
        """Return all rows, oldest first. Raises NotRecorded."""
        with self._writing() as connection:
            return tuple(AuditRow(*row) for row in connection.execute(_ROWS))

    def close(self) -> None:
        """Let go of the database; asking it opens it again."""
        with self._lock:
            if self._opened is not None:
                self._opened.close()
            self._opened = None

    @contextmanager
    def _writing(self) -> Iterator[apsw.Connection]:
        with self._lock:
            try:
                connection = self._opened = self._opened or self._open()
                connection.execute("BEGIN IMMEDIATE")
                try:
                    yield connection
                except BaseException:
                    connection.execute("ROLLBACK")
                    raise
                connection.execute("COMMIT")
            except (apsw.Error, OSError) as error:
                raise NotRecorded(f"{self._path}: {error}") from error

    def _open(self) -> apsw.Connection:
        self._path.touch(mode=0o600)
        connection = apsw.Connection(str(self._path))
        connection.set_busy_timeout(BUSY_MS)
        connection.pragma("journal_mode", "wal")
        connection.pragma("synchronous", 2)
        connection.execute(_SCHEMA)
        return connection


def _begin(connection: apsw.Connection, about: tuple[Any, ...], at_ms: int, life_ms: int) -> Begun:
    row = int(_one(connection, "SELECT coalesce(max(id), 0) + 1 FROM audit") or 0)
    connection.execute(_INSERT, (row, row, "pending", at_ms, at_ms + life_ms, *about, "", ""))
    return Begun(row, about[3])


def _close_left_open(connection: apsw.Connection, at_ms: int) -> None:
    left = [of for (of,) in connection.execute(_LEFT_OPEN, (at_ms - GRACE_MS,))]
    for of in left:
        detail = "the program ended before an answer"
        connection.execute(_AFTER, {"of": of, "state": "unanswered", "at_ms": at_ms, "result": "", "detail": detail})


def _one(connection: apsw.Connection, query: str, *values: object) -> int | None:
    (value,) = next(connection.execute(query, values))
    return value if isinstance(value, int) else None
