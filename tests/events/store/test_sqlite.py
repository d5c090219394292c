"""The log in SQLite: pragmas that are asserted, files that are no logs, a full disk, readers that see commits alone."""

from __future__ import annotations

import os
from hashlib import sha256
from pathlib import Path

import apsw
import pytest

from events.store import SqliteReader, SqliteStore, StoreFailed, StoreMissing, sqlite
from events.store.reserve import RESERVE_BYTES
from tests.checks import check_equal
from tests.events.store.test_contract import FLIGHT_ID, SECRET, batch, check_holds


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Name a database that is not there yet."""
    return tmp_path / "flight.db"


@pytest.fixture
def store(path: Path) -> SqliteStore:
    """Make an empty log."""
    return SqliteStore.create(path, FLIGHT_ID, SECRET)


def check_fails(words: str, call: object, *arguments: object) -> None:
    """Check that opening or writing says what is wrong."""
    assert callable(call)
    with pytest.raises(StoreFailed, match=words):
        call(*arguments)


def test_it_is_durable_by_its_settings(store: SqliteStore) -> None:
    """WAL, synchronous FULL, no memory map, no checkpoint in somebody's commit."""
    pragma = store._connection.pragma
    names = ("journal_mode", "synchronous", "mmap_size", "wal_autocheckpoint", "foreign_keys", "trusted_schema")
    check_equal([pragma(name) for name in names], ["wal", 2, 0, 0, 1, 0])


def test_a_pragma_that_does_not_take_is_refused(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At making and at opening; nothing is left that looks like a log."""
    with monkeypatch.context() as patch:
        patch.setitem(sqlite._PRAGMAS, "page_size", 3)
        check_fails("PRAGMA page_size is 4096", SqliteStore.create, path, FLIGHT_ID, SECRET)
        assert not path.exists()
    SqliteStore.create(path, FLIGHT_ID, SECRET).close()
    monkeypatch.setitem(sqlite._PRAGMAS, "page_size", 3)
    check_fails("PRAGMA page_size is 4096", SqliteStore, path)


def test_an_old_sqlite_is_refused(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its WAL-reset race can corrupt a database that has a reader."""
    monkeypatch.setattr(apsw, "SQLITE_VERSION_NUMBER", 3_051_002)
    check_fails("3.51.3 or newer", SqliteStore.create, path, FLIGHT_ID, SECRET)


@pytest.mark.parametrize("opener", [SqliteStore, SqliteReader])
def test_what_is_no_log_is_not_opened(path: Path, opener: type[SqliteStore] | type[SqliteReader]) -> None:
    """A file that is missing, empty, of another format, a folder, or another program's database."""
    with pytest.raises(StoreMissing, match=r"no log at .*flight\.db"):
        opener(path)
    path.write_bytes(b"")
    check_fails("not the log of a flight", opener, path)
    path.write_bytes(b"no database at all, but long enough to be one" * 100)
    check_fails("not a database", opener, path)
    path.unlink()
    path.mkdir()
    check_fails("unable to open|disk I/O error", opener, path)
    path.rmdir()
    other = apsw.Connection(str(path))
    other.execute("CREATE TABLE meta (name, value); INSERT INTO meta VALUES ('flight_id', 'x')")
    other.close()
    check_fails("not the log of a flight", opener, path)


def test_what_can_not_be_opened_is_let_go(path: Path, store: SqliteStore, monkeypatch: pytest.MonkeyPatch) -> None:
    """No connection stays behind, and what went wrong first is what is said."""
    store.close()
    before = len(apsw.connections())
    monkeypatch.setitem(sqlite._PRAGMAS, "page_size", 3)
    with pytest.raises(StoreFailed, match=r"^PRAGMA page_size"):
        SqliteStore(path)
    check_equal(len(apsw.connections()), before)
    close = sqlite._close

    def broken(connection: apsw.Connection) -> None:
        close(connection)
        raise StoreFailed("it can't be closed either")

    monkeypatch.setattr(sqlite, "_close", broken)
    check_fails("^PRAGMA page_size", SqliteStore, path)


def test_a_file_is_never_written_over(path: Path, store: SqliteStore) -> None:
    """Whatever it is; the log in it stays."""
    store.append(batch(0, 2))
    store.close()
    before = path.read_bytes()
    check_fails("never written over", SqliteStore.create, path, FLIGHT_ID, SECRET)
    check_equal(path.read_bytes(), before)


def test_a_log_is_there_whole_or_not_at_all(path: Path) -> None:
    """A start that is cut short while it makes the log leaves none; one that is not leaves nothing else."""
    check_fails("NOT NULL", SqliteStore.create, path, FLIGHT_ID, None)
    check_equal(path.exists(), False)
    path.with_name("flight.db.new").unlink()
    SqliteStore.create(path, FLIGHT_ID, SECRET).close()
    check_equal(sorted(file.name for file in path.parent.iterdir()), ["flight.db", "head"])
    check_fails("unable to open", SqliteStore.create, path / "no" / "folder", FLIGHT_ID, SECRET)


def test_it_goes_on_where_it_ended(path: Path, store: SqliteStore) -> None:
    """Closed and opened, also with everything still in the WAL."""
    store.append(batch(0, 3))
    other = SqliteStore(path)
    check_holds(other, batch(0, 3))
    other.close()
    store.close()
    again = SqliteStore(path)
    again.append(batch(3, 5))
    check_holds(again, batch(0, 5))
    again.close()


def test_a_reader_sees_commits_alone(path: Path, store: SqliteStore) -> None:
    """Not what a transaction holds; and what it began to read does not change under it."""
    store.append(batch(0, 2))
    reader = SqliteReader(path)
    with store._connection:
        rows = list(store._rows_of(batch(2, 4)))
        store._connection.executemany(sqlite._INSERT, rows)
        check_holds(reader, batch(0, 2))
    check_holds(reader, batch(0, 4))
    rows_read = reader.stored()
    check_equal(next(rows_read).seq, 0)
    reader.close()
    store.close()


def test_a_reader_changes_nothing(path: Path, store: SqliteStore) -> None:
    """It can't write, and the database is the same byte for byte after it."""
    store.append(batch(0, 50))
    store.close()
    before = sha256(path.read_bytes()).digest()
    reader = SqliteReader(path)
    check_holds(reader, batch(0, 50))
    with pytest.raises(apsw.ReadOnlyError):
        reader._connection.execute("DELETE FROM record")
    reader.close()
    reader.close()
    check_equal(sha256(path.read_bytes()).digest(), before)
    check_fails("closed", lambda: reader.head)
    check_fails("closed", lambda: list(reader.stored()))


def test_a_full_disk(path: Path, store: SqliteStore) -> None:
    """The batch that does not fit counts for nothing, nothing more is taken, and what was acknowledged is there."""
    store.append(batch(0, 5))
    store._connection.pragma("max_page_count", store._connection.pragma("page_count"))
    check_fails("could not be written.*full", store.append, batch(5, 500))
    check_equal(store.head.seq, 4)
    store._connection.pragma("max_page_count", 1 << 20)
    check_fails("failed before", store.append, batch(5, 6))
    store.idle()
    store.close()
    again = SqliteStore(path)
    check_holds(again, batch(0, 5))
    again.append(batch(5, 6))
    check_holds(again, batch(0, 6))
    again.close()


def test_a_full_disk_with_space_reserved(path: Path, store: SqliteStore, monkeypatch: pytest.MonkeyPatch) -> None:
    """The batch that met it is written in the space that is given up, once; the next time the log ends."""
    reserve = path.with_name("reserve")
    assert (reserve.stat().st_size, reserve.stat().st_blocks * 512 >= RESERVE_BYTES) == (RESERVE_BYTES, True)
    pages = store._connection.pragma("page_count")
    store._connection.pragma("max_page_count", pages)
    give_up = store._reserve.give_up

    def room() -> bool:
        store._connection.pragma("max_page_count", pages + 20)
        return give_up()

    monkeypatch.setattr(store._reserve, "give_up", room)
    check_equal(store.reserve_spent, False)
    store.append(batch(0, 100))
    check_equal((store.reserve_spent, reserve.exists()), (True, False))
    check_holds(store, batch(0, 100))
    check_fails("could not be written.*full", store.append, batch(100, 3000))
    store.close()
    again = SqliteStore(path)
    check_equal((again.reserve_spent, reserve.exists()), (False, True))
    check_holds(again, batch(0, 100))
    again.close()
    check_equal(reserve.exists(), False)


def test_a_checkpoint_note_on_a_full_disk(store: SqliteStore, monkeypatch: pytest.MonkeyPatch) -> None:
    """It too is written in the space that is given up."""
    pages = store._connection.pragma("page_count")
    store._connection.pragma("max_page_count", pages)
    give_up = store._reserve.give_up

    def room() -> bool:
        store._connection.pragma("max_page_count", pages + 20)
        return give_up()

    monkeypatch.setattr(store._reserve, "give_up", room)
    store.add_checkpoint(0, "n" * 9000)
    check_equal((store.reserve_spent, store.checkpoints()), (True, [(0, "n" * 9000)]))
    store.close()


def test_where_no_space_can_be_reserved(path: Path, store: SqliteStore, monkeypatch: pytest.MonkeyPatch) -> None:
    """It goes without, and a full disk ends the log at once."""
    store.close()

    def full(_descriptor: int, _offset: int, _length: int) -> None:
        raise OSError("no space for a test")

    monkeypatch.setattr(os, "posix_fallocate", full)
    again = SqliteStore(path)
    again._connection.pragma("max_page_count", again._connection.pragma("page_count"))
    check_equal(path.with_name("reserve").exists(), False)
    check_fails("could not be written.*full", again.append, batch(0, 500))
    again.close()


def test_a_second_writer_is_noticed(path: Path, store: SqliteStore) -> None:
    """Its first record collides: it fails, and the first writer's log stays as it is."""
    other = SqliteStore(path)
    store.append(batch(0, 2))
    check_fails("could not be written", other.append, batch(0, 1))
    check_fails("failed before", other.append, batch(2, 3))
    other.close()
    store.append(batch(2, 3))
    check_holds(store, batch(0, 3))
    store.close()


def wal_bytes(path: Path) -> int:
    """Return the size of the WAL."""
    return path.with_name(f"{path.name}-wal").stat().st_size


def test_the_wal_moves_into_the_database_when_idle(
    path: Path, store: SqliteStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not in a commit, once it has grown; under load only where it is far too large."""
    size = path.stat().st_size
    store.append(batch(0, 100))
    store.idle()
    check_equal(path.stat().st_size, size)
    monkeypatch.setattr(sqlite, "IDLE_PAGES", 2)
    store.idle()
    assert path.stat().st_size > size
    size = path.stat().st_size
    monkeypatch.setattr(sqlite, "LOADED_PAGES", 2)
    store.append(batch(100, 400))
    assert path.stat().st_size > size
    check_holds(store, batch(0, 400))
    store.close()


def test_a_checkpoint_that_fails_is_loud(store: SqliteStore, monkeypatch: pytest.MonkeyPatch) -> None:
    """And the store takes nothing more."""
    store.append(batch(0, 100))
    monkeypatch.setattr(sqlite, "IDLE_PAGES", 1)

    class Broken:
        """A connection whose disk is gone."""

        def wal_checkpoint(self, mode: int) -> None:
            raise apsw.IOError("disk I/O error")

    with monkeypatch.context() as patch:
        patch.setattr(store, "_connection", Broken())
        check_fails("moved out of its WAL", store.idle)
    check_fails("failed before", store.append, batch(100, 101))
    store.close()


def test_what_was_changed_in_the_file_is_read_as_it_lies(path: Path, store: SqliteStore) -> None:
    """Reading believes nothing and judges nothing: the chain does."""
    store.append(batch(0, 3))
    store._connection.execute("UPDATE record SET body = 'text', clock_quality = 999 WHERE seq = 1")
    check_equal([row.at.clock_quality for row in store.stored()], [2, 999, 2])
    store.close()
