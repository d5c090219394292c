"""Bit rot, exhaustive: every byte of WAL, database and head file; every cut; blocks zeroed and exchanged.

    run(None, seed=1, report=print, jobs=2)     every case; a count is that many of each area, by seed

Each case is counted in one class: `found` (the log is kept, or its seals say so), `harmless` (all that can be read is
what it was), `unchanged` (two blocks that are alike), `go_on_and_say` and `cut_and_say` (said to whoever starts or
checks); a sound `cut_and_say` and a shorter log under `go_on` only where a power cut leaves the files so. SILENT, ALARM
(a power cut taken for damage) and RAISED must stay at 0.
"""

from __future__ import annotations

import shutil
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from functools import partial
from itertools import combinations
from random import Random
from typing import Any, NamedTuple

from events.store.flights import DATABASE
from events.store.head import NAME as HEAD
from events.store.head import SLOT_APART
from tests.torture.rotting import WAL, Bench, Whole, recorded, scratch

BLOCKS = (512, 4096)
Change = Mapping[str, bytes | None]


class Area(NamedTuple):
    """Cases of one kind, by number."""

    name: str
    whole: Whole
    size: int
    case: Callable[[int], Change]
    power_cut: bool = False  # a power cut may leave the files so


def areas(live: Whole, settled: Whole, seed: int) -> Iterator[Area]:
    """Yield everything that is tried."""
    yield _flips("WAL: one bit of every byte", live, WAL, seed)
    yield _flips("database under a live WAL: one bit of every byte", live, DATABASE, seed)
    yield _flips("database: one bit of every byte", settled, DATABASE, seed)
    yield _flips("head file: one bit of every byte", live, HEAD, seed)
    yield _flips("head file of a settled log: one bit of every byte", settled, HEAD, seed)
    yield _cuts("WAL: cut at every byte, as a power cut leaves it", live, WAL, _as_written(live), power_cut=True)
    yield _cuts("WAL: cut at every byte, head file as it was synced", live, WAL, _as_synced(live), power_cut=True)
    yield _cuts("WAL: cut at every byte, head file whole", live, WAL, lambda _: {})
    yield _cuts("WAL: cut at every byte, no head file", live, WAL, lambda _: {HEAD: None})
    yield _cuts("database: cut at every byte", settled, DATABASE, lambda _: {})
    yield _cuts("head file: cut at every byte", live, HEAD, lambda _: {})
    yield _torn_heads("head file: its newest slot torn at every byte", live)
    for size in BLOCKS:
        for name, whole in ((WAL, live), (DATABASE, settled), (HEAD, live)):
            said = {WAL: "WAL", DATABASE: "database", HEAD: "head file"}[name]
            yield _zeroed(f"{said}: every block of {size} bytes zeroed", whole, name, size)
            yield _exchanged(f"{said}: every two blocks of {size} bytes exchanged", whole, name, size)


def _flips(name: str, whole: Whole, file: str, seed: int) -> Area:
    content = whole.files[file]
    bits = Random(seed).choices(range(8), k=len(content))

    def case(at: int) -> Change:
        return {file: content[:at] + bytes([content[at] ^ 1 << bits[at]]) + content[at + 1 :]}

    return Area(name, whole, len(content), case)


def _cuts(name: str, whole: Whole, file: str, beside: Callable[[int], Change], *, power_cut: bool = False) -> Area:
    content = whole.files[file]
    return Area(name, whole, len(content), lambda at: {file: content[:at], **beside(at)}, power_cut)


def _as_written(live: Whole) -> Callable[[int], Change]:
    """The head file names the last commit that is whole."""
    return lambda at: {HEAD: live.heads[bisect_right(live.ends, at) - 1]}


def _as_synced(live: Whole) -> Callable[[int], Change]:
    """The head file is as it was when the WAL was last moved into the database."""
    return lambda _at: {HEAD: live.heads[0]}


def _torn_heads(name: str, live: Whole) -> Area:
    """The write of the newest head stopped after some bytes; the log holds what it was to name."""
    before, after = live.heads[-2:]
    place = SLOT_APART if before[:SLOT_APART] == after[:SLOT_APART] else 0

    def case(at: int) -> Change:
        return {HEAD: before[:place] + after[place : place + at] + before[place + at :]}

    return Area(name, live, SLOT_APART, case, power_cut=True)


def _zeroed(name: str, whole: Whole, file: str, size: int) -> Area:
    content = whole.files[file]
    blocks = range(0, len(content), size)

    def case(number: int) -> Change:
        at = blocks[number]
        return {file: content[:at] + bytes(len(content[at : at + size])) + content[at + size :]}

    return Area(name, whole, len(blocks), case)


def _exchanged(name: str, whole: Whole, file: str, size: int) -> Area:
    content = whole.files[file]
    pairs = list(combinations(range(0, len(content) - size + 1, size), 2))

    def case(number: int) -> Change:
        one, other = pairs[number]
        parts = (content[other : other + size], content[one + size : other], content[one : one + size])
        return {file: content[:one] + b"".join(parts) + content[other + size :]}

    return Area(name, whole, len(pairs), case)


def run(count: int | None, seed: int, report: Callable[[str], None], jobs: int = 2) -> dict[str, Any]:
    """Try `count` cases of each area, all of them for None, in so many processes; return the counts and the reasons."""
    work = scratch("rot")
    live, settled = recorded(work, seed)
    shutil.rmtree(work)
    names = [area.name for area in areas(live, settled, seed)]
    one = partial(_area, live, settled, count, seed)
    counts: dict[str, dict[str, int]] = {}
    total, reasons = Counter[str](), Counter[str]()
    with ProcessPoolExecutor(jobs) if jobs > 1 else nullcontext() as pool:
        tried = pool.map(one, range(len(names))) if pool else map(one, range(len(names)))
        for name, (classes, because) in zip(names, tried, strict=True):
            counts[name] = dict(sorted(classes.items()))
            total, reasons = total + classes, reasons + because
            report(f"{name}: {counts[name]}")
    sizes = {"wal_bytes": len(live.files[WAL]), "database_bytes": len(settled.files[DATABASE])}
    return {
        **sizes,
        "records": len(live.content.records),
        "cases": total.total(),
        "silent": total["SILENT"],
        "false_alarms": total["ALARM"],
        "raised": total["RAISED"],
        "classes": dict(sorted(total.items())),
        "areas": counts,
        "reasons": dict(sorted(reasons.items())),
    }


def _area(live: Whole, settled: Whole, count: int | None, seed: int, number: int) -> tuple[Counter[str], Counter[str]]:
    """Try one area in a folder of its own; return the counts of its classes and of their reasons."""
    area, folder = list(areas(live, settled, seed))[number], scratch("rot")
    bench, classes, reasons = Bench(folder, area.whole), Counter[str](), Counter[str]()
    for case in _chosen(area.size, count, seed):
        said = bench.said(area.case(case), expected=area.power_cut)
        classes[said.kind] += 1
        reasons[f"{said.kind}: {said.because}"] += 1
    shutil.rmtree(folder)
    return classes, reasons


def _chosen(size: int, count: int | None, seed: int) -> Sequence[int]:
    return range(size) if count is None or count >= size else sorted(Random(seed).sample(range(size), count))
