"""XChaCha20-Poly1305 in Python's integers (RFC 8439, draft-irtf-cfrg-xchacha-03): the second opinion of the tests."""

from __future__ import annotations

import struct
from collections.abc import Iterator

_CONSTANT = struct.unpack("<4I", b"expand 32-byte k")
_P1305 = 2**130 - 5


def _rounds(state: list[int]) -> list[int]:
    work = list(state)
    for _ in range(10):
        for a, b, c, d in (*((i, i + 4, i + 8, i + 12) for i in range(4)), *_DIAGONALS):
            _quarter(work, a, b, c, d)
    return work


_DIAGONALS = ((0, 5, 10, 15), (1, 6, 11, 12), (2, 7, 8, 13), (3, 4, 9, 14))


def _quarter(work: list[int], a: int, b: int, c: int, d: int) -> None:
    for one, other, third, turn in ((a, b, d, 16), (c, d, b, 12), (a, b, d, 8), (c, d, b, 7)):
        work[one] = work[one] + work[other] & 0xFFFFFFFF
        mixed = work[third] ^ work[one]
        work[third] = (mixed << turn | mixed >> 32 - turn) & 0xFFFFFFFF


def hchacha20(key: bytes, nonce16: bytes) -> bytes:
    """Return the subkey that the first 16 bytes of a nonce select."""
    work = _rounds([*_CONSTANT, *struct.unpack("<8I", key), *struct.unpack("<4I", nonce16)])
    return struct.pack("<8I", *work[:4], *work[12:])


def _stream(key: bytes, nonce12: bytes, counter: int) -> Iterator[bytes]:
    while True:
        state = [*_CONSTANT, *struct.unpack("<8I", key), counter, *struct.unpack("<3I", nonce12)]
        summed = [a + b & 0xFFFFFFFF for a, b in zip(state, _rounds(state), strict=True)]
        yield struct.pack("<16I", *summed)
        counter += 1


def _xored(data: bytes, key: bytes, nonce12: bytes) -> bytes:
    blocks = zip(range(0, len(data), 64), _stream(key, nonce12, 1), strict=False)
    pairs = (zip(data[at : at + 64], block, strict=False) for at, block in blocks)
    return bytes(a ^ b for pair in pairs for a, b in pair)


def poly1305(key: bytes, message: bytes) -> bytes:
    """Return the one-time authenticator."""
    r = int.from_bytes(key[:16], "little") & 0x0FFFFFFC0FFFFFFC0FFFFFFC0FFFFFFF
    total = 0
    for at in range(0, len(message), 16):
        total = (total + int.from_bytes(message[at : at + 16] + b"\x01", "little")) * r % _P1305
    return (total + int.from_bytes(key[16:], "little") & (1 << 128) - 1).to_bytes(16, "little")


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 16)


def seal(key: bytes, nonce: bytes, aad: bytes, plaintext: bytes) -> bytes:
    """Return ciphertext and tag."""
    subkey, nonce12 = hchacha20(key, nonce[:16]), bytes(4) + nonce[16:]
    ciphertext = _xored(plaintext, subkey, nonce12)
    lengths = struct.pack("<2Q", len(aad), len(ciphertext))
    once = next(_stream(subkey, nonce12, 0))[:32]
    return ciphertext + poly1305(once, _padded(aad) + _padded(ciphertext) + lengths)
