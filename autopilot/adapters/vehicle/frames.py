"""Frames of MAVLink 2 as bytes: how long one is, where one begins in a stream, its checksum without its definition.

Frame, after the MAVLink guide ("Packet Serialization"): magic, length of the payload, incompatible flags, compatible
flags, number, system, component, 3 bytes message id, payload, 2 bytes checksum, and 13 bytes where it is signed.
Numbers are little-endian. Nothing here reads a payload.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Final

from pymavlink.dialects.v20 import common as dialect

MAGIC: Final = 0xFD
HEADER_BYTES: Final = 10
CHECKSUM_BYTES: Final = 2
SIGNATURE_BYTES: Final = 13
SIGNED: Final = 0x01  # of the incompatible flags
FRAME_BYTES_MAX: Final = HEADER_BYTES + 255 + CHECKSUM_BYTES + SIGNATURE_BYTES
_FLAGS_AT: Final = 2
_MAGIC: Final = bytes([MAGIC])


def length_of(frame: bytes) -> int | None:
    """Return the whole frame's length in bytes by its header, or None where that is cut."""
    if len(frame) < HEADER_BYTES + CHECKSUM_BYTES:
        return None
    return HEADER_BYTES + frame[1] + CHECKSUM_BYTES + (SIGNATURE_BYTES if frame[_FLAGS_AT] & SIGNED else 0)


def message_id(frame: bytes) -> int:
    """Return the message id of a whole frame."""
    return int.from_bytes(frame[7:10], "little")


def is_signed(frame: bytes) -> bool:
    """Say whether a whole frame bears a signature."""
    return bool(frame[_FLAGS_AT] & SIGNED)


def is_intact(frame: bytes) -> bool:
    """Say whether a whole frame's checksum holds; one of a message that nobody here knows can't be told."""
    known = dialect.mavlink_map.get(message_id(frame))
    if known is None:
        return True
    end = HEADER_BYTES + frame[1]
    checksum = dialect.x25crc(frame[1:end] + bytes([known.crc_extra])).crc
    return bool(checksum == int.from_bytes(frame[end : end + CHECKSUM_BYTES], "little"))


def as_signed(frame: bytes) -> bytes:
    """Return an unsigned frame with the flag of a signed one, its checksum right; the signature is still to follow."""
    return _turned(frame)


def without_signature(frame: bytes) -> bytes:
    """Return a frame as it would be unsigned, its checksum right; one that is not signed is returned as it is."""
    return _turned(frame[:-SIGNATURE_BYTES]) if is_signed(frame) else frame


def _turned(frame: bytes) -> bytes:
    """Turn the flag over, and the checksum with it: a CRC is linear, so no definition of the message is needed."""
    checksum = int.from_bytes(frame[-CHECKSUM_BYTES:], "little") ^ _turn_of_checksum(frame[1])
    flags = bytes([frame[_FLAGS_AT] ^ SIGNED])
    body = frame[:_FLAGS_AT] + flags + frame[_FLAGS_AT + 1 : -CHECKSUM_BYTES]
    return body + checksum.to_bytes(CHECKSUM_BYTES, "little")


@cache
def _turn_of_checksum(payload_bytes: int) -> int:
    """Return by how much a checksum differs between a frame with the flag and one without."""
    difference = bytearray(HEADER_BYTES + payload_bytes)  # from the length on, and the message's own byte behind it
    difference[_FLAGS_AT - 1] = SIGNED
    crc = dialect.x25crc()
    crc.crc = 0
    crc.accumulate(difference)
    return int(crc.crc)


class Deframer:
    """Cuts a stream of bytes into frames. What is no frame is skipped, byte by byte, and counted.

    A message that nobody here knows has no checksum to hold it to: it counts where another frame, or nothing, follows.
    """

    def __init__(self) -> None:
        self._held = b""
        self.skipped_bytes = 0

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Take bytes; yield the whole frames that they end."""
        held, at = self._held + data, 0
        while (begin := held.find(MAGIC, at)) >= 0:
            self.skipped_bytes += begin - at
            at = begin
            length = length_of(held[at : at + FRAME_BYTES_MAX])
            if length is None or at + length > len(held):
                break
            frame, behind = held[at : at + length], held[at + length : at + length + 1]
            if is_intact(frame) and (message_id(frame) in dialect.mavlink_map or behind in (b"", _MAGIC)):
                yield frame
                at += length
            else:
                self.skipped_bytes += 1
                at += 1
        else:
            self.skipped_bytes += len(held) - at
            at = len(held)
        self._held = held[at:]
