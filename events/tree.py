"""The Merkle tree over a flight's leaves (RFC 9162, section 2.1): roots, and proofs that two things fit together.

A leaf of the chain is a leaf hash of this tree as it is (`events.chain`), so nothing is hashed twice. `Peaks` is what
a node keeps while it records, a hash for each bit of the size; `Tree` keeps every node and gives the proofs. Signing
a root is not done here, and neither is the check of a proof by a stranger, who has a program of his own.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from hashlib import sha256

_NODE = b"\x01"


class ProofFailed(ValueError):
    """A proof does not lead to the root that it was made for."""


def node_of(left: bytes, right: bytes) -> bytes:
    """Return the hash of an interior node."""
    return sha256(_NODE + left + right).digest()


class Peaks:
    """The compact range of a growing tree: the roots of its whole subtrees, from the left, largest first."""

    __slots__ = ("_peaks", "size")

    def __init__(self, size: int = 0, peaks: Iterable[bytes] = ()) -> None:
        """Begin with nothing, or go on from a tree of `size` leaves. Raises ValueError for another number of peaks."""
        self._peaks: list[bytes] = list(peaks)
        self.size = size
        if len(self._peaks) != size.bit_count():
            raise ValueError(f"a tree of {size} leaves has {size.bit_count()} peaks, not {len(self._peaks)}")

    @property
    def peaks(self) -> tuple[bytes, ...]:
        """What is needed to go on."""
        return tuple(self._peaks)

    def append(self, leaf: bytes) -> None:
        """Take the next leaf in. Two subtrees of the same size become one: once for each low bit that carries."""
        size = self.size
        while size & 1:
            leaf = sha256(_NODE + self._peaks.pop() + leaf).digest()
            size >>= 1
        self._peaks.append(leaf)
        self.size += 1

    def root(self) -> bytes:
        """Return the root over all leaves so far; of none it is the hash of nothing."""
        if not self._peaks:
            return sha256().digest()
        root = self._peaks[-1]
        for left in reversed(self._peaks[:-1]):
            root = node_of(left, root)
        return root


class Tree:
    """The whole tree over a log that lies still: the whole subtrees of every height, by place."""

    def __init__(self, leaves: Iterable[bytes]) -> None:
        self._levels: list[list[bytes]] = [list(leaves)]
        while len(below := self._levels[-1]) > 1:
            pairs = zip(below[::2], below[1::2], strict=False)
            self._levels.append([node_of(left, right) for left, right in pairs])

    @property
    def size(self) -> int:
        """How many leaves there are."""
        return len(self._levels[0])

    def root(self, size: int | None = None) -> bytes:
        """Return the root over the first `size` leaves. Raises IndexError beyond the end."""
        size = self.size if size is None else self._within(size)
        return self._range(0, size) if size else sha256().digest()

    def inclusion(self, index: int, size: int | None = None) -> list[bytes]:
        """Return the proof that leaf `index` is in the tree of `size` leaves. Raises IndexError beyond it."""
        size = self.size if size is None else self._within(size)
        if not 0 <= index < size:
            raise IndexError(f"leaf {index} is not in a tree of {size} leaves")
        return self._path(index, 0, size)

    def consistency(self, before: int, size: int | None = None) -> list[bytes]:
        """Return the proof that the tree of `size` leaves only adds to that of `before`. Raises IndexError."""
        size = self.size if size is None else self._within(size)
        if not 0 < before <= size:
            raise IndexError(f"a tree of {size} leaves does not go on from one of {before}")
        return self._subproof(before, 0, size, whole=True)

    def _within(self, size: int) -> int:
        if not 0 <= size <= self.size:
            raise IndexError(f"there are {self.size} leaves, not {size}")
        return size

    def _range(self, start: int, stop: int) -> bytes:
        """Return the root over leaves start to stop; start is a multiple of the largest power of two within."""
        height = (stop - start).bit_length() - 1
        if stop - start == 1 << height:
            return self._levels[height][start >> height]
        middle = start + (1 << height)
        return node_of(self._range(start, middle), self._range(middle, stop))

    def _path(self, index: int, start: int, stop: int) -> list[bytes]:
        if stop - start == 1:
            return []
        middle = start + _split(stop - start)
        if index < middle:
            return [*self._path(index, start, middle), self._range(middle, stop)]
        return [*self._path(index, middle, stop), self._range(start, middle)]

    def _subproof(self, before: int, start: int, stop: int, *, whole: bool) -> list[bytes]:
        """`before` counts from `start`; `whole`: its root is known to whoever checks, so it is left out."""
        if before == stop - start:
            return [] if whole else [self._range(start, stop)]
        middle = start + _split(stop - start)
        if before <= middle - start:
            return [*self._subproof(before, start, middle, whole=whole), self._range(middle, stop)]
        rest = before - (middle - start)
        return [*self._subproof(rest, middle, stop, whole=False), self._range(start, middle)]


def _split(size: int) -> int:
    """Return the largest power of two below `size`."""
    return 1 << (size - 1).bit_length() - 1


def check_inclusion(leaf: bytes, index: int, size: int, proof: Sequence[bytes], root: bytes) -> None:
    """Check an inclusion proof (RFC 9162, section 2.1.3.2). Raises ProofFailed."""
    if not 0 <= index < size:
        raise ProofFailed(f"leaf {index} can't be in a tree of {size} leaves")
    place, last, found = index, size - 1, leaf
    for sibling in proof:
        if last == 0:
            raise ProofFailed("the proof is longer than its tree is high")
        if place & 1 or place == last:
            found = node_of(sibling, found)
            while not place & 1 and place:
                place, last = place >> 1, last >> 1
        else:
            found = node_of(found, sibling)
        place, last = place >> 1, last >> 1
    if last or found != root:
        raise ProofFailed(f"leaf {index} is not what the tree of {size} leaves holds there")


def check_consistency(before: int, old: bytes, size: int, new: bytes, proof: Sequence[bytes]) -> None:
    """Check that root `new` only adds to root `old` (RFC 9162, section 2.1.4.2). Raises ProofFailed."""
    if not 0 < before <= size or (before == size) != (not proof):
        raise ProofFailed(f"this is no proof from {before} to {size} leaves")
    path = [old, *proof] if before & (before - 1) == 0 or before == size else list(proof)
    place, last = (before - 1, size - 1) if before < size else (0, 0)
    while place & 1:
        place, last = place >> 1, last >> 1
    one = other = path[0]
    for sibling in path[1:]:
        if last == 0:
            raise ProofFailed("the proof is longer than its tree is high")
        if place & 1 or place == last:
            one, other = node_of(sibling, one), node_of(sibling, other)
            while not place & 1 and place:
                place, last = place >> 1, last >> 1
        else:
            other = node_of(other, sibling)
        place, last = place >> 1, last >> 1
    if last or one != old or other != new:
        raise ProofFailed(f"the tree of {size} leaves does not go on from that of {before}")
