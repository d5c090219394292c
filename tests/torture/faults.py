"""Every operation of a run fails, and every block of a full disk is the last: orderly, or not at all.

An I/O error at each operation, once and for ever; then a disk with each number of free blocks when a flight ends.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from multiprocessing import get_context
from typing import Any, TypeVar

from tests.disk import failing, filling

# More blocks than any end needs and the start of the next flight, its reserved space left out.
BLOCKS = 24
T = TypeVar("T")
R = TypeVar("R")
Report = Callable[[str], None]


def run(count: int | None, seed: int, report: Report) -> dict[str, Any]:
    """Let every operation fail, or every n-th, so that near `count` do, from `seed` on. Raises AssertionError."""
    operations = failing.run(0).operations
    every = 1 if count is None else max(operations // count, 1)
    at = range(max(seed, 1), operations + 1, every)
    report(f"{len(at)} of {operations} operations fail")
    ends, broken = Counter[str](), list[str]()
    for found in _mapped(_failed, [(number, stays) for number in at for stays in (False, True)], count):
        ends[found.end] += 1
        broken += [f"{found.failed}: {one}" for one in found.broken]
    assert not broken, "\n".join(broken[:10])
    report("disks fill")
    free = range(0, BLOCKS, every)
    cases = [(how, blocks, reserved) for how in filling.WAYS for blocks in free for reserved in (True, False)]
    endings = list(_mapped(_filled, cases, count))
    broken = [f"{case}: {one}" for case, ending in zip(cases, endings, strict=True) for one in ending.broken]
    assert not broken, "\n".join(broken[:10])
    return {
        "operations_that_failed": len(at),
        "runs": sum(ends.values()),
        "ended_orderly": ends[failing.ENDED],
        "went_on_and_lost_nothing": ends[failing.WENT_ON],
        "full_disks": len(cases),
        "closed_in_the_space_reserved": sum(e.whole for c, e in zip(cases, endings, strict=True) if c[2]),
        "closed_without": sum(e.whole for c, e in zip(cases, endings, strict=True) if not c[2]),
        "not_closed_and_said": sum(not e.whole for e in endings),
    }


def _mapped(work: Callable[[T], R], cases: Iterable[T], count: int | None) -> Iterator[R]:
    if count is not None:
        yield from map(work, cases)
        return
    with get_context("spawn").Pool(os.cpu_count() or 1) as pool:
        yield from pool.imap(work, cases, chunksize=8)


def _failed(case: tuple[int, bool]) -> failing.Run:
    at, stays = case
    return failing.run(at, stays=stays)


def _filled(case: tuple[str, int, bool]) -> filling.Ending:
    how, free, reserved = case
    return filling.end(how, free, reserved=reserved)
