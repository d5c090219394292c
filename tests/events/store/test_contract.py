"""What every store of a flight promises: one suite for all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from events import Chain, Moment, Record, make_record, read_record
from events.chain import FIRST_LEAF_BEFORE
from events.schema.flight_pb2 import InputsDropped
from events.store import MemoryStore, SqliteReader, SqliteStore, StoreFailed
from events.store.protocol import Appender, Head, Reader
from tests.checks import check_equal

FLIGHT_ID = bytes(range(16))
SECRET = bytes(range(32))
Make = Callable[[], Appender]


def record(seq: int, flight_ns: int = 0, boot: int = 1) -> Record:
    """Return a record with a body of its own."""
    message = InputsDropped(input_class="frame", count=seq)
    return make_record(seq, seq - 1, Moment(flight_ns, 2 * seq, boot, -seq, 2), message)


def batch(start: int, stop: int) -> list[Record]:
    """Return records with start <= seq < stop."""
    return [record(seq) for seq in range(start, stop)]


@pytest.fixture(params=["memory", "sqlite"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Appender]:
    """Make an empty store of each sort."""
    made: Appender = MemoryStore(FLIGHT_ID, SECRET)
    if request.param == "sqlite":
        made = SqliteStore.create(tmp_path / "flight.db", FLIGHT_ID, SECRET)
    yield made
    made.close()


def check_holds(reader: Reader, records: list[Record]) -> None:
    """Check that a flight holds these records and no others, and that its chain holds."""
    rows = list(reader.stored())
    check_equal([read_record(row) for row in rows], records)
    chain = Chain(reader.flight_id, reader.secret)
    for row in rows:
        chain.check(row)
    check_equal(reader.head, Head(len(records) - 1, chain.leaf))


def test_an_empty_store(store: Appender) -> None:
    """Head -1, nothing to read, and it knows whose it is."""
    check_equal((store.flight_id, store.secret), (FLIGHT_ID, SECRET))
    check_equal(store.head, Head(-1, FIRST_LEAF_BEFORE))
    check_holds(store, [])
    check_equal(store.append([]), store.head)


def test_what_was_appended_is_read_back(store: Appender) -> None:
    """In order, as it was, through several batches."""
    check_equal(store.append(batch(0, 3)).seq, 2)
    check_equal(store.append(batch(3, 4)), store.head)
    store.append([])
    store.idle()
    check_holds(store, batch(0, 4))


@pytest.mark.parametrize(
    ("start", "stop", "seqs"),
    [
        (0, None, [0, 1, 2, 3, 4]),
        (2, None, [2, 3, 4]),
        (1, 3, [1, 2]),
        (3, 3, []),
        (4, 2, []),
        (5, None, []),
        (2, 99, [2, 3, 4]),
    ],
)
def test_a_part_of_it_is_read(store: Appender, start: int, stop: int | None, seqs: list[int]) -> None:
    """Start <= seq < stop."""
    store.append(batch(0, 5))
    check_equal([row.seq for row in store.stored(start, stop)], seqs)


def check_refused(store: Appender, records: list[Record], words: str) -> None:
    """Check that a batch is refused whole, and that the store goes on as if it had not been."""
    before, rows = store.head, list(store.stored())
    with pytest.raises(ValueError, match=words):
        store.append(records)
    check_equal((store.head, list(store.stored())), (before, rows))
    store.append([record(before.seq + 1)])
    check_holds(store, batch(0, before.seq + 2))


@pytest.mark.parametrize("seqs", [[3], [0], [1], [2, 4], [2, 2], [2, 3, 2], [3, 2]])
def test_a_gap_is_refused_whole(store: Appender, seqs: list[int]) -> None:
    """Nothing of the batch stays, and the next one finds the chain as it was."""
    store.append(batch(0, 2))
    check_refused(store, [record(seq) for seq in seqs], "seq [234]")


@pytest.mark.parametrize(("flight_ns", "boot"), [(-1, 1), (0, 1 << 32), (0, -1), (1 << 64, 1)])
def test_a_record_that_does_not_fit_is_refused_whole(store: Appender, flight_ns: int, boot: int) -> None:
    """A value too large for its column takes its batch with it and nothing else."""
    store.append(batch(0, 2))
    check_refused(store, [record(2), record(3, flight_ns, boot)], "does not fit")


def test_a_closed_store(store: Appender) -> None:
    """Takes nothing, gives nothing; closing again is harmless."""
    store.append(batch(0, 2))
    store.close()
    store.close()
    with pytest.raises(StoreFailed):
        store.append(batch(2, 3))
    with pytest.raises(StoreFailed):
        list(store.stored())


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 6), st.sampled_from(["append", "gap", "idle", "open", "misfit"])), max_size=12)
)
def test_any_sequence_of_batches(steps: list[tuple[int, str]]) -> None:
    """Both stores end with the same rows and leaves, whatever was refused between and however often one was opened."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "flight.db"
        memory, sqlite = MemoryStore(FLIGHT_ID, SECRET), SqliteStore.create(path, FLIGHT_ID, SECRET)
        for size, verb in steps:
            start = memory.head.seq + 1
            records = {"gap": batch(start + 1, start + 2 + size), "misfit": [record(start), record(start + 1, -1)]}
            for store in (memory, sqlite):
                if verb in records:
                    with pytest.raises(ValueError, match=r"seq|fit"):
                        store.append(records[verb])
                elif verb == "append":
                    store.append(batch(start, start + size))
                else:
                    store.idle()
            if verb == "open":
                sqlite.close()
                sqlite = SqliteStore(path)
            check_equal(sqlite.head, memory.head)
        check_equal(list(sqlite.stored()), list(memory.stored()))
        reader = SqliteReader(path)
        check_holds(reader, batch(0, memory.head.seq + 1))
        reader.close()
        sqlite.close()


def test_checkpoints_lie_beside_the_records(store: Appender) -> None:
    """By size, the newest of each; they touch neither head nor chain."""
    assert store.checkpoints() == []
    store.append(batch(0, 3))
    for size, note in ((3, "three"), (1, "one"), (3, "three again")):
        store.add_checkpoint(size, note)
    assert store.checkpoints() == [(1, "one"), (3, "three again")]
    check_holds(store, batch(0, 3))
