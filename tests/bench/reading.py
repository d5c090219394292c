"""How fast a flight is read: every leaf of the chain checked, and every decision taken again and compared.

Absolute figures, for there is nothing to take the ratio to; the budget is stated for one core.
"""

from __future__ import annotations

from pathlib import Path
from statistics import median
from time import perf_counter

from events.chain import Chain
from events.records import Record
from events.store.sqlite import SqliteReader, SqliteStore
from replay.verdict import Outcome
from replay.verify import verify
from tests.bench.flight import FLIGHT_ID, SECRET, records
from tests.bench.flown import TICKS_A_SECOND, flown
from tests.bench.frame import Bench, Row, at_least, interleaved

RECORDS = 50_000
VERIFY_BUDGET = 450_000
FLOWN_S = 600
REPLAY_BUDGET = 60_000
REAL_TIME_BUDGET = 1_000


def verify_chain(folder: Path) -> float:
    """Write a flight, then read it and check its chain; measures records a second of the reading."""
    path = folder / "flight.db"
    store = SqliteStore.create(path, FLIGHT_ID, SECRET)
    head = store.append(records(RECORDS))
    store.close()
    reader = SqliteReader(path)
    chain = Chain(reader.flight_id, reader.secret)
    began = perf_counter()
    for stored in reader.stored():
        chain.check(stored)
    elapsed = perf_counter() - began
    assert chain.leaf == head.leaf
    reader.close()
    return RECORDS / elapsed


def chain_row() -> list[Row]:
    """Return the row of the chain."""
    measures = interleaved({"ours": verify_chain})
    return [at_least("verify chain", median(measures["ours"]), "records/s", VERIFY_BUDGET, "the budget, one core")]


def replayed(folder: Path, log: list[Record]) -> float:
    """Write a decided flight, then replay it; measures seconds."""
    path = folder / "flight.db"
    store = SqliteStore.create(path, FLIGHT_ID, SECRET)
    store.append(log)
    store.close()
    reader = SqliteReader(path)
    began = perf_counter()
    verdict = verify(reader)
    elapsed = perf_counter() - began
    reader.close()
    assert (verdict.outcome, verdict.records) == (Outcome.IDENTICAL, len(log)), verdict
    return elapsed


def replay_rows() -> list[Row]:
    """Return the rows of replay: records a second, and how many times faster than it was flown."""
    log = flown(FLOWN_S * TICKS_A_SECOND)
    took_s = median(interleaved({"ours": lambda folder: replayed(folder, log)})["ours"])
    against = f"a made flight of {FLOWN_S} s, {len(log)} records, one core"
    return [
        at_least("replay", len(log) / took_s, "records/s", REPLAY_BUDGET, against),
        at_least("replay, times real time", FLOWN_S / took_s, "x", REAL_TIME_BUDGET, against),
    ]


BENCHES = (Bench("verify/chain", chain_row), Bench("replay", replay_rows))
