"""Redaction in great number: random removals out of random flights, each copy held to everything that it promises.

No copy is taken for a divergence, none hides a decision, no leaf changes, and no forged hash passes. The draws come
from a seed, so that a run can be repeated.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

from events import Chain, ChainBroken
from projections.bundle import build_redacted
from projections.words import ranges
from replay.verdict import Outcome
from replay.verify import verify
from tests.random_flights import WHATS, Draw, fly
from tests.replay.copies import Copy

FULL = 5_000


def run(count: int | None, seed: int, report: Callable[[str], None]) -> dict[str, Any]:
    """Redact `count` times (None: FULL); return what was counted.

    Raises AssertionError with the seed of the first that fails.
    """
    counts = {"copies": 0, "removed": 0, "compared": 0, "agreeing": 0, "uncompared": 0, "forgeries": 0}
    last = seed + (FULL if count is None else count)
    for number in range(seed, last):
        if number % 500 == 0:
            report(f"{number} of {last - 1}")
        chance = random.Random(f"redact {number}")
        flight = fly(_draws(chance))
        share = chance.choice((0.01, 0.05, 0.3, 0.8))
        remove = {one.seq for one in flight.records[1:] if chance.random() < share} or {1}
        copy = Copy(flight.store, remove)
        verdict = verify(copy)
        assert verdict.outcome is Outcome.INCOMPLETE, (number, verdict.words())
        assert verdict.gaps.removed == sorted(remove), number
        assert verdict.leaf == flight.store.head.leaf.hex(), number
        there = sum(one.cause >= 0 and one.seq not in remove for one in flight.records)
        assert verdict.decisions + verdict.gaps.agreeing + verdict.gaps.uncompared == there, number
        assert build_redacted(copy.stored())["gaps"]["removed"] == ranges(remove), number
        _forge(copy, chance, number)
        found = {"copies": 1, "removed": len(remove), "compared": verdict.decisions, "forgeries": 1}
        found |= {"agreeing": verdict.gaps.agreeing, "uncompared": verdict.gaps.uncompared}
        counts = {name: counts[name] + found[name] for name in counts}
    return counts


def _draws(chance: random.Random) -> list[Draw]:
    return [
        (chance.choice(WHATS), chance.randrange(6), chance.randrange(6), chance.randrange(6))
        for _ in range(chance.randrange(1, 60))
    ]


def _forge(copy: Copy, chance: random.Random, number: int) -> None:
    """Change one bit of what a removed record left, and see that the chain breaks there."""
    rows = list(copy.stored())
    gone = chance.choice([row for row in rows if row.removed])
    forged = bytearray(gone.removed)
    forged[chance.randrange(len(forged))] ^= 1 << chance.randrange(8)
    chain = Chain(copy.flight_id, b"", rows[gone.seq - 1].leaf)
    try:
        chain.check(gone._replace(removed=bytes(forged)))
    except ChainBroken:
        return
    raise AssertionError(f"{number}: a forged hash of record {gone.seq} passed")
