"""The format once more, written from docs/envelope.md with hashlib and libsodium alone: the opinion of a stranger.

It shares no code with the node: its own framing, its own strict reading of the encoding, its own derivations.
"""

from __future__ import annotations

import base64
import hashlib
import struct
from collections.abc import Iterable

from nacl import bindings
from nacl.exceptions import CryptoError

Value = int | bytes
PERSONS = {1: b"wp.cmd.seal.v1", 2: b"wp.ack.seal.v1", 3: b"wp.sta.seal.v1", 5: b"wp.cos.seal.v1", 6: b"wp.pre.seal.v1"}
_LEAF = struct.Struct(">c16sQqQQIqBHB32s32s")


class NotCanonical(ValueError):
    """These bytes are not the one encoding of any message."""


def le64(number: int) -> bytes:
    """Eight bytes, little-endian."""
    return struct.pack("<Q", number)


def pae(*parts: bytes) -> bytes:
    """PASETO's pre-authentication encoding."""
    return le64(len(parts)) + b"".join(le64(len(part)) + part for part in parts)


def blake2b(data: bytes, size: int = 32, key: bytes = b"", person: bytes = b"") -> bytes:
    """BLAKE2b."""
    return hashlib.blake2b(data, digest_size=size, key=key, person=person).digest()


def key_id(public: bytes) -> bytes:
    """16 bytes that point to a key."""
    return blake2b(public, 16, person=b"wp.keyid.v1")


def is_signed(public: bytes, message: bytes, signature: bytes) -> bool:
    """Say whether an Ed25519 signature holds."""
    try:
        return len(signature) == 64 and bindings.crypto_sign_open(signature + message, public) == message
    except CryptoError:
        return False


def varint(number: int) -> bytes:
    """Shortest base-128 encoding."""
    out = bytearray()
    while number > 0x7F:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*out, number])


def encoded(fields: Iterable[tuple[int, Value]]) -> bytes:
    """Encode fields in the order given; what is zero or empty is left out."""
    out = b""
    for number, value in fields:
        if isinstance(value, int):
            out += varint(number << 3) + varint(value) if value else b""
        else:
            out += varint(number << 3 | 2) + varint(len(value)) + value if value else b""
    return out


def spans(data: bytes, repeated: frozenset[int] = frozenset()) -> list[tuple[int, Value, int, int]]:
    """Take one message apart: number, value, first and last byte. Raises NotCanonical.

    Numbers ascend, each comes once but for `repeated`, nothing is zero or empty, numbers are as short as can be.
    """
    found: list[tuple[int, Value, int, int]] = []
    at = 0
    while at < len(data):
        start = at
        tag, at = _varint(data, at)
        value: Value
        value, at = _varint(data, at)
        if tag & 7 == 2:
            length = int(value)
            value, at = data[at : at + length], at + length
        last = found[-1][0] if found else 0
        ordered = tag >> 3 > last or (tag >> 3 == last and last in repeated)
        if tag & 7 not in (0, 2) or not value or not ordered or at > len(data):
            raise NotCanonical(f"field {tag >> 3} at byte {start}")
        found.append((tag >> 3, value, start, at))
    return found


def fields(data: bytes, repeated: frozenset[int] = frozenset()) -> dict[int, Value]:
    """Return the fields of a message by number; of repeated ones the last. Raises NotCanonical."""
    return {number: value for number, value, _, _ in spans(data, repeated)}


def header_fields(header: bytes) -> dict[int, Value]:
    """Return the fields of a header. Raises NotCanonical, also for a field that no header has, or a number too wide."""
    read = fields(header)
    narrow = [value for number in (1, 4, 10) if isinstance(value := read.get(number, 0), int)]
    if not set(read) <= set(range(1, 17)) or max(narrow) >> 32:
        raise NotCanonical("an unknown field, or a number that is too wide for its field")
    return read


def _varint(data: bytes, at: int) -> tuple[int, int]:
    number, shift = 0, 0
    while at < len(data):
        byte = data[at]
        number, at = number | (byte & 0x7F) << shift, at + 1
        if byte < 0x80:
            if (not byte and shift) or number >> 64:
                raise NotCanonical(f"a number at byte {at}")
            return number, at
        shift += 7
    raise NotCanonical("cut off")


def sealing_key(secret: bytes, message_type: int, epoch_id: int, device_key_id: bytes) -> bytes:
    """The key of one sender, epoch and type."""
    return blake2b(le64(epoch_id) + device_key_id, 32, secret, PERSONS[message_type])


def opened(key: bytes, nonce: bytes, header: bytes, ciphertext: bytes) -> bytes:
    """Open a ciphertext. Raises what the library raises."""
    aad = pae(b"waypoint/v1/AuthEnvelope/aead", header)
    return bindings.crypto_aead_xchacha20poly1305_ietf_decrypt(ciphertext, aad, nonce, key)


def signature_input(header: bytes, token: bytes, ciphertext: bytes) -> bytes:
    """What the device signs."""
    return pae(b"waypoint/v1/AuthEnvelope/device-signature", header, token, ciphertext)


def leaf(flight_id: bytes, numbers: Iterable[int], before: bytes, salt: bytes, body: bytes) -> bytes:
    """The leaf of a record; `numbers` are the columns from seq to version."""
    hashed = hashlib.sha256(salt + body).digest()
    return hashlib.sha256(_LEAF.pack(b"\0", flight_id, *numbers, before, hashed)).digest()


def root_of(leaves: list[bytes]) -> bytes:
    """The root of the tree over leaf hashes (RFC 9162, 2.1.1)."""
    if len(leaves) == 1:
        return leaves[0]
    split = 1 << (len(leaves) - 1).bit_length() - 1
    return hashlib.sha256(b"\x01" + root_of(leaves[:split]) + root_of(leaves[split:])).digest()


def note_holds(note: str, name: str, public: bytes) -> bool:
    """Say whether a signed note (C2SP) is this key's under this name."""
    text, _, line = note.rpartition("\n\n")
    dash, signer, data = line.removesuffix("\n").split(" ")
    raw = base64.b64decode(data)
    hint = hashlib.sha256(name.encode() + b"\n\x01" + public).digest()[:4]
    return (dash, signer, raw[:4]) == ("—", name, hint) and is_signed(public, f"{text}\n".encode(), raw[4:])
