"""Messages behind a 4-byte big-endian length: how detections travel through a pipe or a TCP connection.

Only bytes: what is in them is `judging`'s business.
"""

from __future__ import annotations

import asyncio
import struct

LENGTH = struct.Struct(">I")


class Broken(Exception):
    """The stream cannot be read on; `because` is the name it is counted under."""

    def __init__(self, because: str) -> None:
        super().__init__(because)
        self.because = because


def framed(payload: bytes) -> bytes:
    """Return the payload behind its length."""
    return LENGTH.pack(len(payload)) + payload


async def read_framed(reader: asyncio.StreamReader, longest: int) -> bytes | None:
    """Return the next payload, or None where the stream ended between two messages.

    Raises `Broken`: "oversized" for a length above `longest` (nothing of it is read), "cut_short"
    where the stream ends inside a message.
    """
    try:
        (length,) = LENGTH.unpack(await reader.readexactly(LENGTH.size))
        if length > longest:
            raise Broken("oversized")
        return await reader.readexactly(length)
    except asyncio.IncompleteReadError as error:
        if not error.partial and error.expected == LENGTH.size:
            return None
        raise Broken("cut_short") from error
