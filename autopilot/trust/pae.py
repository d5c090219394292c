"""Pre-authentication encoding (PASETO): several byte strings as one, unambiguously.

It only frames; it neither signs nor hashes.
"""

from __future__ import annotations

from typing import Final

ENVELOPE_SIGNATURE: Final = b"waypoint/v1/AuthEnvelope/device-signature"
ENVELOPE_SEAL: Final = b"waypoint/v1/AuthEnvelope/aead"
TRUST_ROOT: Final = b"waypoint/v1/TrustRoot"
IDENTITY_TOKEN: Final = b"waypoint/v1/IdentityToken"
REVOCATION_LIST: Final = b"waypoint/v1/RevocationList"
EPOCH_BUNDLE: Final = b"waypoint/v1/EpochBundle"
TIME_BEACON: Final = b"waypoint/v1/TimeBeacon"
EPOCH_COMMITMENT: Final = b"waypoint/v1/epoch-commit"


def le64(number: int) -> bytes:
    """Return `number` as eight bytes, little-endian.

    Raises OverflowError outside 0..2^64-1.
    """
    return number.to_bytes(8, "little")


def pae(*parts: bytes) -> bytes:
    """Frame `parts`: LE64(count), then LE64(length) and bytes of each (PASETO, Common implementation details).

    The first part is a context string, one for each use of a key, so that a signature made for
    one purpose never passes for another.
    """
    return le64(len(parts)) + b"".join(le64(len(part)) + part for part in parts)
