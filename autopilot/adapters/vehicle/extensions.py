"""Extension fields that the generated dialect does not know, read from the payload's tail.

A sender cuts zeros off the end of a payload (MAVLink guide, "Payload Truncation"), and extension fields come last, in
the order of their definition. So a field that is not there is zero, which also is what a peer without it says.
"""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

from autopilot.adapters.vehicle.frames import HEADER_BYTES


@cache
def _packer(layout: str) -> struct.Struct:
    return struct.Struct("<" + layout)


def extension(message: Any, offset: int, layout: str) -> tuple[Any, ...]:
    """Return the fields at `offset` bytes of a decoded message's payload, by a `struct` layout (little-endian).

    For instance the targets of TIMESYNC: `extension(message, 16, "BB")`; its opaque_id in MISSION_ACK:
    `extension(message, 4, "I")`. Where the payload ends before, zeros are read.
    """
    packer, frame = _packer(layout), bytes(message.get_msgbuf())
    begin, end = HEADER_BYTES + offset, HEADER_BYTES + frame[1]  # its get_payload begins at the header of MAVLink 1
    return packer.unpack(frame[begin : min(begin + packer.size, end)].ljust(packer.size, b"\0"))
