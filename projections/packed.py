"""The status as bytes and back, for a start that does not read the whole log again. It decides nothing."""

from __future__ import annotations

import msgspec

from projections.picture import Status


class StatusBroken(ValueError):
    """These bytes are no status as this version knows it."""


_ENCODER = msgspec.msgpack.Encoder()
_DECODER = msgspec.msgpack.Decoder(Status)


def pack(status: Status) -> bytes:
    """Return the status as bytes. Raises StatusBroken for numbers beyond 64 bits, which only a forged log holds."""
    try:
        return _ENCODER.encode(status)
    except OverflowError as error:
        raise StatusBroken(str(error)) from error


def unpack(data: bytes) -> Status:
    """Read a status. Raises StatusBroken."""
    try:
        return _DECODER.decode(data)
    except msgspec.DecodeError as error:
        raise StatusBroken(str(error)) from error
