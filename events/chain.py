"""The hash chain over a flight. What is hashed here can never change later.

    leaf = SHA-256(0x00 || header || SHA-256(salt || body))

The header is fixed-width, big-endian, and ends with the leaf before, so the leaves are a chain; 0x00 is
the leaf prefix of RFC 9162, so they are also the leaves of its tree. The salt of a record is
BLAKE2b-128(key = secret of the flight, LE64(seq)): a body that is removed later can't be guessed from its hash.

A redacted copy has no secret. Its records carry their own salts, and where a body was removed SHA-256(salt || body)
stands in place of both, so each leaf, and everything that is signed over leaves, stays what it was.
"""

from __future__ import annotations

import struct
from hashlib import blake2b, sha256

from events.records import Moment, Stored

LEAF_BYTES = 32
SALT_BYTES = 16
SECRET_BYTES = 32
FLIGHT_ID_BYTES = 16
FIRST_LEAF_BEFORE = bytes(LEAF_BYTES)

# The leaf prefix, then the header: flight_id 16 bytes, seq u64, cause i64, flight_ns u64, mono_ns u64, boot u32,
# wall_ns i64, clock_quality u8, kind u16, version u8, leaf before 32 bytes; then the hash of the salted body.
_LEAF = struct.Struct(">c16sQqQQIqBHB32s32s")
_LE64 = struct.Struct("<Q")


def salt_of(secret: bytes, seq: int) -> bytes:
    """Return the salt of one record: what is shown of it, so that its body alone can be checked."""
    return blake2b(_LE64.pack(seq), digest_size=SALT_BYTES, key=secret).digest()


def salt_shown(stored: Stored, secret: bytes) -> bytes:
    """Return the salt of a stored record: of a flight's secret, or the one that a redacted copy (no secret) carries."""
    return salt_of(secret, stored.seq) if secret else stored.salt


def body_hash(stored: Stored, secret: bytes) -> bytes:
    """Return SHA-256(salt || body) of a stored record, also where the body was removed.

    Raises ChainBroken for a record of a redacted copy that carries neither a whole salt nor a whole hash: a byte that
    wanders from body to salt would not change the hash. TypeError for columns of another type.
    """
    if not stored.removed:
        salt = salt_shown(stored, secret)
        if len(salt) != SALT_BYTES:
            raise ChainBroken(f"record {stored.seq}: its salt has {len(salt)} bytes, not {SALT_BYTES}")
        return sha256(salt + stored.body).digest()
    if len(stored.removed) != LEAF_BYTES or stored.body or stored.salt:
        raise ChainBroken(f"record {stored.seq}: a removed body leaves a hash of {LEAF_BYTES} bytes and nothing else")
    return stored.removed


class ChainBroken(ValueError):
    """A stored leaf is not the hash of its record."""


class Chain:
    """The chain of one flight: knows the leaf before, gives the leaf of the record after."""

    __slots__ = ("_flight_id", "_salts", "_secret", "leaf")

    def __init__(self, flight_id: bytes, secret: bytes, leaf: bytes = FIRST_LEAF_BEFORE) -> None:
        """Begin behind `leaf`. Without a secret (b"": a redacted copy) it checks what carries its own salt."""
        self._flight_id = flight_id
        self._secret = secret
        self._salts = blake2b(digest_size=SALT_BYTES, key=secret)  # keyed once, copied for each record
        self.leaf = leaf

    def extend(self, seq: int, cause: int, at: Moment, kind_number: int, version: int, body: bytes) -> bytes:
        """Return the 32-byte leaf of the next record, and go on from it.

        Raises struct.error for a value that does not fit its column; the chain then stays where it was.
        """
        salt = self._salts.copy()
        salt.update(_LE64.pack(seq))
        hashed = sha256(salt.digest() + body).digest()
        leaf = sha256(
            _LEAF.pack(b"\x00", self._flight_id, seq, cause, *at, kind_number, version, self.leaf, hashed)
        ).digest()
        self.leaf = leaf
        return leaf

    def _extend_given(self, stored: Stored) -> bytes:
        """Return the leaf of a record that carries its own salt or hash."""
        header = (stored.seq, stored.cause, *stored.at, stored.kind_number, stored.version, self.leaf)
        self.leaf = sha256(_LEAF.pack(b"\x00", self._flight_id, *header, body_hash(stored, b""))).digest()
        return self.leaf

    def check(self, stored: Stored) -> None:
        """Go on over a stored record. Raises ChainBroken where its leaf is not what its content gives."""
        before = self.leaf
        try:
            if self._secret:
                leaf = self.extend(stored.seq, stored.cause, stored.at, stored.kind_number, stored.version, stored.body)
            else:
                leaf = self._extend_given(stored)
        except (struct.error, TypeError) as error:  # what lies in a file may be of any type and size
            raise ChainBroken(f"record {stored.seq}: a column does not fit the header: {error}") from error
        if leaf != stored.leaf:
            self.leaf = before
            raise ChainBroken(f"record {stored.seq}: its leaf is not the hash of its content and the leaf before")
