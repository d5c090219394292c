"""How fast a flight is checked: every leaf of the chain, read from the file.

Absolute figures, for there is nothing to take the ratio to; the budget is stated for one core.
"""

from __future__ import annotations

from pathlib import Path
from statistics import median
from time import perf_counter

from events.chain import Chain
from events.store.sqlite import SqliteReader, SqliteStore
from tests.bench.flight import FLIGHT_ID, SECRET, records
from tests.bench.frame import Bench, Row, at_least, interleaved

RECORDS = 50_000
VERIFY_BUDGET = 450_000


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


BENCHES = (Bench("verify/chain", chain_row),)
