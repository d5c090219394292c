"""An examination that begins where somebody vouches for the log: what it still sees, and what it leaves to others."""

from __future__ import annotations

from pathlib import Path

import apsw
import pytest

from events.chain import Chain
from events.records import Stored
from events.store import SqliteStore, recovery
from events.store.head import HeadFile as HeadWriter
from events.store.protocol import Head
from events.store.recovery import Action, Finding, HeadFile, Manifest, Records, examine
from events.store.sqlite import SqliteReader
from tests.checks import check_equal
from tests.flights import FLIGHT_ID, SECRET, story

AFTER = 60


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with the whole story."""
    store = SqliteStore.create(tmp_path / "flight.db", FLIGHT_ID, SECRET)
    store.append(story().records)
    store.close()
    return tmp_path


def head_at(folder: Path, seq: int) -> Head:
    """Return what the log says of a record."""
    reader = SqliteReader(folder / "flight.db")
    leaf = next(iter(reader.stored(seq, seq + 1))).leaf
    reader.close()
    return Head(seq, leaf)


def change(folder: Path, statement: str) -> None:
    """Change the log behind SQLite's users' backs."""
    connection = apsw.Connection(str(folder / "flight.db"))
    connection.execute(statement)
    connection.close()


def looked(folder: Path, seq: int = AFTER, leaf: bytes = b"") -> Finding:
    """Examine, with everything up to `seq` vouched for."""
    vouched = head_at(folder, seq)
    return examine(folder, lambda _: vouched._replace(leaf=leaf or vouched.leaf))


@pytest.mark.parametrize("seq", [0, 1, AFTER, len(story().records) - 1])
def test_a_whole_log_is_found_as_it_is_found_from_zero(folder: Path, seq: int) -> None:
    """Wherever it begins."""
    check_equal(looked(folder, seq), examine(folder))
    check_equal(looked(folder, seq).action, Action.GO_ON)


def test_it_reads_only_what_follows(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The manifest, and the records behind."""
    read: list[int] = []

    class Told(Chain):
        def check(self, stored: Stored) -> None:
            read.append(stored.seq)
            super().check(stored)

    monkeypatch.setattr(recovery, "Chain", Told)
    looked(folder)
    check_equal(read, [0, *range(AFTER + 1, len(story().records))])
    read.clear()
    examine(folder)
    check_equal(read, list(range(len(story().records))))


@pytest.mark.parametrize(
    ("statement", "records"),
    [
        (f"DELETE FROM record WHERE seq = {AFTER + 1}", Records.GAP),
        (f"UPDATE record SET body = x'00' WHERE seq = {AFTER + 1}", Records.BROKEN),
        (f"UPDATE record SET body = x'00' WHERE seq = {AFTER + 9}", Records.BROKEN),
        ("UPDATE record SET body = x'00' WHERE seq = 0", Records.BROKEN),
        ("DELETE FROM record WHERE seq = 0", Records.GAP),
        (f"UPDATE record SET body = x'00' WHERE seq = {AFTER - 1}", Records.WHOLE),  # left to the self-replay
    ],
)
def test_what_it_sees_and_what_not(folder: Path, statement: str, records: Records) -> None:
    """Damage behind is damage; damage before is somebody else's to find, and is found from zero."""
    vouched = head_at(folder, AFTER)
    change(folder, statement)
    found = examine(folder, lambda _: vouched)
    check_equal(found.facts.records, records)
    check_equal(found.action is Action.KEEP_AND_BEGIN, records is not Records.WHOLE)
    whole = examine(folder)
    check_equal(whole.action, Action.KEEP_AND_BEGIN)
    check_equal(found.end == whole.end, records is not Records.WHOLE)


def test_a_log_that_does_not_go_on_from_there(folder: Path) -> None:
    """Another leaf is vouched for than the chain goes on from."""
    check_equal(looked(folder, leaf=bytes(32)).facts.records, Records.BROKEN)


def test_another_manifest(folder: Path) -> None:
    """The first record is read all the same."""
    change(folder, "UPDATE meta SET value = zeroblob(16) WHERE name = 'flight_id'")
    check_equal(looked(folder).facts.records, Records.BROKEN)
    check_equal(examine(folder).facts.manifest, Manifest.NONE)


@pytest.mark.parametrize(
    ("seq", "leaf", "stands"),
    [
        (AFTER - 5, b"", HeadFile.OLDER),
        (0, b"", HeadFile.OLDER),
        (AFTER, b"", HeadFile.OLDER),
        (AFTER + 5, b"", HeadFile.OLDER),
        (AFTER - 5, bytes(32), HeadFile.FORKED),
        (AFTER, bytes(32), HeadFile.FORKED),
        (AFTER + 5, bytes(32), HeadFile.FORKED),
    ],
)
def test_the_head_file_may_name_a_record_that_is_passed_over(
    folder: Path, seq: int, leaf: bytes, stands: HeadFile
) -> None:
    """It stands to the log as it does from zero."""
    (folder / "head").unlink()
    writer = HeadWriter(folder)
    writer.write(Head(seq, leaf or head_at(folder, seq).leaf))
    writer.close()
    check_equal(looked(folder).facts.head_file, stands)
    check_equal(examine(folder).facts.head_file, stands)
