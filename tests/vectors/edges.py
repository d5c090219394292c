"""Edge vectors of the two primitives, made by computation: what Ed25519 and XChaCha20-Poly1305 must take and refuse.

Each says whether it is valid; "either" is for signatures with a part of small order, which only the holder of the key
can make, and on which correct libraries differ (RFC 8032, 8.9). No library is asked here.
"""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import sha512
from typing import Any

from tests.vectors import chacha, curve
from tests.vectors.independent import pae

Vector = dict[str, Any]
SEED, OTHER = b"\x11" * 32, b"\x22" * 32
SCALAR, PUBLIC = curve.scalar_of(SEED)[0], curve.public_of(SEED)
MESSAGE = b"look north"
SIGNATURE = curve.sign(SEED, MESSAGE)
R, S = SIGNATURE[:32], int.from_bytes(SIGNATURE[32:], "little")

RFC_8032 = (  # section 7.1, TEST 1 to 3: seed, message
    ("9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60", ""),
    ("4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb", "72"),
    ("c5aa8df43f9f837bedb7442f31dcb7b166d38535076f094b85ce3a2e0b4458f7", "af82"),
)


def signatures() -> list[Vector]:
    """Return the vectors of Ed25519."""
    every = (_good(), _lengths(), _changed(), _scalars(), _small_order(), _mixed_order(), _others())
    return [vector for group in every for vector in group]


def _vector(name: str, valid: bool | str, public: bytes, signature: bytes, message: bytes = MESSAGE) -> Vector:
    return {
        "name": name,
        "valid": valid,
        "public": public.hex(),
        "message": message.hex(),
        "signature": signature.hex(),
    }


def _good() -> Iterator[Vector]:
    for number, (seed, message) in enumerate(RFC_8032, start=1):
        key, text = bytes.fromhex(seed), bytes.fromhex(message)
        yield _vector(f"RFC 8032 test {number}", True, curve.public_of(key), curve.sign(key, text), text)
    for length in (0, 1, 63, 64, 65, 127, 128, 1000):
        text = bytes(range(256)) * 4
        yield _vector(f"{length} bytes", True, PUBLIC, curve.sign(SEED, text[:length]), text[:length])


def _lengths() -> Iterator[Vector]:
    for length in (0, 1, 31, 32, 33, 63):
        yield _vector(f"signature cut to {length} bytes", False, PUBLIC, SIGNATURE[:length])
    for more in (b"\0", b"\0" * 32, SIGNATURE, MESSAGE):
        yield _vector(f"signature with {len(more)} bytes more", False, PUBLIC, SIGNATURE + more)
    for length in (0, 31):
        yield _vector(f"key cut to {length} bytes", False, PUBLIC[:length], SIGNATURE)
    yield _vector("key of 33 bytes", False, PUBLIC + b"\0", SIGNATURE)
    yield _vector("the first byte of the message behind the signature", False, PUBLIC, SIGNATURE + b"l", MESSAGE[1:])


def _changed() -> Iterator[Vector]:
    for at in range(64):
        yield _vector(f"signature: one bit of byte {at}", False, PUBLIC, _flipped(SIGNATURE, at * 8 + at % 8))
    for at in range(32):
        yield _vector(f"key: one bit of byte {at}", False, _flipped(PUBLIC, at * 8 + at % 8), SIGNATURE)
    yield _vector("message: one bit", False, PUBLIC, SIGNATURE, _flipped(MESSAGE, 3))
    yield _vector("message: empty", False, PUBLIC, SIGNATURE, b"")
    yield _vector("message: one byte more", False, PUBLIC, SIGNATURE, MESSAGE + b"\0")
    yield _vector("R and S exchanged", False, PUBLIC, SIGNATURE[32:] + R)
    yield _vector("all zero", False, PUBLIC, bytes(64))
    yield _vector("all ones", False, PUBLIC, b"\xff" * 64)
    yield _vector("all zero by a key of zeros", False, bytes(32), bytes(64))
    yield _vector("another's signature", False, PUBLIC, curve.sign(OTHER, MESSAGE))


def _scalars() -> Iterator[Vector]:
    """A scalar has one encoding (RFC 8032, 5.1.7): what is congruent to it is refused."""
    for times in (1, 2, 3, 15):
        number = S + times * curve.L
        if number < 1 << 256:
            yield _vector(f"S + {times} L", False, PUBLIC, R + number.to_bytes(32, "little"))
    for name, number in (("L", curve.L), ("L - 1", curve.L - 1), ("2^255 - 1", (1 << 255) - 1), ("0", 0)):
        yield _vector(f"S = {name}", False, PUBLIC, R + number.to_bytes(32, "little"))
    yield _vector("-S", False, PUBLIC, R + curve.s_bytes(-S))
    for bit in (253, 254, 255):
        yield _vector(f"S with bit {bit}", False, PUBLIC, R + (S | 1 << bit).to_bytes(32, "little"))


def _small_order() -> Iterator[Vector]:
    """Every encoding of the eight points of small order, as key and as R, where the equation holds."""
    for order, point in enumerate(curve.torsion()):
        for data in curve.encodings(point):
            how = f"{order} T, {'canonical' if data == point.encoded() else 'another encoding'} {data.hex()[:4]}"
            yield _vector(f"key of small order, {how}", False, data, *_of_small_key(data))
            s = curve.challenge(data, PUBLIC, MESSAGE) * SCALAR
            yield _vector(f"R of small order, {how}", False, PUBLIC, data + curve.s_bytes(s))
            yield _vector(f"key and R of small order, S = 0, {how}", False, data, data + bytes(32))


def _of_small_key(public: bytes) -> tuple[bytes, bytes]:
    """Return a signature and a message for which the equation holds, by anybody."""
    signature = curve.B.times(5).encoded() + curve.s_bytes(5)
    texts = (b"message %d" % number for number in range(1000))
    return signature, next(text for text in texts if curve.holds(public, text, signature, cofactored=False))


def _mixed_order() -> Iterator[Vector]:
    """A key or R with a part of small order: its holder's own doing; the strict equation decides, or either."""
    nonce = curve.scalar_of(OTHER)[0]
    for order, point in enumerate(curve.torsion()[1:], start=1):
        key = (curve.B.times(SCALAR) + point).encoded()
        r = curve.B.times(nonce).encoded()
        signed = r + curve.s_bytes(nonce + curve.challenge(r, key, MESSAGE) * SCALAR)
        strict = curve.holds(key, MESSAGE, signed, cofactored=False)
        yield _vector(f"key + {order} T, equation {'holds' if strict else 'times 8 only'}", "either", key, signed)
        mixed = (curve.B.times(nonce) + point).encoded()
        s = nonce + curve.challenge(mixed, PUBLIC, MESSAGE) * SCALAR
        yield _vector(f"R + {order} T, equation times 8 only", "either", PUBLIC, mixed + curve.s_bytes(s))


def _others() -> Iterator[Vector]:
    off = next(bytes([y]) + bytes(31) for y in range(2, 99) if curve.decoded(bytes([y]) + bytes(31)) is None)
    yield _vector("R is no point", False, PUBLIC, off + SIGNATURE[32:])
    yield _vector("key is no point", False, off, SIGNATURE)
    yield _vector("-R", False, PUBLIC, _flipped(R, 255) + SIGNATURE[32:])
    yield _vector("-key", False, _flipped(PUBLIC, 255), SIGNATURE)
    dom2 = b"SigEd25519 no Ed25519 collisions\x01\x00"
    scalar, prefix = curve.scalar_of(SEED)
    hashed = sha512(MESSAGE).digest()
    nonce = int.from_bytes(sha512(dom2 + prefix + hashed).digest(), "little") % curve.L
    r = curve.B.times(nonce).encoded()
    bound = int.from_bytes(sha512(dom2 + r + PUBLIC + hashed).digest(), "little")
    yield _vector("Ed25519ph of the message", False, PUBLIC, r + curve.s_bytes(nonce + bound * scalar))


KEY, NONCE, HEADER = bytes(range(32)), bytes(range(64, 88)), b"header"
CONTEXT = b"waypoint/v1/AuthEnvelope/aead"


def seals() -> list[Vector]:
    """Return the vectors of XChaCha20-Poly1305 with the header framed as associated data."""
    return [*_good_seals(), *_broken_seals(), *_resized_seals()]


def _seal(name: str, valid: bool, sealed: bytes, plaintext: bytes = b"", **changes: bytes) -> Vector:
    parts = {"key": KEY, "nonce": NONCE, "header": HEADER} | changes
    texts = {part: data.hex() for part, data in parts.items()}
    return {"name": name, "valid": valid, **texts, "sealed": sealed.hex(), "plaintext": plaintext.hex()}


def _sealed(plaintext: bytes, header: bytes = HEADER) -> bytes:
    return chacha.seal(KEY, NONCE, pae(CONTEXT, header), plaintext)


def _good_seals() -> Iterator[Vector]:
    for length in (1, 15, 16, 17, 31, 32, 33, 63, 64, 65, 127, 128, 129, 512, 2032):
        plaintext = bytes(number * 7 & 0xFF for number in range(length))
        yield _seal(f"{length} bytes", True, _sealed(plaintext), plaintext)
    for header in (b"", b"\0", bytes(16), bytes(512)):
        yield _seal(f"header of {len(header)} bytes", True, _sealed(b"text", header), b"text", header=header)
    yield _seal("zeros", True, _sealed(bytes(64)), bytes(64))
    yield _seal("ones", True, _sealed(b"\xff" * 64), b"\xff" * 64)


def _broken_seals() -> Iterator[Vector]:
    good = _sealed(b"plaintext")
    for bit in range(128):
        yield _seal(f"tag: bit {bit}", False, _flipped(good, (len(good) - 16) * 8 + bit))
    for at in range(len(good) - 16):
        yield _seal(f"ciphertext: one bit of byte {at}", False, _flipped(good, at * 8))
    for name, data in (("key", KEY), ("nonce", NONCE), ("header", HEADER)):
        for at in range(len(data)):
            yield _seal(f"{name}: one bit of byte {at}", False, good, **{name: _flipped(data, at * 8 + at % 8)})
    yield _seal("tag of zeros", False, good[:-16] + bytes(16))
    yield _seal("tag of ones", False, good[:-16] + b"\xff" * 16)
    yield _seal("tag in front", False, good[-16:] + good[:-16])
    yield _seal("header with a byte more", False, good, header=HEADER + b"\0")
    yield _seal("a byte moved from header to ciphertext", False, HEADER[-1:] + good, header=HEADER[:-1])
    yield _seal("the bare header as associated data", False, chacha.seal(KEY, NONCE, HEADER, b"plaintext"))
    first = chacha.hchacha20(KEY, NONCE[:16])
    yield _seal("sealed under the subkey", False, chacha.seal(first, NONCE, pae(CONTEXT, HEADER), b"plaintext"))


def _resized_seals() -> Iterator[Vector]:
    good = _sealed(b"plaintext")
    for length in range(len(good)):
        yield _seal(f"cut to {length} bytes", False, good[:length])
    for more in (b"\0", bytes(16), good):
        yield _seal(f"{len(more)} bytes more", False, good + more)
    for length in (0, 8, 12, 16, 23, 25, 32):
        yield _seal(f"nonce of {length} bytes", False, good, nonce=(NONCE + NONCE)[:length])
    yield _seal("of nothing: only a tag", False, _sealed(b""))


def _flipped(data: bytes, bit: int) -> bytes:
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)
