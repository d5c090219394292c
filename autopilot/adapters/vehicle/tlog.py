"""One `.tlog` file: frames of both directions behind their time, as ground stations write and read them.

A record is 8 bytes of time, microseconds since 1970, big-endian, and one frame. Signatures are cut off, SETUP_SIGNING
(which holds a key) is left out, and so is what is no frame. While a file is written it is called NAME.tlog.open; it
gets its name when its digest is in the log, so a file without that ending is complete. Nothing here decides when.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from autopilot.adapters.vehicle.frames import MAGIC, is_intact, length_of, message_id, without_signature
from events.schema.link_pb2 import RawSegmentClosed

ENDING: Final = ".tlog"
OPEN: Final = ".tlog.open"
SETUP_SIGNING: Final = 256
TIME_BYTES: Final = 8


def record_of(wall_us: int, frame: bytes) -> bytes | None:
    """Return the record of a whole frame, or None where it must not or can not be kept."""
    if message_id(frame) == SETUP_SIGNING or not is_intact(frame):
        return None
    return wall_us.to_bytes(TIME_BYTES, "big") + without_signature(frame)


def name_of(path: Path) -> str:
    """Return how the log names a file: flight/raw/file, without the ending of an open one."""
    return "/".join((path.parent.parent.name, path.parent.name, path.name.removesuffix(OPEN) + ENDING))


class Segment:
    """A file that is written. All its methods raise OSError."""

    def __init__(self, folder: Path, number: int) -> None:
        """Begin NNNN.tlog in a folder that is made where it is missing."""
        folder.mkdir(exist_ok=True)
        self.path = folder / f"{number:04}{OPEN}"
        self._file = self.path.open("xb")
        self._hash = hashlib.sha256()
        self.closed = RawSegmentClosed(name=name_of(self.path))

    @property
    def size_bytes(self) -> int:
        """How much is in it."""
        return self.closed.size_bytes

    def write(self, record: bytes) -> None:
        """Append a record of `record_of`."""
        self._file.write(record)
        self._hash.update(record)
        _count(self.closed, record)

    def flush(self) -> None:
        """Hand over to the system what was written, so that only a power cut loses it."""
        self._file.flush()

    def close(self) -> RawSegmentClosed:
        """Make it durable; return what is to be recorded of it."""
        with self._file:
            self._file.flush()
            os.fsync(self._file.fileno())
        self.closed.sha256 = self._hash.digest()
        return self.closed


def name_for_good(path: Path) -> None:
    """Give a file its name, once its digest is recorded. Raises OSError."""
    path.rename(path.with_name(path.name.removesuffix(OPEN) + ENDING))


def next_number(folder: Path) -> int:
    """Return the number of the next file of a folder, from 1."""
    numbers = [int(path.name[:4]) for path in folder.glob(f"[0-9][0-9][0-9][0-9]{ENDING}*")]
    return max(numbers, default=0) + 1


def left_open(flights: Path) -> list[Path]:
    """Return the files below the folder of all flights that a process left open, the oldest first."""
    return sorted(flights.glob(f"*/raw/*{OPEN}"))


def close_found(path: Path) -> RawSegmentClosed:
    """Cut a file that a process left open behind its last whole record; return what is to be recorded of it.

    Raises OSError.
    """
    data = path.read_bytes()
    closed = RawSegmentClosed(name=name_of(path), found=True)
    for record in _records(data):
        _count(closed, record)
    with path.open("r+b") as file:
        file.truncate(closed.size_bytes)
        os.fsync(file.fileno())
    closed.sha256 = hashlib.sha256(data[: closed.size_bytes]).digest()
    return closed


def _records(data: bytes) -> Iterator[bytes]:
    at = 0
    while at + TIME_BYTES < len(data) and data[at + TIME_BYTES] == MAGIC:
        length = length_of(data[at + TIME_BYTES : at + TIME_BYTES + 12])
        if length is None or at + TIME_BYTES + length > len(data):
            return
        yield data[at : at + TIME_BYTES + length]
        at += TIME_BYTES + length


def _count(closed: RawSegmentClosed, record: bytes) -> None:
    wall_us = int.from_bytes(record[:TIME_BYTES], "big")
    if not closed.frames:
        closed.first_us = wall_us
    closed.last_us = wall_us
    closed.frames += 1
    closed.size_bytes += len(record)
