"""Reads the WAL before SQLite opens it, and tells a torn tail from damage (SQLite file format, section 4).

SQLite takes the first frame that does not check for the end of the WAL, and says nothing: one rotten bit can take
acknowledged commits with it. A power cut can only tear the last transaction, for each commit is synced before the next
begins. So a commit mark beyond the transaction of the first bad frame says that the WAL is damaged, not torn. Damage
in the last transaction looks like a torn tail from here; the head file tells those apart. Nothing is changed.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

HEADER_BYTES = 32
FRAME_HEADER_BYTES = 24
# Read at a time; 256 frames of 4 KiB are 1 MiB.
CHUNK_FRAMES = 256

_HEADER = struct.Struct(">8I")  # magic, format, page size, checkpoint number, two salts, two sums
_FRAME = struct.Struct(">6I")  # page number, pages after a commit or 0, two salts, two sums
_MAGIC = 0x377F0682  # its last bit is set where the sums are over big-endian words
_FORMAT = 3_007_000
_WORD = 0xFFFFFFFF

Sums = tuple[int, int]
Words = npt.NDArray[np.uint32]


class Wal(Enum):
    """What the WAL is."""

    ABSENT = "absent"  # no file, or an empty one: everything is in the database
    CLEAN = "clean"
    TORN = "torn"  # the last transaction is not whole, which is what a power cut leaves
    DAMAGED = "damaged"  # a frame is bad, and a commit that came after it is there
    HEADER_DAMAGED = "header damaged"  # frames follow a header that does not check: SQLite would drop them all


@dataclass(frozen=True, slots=True)
class WalScan:
    """What a scan found. Frames and commits are counted from 1; 0 is none."""

    verdict: Wal
    commits: int = 0  # that SQLite will find
    frames: int = 0  # up to the last of these commits
    bad_frame: int = 0  # the first frame after them that does not check
    later_commit: int = 0  # frame with a commit mark that proves damage


def scan_wal(path: Path) -> WalScan:
    """Return what the WAL at `path` is. Raises OSError where it can't be read."""
    try:
        with path.open("rb") as file:
            return _scan(file)
    except FileNotFoundError:
        return WalScan(Wal.ABSENT)


def _scan(file: BinaryIO) -> WalScan:
    header = file.read(HEADER_BYTES)
    if not header:
        return WalScan(Wal.ABSENT)
    if len(header) < HEADER_BYTES:
        return WalScan(Wal.TORN)
    magic, version, page_bytes, _number, salt_one, salt_two, *sums = _HEADER.unpack(header)
    big = bool(magic & 1)
    told = _fold(_words(header[:24], big=big)[None, :], (0, 0))[0]
    if magic & ~1 != _MAGIC or version != _FORMAT or not _is_page_size(page_bytes) or told != tuple(sums):
        return WalScan(Wal.HEADER_DAMAGED if _anything(file) else Wal.TORN)
    return _Frames(page_bytes, (salt_one, salt_two), told, big=big).scan(file)


def _is_page_size(size: int) -> bool:
    return 512 <= size <= 65_536 and size & (size - 1) == 0


def _anything(file: BinaryIO) -> bool:
    """Say whether there is a byte that is not zero: blocks that were given to a file and never written are zero."""
    while chunk := file.read(1 << 20):
        if chunk.count(0) != len(chunk):
            return True
    return False


class _Frames:
    """One walk over the frames."""

    def __init__(self, page_bytes: int, salts: tuple[int, int], sums: Sums, *, big: bool) -> None:
        self._frame_bytes = FRAME_HEADER_BYTES + page_bytes
        self._salts = salts
        self._sums = sums
        self._big = big
        self._number = 0  # frames walked over
        self._commits = self._frames = self._bad = 0
        self._ours_after = self._own_commit = False  # from the bad frame on: a frame of this WAL, the first commit

    def scan(self, file: BinaryIO) -> WalScan:
        """Return what was found."""
        for chunk in self._chunks(file):
            for later_commit in self._walk(chunk):
                return WalScan(Wal.DAMAGED, self._commits, self._frames, self._bad, later_commit)
        part = file.seek(0, 2) - HEADER_BYTES - self._number * self._frame_bytes
        begun = self._number if not self._bad else self._bad - 1
        torn = self._ours_after or begun > self._frames or (part > 0 and not self._bad)
        # Frames of other salts after a commit are left over from before the WAL began anew: its end, and no tear.
        bad = 0 if not torn else self._bad or begun + 1
        return WalScan(Wal.TORN if torn else Wal.CLEAN, self._commits, self._frames, bad)

    def _chunks(self, file: BinaryIO) -> Iterator[bytes]:
        while chunk := file.read(self._frame_bytes * CHUNK_FRAMES):
            whole = len(chunk) - len(chunk) % self._frame_bytes
            if whole:
                yield chunk[:whole]

    def _walk(self, chunk: bytes) -> Iterator[int]:
        """Go on over whole frames; yield the commit that proves damage."""
        count = len(chunk) // self._frame_bytes
        heads = [_FRAME.unpack_from(chunk, number * self._frame_bytes) for number in range(count)]
        found: list[Sums] = []
        if not self._bad:
            content = _words(chunk, big=self._big).reshape(count, -1)
            summed = np.hstack([content[:, :2], content[:, FRAME_HEADER_BYTES // 4 :]])
            found = _fold(summed, self._sums)
        for index, (_page, pages_after, *rest) in enumerate(heads):
            self._number += 1
            ours = (rest[0], rest[1]) == self._salts
            if not self._bad:
                self._check(pages_after, ours and found[index] == (rest[2], rest[3]), found[index])
            if self._bad and ours:
                self._ours_after = True
                if pages_after and self._own_commit:
                    yield self._number
                self._own_commit = self._own_commit or bool(pages_after)

    def _check(self, pages_after: int, holds: bool, sums: Sums) -> None:
        if not holds:
            self._bad = self._number
            return
        self._sums = sums
        if pages_after:
            self._commits += 1
            self._frames = self._number


def _words(content: bytes, *, big: bool) -> Words:
    return np.frombuffer(content, dtype=">u4" if big else "<u4").astype(np.uint32)


@cache
def _weights(pairs: int) -> tuple[Words, Sums, Sums]:
    """Return how each word of a block counts in its two sums, and how the sums before it do.

    A step over the words (x, y) is s' = s + x + t, t' = t + y + s', all modulo 2^32: a linear map, so a whole block is
    one, and numpy can do all blocks at once.
    """
    weights = np.zeros((2 * pairs, 2), dtype=np.uint32)
    # (s, t) at the end as a sum of (s, t) at this place: begins as the identity at the end of the block.
    s, t = (1, 0), (0, 1)
    for pair in reversed(range(pairs)):
        weights[2 * pair] = [(s[0] + t[0]) & _WORD, (s[1] + t[1]) & _WORD]  # x counts in s' and so in t'
        weights[2 * pair + 1] = t  # y counts in t' alone
        before_s = ((s[0] + t[0]) & _WORD, (s[1] + t[1]) & _WORD)
        before_t = ((s[0] + 2 * t[0]) & _WORD, (s[1] + 2 * t[1]) & _WORD)
        s, t = before_s, before_t
    return weights, s, t


def _fold(blocks: Words, sums: Sums) -> list[Sums]:
    """Return the cumulative sums after each block (a row of words), going on from `sums`."""
    weights, from_s, from_t = _weights(blocks.shape[1] // 2)
    found = []
    for own_s, own_t in (blocks @ weights).tolist():
        s, t = sums
        sums = (s * from_s[0] + t * from_t[0] + own_s) & _WORD, (s * from_s[1] + t * from_t[1] + own_t) & _WORD
        found.append(sums)
    return found
