"""Replays of redacted copies: no false alarm, a true one wherever it can be told, and an honest count of the rest."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings

from events import KINDS, Record, read_record
from events.schema.common_pb2 import Moved
from replay.incomplete import Level, Partial, Watch, WatchedState
from replay.reach import MAY_WRITE, MOVE_WRITES, may_write
from replay.verdict import Outcome
from replay.verify import verify
from statecharts import CHARTS, evolve
from statecharts.engine import _EVOLVE
from tests.breaking import break_chart
from tests.flights import (
    Flight,
    detection,
    first_answer,
    frame,
    point_at_place,
    resealed,
    story,
)
from tests.random_flights import Draw, draws, fly
from tests.replay.changes import at, forged
from tests.replay.copies import Copy, check_differs, check_incomplete, check_open, removals

STORY = story()
RECORDS = STORY.records


def test_nothing_removed_is_identical() -> None:
    """A copy that lacks nothing replays as the flight does."""
    assert check_incomplete(RECORDS, ()).decisions == 78


def test_everything_but_the_manifest() -> None:
    """Nothing can be compared, and that is said."""
    verdict = check_incomplete(RECORDS, range(1, 200))
    assert verdict.words().startswith("INCOMPLETE(1-120): nothing differs (121 records, 0 decisions compared;")
    assert not verdict.holds


def test_without_the_manifest_nothing_is_judged() -> None:
    """Limits and node are in it."""
    verdict = verify(Copy(STORY.store, {0}))
    assert (verdict.outcome, verdict.seq) == (Outcome.UNREADABLE, 0)


def test_how_much_is_compared() -> None:
    """What no decision reads costs nothing; a decision costs itself; an observation what rests on it."""
    check_open(RECORDS, {at(STORY, "position_reported")}, 78, 0, "")
    check_open(RECORDS, {at(STORY, "flight_closed")}, 78, 0, "")
    check_open(RECORDS, {at(STORY, "camera_taken")}, 77, 0, "")
    check_open(RECORDS, {at(STORY, "time_passed")}, 76, 0, "117")
    check_open(RECORDS, {at(STORY, "command_sent")}, 76, 0, "14")
    check_open(RECORDS, {at(STORY, "origin_set")}, 65, 0, "6,97")
    check_open(RECORDS, {at(STORY, "frame_observed")}, 29, 44, "45,47,49")


def test_a_frame_is_whole_again_with_the_next() -> None:
    """The newest frame is replaced as a whole: its table is known again, the map is not."""
    flight = Flight()
    for number in range(1, 4):
        flight.tell(frame(number, detection(0, 0)), 100)
    state = WatchedState()
    watch = state.watch
    watch.doubt(("frame", "objects"), Level.UNKNOWN)
    evolve(state, flight.records[0])
    state.frame.set(flight.records[5])
    check_levels(watch, Level.KNOWN, "frame", Level.KNOWN)
    assert state.objects.get(1) is None
    check_levels(watch, Level.UNKNOWN, "frame", Level.KNOWN)
    state.frame.set(None)
    check_levels(watch, Level.UNKNOWN, "frame", Level.UNKNOWN)


def check_levels(watch: Watch, step: Level, table: str, of_table: Level) -> None:
    """Check how far a step and a table are believed."""
    assert (watch.step, watch.tables[table]) == (step, of_table)


def test_a_change_in_what_is_known_is_found() -> None:
    """Whoever holds the secret forges a decision, and redacts something else."""
    seq = first_answer(STORY)
    found = check_differs(forged(STORY, seq, detail="forged"), {5, seq - 1}, seq, "field")
    assert (found.field, found.recorded) == ("detail", "'forged'")
    changed = list(RECORDS)
    changed[8] = replace(changed[8], cause=5)
    assert check_differs(changed, {8}, 8, "header").field == "cause"
    assert check_differs(_without(11), {10}, 11, "missing in the log").kind == "camera_taken"


def _without(seq: int) -> list[Record]:
    return [replace(one, seq=one.seq - (one.seq > seq)) for one in RECORDS if one.seq != seq]


def test_what_differs_after_an_assumption_convicts_nobody() -> None:
    """A removed decision may have been another one than is decided now."""
    other = forged(STORY, 15, because="forged")
    check_differs(other, {5}, 15, "field")
    verdict = verify(Copy(resealed(other), {7}))
    assert (verdict.outcome, verdict.plain()["gaps"]["uncompared_steps"]) == (Outcome.INCOMPLETE, "14")


def test_what_rests_on_a_removed_observation_is_not_compared() -> None:
    """Agreeing there proves nothing, and differing neither."""
    other = forged(STORY, 15, because="forged")
    verdict = verify(Copy(resealed(other), {6}))
    assert verdict.outcome is Outcome.INCOMPLETE
    assert "14" in verdict.plain()["gaps"]["uncompared_steps"].split(",")


def test_a_failed_step_is_passed_over_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its observation changed nothing: the same order is new when it comes again."""
    flight = Flight()
    with monkeypatch.context() as patch:
        break_chart(patch, "command", "order_received")
        flight.tell(point_at_place("a", 20_000, 30_000), 100)
    flight.tell(point_at_place("a", 20_000, 30_000), 100)
    seq = at(flight, "step_failed")
    check_differs(flight.records, (), seq, "kind")
    assert verify(Copy(flight.store, ())).further == 0


def test_deadlines_are_known_by_chart() -> None:
    """Whose deadline passed is asked chart by chart."""
    state = WatchedState()
    state.watch.doubt(("deadlines/aim",), Level.UNKNOWN)
    state.passed("poi", 0)
    check_levels(state.watch, Level.KNOWN, "deadlines/aim", Level.UNKNOWN)
    state.passed("aim", 0)
    check_levels(state.watch, Level.UNKNOWN, "deadlines/aim", Level.UNKNOWN)


def test_what_was_not_written_for_want_of_knowledge_is_doubted() -> None:
    """An answer to an effect that is not known may have been written to an order all the same."""
    rows = list(Copy(STORY.store, ()).stored())
    partial = Partial(read_record, lambda stored, record: stored.body == record.body)
    for first, stop in ((0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 14), (14, 17)):
        assert partial.step(rows[first:stop]).uncompared == 0
    partial.state.effects.drop(8)
    partial.state.watch.doubt(("effects",), Level.UNKNOWN)
    assert partial.step(rows[17:20]).uncompared == 2
    assert partial.state.watch.tables["orders"] is Level.UNKNOWN


def test_who_may_have_moved() -> None:
    """The charts that heard of the step, and no others."""
    rows = list(Copy(STORY.store, range(1, 200)).stored())
    assert {"orders", "cameras", "scans", "aims"} <= set(may_write(rows[7], "", rows[6:14]))
    assert set(may_write(rows[22], "", rows[21:23])) == {"aims", "deadlines/aim"}
    assert may_write(rows[22], "camera", rows[21:23]) == ("cameras", "deadlines/camera")


@settings(max_examples=120, deadline=None)
@given(draws, removals)
def test_no_removal_is_taken_for_a_divergence(drawn: list[Draw], remove: frozenset[int]) -> None:
    """Any records of any flight; each decision is compared, agreeing or open."""
    check_incomplete(fly(drawn).records, remove)


@settings(max_examples=60, deadline=None)
@given(draws)
def test_nothing_is_written_but_what_is_declared(drawn: list[Draw]) -> None:
    """On any flight, record by record: the account of what is not known rests on this table."""
    state = WatchedState()
    for record in [*fly(drawn).records, *RECORDS]:
        state.watch.written.clear()
        evolve(state, record)
        declared = MAY_WRITE.get(record.kind.name, ("manifest", "cameras"))
        if isinstance(record.message, Moved):
            declared = MOVE_WRITES[record.message.chart]
        assert state.watch.written <= set(declared), record.kind.name


def test_every_kind_that_changes_something_is_declared() -> None:
    """A new handler needs a line in the table, and a line needs a handler."""
    assert set(_EVOLVE) - {"flight_opened", "moved"} == set(MAY_WRITE)
    assert {chart.name for chart in CHARTS} == set(MOVE_WRITES)
    assert set(MAY_WRITE) <= {kind.name for kind in KINDS}
    tables = set(WatchedState.__slots__) | set(WatchedState.__mro__[1].__slots__)  # type: ignore[attr-defined]
    named = {table.split("/")[0] for tables in (MAY_WRITE, MOVE_WRITES) for row in tables.values() for table in row}
    assert named <= tables
