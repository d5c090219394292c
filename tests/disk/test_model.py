"""What a cut may leave of a few operations, and what it may not: the durable is there, the rest is drawn."""

from __future__ import annotations

from itertools import islice
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.checks import check_equal
from tests.disk.cuts import Chosen, alone, anything, cuts_of, everything, nothing, prefix, torn, without
from tests.disk.model import Disk, Do, Image, Op, digest, folder_of

A, B = "a/one", "a/two"
SIZES = st.integers(0, 40)
OPS = st.one_of(
    st.builds(lambda path, at, byte, size: Op(Do.WRITE, path, at, bytes([byte]) * size), st.sampled_from([A, B]),
              SIZES, st.integers(1, 255), st.integers(1, 20)),
    st.builds(lambda path, size: Op(Do.SIZE, path, size), st.sampled_from([A, B]), SIZES),
    st.builds(lambda path: Op(Do.SYNC, path), st.sampled_from([A, B])),
)  # fmt: skip


def disk_of(*ops: Op) -> Disk:
    """Return a disk with two empty files in a folder, all durable, on which these operations were done."""
    disk = Disk({"a": None, A: b"", B: b""})
    for op in ops:
        disk.do(op)
    return disk


def write(data: bytes, offset: int = 0, path: str = A) -> Op:
    """Return a write."""
    return Op(Do.WRITE, path, offset, data)


def left(disk: Disk, cut: Chosen, path: str = A) -> bytes | None:
    """Return what a cut leaves of a file."""
    return disk.after(cut)[path]


def every_image(disk: Disk, cuts: int = 400) -> list[Image]:
    """Return all the images that so many seeded cuts leave, each once."""
    choices = islice(cuts_of(disk, Random(1), tearing=True), cuts)
    images = {digest(image): image for image in map(disk.after, choices)}
    return list(images.values())


def test_what_is_synced_is_left_and_what_is_not_may_be() -> None:
    """A cut that loses all leaves what was durable; one that loses nothing leaves what was written."""
    disk = disk_of(write(b"old"), Op(Do.SYNC, A), write(b"new!"))
    check_equal(left(disk, Chosen(512, False, limit=0)), b"old")
    check_equal(left(disk, Chosen(512, False)), b"new!")
    check_equal(disk.pending(), [3])
    disk.do(Op(Do.SYNC, A))
    check_equal([image[A] for image in every_image(disk)], [b"new!"])


@given(st.lists(OPS, max_size=12), st.randoms(use_true_random=False))
def test_the_ends_and_the_middle(ops: list[Op], chance: Random) -> None:
    """Everything is what was done; each byte of any cut was there at some time, or is of a hole."""
    disk, contents = disk_of(*ops), {A: [b""], B: [b""]}
    for op in ops:
        size, now = max(len(contents[op.path][-1]), op.offset), contents[op.path][-1]
        if op.do is Do.WRITE:
            contents[op.path].append(
                now[: op.offset].ljust(op.offset, b"\0") + op.data + now[op.offset + len(op.data) :]
            )
        elif op.do is Do.SIZE:
            contents[op.path].append(now[: op.offset].ljust(op.offset, b"\0"))
        assert size >= 0
    check_equal(
        [disk.after(everything(disk, chance, 512, False))[path] for path in (A, B)], [contents[A][-1], contents[B][-1]]
    )
    for cut in (nothing, prefix, torn, without, alone, anything):
        if not disk.pending():
            return
        image = disk.after(cut(disk, chance, 4, chance.random() < 0.5))
        for path in (A, B):
            found = image[path] or b""
            assert len(found) <= max(map(len, contents[path]))
            for at, byte in enumerate(found):
                assert byte in {0, *(content[at] for content in contents[path] if at < len(content))}


def test_sectors_arrive_each_for_itself() -> None:
    """Of two sectors either may arrive alone; bytes of one arrive together, except on a disk that tears."""
    disk = disk_of(write(b"\0" * 8), Op(Do.SYNC, A), write(b"abcd", 2))
    found = {disk.after(anything(disk, Random(seed), 4, False))[A] for seed in range(40)}
    check_equal(found, {b"\0" * 8, b"\0\0ab\0\0\0\0", b"\0\0\0\0cd\0\0", b"\0\0abcd\0\0"})
    found = {disk.after(prefix(disk, Random(seed), 4, False))[A] for seed in range(40)}
    check_equal(found, {b"\0" * 8, b"\0\0ab\0\0\0\0"})
    found = {disk.after(torn(disk, Random(seed), 4, False))[A] for seed in range(80)}
    check_equal(len(found), 5)


def test_of_a_sector_any_version_may_be_left() -> None:
    """Later writes to it may be lost and the earlier kept, never the other way round."""
    disk = disk_of(write(b"11"), write(b"2"), write(b"3", 1))
    found = {disk.after(anything(disk, Random(seed), 512, False))[A] for seed in range(60)}
    check_equal(found, {b"", b"11", b"21", b"23"})


def test_nothing_arrives_before_the_cut_that_was_before_it() -> None:
    """What was written where a file had been cut off is there only if the cut is."""
    disk = disk_of(write(b"old-old-"), Op(Do.SYNC, A), Op(Do.SIZE, A, 0), write(b"new"))
    found = {disk.after(anything(disk, Random(seed), 4, False))[A] for seed in range(60)}
    check_equal(found, {b"old-old-", b"", b"new"})


@pytest.mark.parametrize(
    ("cut", "expected"),
    [
        (Chosen(4, False, missing=1), b"\0\0\0\0cccc"),
        (Chosen(4, False, missing=2), b"aaaacccc"),
        (Chosen(4, False, missing=3), b"bbaa"),
        (Chosen(4, False, alone=1), b"aaaa"),
        (Chosen(4, False, alone=2), b"bbaa"),
        (Chosen(4, False, alone=3), b"\0\0\0\0cccc"),
    ],
)
def test_one_write_is_lost_or_arrives_alone(cut: Chosen, expected: bytes) -> None:
    """With a sector comes what was in it before; what came later into a sector that was lost is lost too."""
    check_equal(left(disk_of(write(b"aaaa"), write(b"bb"), write(b"cccc", 4)), cut), expected)


@pytest.mark.parametrize(
    ("cut", "expected"),
    [
        (Chosen(512, False, missing=1), {"a", A, B, "a/second"}),
        (Chosen(512, False, missing=2), {"a", A, B, "a/first"}),
        (Chosen(512, False, alone=1), {"a", A, B, "a/first"}),
        (Chosen(512, False, alone=2), {"a", A, B, "a/second"}),
        (Chosen(512, False, limit=1), {"a", A, B, "a/first"}),
    ],
)
def test_one_name_is_lost_or_arrives_alone(cut: Chosen, expected: set[str]) -> None:
    """Names may arrive in any order."""
    check_equal(set(disk_of(Op(Do.CREATE, "a/first"), Op(Do.CREATE, "a/second")).after(cut)), expected)


def test_sizes_arrive_in_their_order() -> None:
    """A later size without the one before it, or growth for a write that waits for it, was never there."""
    disk = disk_of(write(b"aaaaaaaa"), Op(Do.SYNC, A), Op(Do.SIZE, A, 2), Op(Do.SIZE, A, 6), write(b"b", 9))
    found = {disk.after(anything(disk, Random(seed), 4, seed % 2 == 0))[A] for seed in range(200)}
    check_equal(found, {b"a" * 8, b"aa", b"aa" + bytes(4), b"aa" + bytes(8), b"aa" + bytes(7) + b"b"})


def test_making_a_file_that_is_there_changes_nothing() -> None:
    """It keeps its content, and what is written goes on from there."""
    disk = disk_of(write(b"x"), Op(Do.CREATE, A), write(b"y", 1))
    check_equal(left(disk, Chosen(512, False)), b"xy")


def test_a_file_may_have_grown_for_nothing() -> None:
    """Blocks that were given to it and not written are zero."""
    disk = disk_of(write(b"abc"))
    check_equal(left(disk, Chosen(512, True, limit=0)), b"\0\0\0")
    check_equal(left(disk, Chosen(512, False, limit=0)), b"")


def test_space_that_is_set_aside_is_zero_and_cuts_nothing() -> None:
    """Growing to a smaller size is nothing at all."""
    disk = disk_of(Op(Do.GROW, A, 4), write(b"abcdef"), Op(Do.GROW, A, 2))
    check_equal(left(disk, Chosen(512, False)), b"abcdef")
    check_equal(len(disk.pending()), 2)


def test_a_failed_sync_takes_what_it_should_have_kept() -> None:
    """The next one returns, and knows nothing of it; what is written after the failure is kept."""
    disk = disk_of(write(b"lost"))
    disk.fail(Op(Do.SYNC, A))
    disk.fail(write(b"never done"))
    disk.do(write(b"kept", 8))
    disk.do(Op(Do.SYNC, A))
    check_equal([image[A] for image in every_image(disk, 20)], [b"\0" * 8 + b"kept"])


@pytest.mark.parametrize(
    ("op", "before", "after"),
    [
        (Op(Do.CREATE, "a/new"), {"a", A, B}, {"a", A, B, "a/new"}),
        (Op(Do.DELETE, A), {"a", A, B}, {"a", B}),
        (Op(Do.RENAME, A, target="a/other"), {"a", A, B}, {"a", B, "a/other"}),
        (Op(Do.RENAME, A, target=B), {"a", A, B}, {"a", B}),
        (Op(Do.FOLDER, "a/deep"), {"a", A, B}, {"a", A, B, "a/deep"}),
        (Op(Do.CREATE, A), {"a", A, B}, {"a", A, B}),
    ],
)
def test_names_are_durable_by_their_folder_alone(op: Op, before: set[str], after: set[str]) -> None:
    """Syncing the file, or another folder, changes nothing."""
    disk = disk_of(op, Op(Do.SYNC_FOLDER, ""), Op(Do.SYNC, B))
    found = {frozenset(image) for image in every_image(disk)}
    check_equal(found, {frozenset(before), frozenset(after)})
    disk.do(Op(Do.SYNC_FOLDER, "a"))
    check_equal({frozenset(image) for image in every_image(disk)}, {frozenset(after)})


def test_what_is_in_a_folder_goes_with_it() -> None:
    """A folder whose name was never synced takes what was synced in it."""
    disk = Disk()
    for op in (Op(Do.FOLDER, "b"), Op(Do.CREATE, "b/x"), write(b"x", path="b/x"), Op(Do.SYNC, "b/x")):
        disk.do(op)
    disk.do(Op(Do.SYNC_FOLDER, "b"))
    check_equal(disk.after(nothing(disk, Random(1), 512, False)), {})
    disk.do(Op(Do.SYNC_FOLDER, ""))
    check_equal(disk.after(nothing(disk, Random(1), 512, False)), {"b": None, "b/x": b"x"})


def test_a_name_keeps_its_content_when_it_changes() -> None:
    """What is written after a rename is of the same file, under whichever name is left."""
    disk = disk_of(write(b"x"), Op(Do.SYNC, A), Op(Do.RENAME, A, target=B), write(b"y", path=B), Op(Do.SYNC, B))
    images = every_image(disk)
    check_equal(sorted((image.get(A), image[B]) for image in images if A in image), [(b"y", b"")])
    check_equal([image[B] for image in images if A not in image], [b"y"])


def test_images_differ_by_name_kind_and_content() -> None:
    """Equal images are started once, so nothing else may be taken for equal."""
    images: list[Image] = [{}, {"a": None}, {"a": b""}, {"a": b"x"}, {"b": b"x"}, {"a": b"x", "b": b""}]
    check_equal(len({digest(image) for image in images}), len(images))
    check_equal((folder_of("a/b/c"), folder_of("a")), ("a/b", ""))
