"""Divergences with known causes, and whether replay finds them: the first record in all, the cause in nine of ten.

`mutations` says how they are made. Seeds below `SEED` are those that the search was developed on; what is reported is
scored on others.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator

from replay.blame import Again, Cause, blame
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
SEED = 1_000
Report = Callable[[str], None]


def run(count: int | None = None, seed: int = SEED, report: Report = print) -> dict[str, object]:
    """Score about so many mutations, every cause in its share, and return the counts and the table of confusion."""
    found = list(_judged(FULL if count is None else count, seed, report))
    right = sum(cause is one.blamed for cause, one in found)
    return {
        "seed": seed,
        "mutations": len(found),
        "first_seq_right": sum(one.true_seq == one.found_seq for _, one in found),
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
