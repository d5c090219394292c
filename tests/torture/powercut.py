"""Cuts the power under the node, 100,000 times: what was acknowledged is there, and nothing is done twice.

`tests/disk` says what a cut may leave. Half of the lives begin on what a cut has left, so recoveries are cut too; on
half of the disks a cut may tear inside a sector.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from itertools import count as counting
from multiprocessing import get_context
from typing import Any

from tests.disk.powercut import Tally, cut_life
from tests.disk.promises import ALARM, FAILED, LOST, OPEN, REPLACED, TWICE, UNRECORDED, UNSEALED

STATES = 100_000
STATES_A_POINT, IN_A_SAMPLE = 8, 2
# Fewer than this are a sample, and not worth other processes.
SAMPLE = 5_000
_COUNTS = {
    "acknowledged_records_lost": LOST,
    "acknowledged_records_replaced": REPLACED,
    "effects_without_their_record": UNRECORDED,
    "effects_twice": TWICE,
    "performed_orders_left_open": OPEN,
    "stored_checkpoints_lost": UNSEALED,
    "cuts_taken_for_damage": ALARM,
    "starts_that_failed": FAILED,
}


def run(count: int | None, seed: int, report: Callable[[str], None]) -> dict[str, Any]:
    """Cut at least `count` times (None: 100,000), beginning with the life of this seed. Raises AssertionError."""
    wanted, total = count or STATES, Tally()
    for tally in _tallies(seed, sample=wanted <= SAMPLE):
        total.add(tally)
        assert not total.broken, f"{dict(total.broken)}\n" + "\n".join(total.examples)
        report(f"{total.lives} lives, {total.states} states, {total.images} images: every promise is kept")
        if total.states >= wanted:
            break
    return {
        "states": total.states,
        "distinct_images": total.images,
        "lives": total.lives,
        "points": total.points,
        "first_seed": seed,
        "acknowledged_records_looked_for": total.acknowledged,
        "of_these_class_sync": total.synced,
        "effects_looked_for": total.effects,
        "classified": dict(sorted(total.actions.items())),
        **{name: total.broken[what] for name, what in _COUNTS.items()},
    }


def _tallies(seed: int, *, sample: bool) -> Iterator[Tally]:
    if sample:
        yield from (_cut(each, IN_A_SAMPLE) for each in counting(seed))
        return
    cores = os.cpu_count() or 1
    with get_context("spawn").Pool(cores) as pool:
        for first in counting(seed, 4 * cores):
            yield from pool.imap(_cut, range(first, first + 4 * cores))


def _cut(seed: int, states_a_point: int = STATES_A_POINT) -> Tally:
    return cut_life(seed, states_a_point, tearing=seed % 4 in (2, 3))
