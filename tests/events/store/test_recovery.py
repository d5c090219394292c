"""Recovery: the table over every combination of facts, and real logs cut, flipped, zeroed and rewritten."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from hashlib import sha256
from itertools import product
from pathlib import Path
from random import Random

import apsw
import pytest

from events import NO_CAUSE, Moment, make_record
from events.schema.flight_pb2 import FlightOpened
from events.store import SqliteStore, StoreFailed, StoreMissing, recovery
from events.store.head import NAME, SLOT_APART
from events.store.protocol import Head
from events.store.recovery import (
    TABLE,
    Action,
    Database,
    Facts,
    HeadFile,
    KeptLog,
    Manifest,
    Records,
    action_for,
    examine,
)
from events.store.walscan import Wal
from tests.checks import check_equal
from tests.events.store.test_contract import FLIGHT_ID, SECRET, batch

COMMITS = 8
LAST = 3 * (COMMITS - 1)


def test_every_combination_of_facts_has_one_row() -> None:
    """And only the one; and every action is reached."""
    reached = set()
    for combination in product(Database, Wal, Records, HeadFile, Manifest):
        facts = Facts(*combination)
        check_equal((facts, sum(row.holds(facts) for row in TABLE)), (facts, 1))
        reached.add(action_for(facts))
    check_equal(reached, set(Action))


def test_nothing_that_is_known_to_be_lost_is_gone_on_with() -> None:
    """Rules that the table must keep, whatever its rows."""
    for combination in product(Database, Wal, Records, HeadFile, Manifest):
        facts = Facts(*combination)
        lost = facts.wal is Wal.DAMAGED or facts.records is not Records.WHOLE
        lost = (
            lost
            or facts.head_file in (HeadFile.NEWER, HeadFile.FORKED, HeadFile.SIGNED_MORE)
            or facts.manifest is Manifest.OTHER
        )
        if facts.database is Database.FAILING:
            check_equal(action_for(facts), Action.REFUSE)
        elif lost or facts.database is Database.MALFORMED:
            check_equal(action_for(facts), Action.KEEP_AND_BEGIN)
        elif facts.wal is Wal.TORN and facts.manifest is Manifest.OWN:
            check_equal(action_for(facts), Action.CUT_AND_SAY)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight as a power cut leaves it, its first half moved into the database and the rest in the WAL."""
    work, left = tmp_path_factory.mktemp("work"), tmp_path_factory.mktemp("left") / "flight"
    SqliteStore.create(work / "flight.db", FLIGHT_ID, SECRET).close()
    store = SqliteStore(work / "flight.db")
    manifest = FlightOpened(flight_id=FLIGHT_ID, flight_number=1)
    store.append([make_record(0, NO_CAUSE, Moment(0, 0, 1, 0, 2), manifest)])
    for number in range(1, COMMITS):
        store.append(batch(3 * number - 2, 3 * number + 1))
        if number == 2:
            store._connection.wal_checkpoint(mode=apsw.SQLITE_CHECKPOINT_TRUNCATE)
    shutil.copytree(work, left, ignore=shutil.ignore_patterns("*-shm", "reserve"))
    store.close()
    return left


@pytest.fixture
def folder(recorded: Path, tmp_path: Path) -> Path:
    """Return a copy of the flight to spoil."""
    return shutil.copytree(recorded, tmp_path / "000001-00010203")


def content(folder: Path) -> dict[str, str]:
    """Return the digests of a folder's files; SQLite's index of the WAL and an empty WAL come and go with a reader."""
    files = [file for file in folder.iterdir() if file.is_file() and not file.name.endswith("-shm")]
    return {file.name: sha256(file.read_bytes()).hexdigest() for file in files if file.stat().st_size}


def check_found(folder: Path, action: Action, last: int, words: str = "") -> None:
    """Check what an examination finds, and that it changes nothing."""
    before = content(folder)
    finding = examine(folder)
    check_equal((finding.action, finding.end.seq), (action, last))
    check_equal(content(folder), before)
    assert words in finding.words(), finding.words()
    check_equal(finding.sound, action in (Action.GO_ON, Action.PASS_OVER))


def spoil(path: Path, change: Callable[[bytearray], None]) -> None:
    """Change a file's bytes."""
    changed = bytearray(path.read_bytes())
    change(changed)
    path.write_bytes(bytes(changed))


def test_a_log_that_a_kill_left_is_whole(folder: Path) -> None:
    """Nothing to say; also when the head file did not get to the disk."""
    check_found(folder, Action.GO_ON, LAST)
    spoil(folder / NAME, lambda file: file.__setitem__(slice(SLOT_APART, None), bytes(SLOT_APART)))
    check_found(folder, Action.GO_ON, LAST, "one slot of the head file is torn")


def test_without_a_head_file(folder: Path) -> None:
    """It goes on, and says that nothing vouches for the end."""
    (folder / NAME).write_bytes(b"")
    check_found(folder, Action.GO_ON_AND_SAY, LAST, "head file is unreadable")
    (folder / NAME).unlink()
    check_found(folder, Action.GO_ON_AND_SAY, LAST, "there is no head file")
    (folder / NAME).mkdir()
    check_found(folder, Action.REFUSE, -1)


def test_a_torn_tail_is_cut_at_every_sampled_offset(recorded: Path, tmp_path: Path) -> None:
    """With a head that knows no more than what is left, a cut is never called damage; with one that does, always."""
    wal = (recorded / "flight.db-wal").read_bytes()
    chance = Random(5)
    for number, cut in enumerate(sorted(chance.sample(range(len(wal)), 40))):
        folder = shutil.copytree(recorded, tmp_path / str(number))
        (folder / "flight.db-wal").write_bytes(wal[:cut])
        finding = examine(folder)
        check_equal((finding.action, finding.facts.head_file), (Action.KEEP_AND_BEGIN, HeadFile.NEWER))
        assert finding.facts.wal in (Wal.TORN, Wal.CLEAN, Wal.ABSENT)
        (folder / NAME).unlink()
        check_equal(examine(folder).action in (Action.CUT_AND_SAY, Action.GO_ON_AND_SAY), True)
        if examine(folder).end.seq < 0:
            continue
        store = SqliteStore(folder / "flight.db")
        check_equal(store.head, finding.end)
        seq = store.head.seq + 1
        store.append(batch(seq, seq + 2))
        store.close()
        check_found(folder, Action.GO_ON, seq + 1)


@pytest.mark.parametrize(("name", "at_least"), [("flight.db", 30), ("flight.db-wal", 300)])
def test_no_flipped_bit_is_silent(recorded: Path, tmp_path: Path, name: str, at_least: int) -> None:
    """A seeded sample: found, or of no consequence: every record is there and holds."""
    source, folder = shutil.copytree(recorded, tmp_path / "source"), tmp_path / "flight"
    if name == "flight.db":
        SqliteStore(source / name).close()  # moves everything into it
    whole = (source / name).read_bytes()
    chance, found = Random(7), 0
    for at in chance.sample(range(len(whole)), 300):
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(source, folder)
        flipped = bytearray(whole)
        flipped[at] ^= 1 << chance.randrange(8)
        (folder / name).write_bytes(bytes(flipped))
        finding = examine(folder)
        if finding.action is Action.KEEP_AND_BEGIN:
            found += 1
        else:
            check_equal((at, finding.action, finding.end.seq), (at, Action.GO_ON, LAST))
    assert found >= at_least


def rewritten(folder: Path, sql: str) -> None:
    """Change the database as somebody who holds the disk can."""
    connection = apsw.Connection(str(folder / "flight.db"))
    connection.execute(sql)
    connection.close()


def test_a_log_that_somebody_changed(recorded: Path, tmp_path: Path) -> None:
    """Edited, cut at its end, holed, emptied, exchanged: each is kept, with what holds named."""
    for number, (sql, last, words) in enumerate(
        [
            ("UPDATE record SET body = x'00' WHERE seq = 7", 6, "record 7"),
            ("DELETE FROM record WHERE seq > 9", 9, "what follows 9 is lost"),
            ("DELETE FROM record WHERE seq = 4", 3, "record 4 is missing"),
            ("DELETE FROM record", -1, "no record can be read"),
            ("UPDATE meta SET value = x'11' WHERE name = 'flight_id'", -1, "its id or its secret is damaged"),
            ("UPDATE meta SET value = value || x'00' WHERE name = 'secret'", -1, "its id or its secret is damaged"),
            ("UPDATE meta SET value = zeroblob(16) WHERE name = 'flight_id'", -1, "record 0"),
            ("UPDATE record SET cause = 'x' WHERE seq = 2", 1, "record 2: a column does not fit"),
            ("DROP TABLE meta", -1, "not the log of a flight"),
        ]
    ):
        folder = shutil.copytree(recorded, tmp_path / str(number))
        rewritten(folder, sql)
        check_found(folder, Action.KEEP_AND_BEGIN, last, words)


def test_a_log_that_was_sealed_anew(folder: Path) -> None:
    """The secret lies in the file: a chain can be made anew, but the head file knows the old leaf."""
    other = folder.parent / "other"
    other.mkdir()
    store = SqliteStore.create(other / "flight.db", FLIGHT_ID, SECRET)
    manifest = FlightOpened(flight_id=FLIGHT_ID, flight_number=9)
    store.append([make_record(0, NO_CAUSE, Moment(0, 0, 1, 0, 2), manifest)])
    store.append(batch(1, LAST + 3))
    store.close()
    (folder / "flight.db-wal").unlink()
    shutil.copy(other / "flight.db", folder / "flight.db")
    check_found(folder, Action.KEEP_AND_BEGIN, LAST + 2, f"another leaf for record {LAST}")


def test_a_log_without_its_manifest(tmp_path: Path) -> None:
    """Another flight's manifest, or a record that is none; an empty log is a start that was cut short."""
    for number, records in enumerate([[], batch(0, 2)]):
        folder = tmp_path / str(number)
        folder.mkdir()
        store = SqliteStore.create(folder / "flight.db", FLIGHT_ID, SECRET)
        store.append(records)
        store.close()
    check_found(tmp_path / "0", Action.PASS_OVER, -1)
    check_found(tmp_path / "1", Action.KEEP_AND_BEGIN, 1, "does not begin with the manifest")


def test_a_wal_whose_header_is_gone(folder: Path) -> None:
    """SQLite would drop all of it without a word; here the head file says what is lost, and nothing is cut."""
    spoil(folder / "flight.db-wal", lambda file: file.__setitem__(slice(0, 32), bytes(32)))
    check_found(folder, Action.KEEP_AND_BEGIN, 6, "what follows 6 is lost")
    (folder / NAME).unlink()
    check_found(folder, Action.KEEP_AND_BEGIN, 6, "the header of the WAL is damaged")


def test_a_log_that_can_not_be_read(tmp_path: Path) -> None:
    """Refused where the system does not let it be read, kept where it is no log; missing is missing."""
    with pytest.raises(StoreMissing, match="no log at"):
        examine(tmp_path)
    (tmp_path / "flight.db").mkdir()
    check_found_kind(tmp_path, Database.FAILING, Action.REFUSE)
    (tmp_path / "flight.db").rmdir()
    (tmp_path / "flight.db").write_bytes(b"no database at all, but long enough to be one" * 100)
    check_found_kind(tmp_path, Database.MALFORMED, Action.KEEP_AND_BEGIN)


def check_found_kind(folder: Path, database: Database, action: Action) -> None:
    """Check how SQLite's answer is taken."""
    finding = examine(folder)
    check_equal((finding.facts.database, finding.action), (database, action))
    assert finding.detail


def test_a_torn_tail_is_sound_where_the_head_vouches_for_the_rest(folder: Path) -> None:
    """It is what a power cut leaves; without the head nobody can tell."""
    wal = folder / "flight.db-wal"
    wal.write_bytes(wal.read_bytes() + wal.read_bytes()[32:1000])
    finding = examine(folder)
    check_equal((finding.action, finding.end.seq, finding.sound), (Action.CUT_AND_SAY, LAST, True))
    (folder / NAME).unlink()
    finding = examine(folder)
    check_equal((finding.action, finding.end.seq, finding.sound), (Action.CUT_AND_SAY, LAST, False))


@pytest.mark.parametrize(
    ("error", "database"),
    [
        *((each, Database.FAILING) for each in (apsw.IOError, apsw.CantOpenError, apsw.PermissionsError)),
        *((each, Database.FAILING) for each in (apsw.ReadOnlyError, apsw.BusyError, apsw.LockedError)),
        *((each, Database.FAILING) for each in (apsw.NoMemError, apsw.FullError)),
        *((each, Database.MALFORMED) for each in (apsw.CorruptError, apsw.NotADBError, apsw.SQLError, ValueError)),
    ],
)
def test_whose_fault_it_is(
    folder: Path, monkeypatch: pytest.MonkeyPatch, error: type[Exception], database: Database
) -> None:
    """A disk that says no says nothing of the log; everything else that SQLite says does."""

    def reader(_path: Path) -> None:
        raise StoreFailed("for a test") from error("for a test")

    monkeypatch.setattr(recovery, "SqliteReader", reader)
    check_equal(examine(folder).facts.database, database)


def test_a_manifest_of_another_flight(folder: Path) -> None:
    """A log under a wrong id: its own chain may hold, and it is not this flight's."""
    other = folder.parent / "000002-00000000"
    other.mkdir()
    store = SqliteStore.create(other / "flight.db", bytes(16), SECRET)
    store.append([make_record(0, NO_CAUSE, Moment(0, 0, 1, 0, 2), FlightOpened(flight_id=FLIGHT_ID))])
    store.close()
    check_found(other, Action.KEEP_AND_BEGIN, 0, "does not begin with the manifest")


def test_a_kept_log_gives_what_holds_and_takes_nothing(folder: Path) -> None:
    """Up to the damage, and not beyond."""
    rewritten(folder, "UPDATE record SET body = x'00' WHERE seq = 7")
    kept = KeptLog(examine(folder))
    check_equal([stored.seq for stored in kept.stored()], list(range(7)))
    check_equal([stored.seq for stored in kept.stored(2, 99)], [2, 3, 4, 5, 6])
    check_equal([stored.seq for stored in kept.stored(2, 4)], [2, 3])
    check_equal((kept.flight_id, kept.secret, kept.checkpoints()), (FLIGHT_ID, SECRET, []))
    check_equal(kept.head, Head(6, next(kept.stored(6)).leaf))
    kept.idle()
    for take in (lambda: kept.append(batch(7, 8)), lambda: kept.add_checkpoint(7, "note")):
        with pytest.raises(StoreFailed, match="a damaged log takes no"):
            take()
    kept.close()


def test_a_torn_tail_leaves_no_frames_behind(folder: Path) -> None:
    """What a torn transaction left can't be taken for a later commit by the next scan."""
    wal = folder / "flight.db-wal"
    spoil(wal, lambda file: file.__setitem__(slice(len(file) - 4000, len(file) - 3000), b"x" * 1000))
    (folder / NAME).unlink()
    check_found(folder, Action.CUT_AND_SAY, LAST - 3, "torn after commit")
    store = SqliteStore(folder / "flight.db")
    check_equal(wal.stat().st_size, 0)
    check_holds_from(store, LAST - 3)
    store.close()


def check_holds_from(store: SqliteStore, last: int) -> None:
    """Check that a store goes on after `last`."""
    check_equal(store.head.seq, last)
    store.append(batch(last + 1, last + 3))
    check_equal(store.head.seq, last + 2)
