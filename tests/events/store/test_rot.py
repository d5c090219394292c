"""Bit rot in a sample of every area, the head file whole; and that what finds it is missed where it is missing.

The whole of it is `tests.torture.rot`.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import apsw
import pytest

from events.store import SqliteReader, StoreFailed
from events.store.head import NAME, SLOT_APART, HeadSeen, read_head_file
from events.store.recovery import Action, Database, Finding, HeadFile, action_for, examine
from events.store.walscan import Wal
from tests.checks import check_equal
from tests.torture import rot, rotting
from tests.torture.rotting import WAL, Bench, Whole, recorded

SAMPLE = 60
SLOT_BYTES = 68


@pytest.fixture(scope="module")
def wholes(tmp_path_factory: pytest.TempPathFactory) -> tuple[Whole, Whole]:
    """Return a flight with a live WAL, and the same settled."""
    return recorded(tmp_path_factory.mktemp("recorded"))


def check_counts(counts: dict[str, int], *classes: str) -> None:
    """Check that an area's cases fall into these classes alone, and that there are some."""
    assert set(counts) <= set(classes), counts
    assert sum(counts.values()) >= 1


def test_no_rot_is_silent_and_no_power_cut_is_rot() -> None:
    """A seeded sample of each area."""
    said: list[str] = []
    found = rot.run(SAMPLE, seed=2, report=said.append)
    check_equal([found[name] for name in ("silent", "false_alarms", "raised")], [0, 0, 0])
    areas = found["areas"]
    check_equal((len(said), found["cases"] > 15 * SAMPLE), (len(areas), True))
    for name, counts in areas.items():
        if "power cut leaves" in name or "synced" in name:
            check_counts(counts, "cut_and_say", "go_on")
        elif name in ("WAL: one bit of every byte", "WAL: cut at every byte, head file whole"):
            check_counts(counts, "found")
        elif "no head file" in name:
            check_counts(counts, "cut_and_say", "go_on_and_say")
        else:
            check_counts(counts, "found", "harmless", "unchanged", "go_on_and_say")


def test_every_byte_of_the_head_file(wholes: tuple[Whole, Whole], tmp_path: Path) -> None:
    """A flip gives the head, or the one before with a word of it; what is cut away takes the newest slot or both."""
    live = wholes[0]
    content = live.files[NAME]
    newest, older = head_of(tmp_path, content), head_of(tmp_path, live.heads[-2])
    place = SLOT_APART if newest.generation % 2 == 0 else 0
    (tmp_path / NAME).write_bytes(content)
    with (tmp_path / NAME).open("r+b", buffering=0) as file:
        for at in range(len(content)):
            os.pwrite(file.fileno(), bytes([content[at] ^ 1 << at % 8]), at)
            in_newest, in_older = at - place in range(SLOT_BYTES), at - (SLOT_APART - place) in range(SLOT_BYTES)
            expected = replace((newest, older)[in_newest], torn=in_newest or in_older)
            check_equal((at, read_head_file(tmp_path)), (at, expected))
            os.pwrite(file.fileno(), content[at : at + 1], at)


def head_of(folder: Path, content: bytes) -> HeadSeen:
    """Return what a head file says."""
    (folder / NAME).write_bytes(content)
    seen = read_head_file(folder)
    assert seen is not None
    return seen


def test_what_is_not_looked_at_is_silent(
    monkeypatch: pytest.MonkeyPatch, wholes: tuple[Whole, Whole], tmp_path: Path
) -> None:
    """The last commit is a checkpoint: without the head file's word of it, its loss would look like a clean log."""

    def blind(folder: Path) -> Finding:
        found = examine(folder)
        check_equal((found.action, found.facts.head_file), (Action.KEEP_AND_BEGIN, HeadFile.SIGNED_MORE))
        seen = found.facts._replace(head_file=HeadFile.EQUAL, wal=Wal.CLEAN)
        return replace(found, facts=seen, action=action_for(seen))

    monkeypatch.setattr(rotting, "examine", blind)
    content = wholes[0].files[WAL]
    flipped = content[:-100] + bytes([content[-100] ^ 1]) + content[-99:]
    check_equal(Bench(tmp_path, wholes[0]).said({WAL: flipped}).kind, "SILENT")


@pytest.mark.parametrize(
    ("sql", "because"),
    [
        ("UPDATE sqlite_schema SET sql = replace(sql, 'seq INTEGER', 'seq INTEGES')", "malformed"),
        ("UPDATE sqlite_schema SET sql = replace(sql, 'size INTEGER', 'size INTEGES')", "schema"),
        ("UPDATE sqlite_schema SET sql = replace(sql, 'cause INTEGER', 'caust INTEGER')", "no such column"),
        ("UPDATE sqlite_schema SET name = 'checkpoins', tbl_name = 'checkpoins' WHERE name = 'checkpoint'", ""),
        ("CREATE TABLE other (one)", "schema"),
        ("CREATE TRIGGER other AFTER INSERT ON record BEGIN SELECT 1; END", "schema"),
        ("DROP TABLE checkpoint", "their checkpoint is lost"),
        ("DELETE FROM checkpoint", "their checkpoint is lost"),
        ("UPDATE checkpoint SET note = x'ff'", "a column is damaged"),
        ("UPDATE checkpoint SET note = CAST(x'ff' AS TEXT)", "could not be read"),
        ("UPDATE record SET body = CAST(x'ff' AS TEXT) WHERE seq = 5", "could not be read"),
        ("UPDATE record SET leaf = 7 WHERE seq = (SELECT max(seq) FROM record)", "its leaf is not"),
    ],
)
def test_a_damaged_schema_or_side_table(wholes: tuple[Whole, Whole], tmp_path: Path, sql: str, because: str) -> None:
    """Each is kept, with a word that says why."""
    for name, data in wholes[1].files.items():
        (tmp_path / name).write_bytes(data)
    rewritten(tmp_path, sql)
    finding = examine(tmp_path)
    check_equal((finding.action, because in finding.words()), (Action.KEEP_AND_BEGIN, True))


@pytest.mark.parametrize(
    "sql",
    [
        "UPDATE sqlite_schema SET sql = replace(sql, 'PRIMARY', 'PRIMARX') WHERE name = 'checkpoint'",
        "UPDATE record SET leaf = 7 WHERE seq = (SELECT max(seq) FROM record)",
    ],
)
def test_a_reader_gives_nothing_of_the_wrong_type(wholes: tuple[Whole, Whole], tmp_path: Path, sql: str) -> None:
    """Also where nobody has examined the log before."""
    for name, data in wholes[1].files.items():
        (tmp_path / name).write_bytes(data)
    rewritten(tmp_path, sql)
    reader = SqliteReader(tmp_path / "flight.db")
    with pytest.raises(StoreFailed, match="damaged"):
        check_equal((reader.head, reader.checkpoints()), "neither of them")
    reader.close()


def rewritten(folder: Path, sql: str) -> None:
    """Change the database as rot could."""
    connection = apsw.Connection(str(folder / "flight.db"))
    connection.execute("PRAGMA writable_schema = ON")
    connection.execute(sql)
    connection.close()


def test_a_page_of_the_side_tables_that_lost_its_rows(wholes: tuple[Whole, Whole], tmp_path: Path) -> None:
    """The count of a page's cells is no row and in no chain; SQLite's own check of the small tables sees it."""
    files = dict(wholes[1].files)
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    connection = apsw.Connection(str(tmp_path / "flight.db"))
    page = connection.execute("SELECT rootpage FROM sqlite_schema WHERE name = 'checkpoint'").fetchall()[0][0]
    connection.close()
    assert isinstance(page, int)
    at = (page - 1) * 4096 + 3
    content = files["flight.db"]
    fewer = int.from_bytes(content[at : at + 2], "big") - 1
    (tmp_path / "flight.db").write_bytes(content[:at] + fewer.to_bytes(2, "big") + content[at + 2 :])
    (tmp_path / NAME).unlink()
    finding = examine(tmp_path)
    check_equal((finding.facts.database, finding.action), (Database.MALFORMED, Action.KEEP_AND_BEGIN))
    assert "table checkpoint" in finding.words()
