"""The alarm: a flight that is the same says so, and one that is not is found at the right place."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings

from events import kind_of
from events.records import Stored
from events.store import MemoryStore, SqliteReader, SqliteStore
from events.store.protocol import Head
from replay.causes import Line
from replay.verdict import Outcome
from replay.verify import verify
from tests.breaking import break_chart
from tests.flights import (
    FLIGHT_ID,
    SECRET,
    Flight,
    detection,
    frame,
    resealed,
    said,
    story,
)
from tests.house import REPO
from tests.random_flights import Draw, draws, fly
from tests.replay.changes import (
    Tampered,
    at,
    check_diverges,
    check_ends,
    check_identical,
    forged,
    small,
)


def test_a_whole_story_is_identical() -> None:
    """Closed or not; every decision is compared."""
    flight = story()
    verdict = check_identical(flight.store, 121)
    assert verdict.decisions == len(said(flight.records)) == 78
    assert verdict.words() == "identical: 121 records, 78 decisions compared"
    check_identical(small().store, len(small().records))


def test_a_failed_step_replays(monkeypatch: pytest.MonkeyPatch) -> None:
    """It raises again, and is recorded again; where it no longer raises, that is a divergence."""
    flight = Flight()
    with monkeypatch.context() as patch:
        break_chart(patch, "map", "frame_observed")
        flight.tell(frame(1, detection(0, 0)), 100)
        flight.tell(frame(2, detection(0, 0)), 100)
        flight.tell(frame(3, detection(0, 0)), 100)
        flight.tell(frame(4, detection(0, 0)), 100)
        assert flight.state.health.value == "safe_mode"
        check_identical(flight.store, len(flight.records))
    first = check_diverges(flight.records, at(flight, "step_failed"), "kind", further=2)
    assert (first.kind, first.replayed.split(":")[0]) == ("step_failed", "sightings_classified")


def test_every_byte_of_a_body_is_under_the_chain() -> None:
    """One bit in any byte of the log's bodies and leaves: found at its record, never replayed."""
    store = MemoryStore(FLIGHT_ID, SECRET)
    store.append(small().records)
    rows = list(store.stored())
    for seq, row in enumerate(rows):
        for index in range(len(row.body)):
            flipped = bytearray(row.body)
            flipped[index] ^= 1 << index % 8
            bad = row._replace(body=bytes(flipped))
            _check_chain(store, rows, seq, bad)
        _check_chain(store, rows, seq, row._replace(leaf=bytes(32)))


def test_a_changed_byte_of_a_decision_says_what_it_should_have_said() -> None:
    """The chain tells where, replay tells what: field, both values, and the causes back to the observation."""
    store = MemoryStore(FLIGHT_ID, SECRET)
    store.append(story().records)
    rows = list(store.stored())
    seq = next(row.seq for row in rows if b"all gates passed" in row.body)
    body = rows[seq].body.replace(b"all gates passed", b"all gates locked")
    verdict = verify(Tampered(store, [*rows[:seq], rows[seq]._replace(body=body), *rows[seq + 1 :]]))
    assert (verdict.outcome, verdict.seq) == (Outcome.BROKEN, seq)
    assert verdict.first is not None
    found = verdict.first
    assert (found.seq, found.field, found.recorded, found.replayed) == (
        seq,
        "because",
        "'all gates locked'",
        "'all gates passed'",
    )
    assert found.causes[-1].kind == "order_received"
    assert "because" in verdict.words()


def _check_chain(store: MemoryStore, rows: list[Stored], seq: int, bad: Stored) -> None:
    # Only what follows the flight's beginning is looked at: the chain is checked record by record.
    tampered = Tampered(store, [*rows[:seq], bad, *rows[seq + 1 :]])
    check_ends(tampered, Outcome.BROKEN, seq, f"record {seq}: its leaf is not the hash")


def test_gaps_cuts_and_strangers_break_the_chain() -> None:
    """Records are numbered without a gap up to the head, and belong to this flight."""
    store = MemoryStore(FLIGHT_ID, SECRET)
    store.append(small().records)
    rows = list(store.stored())
    check_ends(Tampered(store, rows[:4] + rows[5:]), Outcome.BROKEN, 4, "record 4 is missing")
    count = store.head.seq + 1
    check_ends(Tampered(store, rows[:-1]), Outcome.BROKEN, count - 1, "its head is")
    other = Head(store.head.seq, bytes(32))
    check_ends(Tampered(store, rows, other), Outcome.BROKEN, count, "its head is")
    check_ends(resealed(small().records, b"another flight!!"), Outcome.BROKEN, 0, "the manifest is that of flight 0001")


def test_rows_that_are_no_records_break_the_chain() -> None:
    """Whoever holds the disk may put anything into a column."""
    store = resealed(small().records)
    rows = list(store.stored())
    bad: list[Stored] = [
        rows[5]._replace(body="text"),  # type: ignore[arg-type]
        rows[5]._replace(at=rows[5].at._replace(flight_ns=-1)),
        rows[5]._replace(kind_number=1 << 16),
        rows[5]._replace(cause=None),  # type: ignore[arg-type]
    ]
    for row in bad:
        check_ends(Tampered(store, [*rows[:5], row]), Outcome.BROKEN, 5, "record 5: a column does not fit")


def test_what_can_not_be_read_is_said_so() -> None:
    """Nothing is skipped."""
    check_ends(MemoryStore(FLIGHT_ID, SECRET), Outcome.UNREADABLE, 0, "empty")
    beginning = [replace(one, seq=one.seq - 1) for one in Flight().records[1:]]
    check_ends(resealed(beginning), Outcome.UNREADABLE, 0, "begins with node_started, not with a manifest")
    flight = small()
    seq = at(flight, "command_sent")
    records = list(flight.records)
    records[seq] = replace(records[seq], body=b"\xff\xff")
    check_ends(resealed(records), Outcome.UNREADABLE, seq, f"the body of record {seq} is no command_sent")
    records[seq] = replace(flight.records[seq], version=9)
    check_ends(resealed(records), Outcome.UNREADABLE, seq, "version 9")
    unknown = replace(kind_of(flight.records[seq].message), number=999)
    records[seq] = replace(flight.records[seq], kind=unknown)
    assert verify(resealed(records)).outcome is not Outcome.IDENTICAL


def test_progress_reaches_the_end() -> None:
    """Done never exceeds what there is."""
    told: list[tuple[int, int]] = []
    verify(small().store, lambda done, of: told.append((done, of)))
    assert told[-1] == (len(small().records), len(small().records))
    assert [one for one in told if one[0] > one[1]] == []


def test_a_verdict_is_plain() -> None:
    """As JSON, with the whole divergence."""
    flight = small()
    seq = at(flight, "send_ack")
    plain = json.loads(json.dumps(verify(resealed(forged(flight, seq, detail="forged"))).plain()))
    assert (plain["outcome"], plain["first"]["field"], plain["first"]["recorded"]) == ("diverges", "detail", "'forged'")
    assert Line(**plain["first"]["causes"][0]).kind == "send_ack"


@settings(max_examples=60, deadline=None)
@given(draws)
def test_every_flight_replays(drawn: list[Draw]) -> None:
    """From memory."""
    flight = fly(drawn, end=len(drawn) % 2 == 0)
    check_identical(flight.store, len(flight.records))


@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(draws)
def test_every_flight_replays_from_disk(tmp_path: Path, drawn: list[Draw]) -> None:
    """Through SQLite, and while it is still being written."""
    path = tmp_path / f"{len(list(tmp_path.iterdir()))}.db"
    store = SqliteStore.create(path, FLIGHT_ID, SECRET)
    flight = fly(drawn, store)
    reader = SqliteReader(path)
    check_identical(reader, len(flight.records))
    reader.close()
    store.close()


def test_hash_seeds_change_nothing(tmp_path: Path) -> None:
    """A flight recorded under one seed replays under three, and is recorded the same under each."""
    program = (
        "from tests.flights import story\nfrom replay.verify import verify\n"
        "flight = story()\nprint(flight.store.head.leaf.hex(), verify(flight.store).words())"
    )
    told = {_run(program, str(seed)) for seed in (0, 1, 4242)}
    leaf = story().store.head.leaf.hex()
    assert told == {f"{leaf} identical: 121 records, 78 decisions compared\n"}


def _run(program: str, seed: str) -> str:
    environ = os.environ | {"PYTHONHASHSEED": seed}
    run = [sys.executable, "-c", program]
    return subprocess.run(run, cwd=REPO, env=environ, capture_output=True, text=True, check=True, timeout=60).stdout
