"""The scan of the WAL: truncated at every offset, one bit flipped in every byte, blocks zeroed and swapped."""

from __future__ import annotations

import struct
from io import BytesIO
from pathlib import Path
from random import Random

import pytest

from events.store import SqliteStore
from events.store.walscan import CHUNK_FRAMES, Wal, WalScan, _scan, scan_wal
from tests.checks import check_equal
from tests.events.store.test_contract import FLIGHT_ID, SECRET, batch
from tests.events.store.wals import PAGE_BYTES, make_wal

FRAME = 24 + PAGE_BYTES


def scan(content: bytes) -> WalScan:
    """Scan bytes."""
    return _scan(BytesIO(content))


@pytest.mark.parametrize("restarts", [0, 1])
def test_truncated_at_every_offset(tmp_path: Path, restarts: int) -> None:
    """No false alarm: clean at the end of a commit, torn everywhere else, with the commits that stand."""
    content, ends = make_wal(tmp_path, restarts=restarts)
    content = content[: ends[-1]]
    for cut in range(len(content) + 1):
        found = scan(content[:cut])
        commits = sum(end <= cut for end in ends)
        verdict = Wal.CLEAN if cut in ends or cut == 32 else Wal.TORN
        check_equal((cut, found.verdict, found.commits), (cut, verdict if cut else Wal.ABSENT, commits))
        check_equal(found.bad_frame > 0, verdict is Wal.TORN and cut > 32)


def test_one_bit_of_every_byte(tmp_path: Path) -> None:
    """Damage is told wherever a later commit shows it; else a commit is missing, which the head file tells."""
    content, ends = make_wal(tmp_path)
    chance = Random(3)
    for at in range(len(content)):
        flipped = bytearray(content)
        flipped[at] ^= 1 << chance.randrange(8)
        found = scan(bytes(flipped))
        before = sum(end <= at for end in ends)
        expected = {Wal.DAMAGED}
        if at < 32:
            expected = {Wal.HEADER_DAMAGED}
        elif at >= ends[-2]:
            expected = {Wal.TORN, Wal.CLEAN}  # the last transaction; clean where a salt of its last frame is hit
            expected |= {Wal.DAMAGED} if 4 <= (at - 32) % FRAME < 8 else set()  # a commit mark that was none
        elif at >= ends[-3] and (at - 32) % FRAME < 16:
            expected = {Wal.DAMAGED, Wal.TORN}  # a commit mark or its salt may be gone, and one commit proves nothing
        assert found.verdict in expected, (at, found)
        check_equal((at, found.commits), (at, before if at >= 32 else 0))


@pytest.mark.parametrize("block", [64, 512, 4096])
def test_blocks_zeroed_and_swapped(tmp_path: Path, block: int) -> None:
    """Everything that changes what is before the last two transactions is damage."""
    content, ends = make_wal(tmp_path, 20)
    for at in range(0, ends[-3] - block, block):
        other = (at + 7 * block) % (ends[-3] - block)
        swapped = bytearray(content)
        swapped[at : at + block], swapped[other : other + block] = content[other:][:block], content[at:][:block]
        for changed in (content[:at] + bytes(block) + content[at + block :], bytes(swapped)):
            if changed != content:
                assert scan(changed).verdict in (Wal.DAMAGED, Wal.HEADER_DAMAGED), (at, other)


def test_frames_from_before_the_wal_began_anew(tmp_path: Path) -> None:
    """They carry other salts: the end of the WAL, not its damage."""
    content, ends = make_wal(tmp_path, 4, restarts=2)
    assert len(content) > ends[-1] + 3 * FRAME
    check_equal(scan(content), WalScan(Wal.CLEAN, 4, (ends[-1] - 32) // FRAME))
    torn = content[: ends[-1] - 10] + bytes(10) + content[ends[-1] :]
    check_equal(scan(torn), WalScan(Wal.TORN, 3, (ends[-2] - 32) // FRAME, (ends[-1] - 32) // FRAME))


def test_what_the_file_system_gives_and_nobody_wrote(tmp_path: Path) -> None:
    """Zeros after a whole WAL are its end; zeros alone are one that was never written."""
    content, _ends = make_wal(tmp_path)
    check_equal(scan(content + bytes(3 * FRAME)).verdict, Wal.CLEAN)
    check_equal(scan(bytes(4096)).verdict, Wal.TORN)
    check_equal(scan_wal(tmp_path / "none-wal"), WalScan(Wal.ABSENT))


def test_a_header_must_be_one_that_sqlite_takes(tmp_path: Path) -> None:
    """Also where its sums are right: a format or a page size that does not exist."""
    content, _ends = make_wal(tmp_path)
    for at, value in ((4, 3_007_001), (8, 500), (8, 131_072), (8, 0)):
        header = bytearray(content[:24])
        struct.pack_into(">I", header, at, value)
        changed = bytes(header) + struct.pack(">2I", *sums(bytes(header))) + content[32:]
        check_equal(scan(changed).verdict, Wal.HEADER_DAMAGED)


def sums(content: bytes) -> tuple[int, int]:
    """Return the two sums as the format says them, word by word, little-endian."""
    one = two = 0
    for first, second in struct.iter_unpack("<2I", content):
        one = (one + first + two) & 0xFFFFFFFF
        two = (two + second + one) & 0xFFFFFFFF
    return one, two


def test_the_log_of_a_flight_through_several_chunks(tmp_path: Path) -> None:
    """Pages as they are in flight, more frames than are read at a time; and a flip in the second chunk is found."""
    SqliteStore.create(tmp_path / "flight.db", FLIGHT_ID, SECRET).close()
    store = SqliteStore(tmp_path / "flight.db")
    for number in range(CHUNK_FRAMES):
        store.append(batch(number, number + 1))
    wal = tmp_path / "flight.db-wal"
    found = scan_wal(wal)
    check_equal((found.verdict, found.commits), (Wal.CLEAN, CHUNK_FRAMES))
    content = bytearray(wal.read_bytes())
    assert found.frames > CHUNK_FRAMES + 2
    at = 32 + CHUNK_FRAMES * 4120 + 2000
    content[at] ^= 4
    found = scan(bytes(content))
    check_equal((found.verdict, found.bad_frame), (Wal.DAMAGED, CHUNK_FRAMES + 1))
    store.close()
