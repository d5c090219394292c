"""The upper part of a Merkle tree that grows: proofs about a long log without holding, or reading, all of its leaves.

The whole subtrees of 1,024 leaves and more are kept (near 200 KB among a million records); what lies below is read
again when a proof needs it, and a consistency proof needs at most two such blocks: where each of its sizes ends.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from events.tree import Tree, node_of

BLOCK_HEIGHT = 10
BLOCK = 1 << BLOCK_HEIGHT


class Canopy(Tree):
    """A tree over leaves that are read where they lie: `read(start, stop)` yields those with start <= seq < stop."""

    def __init__(self, read: Callable[[int, int], Iterable[bytes]]) -> None:
        self._read = read
        self._levels = [[]]  # from the height of a block up
        self._leaves = 0

    @property
    def size(self) -> int:
        """How many leaves may be asked about."""
        return self._leaves

    def lacks(self, size: int) -> bool:
        """Say whether a block must still be taken in before `size` leaves may be asked about."""
        return (len(self._levels[0]) + 1) * BLOCK <= size

    def take_block(self) -> None:
        """Read the next block. Raises IndexError where the log ends within it."""
        self._push(0, self._root_of(start := len(self._levels[0]) * BLOCK, start + BLOCK))

    def reach(self, size: int) -> None:
        """Allow questions about the first `size` leaves, whose blocks were taken. Raises IndexError otherwise."""
        if self.lacks(size):
            raise IndexError(f"only {len(self._levels[0]) * BLOCK} leaves were taken in, not {size}")
        self._leaves = max(self._leaves, size)

    def _push(self, level: int, root: bytes) -> None:
        if level == len(self._levels):
            self._levels.append([])
        known = self._levels[level]
        known.append(root)
        if len(known) % 2 == 0:
            self._push(level + 1, node_of(known[-2], known[-1]))

    def _range(self, start: int, stop: int) -> bytes:
        height = (stop - start).bit_length() - 1
        if height < BLOCK_HEIGHT:
            return self._root_of(start, stop)
        if stop - start == 1 << height:
            return self._levels[height - BLOCK_HEIGHT][start >> height]
        middle = start + (1 << height)
        return node_of(self._range(start, middle), self._range(middle, stop))

    def _root_of(self, start: int, stop: int) -> bytes:
        leaves = list(self._read(start, stop))
        if len(leaves) != stop - start:
            raise IndexError(f"the log ends before record {stop - 1}")
        return Tree(leaves).root()
