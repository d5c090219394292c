"""Snapshots: whatever the chunks, each is the state that a replay from the first record comes to, and goes on alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from events import Record
from events.chain import Chain
from events.tree import Peaks
from statecharts import LOGIC, State, restore, step, steps_of
from statecharts.charts.mapping import grid_of, place_object
from statecharts.codec import LAYOUT, software_digest
from statecharts.digest import Rows, StateDigest, digest_of
from statecharts.facts import MapObject, Spot
from statecharts.snapshot import (
    Chunk,
    SnapshotUnfit,
    Vouched,
    chunks_of,
    merge_into,
    pack,
    restore_state,
    tables_of,
    unpack,
)
from tests.checks import check_equal, check_same
from tests.flights import FLIGHT_ID, SECRET, place, story
from tests.random_flights import Draw, draws, fly

OURS = software_digest(LOGIC)


class Kept:
    """A flight's snapshots, kept as the node does, and what vouches for them."""

    def __init__(self, records: Sequence[Record], every: int, long: int) -> None:
        self.steps = list(steps_of(records))
        self.chunks: dict[int, bytes] = {}
        self.base_of: dict[int, int] = {}
        self.vouched: dict[int, Vouched] = {}
        self._newest = self._long = 0
        self._since_newest, self._since_long = Rows(), Rows()
        state, peaks, chain = State(), Peaks(), Chain(FLIGHT_ID, SECRET)
        digest = StateDigest(state)
        for recorded in self.steps:
            restore(state, recorded)
            for one in recorded:
                peaks.append(chain.extend(one.seq, one.cause, one.at, one.kind.number, one.version, one.body))
            if peaks.size - self._newest >= every:
                self._keep(peaks, chain.leaf, digest, long)

    def _keep(self, peaks: Peaks, leaf: bytes, digest: StateDigest, long: int) -> None:
        merge_into(self._since_newest, digest.advance())
        merge_into(self._since_long, self._since_newest)
        is_long = len(self.chunks) % long == long - 1
        base, rows = (self._long, self._since_long) if is_long else (self._newest, self._since_newest)
        size = peaks.size
        self.chunks[size] = pack(Chunk(size, base, OURS, leaf, peaks.peaks, b"side", tables_of(rows)))
        self.base_of[size] = base
        self.vouched[size] = Vouched(leaf, peaks.root(), LAYOUT, digest.value)
        self._newest, self._since_newest = size, {}
        if is_long:
            self._long, self._since_long = size, {}

    def load(self, size: int, software: bytes = OURS) -> tuple[State, StateDigest]:
        """Return a snapshot's state. Raises SnapshotUnfit."""
        found = chunks_of(size, self.base_of, self.chunks.__getitem__, software)
        return restore_state(found, self.vouched[size])


def check_snapshots(records: Sequence[Record], every: int, long: int) -> None:
    """Check every snapshot of a flight against the state from zero, and the decisions that follow, byte for byte."""
    kept, state, size = Kept(records, every, long), State(), 0
    for number, recorded in enumerate(kept.steps):
        restore(state, recorded)
        size += len(recorded)
        if size in kept.chunks:
            loaded, digest = kept.load(size)
            check_same(loaded, state)
            check_equal((digest.value, digest_of(loaded)), (digest_of(state), digest_of(state)))
            for following in kept.steps[number + 1 : number + 4]:
                check_equal([one.body for one in step(loaded, following[0]).records], [one.body for one in following])
            digest.advance()
            check_equal(digest.value, digest_of(loaded))
    check_equal(len(kept.chunks) > 0, size >= every)


@settings(max_examples=25, deadline=None)
@given(draws, st.sampled_from([1, 2, 7, 40]), st.sampled_from([1, 2, 3, 8]))
def test_every_snapshot_is_a_replay_from_zero(drawn: list[Draw], every: int, long: int) -> None:
    """Any flight, down to a chunk a step."""
    check_snapshots(fly(drawn).records, every, long)


@pytest.mark.parametrize("every", [1, 10, 50])
def test_the_story_too(every: int) -> None:
    """With everything that happens in it."""
    check_snapshots(story().records, every, 4)


def test_the_grid_follows_from_the_objects() -> None:
    """Whatever way they came and went: a cell names what is in it in order, and an empty one is not there."""
    state = story().state
    for number, east_mm in [(7, 0), (9, 50_000), (8, 50_100), (7, 50_200), (9, 90_000), (7, 0)]:
        spot = Spot.of(place(east_mm, 0))
        place_object(state, MapObject(number, "person", "person", spot, 5_000, 1))
        grid = grid_of(state.objects.values(), state.flight.limits.same_object_mm)
        check_equal(dict(state.grid.items()), grid)


def check_unfit(kept: Kept, size: int, because: str, **values: bytes) -> None:
    """Check that a snapshot is not used."""
    with pytest.raises(SnapshotUnfit, match=because):
        kept.load(size, **values)


@pytest.fixture
def kept() -> Kept:
    return Kept(story().records, 20, 3)


def test_another_software_is_refused(kept: Kept) -> None:
    """Another logic, layout or schema: nothing is read of it."""
    check_unfit(kept, max(kept.chunks), "another logic", software=software_digest(LOGIC + 1))


def test_another_log_is_refused(kept: Kept) -> None:
    """By its last leaf, by its root, and by a layout that can't be compared."""
    size = max(kept.chunks)
    good = kept.vouched[size]
    for bad, because in [
        (good._replace(leaf=bytes(32)), "another leaf"),
        (good._replace(root=bytes(32)), "another root"),
        (good._replace(layout=bytes(4)), "another layout"),
        (good._replace(digest=bytes(32)), "not the one that was signed"),
    ]:
        kept.vouched[size] = bad
        check_unfit(kept, size, because)


def test_a_chunk_that_is_missing_or_another(kept: Kept) -> None:
    """What a snapshot rests on must all be there, in its place."""
    first, second, *_, last = sorted(kept.chunks)
    rests_on = kept.base_of[last]
    del kept.base_of[rests_on]
    check_unfit(kept, last, f"chunk of {rests_on} records is not there")
    kept.base_of[second] = second
    check_unfit(kept, second, "rests on a later one")
    kept.base_of[second] = 0
    check_unfit(kept, second, "is another one")
    good = kept.chunks[first]
    for bad in (kept.chunks[last], pack(unpack(good)._replace(size=first + 1))):
        kept.chunks[first] = bad
        check_unfit(kept, first, "is another one")
    kept.chunks[first] = b"\x93"
    check_unfit(kept, first, "no chunk of a snapshot")
    kept.chunks[first] = pack(unpack(kept.chunks[last])._replace(size=first, base=0, peaks=()))
    check_unfit(kept, first, "another l|peaks")


Tables = dict[str, tuple[list[bytes], list[bytes]]]


def without(name: str) -> Callable[[Tables], object]:
    """Return a change: a table is emptied."""
    return lambda tables: tables.pop(name)


def _swap(tables: Tables) -> None:
    keys, rows = tables["objects"]
    tables["objects"] = keys, [rows[-1], *rows[:-1]]


def _extra(tables: Tables) -> None:
    tables["orders"][0].append(b"\xa1x")
    tables["orders"][1].append(tables["orders"][1][0])


@pytest.mark.parametrize(
    ("change", "because"),
    [
        (without("nonces"), "not the one that was signed"),
        (without("orders"), "not the one that was signed"),
        (_swap, "not the one that was signed"),
        (_extra, "not the one that was signed"),
        (without("next_seq"), "after 0 records"),
        (without("manifest"), "manifest"),
        (lambda tables: tables.update(others=([b"a"], [b"b"])), "no such table"),
        (lambda tables: tables["orders"][1].pop(), "do not pair"),
        (lambda tables: tables.update(orders=([b"\xa1x"], [b"\x01"])), "orders"),
    ],
)
def test_a_forged_state_is_refused(change: Callable[[Tables], object], because: str) -> None:
    """Whoever holds the disk may empty the window that replays are found by; then the log is read instead."""
    forged = Kept(story().records, 100, 8)
    size = max(forged.chunks)
    whole = unpack(forged.chunks[size])
    change(whole.tables)
    forged.chunks[size] = pack(whole)
    check_unfit(forged, size, because)
