"""What is done with the core under the guard: everything that it can do with each golden flight.

Imported when the guard is there and not before, for it imports the core.
"""

from __future__ import annotations

from contextlib import suppress

from events import Record, read_record
from events.canopy import BLOCK, Canopy
from projections import audit, objects, packed, pois, status
from projections.describe import describe
from projections.picture import Status
from statecharts import LOGIC, State, carry_over, codec, digest, restore, snapshot, steps_of
from tests.golden.digest import digests, rows_of
from tests.golden.table import GOLDEN

FOLDS = (audit.PROJECTION, objects.PROJECTION, pois.PROJECTION)


def fly_all() -> int:
    """Tell, replay, restore, hand over and show every golden flight; return how many there were."""
    for golden in GOLDEN:
        golden.records()
        digests(golden.path)
        _use([read_record(row) for row in rows_of(golden.path)[0]])
    _prove()
    return len(GOLDEN)


def _prove() -> None:
    """Grow a canopy over made-up leaves and prove that it grew."""
    size = 2 * BLOCK + 7
    canopy = Canopy(lambda start, stop: (number.to_bytes(32) for number in range(start, stop)))
    while canopy.lacks(size):
        canopy.take_block()
    canopy.reach(size)
    canopy.consistency(BLOCK + 1, size)


def _use(records: list[Record]) -> None:
    state, told = State(), Status()
    for recorded in steps_of(records):
        restore(state, recorded)
    with suppress(ValueError):  # in `extremes` a count is at the end of its range, and one more does not fit
        carry_over(state, records[-1].at.flight_ns)
    for fold in FOLDS:
        folded = fold.start()
        for record in records:
            folded = fold.apply(folded, record)
        fold.tables(folded)
    for record in records:
        describe(record)
        told = status.apply(told, record)
    status.plain(told)
    packed.unpack(packed.pack(told))
    _keep(state, records)


def _keep(state: State, records: list[Record]) -> None:
    """Make a snapshot of a state and load it."""
    size, rows = len(records), digest.rows_of(state)
    chunk = snapshot.Chunk(size, 0, codec.software_digest(LOGIC), b"", (), b"", snapshot.tables_of(rows))
    expected = digest.digest_of(state)
    with suppress(snapshot.SnapshotUnfit):  # numbers of more than 64 bits, in `poisoned`, are digested but not kept
        loaded = snapshot.load(snapshot.chunks_of(size, {size: 0}, lambda _: snapshot.pack(chunk), chunk.software))
        assert loaded.digest.value == expected
