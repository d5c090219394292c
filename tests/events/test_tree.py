"""The Merkle tree: the vectors of Certificate Transparency, the definition itself, and proofs that can fail."""

from __future__ import annotations

from hashlib import sha256

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from events.tree import Peaks, ProofFailed, Tree, check_consistency, check_inclusion

# Inputs, and roots over the first 1, 2, ... of them, as the reference implementations of RFC 6962 are tested with.
INPUTS = ("", "00", "10", "2021", "3031", "40414243", "5051525354555657", "606162636465666768696a6b6c6d6e6f")
ROOTS = (
    "6e340b9cffb37a989ca544e6bb780a2c78901d3fb33738768511a30617afa01d",
    "fac54203e7cc696cf0dfcb42c92a1d9dbaf70ad9e621f4bd8d98662f00e3c125",
    "aeb6bcfe274b70a14fb067a5e5578264db0fa9b51af5e0ba159158f329e06e77",
    "d37ee418976dd95753c1c73862b9398fa2a2cf9b4ff0fdfe8b30cd95209614b7",
    "4e3bbb1f7b478dcfe71fb631631519a3bca12c9aefca1612bfce4c13a86264d4",
    "76e67dadbcdf1e10e1b74ddc608abd2f98dfb16fbce75277b5232a127f2087ef",
    "ddb89be403809e325750d3d263cd78929c2942b7942a34b77e122c9594a74c8c",
    "5dc9da79a70659a9ad559cb701ded9a2ab9d823aad2f4960cfe370eff4604328",
)
LEAVES = [sha256(b"\0" + bytes.fromhex(text)).digest() for text in INPUTS]


def leaves(count: int) -> list[bytes]:
    """Return as many different leaf hashes."""
    return [sha256(b"\0" + number.to_bytes(4, "big")).digest() for number in range(count)]


def defined(hashes: list[bytes]) -> bytes:
    """Return the root as section 2.1.1 defines it, word for word."""
    if len(hashes) < 2:
        return hashes[0] if hashes else sha256(b"").digest()
    split = 1
    while split * 2 < len(hashes):
        split *= 2
    return sha256(b"\1" + defined(hashes[:split]) + defined(hashes[split:])).digest()


def check_roots(hashes: list[bytes], expected: list[bytes]) -> None:
    """Check the roots over the first 0, 1, 2, ... leaves, in both forms of the tree."""
    peaks, tree, grown = Peaks(), Tree(hashes), []
    for leaf in hashes:
        grown.append(peaks.root())
        peaks.append(leaf)
    assert [*grown, peaks.root()] == [tree.root(size) for size in range(len(hashes) + 1)] == expected
    assert (peaks.size, tree.size, tree.root()) == (len(hashes), len(hashes), expected[-1])


def test_known_roots() -> None:
    """The published ones, and the root of nothing."""
    check_roots(LEAVES, [sha256(b"").digest(), *map(bytes.fromhex, ROOTS)])


def test_roots_are_as_defined() -> None:
    """For every size of a tree up to 130."""
    check_roots(leaves(130), [defined(leaves(size)) for size in range(131)])


def test_every_inclusion_proof_holds_and_no_other_does() -> None:
    """Every leaf of every size up to 64: for its own place, size, root and proof only."""
    tree = Tree(leaves(65))
    for size in range(1, 65):
        root = tree.root(size)
        for index, leaf in enumerate(leaves(size)):
            proof = tree.inclusion(index, size)
            check_inclusion(leaf, index, size, proof, root)
            check_no_inclusion(leaves(65)[64], index, size, proof, root)
            check_no_inclusion(leaf, index, size, [*proof, root], root)
            check_no_inclusion(leaf, (index + 1) % size, size, proof, tree.root(size + 1))
            if proof:
                check_no_inclusion(leaf, index, size, proof[:-1], root)
                check_no_inclusion(leaf, index ^ 1, size, proof, root)


def check_no_inclusion(leaf: bytes, index: int, size: int, proof: list[bytes], root: bytes) -> None:
    """Check that a proof is refused."""
    with pytest.raises(ProofFailed):
        check_inclusion(leaf, index, size, proof, root)


def check_no_consistency(before: int, old: bytes, size: int, new: bytes, proof: list[bytes]) -> None:
    """Check that a proof is refused."""
    with pytest.raises(ProofFailed):
        check_consistency(before, old, size, new, proof)


def test_every_consistency_proof_holds_and_no_other_does() -> None:
    """Every pair of sizes up to 64."""
    tree, other = Tree(leaves(64)), Tree([bytes(32), *leaves(64)[1:]])
    for size in range(1, 65):
        for before in range(1, size + 1):
            old, new, proof = tree.root(before), tree.root(size), tree.consistency(before, size)
            check_consistency(before, old, size, new, proof)
            check_no_consistency(before, other.root(before), size, new, proof)
            check_no_consistency(before, old, size, other.root(size), proof)
            check_no_consistency(before, old, size, new, [*proof, old])
            if proof:
                check_no_consistency(before, old, size, new, proof[:-1])


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 1500), st.data())
def test_any_tree(size: int, data: st.DataObject) -> None:
    """Larger ones, by chance."""
    tree = Tree(leaves(size))
    index, before = data.draw(st.integers(0, size - 1)), data.draw(st.integers(1, size))
    check_inclusion(leaves(size)[index], index, size, tree.inclusion(index), tree.root())
    check_consistency(before, defined(leaves(before)), size, tree.root(), tree.consistency(before))
    assert len(tree.inclusion(index)) <= (size - 1).bit_length()


def test_what_is_not_in_a_tree_has_no_proof() -> None:
    """Asked for, it is an error; given, it is refused."""
    tree = Tree(leaves(3))
    for wrong in (lambda: tree.inclusion(3), lambda: tree.inclusion(-1), lambda: tree.root(4)):
        with pytest.raises(IndexError):
            wrong()
    for before in (0, 4):
        with pytest.raises(IndexError):
            tree.consistency(before)
        check_no_consistency(before, tree.root(), 3, tree.root(), [])
    check_no_inclusion(leaves(3)[0], 3, 3, [], tree.root())
    check_no_inclusion(leaves(3)[0], 0, 2, [], leaves(3)[0])  # the root of a smaller tree


@pytest.mark.parametrize("size", [0, 1, 2, 3, 7, 8, 37])
def test_a_growing_tree_goes_on_from_its_peaks(size: int) -> None:
    """As if it had seen every leaf; a tree of this size has so many peaks and no others."""
    leaves = [bytes([number]) * 32 for number in range(50)]
    whole, begun = Peaks(), Peaks()
    for leaf in leaves[:size]:
        begun.append(leaf)
    again = Peaks(size, begun.peaks)
    for leaf in leaves:
        whole.append(leaf)
    for leaf in leaves[size:]:
        again.append(leaf)
    assert (again.size, again.root(), again.peaks) == (50, whole.root(), whole.peaks)
    with pytest.raises(ValueError, match="peaks"):
        Peaks(size, (*begun.peaks, bytes(32)))
