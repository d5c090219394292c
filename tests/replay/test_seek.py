"""The state after any record: from whatever snapshot it is read, it is the one that a replay from zero comes to."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from events import Record, uuid_of
from events.store import MemoryStore
from events.store.snapshots import NAME, SnapshotWriter
from replay.picture import lines, plain
from replay.seek import Seen, Signed, state_at
from statecharts import State, evolve, steps_of
from statecharts.digest import digest_of
from tests.breaking import break_chart
from tests.checks import check_equal, check_same
from tests.flights import FLIGHT_ID, Flight, closed, point_at_place, position, resealed, story
from tests.replay.changes import at
from tests.statecharts.test_snapshot import Kept

EVERY = 25
LAST = len(story().records) - 1


class Sought:
    """A flight with snapshots beside it."""

    def __init__(self, folder: Path, records: Sequence[Record]) -> None:
        self.folder, self.records = folder, records
        self.store: MemoryStore = resealed(records)
        self.kept = Kept(records, EVERY, 3)
        self.done: list[tuple[int, int]] = []
        writer = SnapshotWriter(folder, 0)
        for size, body in self.kept.chunks.items():
            writer.append(size, self.kept.base_of[size], body)

    def at(self, seq: int, signed: Signed | None = None) -> Seen:
        """Return the state after a record."""
        return state_at(self.store, self.folder, seq, signed or self.signed, lambda *done: self.done.append(done))

    def signed(self, size: int) -> tuple[bytes, bytes, bytes] | None:
        """Return what a checkpoint of this size says."""
        found = self.kept.vouched.get(size)
        return None if found is None else (found.root, found.layout, found.digest)


@pytest.fixture
def sought(tmp_path: Path) -> Sought:
    return Sought(tmp_path, story().records)


def from_zero(records: Sequence[Record], seq: int) -> State:
    """Return the state after a record, evolved from nothing by the plainest means."""
    failed = {one[0].seq for one in steps_of(records) if len(one) > 1 and one[1].kind.name == "step_failed"}
    state = State()
    for record in records[: seq + 1]:
        if record.seq not in failed:
            evolve(state, record)
    return state


def check_every_seq(sought: Sought, signed: Signed | None = None, *, from_snapshots: bool = True) -> None:
    """Check the state after every record, and what it was read from."""
    for seq in range(len(sought.records)):
        seen, expected = sought.at(seq, signed), from_zero(sought.records, seq)
        check_same(seen.state, expected)
        check_equal((seen.digest, seen.record.seq), (digest_of(expected), seq))
        nearest = max((size for size in sought.kept.chunks if size <= seq + 1), default=0)
        check_equal((seq, seen.start), (seq, nearest if from_snapshots else 0))


def test_every_record_of_a_flight(sought: Sought) -> None:
    """Also those in the middle of a step."""
    check_every_seq(sought)
    check_equal(sought.done[0], (0, 1))


def test_a_failed_step_counts_as_it_did(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its observation is not applied, wherever in the step somebody looks."""
    flight = Flight()
    break_chart(monkeypatch, "command", "order_received")
    told = flight.tell(point_at_place("a1"), 100)
    check_equal([record.kind.name for record in told[:2]], ["order_received", "step_failed"])
    flight.tell(position(1, 1), 100)
    flight.tell(closed(), 100)
    sought = Sought(tmp_path, flight.records)
    check_every_seq(sought)
    check_equal(len(sought.at(told[0].seq).state.orders), 0)


def test_without_a_signature_it_is_read_from_zero(sought: Sought) -> None:
    """A snapshot that nothing vouches for is told and not used; without any there is nothing to tell."""
    check_every_seq(sought, lambda _: None, from_snapshots=False)
    seen = sought.at(60, lambda _: None)
    check_equal(("nothing vouches" in seen.refused[0], len(seen.refused)), (True, 2))
    (sought.folder / NAME).unlink()
    check_equal(sought.at(60).refused, ())
    (sought.folder / NAME).mkdir()
    check_equal((sought.at(60).start, len(sought.at(60).refused)), (0, 1))


def test_a_rotten_snapshot_gives_way_to_an_older_one(sought: Sought) -> None:
    """And it is said."""
    path = sought.folder / NAME
    path.write_bytes(path.read_bytes()[:-1] + b"\xff")
    last, sizes = len(sought.records) - 1, sorted(sought.kept.chunks)
    seen = sought.at(last)
    check_equal((seen.start, "is damaged" in seen.refused[0]), (sizes[-2], True))
    check_same(seen.state, from_zero(sought.records, last))


@pytest.mark.parametrize("seq", [-1, LAST + 1, 1 << 40])
def test_a_record_that_is_not_there(sought: Sought, seq: int) -> None:
    """Is said, with the last that is."""
    with pytest.raises(LookupError, match=f"no record {seq}: its last one is {LAST}"):
        sought.at(seq)


def test_a_state_in_words(sought: Sought) -> None:
    """What was open, and which tables have rows, also as JSON."""
    seen = sought.at(64)
    told, car = list(lines(seen)), uuid_of(FLIGHT_ID, at(story(), "poi_opened", 1))
    check_equal(told[0].startswith(f"after record 64 ({seen.record.kind.name}), digest {seen.digest.hex()}"), True)
    check_equal(told[1:3], ["health: normal", "vehicle 1: heard, armed, mode 4"])
    check_equal(f"questions: poi {car}, state surfaced, class car" in told, True)
    check_equal("cameras: camera 1/1, state released, callsign " in told, True)
    check_equal("owed answers: seq 24, order alpha/p1" in told, True)
    whole = json.loads(json.dumps(plain(seen)))
    check_equal((whole["seq"], whole["read_from"], whole["digest"]), (64, seen.start, seen.digest.hex()))
    state = from_zero(sought.records, 64)
    check_equal(whole["tables"]["objects"], len(state.objects))
    check_equal(len(whole["open"]["questions"]), len(state.open_pois))
    check_equal(len(whole["open"]["deadlines"]), len(state.deadlines))
    underway = sought.at(9)
    check_equal([one["state"] for one in plain(underway)["open"]["orders"]], ["intended"])
    check_equal(len(plain(underway)["open"]["effects"]), 1)
    check_equal(len(plain(sought.at(LAST))["open"]["owed_answers"]), len(from_zero(sought.records, LAST).owed_acks))
