"""Messages with the fields at their end that the dialect on board here doesn't know yet.

MAVLink 2 lets a message grow at its end, and the checksum doesn't cover which fields there are (MAVLink
guide, "Extension fields"). `Extended` appends such bytes to a message that pymavlink can build:
opaque_id of MISSION_ACK and MISSION_COUNT, mission_id and its two neighbours of MISSION_CURRENT, as
`common.xml` has them.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as dialect

_U32 = struct.Struct("<I")


@dataclass(frozen=True, slots=True)
class Extended:
    """A message of numbers, and the bytes behind its last known field."""

    message: Any
    tail: bytes

    def get_type(self) -> str:
        """Return the message's name, as a message of the dialect does."""
        return str(self.message.get_type())

    def pack(self, link: Any) -> bytes:
        """Return the frame; trailing zeros are cut off, as of any MAVLink 2 message."""
        known = self.message.unpacker.pack(*(getattr(self.message, name) for name in self.message.ordered_fieldnames))
        return bytes(self.message._pack(link, self.message.crc_extra, known + self.tail))


def mission_ack(target: tuple[int, int], result: int, mission_type: int = 0, opaque_id: int = 0) -> Extended:
    """Return MISSION_ACK with its opaque_id."""
    message = dialect.MAVLink_mission_ack_message(*target, result, mission_type)
    return Extended(message, _U32.pack(opaque_id))


def mission_count(target: tuple[int, int], count: int, mission_type: int = 0, opaque_id: int = 0) -> Extended:
    """Return MISSION_COUNT with its opaque_id."""
    message = dialect.MAVLink_mission_count_message(*target, count, mission_type)
    return Extended(message, _U32.pack(opaque_id))


def mission_current(seq: int, total: int, state: int, mode: int, mission_id: int) -> Extended:
    """Return MISSION_CURRENT with its mission_id; the ids of fence and rally points are 0, none."""
    message = dialect.MAVLink_mission_current_message(seq, total, state, mode)
    return Extended(message, _U32.pack(mission_id) + bytes(8))
