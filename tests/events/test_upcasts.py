"""Old shapes are lifted step by step, what was recorded stays as it is, and a ladder with a hole is found at start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from events import BodyBroken, Record, UnknownKind, kind_named, read_record
from events.kinds import KINDS, Kind
from events.records import Stored
from events.schema.findings_pb2 import PoiOpened
from events.upcasts import LADDER, Upcast, UpcastGap, ladder
from replay.same import same
from replay.verdict import Outcome
from replay.verify import verify
from tests.checks import check_equal
from tests.evolving import VERSIONS, as_recorded_by, give_a_past, steps
from tests.flights import Flight, resealed, story
from tests.replay.changes import at, changed

GIMBAL, POI = "gimbal_reported", "poi_opened"
NOW = [replace(kind_named(name), version=VERSIONS[-1]) for name in (GIMBAL, POI)]


def check_gap(because: str, upcasts: Sequence[Upcast], kinds: Sequence[Kind] = NOW) -> None:
    """Check that a ladder is refused, and why."""
    with pytest.raises(UpcastGap, match=because):
        ladder(kinds, upcasts)


def lowered(flight: Flight, version: int) -> list[Record]:
    """Return the flight as a node of that version would have recorded it."""
    return [as_recorded_by(version, record) for record in flight.records]


def row_of(record: Record) -> Stored:
    """Return the record as a store would hand it out."""
    return Stored(record.seq, record.cause, record.at, record.kind.number, record.version, record.body, b"")


def test_the_present_catalogue_has_no_gap() -> None:
    """Checked at import as well, so that a node with a gap does not start."""
    check_equal(ladder(KINDS, LADDER.values()), LADDER)


def test_a_gap_is_found_at_start() -> None:
    """Missing, double, or leading nowhere: each is named by kind and version."""
    check_equal(len(ladder(NOW, steps())), 4)
    for index, lost in enumerate(steps()):
        check_gap(f"no upcast lifts {lost.kind} version {lost.version}", [*steps()[:index], *steps()[index + 1 :]])
    check_gap("two upcasts of gimbal_reported version 1", [*steps(), steps()[0]])
    check_gap("poi_opened version 3 leads to a version", [*steps(), replace(steps()[2], version=3)])
    check_gap("frame_observed version 1 leads to a version", [*steps(), replace(steps()[2], kind="frame_observed")])


@pytest.mark.parametrize("version", VERSIONS)
def test_a_flight_of_every_version_replays_identically(monkeypatch: pytest.MonkeyPatch, version: int) -> None:
    """Observations are lifted before the charts hear them, decisions before they are compared; no byte is rewritten."""
    give_a_past(monkeypatch)
    flight = story()
    records = lowered(flight, version)
    log = resealed(records)
    verdict = verify(log)
    assert (verdict.outcome, verdict.records) == (Outcome.IDENTICAL, len(records)), verdict.words()
    check_equal([row.body for row in log.stored()], [record.body for record in records])
    check_equal([read_record(row).message for row in log.stored()], [record.message for record in flight.records])
    old = sum(one.body != other.body for one, other in zip(records, flight.records, strict=True))
    check_equal(old > 0, version < VERSIONS[-1])


def test_a_decision_of_an_old_version_that_differs_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it says is compared exactly, in the words of the present version."""
    give_a_past(monkeypatch)
    flight = story()
    seq = at(flight, POI)
    poi = PoiOpened.FromString(flight.records[seq].body)
    poi.object += 1
    forged = [as_recorded_by(1, record) for record in changed(flight.records, seq, poi)]
    verdict = verify(resealed(forged))
    assert verdict.first is not None, verdict.words()
    assert (verdict.first.seq, verdict.first.what, verdict.first.field) == (seq, "field", "object")
    assert (verdict.first.recorded, verdict.first.replayed) == ("2", "1")


def test_the_header_of_an_old_decision_is_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lifting is about the body alone."""
    give_a_past(monkeypatch)
    flight = story()
    replayed = flight.records[at(flight, POI)]
    recorded = as_recorded_by(2, replayed)
    assert same(row_of(recorded), replayed)
    moved = (
        replace(recorded, seq=recorded.seq + 1),
        replace(recorded, cause=recorded.cause - 1),
        replace(recorded, at=recorded.at._replace(wall_ns=1)),
        replace(recorded, kind=kind_named("poi_left"), version=1),
        replace(recorded, version=1),
    )
    check_equal([same(row_of(one), replayed) for one in moved], [False] * len(moved))


def test_versions_that_do_not_exist_are_loud(monkeypatch: pytest.MonkeyPatch) -> None:
    """Newer than known, or 0; and a body that is no message of its own version."""
    give_a_past(monkeypatch)
    row = row_of(as_recorded_by(1, story().records[at(story(), GIMBAL)]))
    for version in (0, 4, 9):
        with pytest.raises(UnknownKind, match=f"gimbal_reported version {version}; known is 3"):
            read_record(row._replace(version=version))
    with pytest.raises(BodyBroken, match="is no gimbal_reported"):
        read_record(row._replace(body=b"\xff"))


def test_a_step_that_makes_another_shape_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A step leads to the very next version, not past it and not elsewhere."""
    short = replace(steps()[0], lift=steps()[1].lift)
    give_a_past(monkeypatch, [short, *steps()[1:]])
    with pytest.raises(UpcastGap, match="gimbal_reported version 1 makes GimbalReported"):
        verify(resealed(lowered(story(), 1)))
