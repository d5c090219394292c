"""The snapshots of one flight: a file `snapshots` beside the log, to which chunks are appended.

It is a cache. It is never synced, and whatever of it is missing, torn or damaged is passed over: then the log is read
from further back. What is in a chunk, and whether it may be believed, is not known here.
"""

from __future__ import annotations

import gc
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import blake2b
from pathlib import Path
from typing import NamedTuple

NAME = "snapshots"
# Magic, size u64 (records), base u64 (size of the chunk that it rests on), length u64, BLAKE2b-128 of these and the
# body. Big-endian; then the body.
_HEADER = struct.Struct(">8sQQQ16s")
_COUNTS = struct.Struct(">QQQ")
_MAGIC = b"WPSNAP\x00\x01"


class ChunkDamaged(OSError):
    """A chunk is not there as it was written."""


class Place(NamedTuple):
    """Where a chunk lies."""

    base: int
    start: int  # of its body, in bytes
    length: int


def _checksum(size: int, base: int, body: bytes) -> bytes:
    digest = blake2b(_COUNTS.pack(size, base, len(body)), digest_size=16)
    digest.update(body)
    return digest.digest()


class Snapshots:
    """Reads the chunks of a flight."""

    def __init__(self, folder: Path) -> None:
        """Look where they lie; a file that is not there has none. Raises OSError."""
        self._path = folder / NAME
        self.places: dict[int, Place] = dict(_places(self._path))

    def base_of(self) -> dict[int, int]:
        """Return for each chunk, by its size, the size of the one that it rests on."""
        return {size: place.base for size, place in self.places.items()}

    def read(self, size: int) -> bytes:
        """Return a chunk's body. Raises ChunkDamaged, KeyError where there is none, and OSError."""
        place = self.places[size]
        with self._path.open("rb") as file:
            file.seek(place.start - _HEADER.size)
            header, body = file.read(_HEADER.size), file.read(place.length)
        if header != _HEADER.pack(_MAGIC, size, place.base, place.length, _checksum(size, place.base, body)):
            raise ChunkDamaged(f"the chunk of {size} records is damaged")
        return body


def _places(path: Path) -> Iterator[tuple[int, Place]]:
    """Yield the chunks up to the first that is not whole in its length."""
    try:
        with path.open("rb") as file:
            end, at = os.fstat(file.fileno()).st_size, 0
            while len(header := file.read(_HEADER.size)) == _HEADER.size:
                magic, size, base, length, _ = _HEADER.unpack(header)
                at += _HEADER.size
                if magic != _MAGIC or length > end - at:
                    return
                yield size, Place(base, at, length)
                at += length
                file.seek(at)
    except FileNotFoundError:
        return


class SnapshotWriter:
    """Appends chunks. Belongs to one thread."""

    def __init__(self, folder: Path, after: int) -> None:
        """Go on after the chunk of `after` records, 0 for none, and drop what follows it. Raises OSError."""
        self._path = folder / NAME
        kept = Snapshots(folder).places.get(after)
        end = 0 if kept is None else kept.start + kept.length
        if end or self._path.exists():
            os.truncate(self._path, end)

    def append(self, size: int, base: int, body: bytes) -> None:
        """Write a chunk. Raises OSError; then the file may end with a part of it, which nobody reads."""
        descriptor = os.open(self._path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o600)
        with open(descriptor, "wb") as file:
            file.write(_HEADER.pack(_MAGIC, size, base, len(body), _checksum(size, base, body)))
            file.write(body)

    def discard(self) -> None:
        """Remove the file: there are better uses for the room. Raises OSError."""
        self._path.unlink(missing_ok=True)


@contextmanager
def unhurried() -> Iterator[None]:
    """Let the garbage collector rest while many rows are made that all stay; it would look at them again and again."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
