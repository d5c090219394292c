"""Ed25519 in Python's integers (RFC 8032, section 5.1): slow, plain, and the same on every machine.

It is here to make signatures that no library would make, and to say what they are. It keeps no secret safe.
"""

from __future__ import annotations

from hashlib import sha512
from typing import NamedTuple

P = 2**255 - 19
L = 2**252 + 27742317777372353535851937790883648493
D = -121665 * pow(121666, P - 2, P) % P
_ROOT = pow(2, (P - 1) // 4, P)


class Point(NamedTuple):
    """A point of the curve, affine."""

    x: int
    y: int

    def __add__(self, other: object) -> Point:
        """Add two points."""
        assert isinstance(other, Point)
        both = D * self.x * other.x * self.y * other.y % P
        x = (self.x * other.y + other.x * self.y) * pow(1 + both, -1, P)
        y = (self.y * other.y + self.x * other.x) * pow(1 - both, -1, P)
        return Point(x % P, y % P)

    def times(self, number: int) -> Point:
        """Add the point to itself so many times."""
        total, doubled = ZERO, self
        while number:
            total = total + doubled if number & 1 else total
            doubled, number = doubled + doubled, number >> 1
        return total

    def encoded(self) -> bytes:
        """Return the one canonical encoding."""
        return (self.y | (self.x & 1) << 255).to_bytes(32, "little")


ZERO = Point(0, 1)


def decoded(data: bytes) -> Point | None:
    """Return the point that 32 bytes stand for, also where they are not its canonical encoding; None: none."""
    number = int.from_bytes(data, "little")
    sign, y = number >> 255, (number & (1 << 255) - 1) % P
    square = (y * y - 1) * pow(D * y * y + 1, -1, P) % P
    x = pow(square, (P + 3) // 8, P)
    if x * x % P != square:
        x = x * _ROOT % P
    if x * x % P != square:
        return None
    return Point(P - x if x & 1 != sign and x else x, y)


def _base() -> Point:
    point = decoded((4 * pow(5, P - 2, P) % P).to_bytes(32, "little"))
    assert point is not None
    return point


B = _base()


def torsion() -> list[Point]:
    """Return the eight points whose order divides eight, the neutral one first."""
    y = 2
    while (point := decoded(y.to_bytes(32, "little"))) is None or len(set(_multiples(point.times(L)))) < 8:
        y += 1
    return _multiples(point.times(L))


def _multiples(point: Point) -> list[Point]:
    return [point.times(number) for number in range(8)]


def encodings(point: Point) -> list[bytes]:
    """Return every way to write a point in 32 bytes: the canonical one first."""
    signs = (0, 1) if point.x == 0 else (point.x & 1,)
    ys = [point.y] + [point.y + P] * (point.y + P < 1 << 255)
    every = [(y | sign << 255).to_bytes(32, "little") for y in ys for sign in signs]
    return sorted(every, key=lambda data: data != point.encoded())


def scalar_of(seed: bytes) -> tuple[int, bytes]:
    """Return the secret scalar and the prefix that a seed expands to."""
    digest = sha512(seed).digest()
    clamped = int.from_bytes(digest[:32], "little") & ((1 << 254) - 8) | 1 << 254
    return clamped, digest[32:]


def challenge(r: bytes, public: bytes, message: bytes) -> int:
    """Return what binds R, key and message together."""
    return int.from_bytes(sha512(r + public + message).digest(), "little") % L


def public_of(seed: bytes) -> bytes:
    """Return the public key of a seed."""
    return B.times(scalar_of(seed)[0]).encoded()


def sign(seed: bytes, message: bytes) -> bytes:
    """Return the signature of RFC 8032."""
    scalar, prefix = scalar_of(seed)
    r = int.from_bytes(sha512(prefix + message).digest(), "little") % L
    encoded = B.times(r).encoded()
    return encoded + s_bytes(r + challenge(encoded, public_of(seed), message) * scalar)


def s_bytes(number: int) -> bytes:
    """Return the second half of a signature for this scalar."""
    return (number % L).to_bytes(32, "little")


def holds(public: bytes, message: bytes, signature: bytes, *, cofactored: bool) -> bool:
    """Say whether the equation of a signature holds, with all encodings taken as they come.

    Strict verifiers refuse more than this; none may take what fails the cofactored equation.
    """
    a, r = decoded(public), decoded(signature[:32])
    if a is None or r is None:
        return False
    s = int.from_bytes(signature[32:], "little")
    left, right = B.times(s), r + a.times(challenge(signature[:32], public, message))
    return left.times(8) == right.times(8) if cofactored else left == right
