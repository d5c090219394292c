"""Divergences with known causes, and whether replay finds them: the first record in all, the cause in nine of ten.

`mutations` says how they are made. The search was developed on seeds up to `DEVELOPED_ON`; what is scored begins
behind them, so seed 1 of a run is another one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

from replay.blame import blame
from replay.blame.again import Again
from replay.blame.findings import Cause
from replay.verify import verify
from tests.flights import resealed
from tests.torture.elsewhere import Judged, judged
from tests.torture.mutations import SOFTWARE, Mutation, made

COUNTS = {
    Cause.CODE: 45,
    Cause.CONFIGURATION: 35,
    Cause.UPCAST: 30,
    Cause.MISSING: 35,
    Cause.REORDERED: 30,
    Cause.ENVIRONMENT: 20,
}
FULL = sum(COUNTS.values())
DEVELOPED_ON = 1_000
Report = Callable[[str], None]


def run(count: int | None = None, seed: int = 1, report: Report = print) -> dict[str, Any]:
    """Score about so many mutations, every cause in its share, and return the counts and the table of confusion.

    Raises AssertionError where a first record is wrong, or more than one cause in ten.
    """
    found = list(_judged(FULL if count is None else count, DEVELOPED_ON + seed, report))
    right = sum(cause is one.blamed for cause, one in found)
    first = sum(one.true_seq == one.found_seq for _, one in found)
    assert first == len(found), f"the first record is right in {first} of {len(found)}"
    assert 10 * right >= 9 * len(found), f"the cause is right in {right} of {len(found)}"
    return {
        "seed": DEVELOPED_ON + seed,
        "mutations": len(found),
        "first_seq_right": first,
        "blame_right": right,
        "blame_right_percent": 100 * right // max(len(found), 1),
        "true_cause_to_blamed": _table(found),
        "missed": [f"{cause.value}: {one.name}" for cause, one in found if cause is not one.blamed],
    }


def _table(found: list[tuple[Cause, Judged]]) -> dict[str, dict[str, int]]:
    table: dict[str, Counter[str]] = {}
    for cause, one in found:
        table.setdefault(cause.value, Counter())[one.blamed.value if one.blamed else "nothing"] += 1
    return {cause: dict(sorted(blamed.items())) for cause, blamed in sorted(table.items())}


def _judged(count: int, seed: int, report: Report) -> Iterator[tuple[Cause, Judged]]:
    again = Again()
    try:
        for cause, share in COUNTS.items():
            wanted = max(share * count // FULL, 1)
            for one in judged(seed, wanted) if cause is Cause.ENVIRONMENT else _found(cause, seed, wanted, again):
                report(_line(cause, one))
                yield cause, one
    finally:
        again.close()


def _found(cause: Cause, seed: int, wanted: int, again: Again) -> Iterator[Judged]:
    yield from (_judge(mutation, again) for mutation in made(cause, seed, wanted))


def _judge(mutation: Mutation, again: Again) -> Judged:
    reader = resealed(mutation.records)
    first = verify(reader).first
    if first is None:
        return Judged(mutation.name, mutation.seq, None, None)
    found = blame(reader, first, lifting=mutation.lifting, again=again, software=SOFTWARE)
    return Judged(mutation.name, mutation.seq, first.seq, found.cause)


def _line(cause: Cause, one: Judged) -> str:
    right = "right" if cause is one.blamed and one.true_seq == one.found_seq else "WRONG"
    return f"{right}  {cause.value}: {one.name}, record {one.true_seq}; found {one.blamed}, record {one.found_seq}"
