"""The step: what is recorded with what, what a failing chart leaves behind, and which deadline comes back."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from events import Moment, Record, Role, make_record
from events.schema.flight_pb2 import TimePassed
from events.schema.orders_pb2 import OrderReceived, SendAck
from statecharts import State, engine, restore, step, steps_of
from tests.breaking import break_chart
from tests.checks import check_chart, check_equal, check_same, dump
from tests.flights import opened, said, story
from tests.monitors import complaints
from tests.stories import Story

PARTS = [("command", "order_received"), ("camera", "moved"), ("aim", "point_at_place"), ("scan", "moved")]


def restored(records: list[Record]) -> tuple[State, int | None]:
    """Return the state and the deadline that a restart finds."""
    state, due = State(), None
    for one in steps_of(records):
        due = restore(state, one)
    return state, due


def check_restart(told: Story) -> None:
    """Check that a restart of this flight finds what the live one has."""
    state, due = restored(told.flight.records)
    check_same(state, told.flight.state)
    check_equal(due, told.flight.due)


def test_a_step_is_one_observation_and_its_decisions_in_order() -> None:
    """Gapless, with the observation's moment, caused by it, the charts in their order."""
    told = Story()
    told.at(1234)
    records = told.tell("order a point")
    check_equal(said(records), ["moved", "point_at_place", "send_ack", *["moved", "camera_taken", "moved", "moved"]])
    check_equal([record.seq - records[0].seq for record in records], list(range(8)))
    check_equal([record.cause for record in records], [-1] + [records[0].seq] * 7)
    check_equal({record.at for record in records}, {told.flight.moment()})
    check_equal(
        [getattr(one.message, "chart", "-") for one in records], [*"-", "command", *"--", "camera", *"-", "scan", "aim"]
    )


def check_told_undecided(records: Sequence[Record]) -> None:
    """Check that the issuer is told, on the envelope that came, and that it is not the last word."""
    order, ack = records[0].message, records[2].message
    assert isinstance(order, OrderReceived)
    assert isinstance(ack, SendAck)
    check_equal((ack.command_id, ack.principal_id), (order.command_id, order.issuer.principal_id))
    check_equal((ack.in_reply_to, ack.final, ack.detail), (order.in_reply_to, False, "deciding on it failed"))


@pytest.mark.parametrize(("chart", "kind"), PARTS)
def test_a_step_that_raises_leaves_nothing(chart: str, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever chart it is, and whatever the others had decided: only the failure is known afterwards."""
    told = Story(scan_enabled=True)
    told.tell("order a turn")
    told.tell("frame person@0,0")
    before = dump(told.flight.state)
    break_chart(monkeypatch, chart, kind)
    told.at(500)
    records = told.tell("order b point")
    check_equal(said(records), ["step_failed", "send_ack"])
    check_told_undecided(records)
    failure = records[1]
    check_equal((failure.message.chart, failure.message.error), (chart, "RuntimeError"))  # type: ignore[attr-defined]
    check_equal((failure.cause, failure.at), (records[0].seq, records[0].at))
    after = dump(told.flight.state)
    changed = {name: after[name] for name in after if after[name] != before[name]}
    check_equal(changed, {"failures": (500_000_000,), "next_seq": failure.seq + 2})
    check_restart(told)
    monkeypatch.undo()
    check_equal(said(told.tell("order b point seq=9"))[:2], ["moved", "point_at_place"])
    check_restart(told)


def test_an_observation_that_cannot_be_applied_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where applying it raises half-way."""
    told = Story()
    before = dump(told.flight.state)
    changes = engine._EVOLVE["order_received"]

    def broken(_state: State, _record: Record) -> None:
        raise ZeroDivisionError

    monkeypatch.setitem(engine._EVOLVE, "order_received", (*changes, broken))
    records = told.tell("order a point")
    failure = records[1].message
    check_equal((failure.chart, failure.error), ("evolve", "ZeroDivisionError"))  # type: ignore[attr-defined]
    after = dump(told.flight.state)
    check_equal([name for name in after if after[name] != before[name]], ["failures", "next_seq"])
    check_restart(told)


def test_safe_mode_is_restored(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its move is caused by the failure; a restart finds it, and monitors have nothing to say."""
    break_chart(monkeypatch, "map", "frame_observed")
    told = Story()
    told.tell("frame")
    told.tell("frame")
    records = told.tell("frame")
    check_equal(said(records), ["step_failed", "moved"])
    check_equal(records[2].cause, records[1].seq)
    check_equal(told.flight.state.health.value, "safe_mode")
    check_restart(told)
    check_equal(said(told.tell("frame person@0,0")), [])
    check_equal(said(told.tell("order a point")), ["moved", "send_ack"])
    check_restart(told)
    check_equal(complaints(list(steps_of(told.flight.records))), [])


def test_failures_are_forgotten_after_their_window(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two now and two a minute later are no three."""
    break_chart(monkeypatch, "map", "frame_observed")
    told = Story()
    for at_ms in (0, 1_000, 60_000, 61_000):
        told.at(at_ms)
        told.tell("frame")
    check_equal(told.flight.state.health.value, "normal")
    told.at(61_001)
    told.tell("frame")
    check_equal(told.flight.state.health.value, "safe_mode")


def test_a_deadline_is_offered_once_when_time_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A step that fails on it does not spin: it is offered again with the next observation, a later one at once."""
    told = Story(release_pause_ms=3_000)
    told.tell("order a release")
    told.tell("answered a 0")
    told.at(1_000)
    told.tell("order b point by=bravo")
    check_equal(told.flight.due, 11_000_000_000)
    break_chart(monkeypatch, "aim", "time_passed")
    told.at(11_000)
    check_equal(said(told.tell("time")), ["step_failed"])
    check_equal(told.flight.due, 21_000_000_000)
    told.at(11_500)
    told.tell("vehicle up")
    check_equal(told.flight.due, 11_000_000_000)
    monkeypatch.undo()
    check_equal(said(told.tell("time")), ["moved"])
    check_equal(told.flight.due, 21_000_000_000)


def test_safe_mode_waits_for_safety_alone() -> None:
    """Deadlines of charts that are not asked are not offered; after a start they are where they were."""
    told = Story(sightings_to_ask=1)
    check_chart("poi", "at_s | observe\n0 | frame person@0,0\n0 | time\n0 | order a point", told)
    told.flight.state.health.set("safe_mode")
    check_chart("aim", "at_s | observe | state\n10 | time | 1/1 missed", told)
    check_equal(told.flight.due, 20_000_000_000)
    check_chart(
        "poi",
        """
        at_s | observe          | state
        20   | time             | -
        60   | time             | -
        91   | frame person@0,0 | -
        92   | vehicle up       | -
        """,
        told,
    )
    check_equal(told.flight.due, None)
    told.at(93_000)
    told.tell("start")
    check_equal(told.flight.due, 90_000_000_000)
    moved = said(told.tell("time"))
    check_equal(moved, ["moved"])


def test_without_a_manifest_nothing_is_decided() -> None:
    """A shell that opens no flight is our fault, and loud."""
    state = State()
    with pytest.raises(LookupError, match="no manifest"):
        _ = state.flight
    at = Moment(0, 0, 0, 0, 0)
    check_equal(step(state, make_record(0, -1, at, opened())).due, None)
    check_equal(step(state, make_record(1, -1, at, TimePassed())).due, None)
    check_equal(state.next_seq.value, 2)


def test_steps_are_found_in_a_log() -> None:
    """Each begins with its observation; nothing is lost between them."""
    records = story().records
    groups = list(steps_of(records))
    check_equal([record for group in groups for record in group], records)
    check_equal({group[0].kind.role for group in groups}, {Role.OBSERVATION})
    check_equal({record.kind.role for group in groups for record in group[1:]} & {Role.OBSERVATION}, set())
    check_equal(list(steps_of([])), [])


def test_a_whole_flight_restarts_anywhere() -> None:
    """After every step, what a restart finds is what was there."""
    records = story().records
    live, found = State(), State()
    for group in steps_of(records):
        made = step(live, group[0])
        check_equal(made.records, group)
        check_equal(restore(found, group), made.due)
        check_same(live, found)
