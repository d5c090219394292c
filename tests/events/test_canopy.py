"""The upper part of a tree: it says what the whole tree says, and reads little."""

from __future__ import annotations

import random
from collections.abc import Iterable

import pytest

from events.canopy import BLOCK, Canopy
from events.tree import Tree, check_consistency

LEAVES = [number.to_bytes(32, "big") for number in range(6 * BLOCK + 77)]
TREE = Tree(LEAVES)


class Log:
    """Leaves that count how many of them are read."""

    def __init__(self, leaves: list[bytes]) -> None:
        self.leaves = leaves
        self.read = 0

    def __call__(self, start: int, stop: int) -> Iterable[bytes]:
        """Read some."""
        found = self.leaves[start:stop]
        self.read += len(found)
        return found


def grown(log: Log, size: int) -> Canopy:
    """Return a canopy that may be asked about `size` leaves."""
    canopy = Canopy(log)
    while canopy.lacks(size):
        canopy.take_block()
    canopy.reach(size)
    return canopy


def check_same(old: int, new: int) -> None:
    """Check root and path against the whole tree's, and how much was read for them."""
    log = Log(LEAVES)
    canopy = grown(log, new)
    assert log.read == new // BLOCK * BLOCK
    log.read = 0
    path = canopy.consistency(old, new)
    assert log.read < 2 * BLOCK
    assert (path, canopy.root(old), canopy.root(new)) == (TREE.consistency(old, new), TREE.root(old), TREE.root(new))
    check_consistency(old, canopy.root(old), new, canopy.root(new), path)


@pytest.mark.parametrize(
    ("old", "new"), [(1, 2), (1, BLOCK), (BLOCK, 2 * BLOCK), (BLOCK - 1, BLOCK + 1), (2 * BLOCK, 6 * BLOCK + 77)]
)
def test_the_edges_of_blocks(old: int, new: int) -> None:
    """Within one, at the end of one, across."""
    check_same(old, new)


def test_any_two_sizes() -> None:
    """A hundred seeded pairs."""
    chance = random.Random(5)
    for _ in range(100):
        old, new = sorted(chance.sample(range(1, len(LEAVES) + 1), 2))
        check_same(old, new)


def test_it_grows_with_the_log() -> None:
    """What was taken in once is not read again."""
    log = Log(LEAVES)
    canopy = grown(log, 3 * BLOCK + 5)
    log.read = 0
    while canopy.lacks(5 * BLOCK):
        canopy.take_block()
    canopy.reach(5 * BLOCK)
    assert log.read == 2 * BLOCK
    assert canopy.consistency(3 * BLOCK + 5) == TREE.consistency(3 * BLOCK + 5, 5 * BLOCK)
    canopy.reach(7)
    assert canopy.size == 5 * BLOCK


def test_a_log_that_is_too_short_is_said_so() -> None:
    """Within a block that is to be taken in, within the rest, and before anything was."""
    short = Log(LEAVES[: BLOCK + 5])
    canopy = grown(short, BLOCK + 5)
    with pytest.raises(IndexError, match="ends before"):
        canopy.take_block()
    canopy.reach(BLOCK + 9)
    with pytest.raises(IndexError, match="ends before"):
        canopy.root(BLOCK + 9)
    with pytest.raises(IndexError, match="only 1024 leaves"):
        canopy.reach(2 * BLOCK)
    with pytest.raises(IndexError):
        canopy.root(BLOCK + 10)
