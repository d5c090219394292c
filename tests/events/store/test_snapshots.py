"""The file of snapshots: what was written is read, and what is torn or rotten is passed over."""

from __future__ import annotations

import gc
from contextlib import suppress
from pathlib import Path
from random import Random

import pytest

from events.store.snapshots import NAME, ChunkDamaged, Place, Snapshots, SnapshotWriter, unhurried
from tests.checks import check_equal

CHUNKS = {10: (0, b"ten"), 20: (10, b""), 35: (20, bytes(range(256)) * 3), 50: (10, b"fifty")}
HEADER_BYTES = 48


def written(folder: Path) -> bytes:
    """Write all chunks; return the file."""
    writer = SnapshotWriter(folder, 0)
    for size, (base, body) in CHUNKS.items():
        writer.append(size, base, body)
    return (folder / NAME).read_bytes()


def readable(folder: Path) -> dict[int, tuple[int, bytes]]:
    """Return every chunk that can be read."""
    snapshots, found = Snapshots(folder), dict[int, tuple[int, bytes]]()
    for size, place in snapshots.places.items():
        try:
            found[size] = place.base, snapshots.read(size)
        except ChunkDamaged:
            continue
    return found


def test_what_was_written_is_read(tmp_path: Path) -> None:
    """Each with what it rests on; the file is the owner's alone; without a file there are none."""
    check_equal(readable(tmp_path), {})
    SnapshotWriter(tmp_path, 0)
    check_equal((tmp_path / NAME).exists(), False)
    written(tmp_path)
    check_equal(readable(tmp_path), CHUNKS)
    check_equal(Snapshots(tmp_path).base_of(), {10: 0, 20: 10, 35: 20, 50: 10})
    check_equal(Snapshots(tmp_path).places[10], Place(0, HEADER_BYTES, 3))
    check_equal((tmp_path / NAME).stat().st_mode & 0o777, 0o600)


def test_a_torn_file_has_what_is_whole(tmp_path: Path) -> None:
    """Cut at every byte."""
    whole = written(tmp_path)
    ends = [place.start + place.length for place in Snapshots(tmp_path).places.values()]
    for length in range(len(whole)):
        (tmp_path / NAME).write_bytes(whole[:length])
        expected = [size for size, end in zip(CHUNKS, ends, strict=True) if end <= length]
        check_equal((length, list(readable(tmp_path))), (length, expected))


def test_rot_is_seen(tmp_path: Path) -> None:
    """One bit in every byte: nothing is read that was not written, and what lies before is."""
    whole, chance = written(tmp_path), Random(4)
    starts = [place.start - HEADER_BYTES for place in Snapshots(tmp_path).places.values()]
    for at in range(len(whole)):
        rotten = bytearray(whole)
        rotten[at] ^= 1 << chance.randrange(8)
        (tmp_path / NAME).write_bytes(rotten)
        found = readable(tmp_path)
        check_equal((at, [CHUNKS.get(size) for size in found]), (at, list(found.values())))
        hit = sum(start <= at for start in starts) - 1
        check_equal((at, list(found)[:hit]), (at, list(CHUNKS)[:hit]))
        check_equal((at, list(CHUNKS)[hit] in found), (at, False))
        known = list(Snapshots(tmp_path).places)
        check_equal((at, len(known) == hit or at - starts[hit] >= 8), (at, True))  # nothing behind another magic


def test_a_chunk_that_moved_away_is_damaged(tmp_path: Path) -> None:
    """The place was looked up before the file was begun anew."""
    written(tmp_path)
    snapshots = Snapshots(tmp_path)
    (tmp_path / NAME).write_bytes(b"")
    with pytest.raises(ChunkDamaged, match="chunk of 35 records"):
        snapshots.read(35)


@pytest.mark.parametrize(("after", "left"), [(0, []), (20, [10, 20]), (50, [10, 20, 35, 50]), (7, [])])
def test_a_writer_goes_on_after_a_chunk(tmp_path: Path, after: int, left: list[int]) -> None:
    """What follows it was not usable, and is dropped; also half a chunk at the end."""
    whole = written(tmp_path)
    (tmp_path / NAME).write_bytes(whole + whole[: HEADER_BYTES + 1])
    writer = SnapshotWriter(tmp_path, after)
    check_equal(list(readable(tmp_path)), left)
    writer.append(60, 50, b"sixty")
    check_equal(readable(tmp_path), {**{size: CHUNKS[size] for size in left}, 60: (50, b"sixty")})


def test_a_writer_that_can_not_write_says_so(tmp_path: Path) -> None:
    """And the file can be removed, also where there is none."""
    writer = SnapshotWriter(tmp_path, 0)
    (tmp_path / NAME).mkdir()
    with pytest.raises(OSError, match="directory"):
        writer.append(10, 0, b"ten")
    (tmp_path / NAME).rmdir()
    writer.discard()
    written(tmp_path)
    writer.discard()
    check_equal(list(tmp_path.iterdir()), [])


@pytest.mark.parametrize("on", [True, False])
def test_the_collector_rests_and_is_what_it_was(on: bool) -> None:
    """Also where loading fails."""
    was = gc.isenabled()
    try:
        (gc.enable if on else gc.disable)()
        with suppress(ChunkDamaged), unhurried():
            check_equal(gc.isenabled(), False)
            raise ChunkDamaged("for a test")
        check_equal(gc.isenabled(), on)
    finally:
        (gc.enable if was else gc.disable)()
