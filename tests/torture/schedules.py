"""Ten thousand seeded schedules of a relay that delays, reorders, doubles and drops; what must hold is in `scheduling`.

run(None, 1, report)    10,000 from seed 1 on, on every processor
run(300, 7, report)     300, in this process
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from multiprocessing import get_context
from typing import Any

from tests.torture.scheduling import Seen, held

SCHEDULES = 10_000
SHARE = 100  # schedules of one task


def run(count: int | None, seed: int, report: Callable[[str], None]) -> dict[str, Any]:
    """Run `count` schedules (None: 10,000) from `seed` on. Raises Broken at the first that does not hold."""
    wanted = count or SCHEDULES
    shares = [range(first, min(first + SHARE, seed + wanted)) for first in range(seed, seed + wanted, SHARE)]
    results, rejected, done = Counter[str](), Counter[str](), Counter[str]()
    for found in _run(shares, alone=count is not None):
        for seen in found:
            results += seen.results
            rejected += seen.rejected
            done.update(schedules=1, orders=seen.orders, samples_at_the_node=seen.delivered, performed=seen.performed)
        if done["schedules"] % 1_000 == 0:
            report(f"{done['schedules']} schedules, {done['orders']} orders")
    return {
        **done,
        "first_seed": seed,
        "shown_by_the_issuers": dict(sorted(results.items())),
        "dropped_by_the_node": dict(sorted(rejected.items())),
        "performed_twice": 0,
        "older_after_newer": 0,
        "false_accepted": 0,
    }


def _run(shares: Sequence[range], *, alone: bool) -> Iterator[list[Seen]]:
    if alone:
        yield from map(_share, shares)
        return
    with get_context("spawn").Pool(os.cpu_count() or 1) as pool:
        yield from pool.imap(_share, shares)


def _share(seeds: range) -> list[Seen]:
    return [held(seed) for seed in seeds]
