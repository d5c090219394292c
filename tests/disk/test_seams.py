"""The seams see everything that is done to the disk, and what they refuse is not done."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from random import Random

import apsw
import pytest

from tests.autopilot.node.nodes import FakeClock
from tests.checks import check_equal
from tests.disk.cuts import everything
from tests.disk.lives import Life, folder, land, live, small
from tests.disk.model import Disk, Do, Op, read_in
from tests.disk.seams import meeting


def test_a_disk_that_follows_holds_what_the_folder_holds() -> None:
    """A whole life, two flights, byte for byte, modes and shared memory aside; and outside of it nothing is seen."""
    disk, chance = Disk(), Random("home")
    with folder() as root, small():
        with meeting(root, disk.do):
            life = Life(root, FakeClock(), chance, lambda _: None, "one").start()
            live(life, chance, [1, 2, 3])
            land(life, chance)
            live(life, chance, [4])
            found = read_in(root)
            seen = disk.done
        check_equal(disk.after(everything(disk, chance, 512, False)), found)
        life.let_go()
        assert read_in(root) != found
    check_equal(disk.done, seen)
    check_equal(len([path for path in found if path.endswith("flight.db")]), 2)


@pytest.mark.parametrize(("number", "expected"), [(errno.EIO, apsw.IOError), (errno.ENOSPC, apsw.FullError)])
def test_sqlite_is_told_in_its_own_words(tmp_path: Path, number: int, expected: type[apsw.Error]) -> None:
    """An I/O error, or a full disk; nothing was written."""
    refused = False

    def watch(op: Op) -> None:
        if refused and op.do is Do.WRITE:
            raise OSError(number, "for a test")

    with meeting(tmp_path, watch):
        connection = apsw.Connection(str(tmp_path / "one.db"))
        connection.execute("PRAGMA journal_mode = wal")
        connection.execute("CREATE TABLE t (x)")
        refused = True
        with pytest.raises(expected):
            connection.execute("INSERT INTO t VALUES (1)")
        refused = False
        check_equal(connection.execute("SELECT * FROM t").fetchall(), [])
        connection.close()


def test_sqlite_syncs_folders_as_the_system_does_for_it(tmp_path: Path) -> None:
    """With the first sync of a journal, and with a removal that asks for it."""
    seen: list[Op] = []
    with meeting(tmp_path, seen.append):
        connection = apsw.Connection(str(tmp_path / "one.db"))
        connection.execute("PRAGMA synchronous = EXTRA")
        connection.execute("CREATE TABLE t (x)")
        connection.close()
    done = [(op.do, op.path) for op in seen if op.do in (Do.SYNC, Do.SYNC_FOLDER, Do.DELETE)]
    journal = (Do.SYNC, "one.db-journal")
    check_equal(done[:3], [journal, (Do.SYNC_FOLDER, ""), journal])
    check_equal(done[-2:], [(Do.DELETE, "one.db-journal"), (Do.SYNC_FOLDER, "")])
    check_equal(done.count((Do.SYNC_FOLDER, "")), 2)


def calls(folder: Path) -> None:
    """Make every call that a seam knows, once."""
    descriptor = os.open(folder / "a", os.O_RDWR | os.O_CREAT)
    os.pwrite(descriptor, b"abc", 1)
    os.ftruncate(descriptor, 2)
    os.posix_fallocate(descriptor, 0, 9)
    os.fsync(descriptor)
    os.close(descriptor)
    (folder / "b").mkdir()
    (folder / "a").rename(folder / "c")
    (folder / "c").replace(folder / "d")
    with (folder / "d").open("r+b") as file:
        file.write(b"seen when it is synced")
        file.flush()
        os.fsync(file.fileno())
    (folder / "d").unlink()
    (folder / "d").unlink(missing_ok=True)
    (folder / "b").mkdir(exist_ok=True)
    descriptor = os.open(folder, os.O_RDONLY)
    os.fsync(descriptor)
    os.close(descriptor)


def test_every_call_is_seen(tmp_path: Path) -> None:
    """In its order, and what fails for another reason is not."""
    seen: list[Op] = []
    with meeting(tmp_path, seen.append):
        calls(tmp_path)
    words = b"seen when it is synced"
    check_equal(
        seen,
        [
            Op(Do.CREATE, "a"),
            Op(Do.WRITE, "a", 1, b"abc"),
            Op(Do.SIZE, "a", 2),
            Op(Do.GROW, "a", 9),
            Op(Do.SYNC, "a"),
            Op(Do.FOLDER, "b"),
            Op(Do.RENAME, "a", target="c"),
            Op(Do.RENAME, "c", target="d"),
            Op(Do.OPEN, "d"),
            Op(Do.SIZE, "d", len(words)),
            Op(Do.WRITE, "d", 0, words),
            Op(Do.SYNC, "d"),
            Op(Do.DELETE, "d"),
            Op(Do.OPEN, ""),
            Op(Do.SYNC_FOLDER, ""),
        ],
    )


def test_what_is_refused_is_not_done(tmp_path: Path) -> None:
    """At each call of the whole row: the folder is as it was after the last one that was seen."""
    for at in range(15):
        place = tmp_path / str(at)
        place.mkdir()
        disk = Disk()

        def watch(op: Op, at: int = at, disk: Disk = disk) -> None:
            if disk.done == at:
                raise OSError(errno.EIO, "for a test")
            disk.do(op)

        with meeting(place, watch), pytest.raises(OSError, match="for a test"):
            calls(place)
        expected = disk.after(everything(disk, Random(1), 512, False))
        found = read_in(place)
        if at in (9, 10):  # Python's own writes are done before they are seen
            expected["d"] = found["d"]
        check_equal(found, expected)


def test_elsewhere_nothing_is_seen(tmp_path: Path) -> None:
    """Another folder, also one whose name begins alike."""
    ours, other = tmp_path / "a", tmp_path / "ab"
    ours.mkdir()
    other.mkdir()
    seen: list[Op] = []
    with meeting(ours, seen.append):
        calls(other)
        apsw.Connection(str(other / "x.db")).execute("CREATE TABLE t (x)")
    check_equal(seen, [])
