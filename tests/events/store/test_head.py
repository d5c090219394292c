"""The head file: torn and flipped at every byte, the newest whole slot is what it says."""

from __future__ import annotations

from pathlib import Path

import pytest

from events.chain import FIRST_LEAF_BEFORE
from events.store import SqliteStore
from events.store.head import NAME, SLOT_APART, HeadFile, HeadSeen, read_head_file
from events.store.protocol import Head
from tests.checks import check_equal
from tests.events.store.test_contract import FLIGHT_ID, SECRET, batch

SLOT_BYTES = 68


def head(number: int) -> Head:
    """Return a head that differs in every byte of its leaf."""
    return Head(number, bytes([number]) * 32)


def written(folder: Path, *heads: Head) -> bytes:
    """Write heads one after another; return the file."""
    file = HeadFile(folder)
    for one in heads:
        file.write(one)
    file.close()
    file.close()
    return (folder / NAME).read_bytes()


def seen(folder: Path, content: bytes) -> HeadSeen | None:
    """Return what is read of a file with this content."""
    (folder / NAME).write_bytes(content)
    return read_head_file(folder)


def test_it_says_the_newest(tmp_path: Path) -> None:
    """Also over several openings; a file that was never written says nothing, and one that is missing is missing."""
    with pytest.raises(FileNotFoundError):
        read_head_file(tmp_path)
    written(tmp_path)
    check_equal(read_head_file(tmp_path), None)
    for number in range(1, 6):
        written(tmp_path, head(number))
        check_equal(read_head_file(tmp_path), HeadSeen(head(number), number, torn=False))
    check_equal((tmp_path / NAME).stat().st_mode & 0o777, 0o600)


@pytest.mark.parametrize("number", [2, 3, 4])
def test_it_is_torn_at_every_byte(tmp_path: Path, number: int) -> None:
    """A write that stops anywhere leaves the head before; the whole one is the new head."""
    before = written(tmp_path, *map(head, range(1, number)))
    after = written(tmp_path, head(number))
    place = SLOT_APART * (number % 2 == 0)
    for cut in range(SLOT_BYTES + 1):
        found = seen(tmp_path, before[:place] + after[place : place + cut] + before[place + cut :])
        assert found is not None
        check_equal(
            found.head, head(number if after[place : place + cut] == after[place:][:SLOT_BYTES] else number - 1)
        )


def test_one_bit_of_every_byte(tmp_path: Path) -> None:
    """A flip in the newest slot gives the one before and says that it is torn; in the other one it is said too."""
    whole = written(tmp_path, head(1), head(2))
    for number, place in ((1, 0), (2, SLOT_APART)):
        for at in range(place, place + SLOT_BYTES):
            flipped = bytearray(whole)
            flipped[at] ^= 1 << (at % 8)
            check_equal(seen(tmp_path, bytes(flipped)), HeadSeen(head(3 - number), 3 - number, torn=True))
    check_equal(seen(tmp_path, b""), None)
    check_equal(seen(tmp_path, bytes(len(whole))), None)


def test_a_store_writes_it_after_each_commit(tmp_path: Path) -> None:
    """Every commit that was acknowledged is there, before and after the end; only making it is a generation too."""
    store = SqliteStore.create(tmp_path / "flight.db", FLIGHT_ID, SECRET)
    check_equal(read_head_file(tmp_path), HeadSeen(Head(-1, FIRST_LEAF_BEFORE), 1, torn=False))
    for number in range(2, 6):
        store.append(batch(store.head.seq + 1, store.head.seq + 3))
        store.append([])
        check_equal(read_head_file(tmp_path), HeadSeen(store.head, number, torn=False))
    store.close()
    again = SqliteStore(tmp_path / "flight.db")
    check_equal(read_head_file(tmp_path), HeadSeen(again.head, 5, torn=False))
    again.close()


def test_a_store_writes_it_after_each_checkpoint(tmp_path: Path) -> None:
    """How much was signed is known there too, over several openings, and never gets less."""
    store = SqliteStore.create(tmp_path / "flight.db", FLIGHT_ID, SECRET)
    store.append(batch(0, 9))
    store.add_checkpoint(5, "note")
    check_equal(read_head_file(tmp_path), HeadSeen(store.head, 3, torn=False, signed=5))
    store.add_checkpoint(4, "note")
    check_equal(read_head_file(tmp_path), HeadSeen(store.head, 4, torn=False, signed=5))
    store.close()
    again = SqliteStore(tmp_path / "flight.db")
    again.append(batch(9, 10))
    check_equal(read_head_file(tmp_path), HeadSeen(again.head, 5, torn=False, signed=5))
    again.close()
