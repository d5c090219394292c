"""Divergences with known causes, and whether replay finds them: the first record in all, the cause in nine of ten."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

from replay.blame import Again, Blame, Cause, blame
from replay.verify import verify
from tests.flights import resealed
from tests.torture.mutations import SOFTWARE, Mutation, made

COUNTS = {
    Cause.CODE: 45,
    Cause.CONFIGURATION: 35,
    Cause.UPCAST: 30,
    Cause.MISSING: 30,
    Cause.REORDERED: 30,
    Cause.ENVIRONMENT: 15,
}
FULL = sum(COUNTS.values())
SEED = 1_000_003  # those below were developed on


def judge(mutation: Mutation, again: Again) -> tuple[int | None, Blame | None]:
    """Return the first seq and the blame that replay finds."""
    reader = resealed(mutation.records)
    verdict = verify(reader)
    if verdict.first is None:
        return None, None
    found = blame(reader, verdict.first, lifting=mutation.lifting, again=again, software=SOFTWARE)
    return verdict.first.seq, found


def mutations(seed: int, count: int) -> Iterator[Mutation]:
    for cause, share in COUNTS.items():
        if cause is not Cause.ENVIRONMENT:
            yield from made(cause, seed, max(1, share * count // FULL))


if __name__ == "__main__":
    import sys, time

    seed, count = int(sys.argv[1]), int(sys.argv[2])
    only = sys.argv[3:]
    again = Again()
    right = firsts = total = 0
    spent = Counter()
    for m in mutations(seed, count):
        if only and m.cause.name.lower() not in only:
            continue
        began = time.perf_counter()
        seq, b = judge(m, again)
        took = time.perf_counter() - began
        total += 1
        firsts += seq == m.seq
        ok = b is not None and b.cause is m.cause
        right += ok
        spent[m.cause] += took
        print("ok  " if ok else "MISS", "" if seq == m.seq else f"SEQ {seq} != {m.seq}", m.cause.name, "|", m.name, f"@{m.seq} {took:.2f}s")
        if ok and b:
            print("     ", " ".join(f"{f.cause.name}:{f.weight.name}" for f in b.findings if f.weight > 1))
        if not ok and b:
            for f in b.findings:
                print("      ", f.cause.name, f.weight.name, f.tried, f.words[:230])
    print(firsts, right, total, dict(spent))
    again.close()
