"""A redacted copy of a log: some bodies are not in it, and neither is the secret that all salts derive from.

A record that stays carries its salt; of one that was removed the header stays, and SHA-256(salt || body) in place of
body and salt: 128 bits that nobody has any more keep what it said from being guessed. No leaf changes, so chain, tree,
checkpoints and proofs stand. The copy is built afresh, so that no free page or WAL holds what was taken out, in
rollback mode, so that it can be read where nothing can be written. What to take out is not decided here.
"""

from __future__ import annotations

import os
from collections.abc import Container, Iterator
from contextlib import contextmanager
from pathlib import Path

import apsw

from events.chain import Chain, ChainBroken, body_hash, salt_shown
from events.records import Stored
from events.store.protocol import Head, Reader, StoreFailed
from events.store.sqlite import sync_folder
from events.store.tables import COPY, REDACTED

FORMAT = b"1"

_INSERT = "INSERT INTO record VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"


def redacted(source: Reader, remove: Container[int], stop: int) -> Iterator[Stored]:
    """Yield the records below `stop` as a copy without the bodies of `remove` holds them.

    What an earlier redaction removed stays removed. Raises ChainBroken where the source is not whole: a copy vouches
    for nothing that its source does not. Raises StoreFailed.
    """
    chain = Chain(source.flight_id, source.secret)
    expected = 0
    for stored in source.stored(0, stop):
        if stored.seq != expected:
            break
        chain.check(stored)
        hashed, expected = body_hash(stored, source.secret), expected + 1
        if stored.seq in remove:
            yield stored._replace(body=b"", salt=b"", removed=hashed)
        else:
            yield stored._replace(salt=salt_shown(stored, source.secret))
    if expected != stop:
        raise ChainBroken(f"record {expected} is missing")


def write_redacted(source: Reader, database: Path, remove: Container[int]) -> Head:
    """Write the copy of a log, up to its head now, to a file that is not there yet; return its head.

    Raises ChainBroken where the source is not whole, StoreFailed; then there is no file.
    """
    if database.exists():
        raise StoreFailed(f"{database} is there already: a flight is never written over")
    checkpoints, head = source.checkpoints(), source.head  # in this order: what an open flight signs covers its head
    unfinished = database.with_name(f"{database.name}.new")
    with _made(unfinished) as connection, connection:
        meta = {"flight_id": source.flight_id, REDACTED: FORMAT}
        connection.executemany("INSERT INTO meta VALUES (?, ?)", meta.items())
        connection.executemany(_INSERT, map(_row, redacted(source, remove, head.seq + 1)))
        connection.executemany("INSERT INTO checkpoint VALUES (?, ?)", checkpoints)
    os.rename(unfinished, database)
    sync_folder(database.parent)
    return head


def _row(stored: Stored) -> tuple[int | bytes | None, ...]:
    gone = bool(stored.removed)
    shown = (None, stored.leaf, None, stored.removed) if gone else (stored.body, stored.leaf, stored.salt, None)
    return (stored.seq, stored.cause, *stored.at, stored.kind_number, stored.version, *shown)


@contextmanager
def _made(path: Path) -> Iterator[apsw.Connection]:
    """Give the connection to a fresh database; where the work goes wrong the file is taken away again."""
    try:
        connection = apsw.Connection(str(path))
        try:
            connection.pragma("synchronous", 2)
            connection.execute(COPY)
            yield connection
        finally:
            connection.close()
    except (apsw.Error, OSError, ChainBroken) as error:
        path.unlink(missing_ok=True)
        if isinstance(error, StoreFailed | ChainBroken):
            raise
        raise StoreFailed(f"{path}: {error}") from error
