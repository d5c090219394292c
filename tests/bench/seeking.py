"""How long a start takes on a long flight, and how long it takes to come to any place of it.

Absolute figures, for there is nothing to take the ratio to; within this process, whose imports are done. A start is
everything between the daemon's wish for a session and the session: the log examined, the state there, opened to write,
what the start says recorded. Each start is a kill for the next one.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from pathlib import Path
from random import Random
from statistics import median
from time import perf_counter

from autopilot.cli.seeking import signed_in
from events.store import flights_in, read_flight
from replay.seek import state_at
from tests.autopilot.trust.world import FakeClock
from tests.bench.frame import ROUNDS, Bench, Row, at_most
from tests.bench.million import OBJECTS, RECORDS, million
from tests.bench.million import Bench as Node

RESTART_BUDGET_S = 1.0
SEEK_BUDGET_S = 1.0
PLACES = 20


def timed(work: Callable[[], object]) -> float:
    """Return how many seconds it takes."""
    gc.collect()
    began = perf_counter()
    work()
    return perf_counter() - began


def restarted(root: Path) -> float:
    """Start, and let go of the log without a word; measures seconds."""
    clock = FakeClock()
    clock.now_ms += 1_000_000_000
    node = Node(root, clock)
    began = perf_counter()
    session = node.open()
    elapsed = perf_counter() - began
    assert session.known is not None
    assert len(session.state.objects) == OBJECTS
    session.store.close()
    gc.unfreeze()
    return elapsed


def restart_rows() -> list[Row]:
    """Return the row of a start, the median of some."""
    root = million()
    took_s = median([restarted(root) for _ in range(ROUNDS + 1)][1:])
    against = f"{RECORDS:,} records, {OBJECTS:,} objects, imports apart"
    return [at_most("restart, ready", took_s, "s", RESTART_BUDGET_S, against)]


def sought(folder: Path, seq: int) -> float:
    """Return how many seconds it takes to come to a record's state."""
    reader = read_flight(folder)
    try:
        return timed(lambda: state_at(reader, folder, seq, signed_in(reader, folder), lambda _done, _of: None))
    finally:
        reader.close()


def seek_rows() -> list[Row]:
    """Return the row of a seek: the worst of some places, and the last record."""
    folder, chance = flights_in(million())[0].folder, Random(1)
    places = [*(chance.randrange(RECORDS) for _ in range(PLACES - 1)), RECORDS - 1]
    worst_s = max(sought(folder, seq) for seq in places)
    return [at_most("seek, worst", worst_s, "s", SEEK_BUDGET_S, f"{PLACES} places in {RECORDS:,} records")]


BENCHES = (Bench("restart", restart_rows), Bench("seek", seek_rows))
