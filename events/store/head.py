"""The head file: the end of the log once more, outside the database, in two checksummed slots.

It lies as `head` beside `flight.db` and is written after each commit, without fsync, the slots in turn. SQLite takes a
WAL whose last frame has rotted for one that ends before it; what was acknowledged and is gone is seen here alone, also
a signed checkpoint. It promises nothing of its own: after a power cut it may be older than the log, never newer.
"""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

from events.store.protocol import Head

NAME = "head"
# Slots a page of flash apart: what tears one leaves the other.
SLOT_APART = 4096
# Magic, generation u64, seq i64, leaf 32 bytes, signed u64; then the CRC-32 of these, u32. Big-endian.
_SLOT = struct.Struct(">8sQq32sQ")
_CRC = struct.Struct(">I")
_MAGIC = b"WPHEAD\x00\x01"
_SLOT_BYTES = _SLOT.size + _CRC.size


@dataclass(frozen=True, slots=True)
class HeadSeen:
    """What a head file says."""

    head: Head
    generation: int  # grows by one with each commit since the file was made
    torn: bool  # one of the two slots is not whole
    signed: int = 0  # records under the newest checkpoint, 0 where nothing was signed


def read_head_file(folder: Path) -> HeadSeen | None:
    """Return the newest whole slot; None for a file without one. Raises FileNotFoundError, and OSError."""
    with (folder / NAME).open("rb") as file:
        content = file.read(SLOT_APART + _SLOT_BYTES)
    slots = [content[at : at + _SLOT_BYTES] for at in (0, SLOT_APART)]
    whole = [slot for slot in map(_slot, slots) if slot is not None]
    if not whole:
        return None
    generation, head, signed = max(whole)
    # In the first generation the second slot has never been written, and is zero.
    return HeadSeen(head, generation, len(whole) < 2 and (generation > 1 or any(slots[1])), signed)


def _slot(content: bytes) -> tuple[int, Head, int] | None:
    if len(content) < _SLOT_BYTES or _CRC.pack(crc32(content[: _SLOT.size])) != content[_SLOT.size :]:
        return None
    magic, generation, seq, leaf, signed = _SLOT.unpack_from(content)
    return (generation, Head(seq, leaf), signed) if magic == _MAGIC else None


class HeadFile:
    """Writes the head file of one flight. The descriptor stays open: a commit pays for one small write."""

    def __init__(self, folder: Path) -> None:
        """Open the file, make it where there is none. Raises OSError."""
        try:
            seen = read_head_file(folder)
        except FileNotFoundError:
            seen = None
        self._generation = 0 if seen is None else seen.generation
        self.fresh = seen is None  # nothing of it can be read yet
        self._descriptor = os.open(folder / NAME, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        if os.fstat(self._descriptor).st_size < SLOT_APART + _SLOT_BYTES:
            os.ftruncate(self._descriptor, 2 * SLOT_APART)

    def write(self, head: Head, signed: int = 0) -> None:
        """Write the slot whose turn it is. Not durable before `sync`. Raises OSError."""
        self._generation += 1
        slot = _SLOT.pack(_MAGIC, self._generation, *head, signed)
        place = SLOT_APART if self._generation % 2 == 0 else 0
        os.pwrite(self._descriptor, slot + _CRC.pack(crc32(slot)), place)

    def sync(self) -> None:
        """Make it durable. Raises OSError."""
        os.fsync(self._descriptor)

    def close(self) -> None:
        """Make it durable and let go of it. Closing twice is harmless. Raises OSError."""
        if self._descriptor >= 0:
            descriptor, self._descriptor = self._descriptor, -1
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
