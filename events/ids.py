"""Identifiers that derive from the log: no chance in the core (style 3).

A UUIDv8 (RFC 9562, section 5.8) over the flight and the seq of the record that brings a thing into being.
"""

from __future__ import annotations

import struct
from hashlib import sha256

_BE64 = struct.Struct(">Q")


def uuid_of(flight_id: bytes, seq: int) -> str:
    """Return the UUIDv8 string of what record `seq` of this flight brought into being."""
    digest = bytearray(sha256(flight_id + _BE64.pack(seq)).digest()[:16])
    digest[6] = digest[6] & 0x0F | 0x80
    digest[8] = digest[8] & 0x3F | 0x80
    text = digest.hex()
    return f"{text[:8]}-{text[8:12]}-{text[12:16]}-{text[16:20]}-{text[20:]}"
