"""Redacted copies of a log: every leaf stands, what was removed is nowhere in the file, and no forgery passes."""

from __future__ import annotations

from pathlib import Path

import apsw
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from events import BodyRemoved, Chain, ChainBroken, make_record, read_record
from events.chain import body_hash, salt_of
from events.records import NO_CAUSE, Moment, Record, Stored
from events.schema.flight_pb2 import NodeStarted
from events.store import MemoryStore, SqliteReader, SqliteStore, StoreFailed
from events.store.protocol import Reader
from events.store.redacted import redacted, write_redacted
from tests.checks import check_equal
from tests.replay.copies import Copy

FLIGHT_ID = bytes(range(16))
SECRET = bytes(range(32))
COUNT = 40


def record(seq: int) -> Record:
    """Return a record whose body can be searched for."""
    message = NodeStarted(boot_id=f"a boot that nobody else has, number {seq}", start=seq)
    return make_record(seq, NO_CAUSE, Moment(seq, seq, 1, seq, 2), message)


def flight(count: int = COUNT) -> MemoryStore:
    """Return a flight with a checkpoint."""
    store = MemoryStore(FLIGHT_ID, SECRET)
    store.append([record(seq) for seq in range(count)])
    store.add_checkpoint(count, "a note")
    return store


def check_copy(copy: Reader, source: MemoryStore, removed: set[int]) -> None:
    """Check headers and leaves of all records, bodies of those that stay, and the chain."""
    rows = list(copy.stored())
    chain = Chain(copy.flight_id, b"")
    for row, original in zip(rows, source.stored(), strict=True):
        chain.check(row)
        check_equal(row._replace(body=b"", salt=b"", removed=b""), original._replace(body=b""))
        check_equal(bool(row.removed), row.seq in removed)
        if row.removed:
            check_equal((row.body, row.salt), (b"", b""))
            with pytest.raises(BodyRemoved, match=f"record {row.seq} .node_started. was removed"):
                read_record(row)
        else:
            check_equal(read_record(row), read_record(original))
    check_equal((copy.secret, copy.flight_id), (b"", FLIGHT_ID))
    check_equal((copy.head, chain.leaf), (source.head, source.head.leaf))
    check_equal(copy.checkpoints(), source.checkpoints())


def check_broken(row: Stored, source: MemoryStore) -> None:
    """Check that the chain of a copy does not go over a row."""
    chain = Chain(FLIGHT_ID, b"", list(source.stored())[row.seq - 1].leaf)
    with pytest.raises(ChainBroken, match=f"record {row.seq}"):
        chain.check(row)


@settings(max_examples=60, deadline=None)
@given(st.sets(st.integers(0, COUNT - 1)), st.sets(st.integers(0, COUNT - 1)))
def test_any_records_can_be_removed_in_any_order(first: set[int], second: set[int]) -> None:
    """Redacting twice is redacting both at once."""
    source = flight()
    once = Copy(source, first)
    check_copy(once, source, first)
    check_copy(Copy(once, second), source, first | second)
    check_equal(list(Copy(once, second).stored()), list(Copy(source, first | second).stored()))


def test_the_file_holds_nothing_of_what_was_removed(tmp_path: Path) -> None:
    """No secret, no salt, no body, no WAL; what stays is there, so the search would find it."""
    source, removed = flight(400), set(range(100, 300))
    path = tmp_path / "flight.db"
    check_equal(write_redacted(source, path, removed), source.head)
    content = path.read_bytes()
    check_equal([one.name for one in tmp_path.iterdir()], ["flight.db"])
    assert SECRET not in content
    for row in source.stored():
        there = (row.body in content, row.body[2:-2] in content, salt_of(SECRET, row.seq) in content)
        check_equal(there, (row.seq not in removed,) * 3)
    reader = SqliteReader(path)
    check_copy(reader, source, removed)
    reader.close()


def test_nothing_is_recorded_in_a_copy(tmp_path: Path) -> None:
    """And looking at it leaves no file beside it."""
    path = tmp_path / "flight.db"
    write_redacted(flight(), path, {7})
    before = path.read_bytes()
    with pytest.raises(StoreFailed, match="redacted copy: nothing more is recorded"):
        SqliteStore(path)
    assert path.read_bytes() == before
    check_equal([one.name for one in tmp_path.iterdir()], ["flight.db"])


def test_a_copy_is_made_of_a_whole_log_only(tmp_path: Path) -> None:
    """A broken chain, a gap, a cut; and a file is never written over."""
    source, path = flight(), tmp_path / "flight.db"
    rows = list(source.stored())
    for bad in (
        [*rows[:5], rows[5]._replace(body=b""), *rows[6:]],
        [*rows[:5], *rows[6:]],
        rows[:-1],
    ):
        broken = Copy(source, (), bad)
        broken.secret = SECRET
        with pytest.raises(ChainBroken):
            write_redacted(broken, path, {7})
        assert list(tmp_path.iterdir()) == []
    path.write_bytes(b"kept")
    with pytest.raises(StoreFailed, match="is there already"):
        write_redacted(source, path, {7})
    assert path.read_bytes() == b"kept"
    with pytest.raises(StoreFailed):
        write_redacted(source, tmp_path / "no" / "where.db", {7})


def test_forgeries_break_the_chain() -> None:
    """Another hash, a body put back, a byte that wanders between salt and body, both or neither of them."""
    source = flight()
    rows = list(redacted(source, {7}, COUNT))
    gone, kept = rows[7], rows[8]
    body, salt = record(8).body, salt_of(SECRET, 8)
    for bad in (
        gone._replace(removed=bytes(32)),
        gone._replace(removed=gone.removed[:-1]),
        gone._replace(removed="x" * 32),  # type: ignore[arg-type]
        gone._replace(removed=b"", body=record(7).body, salt=bytes(16)),
        gone._replace(body=record(7).body),
        gone._replace(salt=salt_of(SECRET, 7)),
        gone._replace(removed=b""),
        kept._replace(body=body + b"\x00"),
        kept._replace(salt=bytes(16)),
        kept._replace(salt=salt + body[:1], body=body[1:]),
        kept._replace(salt=salt[:-1], body=salt[-1:] + body),
        kept._replace(removed=bytes(32)),
        kept._replace(cause=0),
        kept._replace(salt=None),  # type: ignore[arg-type]
    ):
        check_broken(bad, source)
    check_equal(gone.removed, body_hash(next(source.stored(7)), SECRET))
    chain = Chain(FLIGHT_ID, b"", rows[6].leaf)
    chain.check(gone)
    chain.check(kept)


def test_a_flight_with_a_secret_takes_no_hash_for_a_body() -> None:
    """What is removed is only so in a copy."""
    source = flight()
    row = next(redacted(source, {0}, COUNT))
    with pytest.raises(ChainBroken):
        Chain(FLIGHT_ID, SECRET).check(row)


def test_a_row_is_whole_or_removed(tmp_path: Path) -> None:
    """The table itself takes no half of one."""
    path = tmp_path / "flight.db"
    write_redacted(flight(), path, {7})
    connection = apsw.Connection(str(path))
    for change in ("body = NULL", "salt = NULL", "removed = x'00'", "body = NULL, salt = NULL"):
        with pytest.raises(apsw.ConstraintError):
            connection.execute(f"UPDATE record SET {change} WHERE seq = 8")
    connection.close()
