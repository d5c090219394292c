"""WALs for tests: real ones with small pages, and where each of their commits ends."""

from __future__ import annotations

from pathlib import Path

import apsw

PAGE_BYTES = 512


def make_wal(folder: Path, commits: int = 10, *, restarts: int = 0) -> tuple[bytes, list[int]]:
    """Return a WAL and the sizes that it had after each commit; `restarts` times it began anew before."""
    path = folder / "small.db"
    connection = apsw.Connection(str(path))
    connection.pragma("page_size", PAGE_BYTES)
    connection.pragma("journal_mode", "wal")
    connection.wal_autocheckpoint(0)
    connection.execute("CREATE TABLE one (number INTEGER PRIMARY KEY, text BLOB)")
    connection.wal_checkpoint(mode=apsw.SQLITE_CHECKPOINT_RESTART)
    for _ in range(restarts):
        for number in range(2 * commits):
            connection.execute("INSERT INTO one (text) VALUES (randomblob(?))", (100 + number,))
        connection.wal_checkpoint(mode=apsw.SQLITE_CHECKPOINT_RESTART)
    ends: list[int] = []
    pages: list[int] = []

    def committed(_connection: apsw.Connection, _name: str, count: int) -> int:
        pages.append(count)
        return apsw.SQLITE_OK

    connection.set_wal_hook(committed)
    for number in range(commits):
        connection.execute("INSERT INTO one (text) VALUES (randomblob(?))", (number * 97 % 900,))
        ends.append(32 + pages[-1] * (24 + PAGE_BYTES))
    content = path.with_name("small.db-wal").read_bytes()
    connection.close()
    return content, ends
