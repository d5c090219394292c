"""The audit: one row an order, whatever happens to it, and rows for judgements and changes of hands."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given, settings

from events import Role
from events.schema.flight_pb2 import BaselineCarried
from projections import audit as fold
from projections.audit import AuditRow
from statecharts import carry_over
from statecharts.charts.command import FINAL
from tests.breaking import break_chart
from tests.flights import (
    Flight,
    answered,
    malformed,
    opened_well,
    point_at_angles,
    point_at_place,
    published,
    release,
    said,
    sent,
    story,
    unanswered,
)
from tests.random_flights import Draw, draws, fly
from tests.stories import Story


def rows_of(flight: Flight) -> list[AuditRow]:
    """Return the audit of a flight."""
    audit = fold.start()
    for record in flight.records:
        audit = fold.apply(audit, record)
    return list(audit.rows)


def check_row(flight: Flight, what: str, command_id: str = "", **expected: object) -> AuditRow:
    """Check the fields of the one row of its sort, and return it."""
    (row,) = [row for row in rows_of(flight) if (row.what, row.command_id) == (what, command_id)]
    assert {name: getattr(row, name) for name in expected} == expected
    return row


def check_kinds(flight: Flight, row: AuditRow, *kinds: str) -> None:
    """Check which records a row rests on, in order."""
    assert tuple(flight.records[seq].kind.name for seq in row.seqs) == kinds


def test_an_order_from_arrival_to_answer() -> None:
    """Who, what, when, result, what the vehicle said, and every record of it."""
    flight = Flight()
    flight.tell(point_at_place("a", 20_000, 30_000), 100)
    effect = flight.effect()
    flight.tell(sent(effect), 2)
    flight.tell(answered(effect, attempts=2), 30)
    ack = flight.records[-1].seq
    flight.tell(published(ack), 3)
    row = check_row(
        flight,
        "order",
        "a",
        principal_id="alpha",
        callsign="ALPHA",
        verb="point_at_place",
        asked="look at 52.1002702 4.3002941, 0.0 m AMSL (31UFT5002050030), camera 1",
        flight_ns=100_000_000,
        result="accepted",
        detail="COMMAND_ACK: MAV_RESULT_ACCEPTED",
        mav_result=0,
        attempts=2,
        duplicates=0,
    )
    intended = ("order_received", "moved", "point_at_place", "send_ack")
    done = ("command_sent", "moved", "send_ack", "command_answered", "moved", "send_ack", "ack_published")
    check_kinds(flight, row, *intended, *done)


@pytest.mark.parametrize("words", ["fly to=1,2", "go-into loiter"])
def test_an_order_of_the_flight_rests_on_what_the_vehicle_answered(words: str) -> None:
    """As one that points the camera does."""
    story = Story(flight_enabled=True, flight_roles=["flight"])
    story.tell(f"order a {words}")
    story.flight.tell(answered(story.flight.effect(), attempts=2), 30)
    check_row(story.flight, "order", "a", result="accepted", mav_result=0, attempts=2)


def test_an_order_that_is_underway_has_no_result() -> None:
    """Nothing is claimed before it is known."""
    flight = Flight()
    flight.tell(point_at_angles("a"))
    check_row(flight, "order", "a", result="", mav_result=None, attempts=0)
    flight.tell(unanswered(flight.effect(), attempts=3), 2_000)
    check_row(flight, "order", "a", result="timeout", mav_result=None, attempts=3)


def test_a_late_answer_is_noted_but_did_not_decide() -> None:
    """The row rests on it; the raw result is that of the answer that counted, here none."""
    flight = Flight()
    flight.tell(point_at_angles("a"))
    effect = flight.effect()
    flight.tell(unanswered(effect, attempts=3), 2_000)
    late = flight.tell(answered(effect, mav_result=4, attempts=3), 500)
    row = check_row(flight, "order", "a", result="timeout", mav_result=None, attempts=3)
    assert late[0].seq in row.seqs


def test_a_duplicate_is_counted_not_listed() -> None:
    """It was told the stored result; the order is still one."""
    flight = Flight()
    flight.tell(point_at_place("a", roles=()))
    flight.tell(point_at_place("a", roles=(), send=2), 10)
    flight.tell(point_at_place("a", roles=(), send=3), 10)
    row = check_row(flight, "order", "a", result="unauthorised", duplicates=2)
    check_kinds(flight, row, "order_received", "moved", *["send_ack", "order_received"] * 2, "send_ack")


def test_a_reused_id_is_a_row_of_its_own() -> None:
    """The first order's row is not touched by it."""
    flight = Flight()
    flight.tell(release("a", roles=()))
    flight.tell(point_at_place("a", order_seq=2, send=2), 10)
    check_row(flight, "order", "a", result="unauthorised", verb="release_camera", duplicates=0)
    row = check_row(flight, "reused id", "a", result="rejected", verb="point_at_place")
    check_kinds(flight, row, "order_received", "send_ack")


def test_what_could_not_be_read() -> None:
    """With its reason, and that it was answered."""
    flight = Flight()
    flight.tell(malformed("m", "bravo", "camera_roi.lat_e7: 95 degrees"))
    row = check_row(
        flight, "malformed", "m", callsign="BRAVO", result="rejected", detail="camera_roi.lat_e7: 95 degrees"
    )
    check_kinds(flight, row, "order_malformed", "send_ack")


def test_an_order_of_the_flight_before() -> None:
    """Known from the baseline only: its repeat gets a row here, with the result that it was told."""
    before = Flight()
    before.tell(point_at_place("a", roles=()))
    carried = BaselineCarried(state=carry_over(before.state, before.now_ns))
    flight = Flight(*opened_well()[:1], carried, *opened_well()[2:])
    flight.tell(point_at_place("a", roles=(), send=2), 10)
    check_row(flight, "order", "a", result="unauthorised", duplicates=1)
    flight.tell(point_at_place("a", roles=(), send=3), 10)
    check_row(flight, "order", "a", result="unauthorised", duplicates=2)


def test_an_answer_that_is_given_again_after_a_restart() -> None:
    """It belongs to its order's row."""
    row = check_row(story(), "order", "p5", result="timeout", detail="unknown after restart")
    assert row.seqs[-1] > row.seq


def test_an_order_that_could_not_be_decided(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was received, and nothing was done."""
    break_chart(monkeypatch, "command", "order_received")
    flight = Flight()
    assert said(flight.tell(point_at_place("a")))[0] == "step_failed"
    check_row(flight, "order", "a", result="", detail="deciding on it failed; nothing was done")


def test_hands_on_the_camera() -> None:
    """Taken from nobody, taken over, let go, and back: the same hands twice are no change."""
    flight = Flight()
    flight.tell(point_at_place("a"))
    flight.tell(point_at_place("b", order_seq=2), 10)
    flight.tell(point_at_place("c", who="bravo"), 10)
    flight.tell(release("d", order_seq=2, who="bravo"), 10)
    flight.wait(5_000)
    hands = [(row.callsign, row.result, row.detail) for row in rows_of(flight) if row.what == "camera"]
    assert hands == [
        ("ALPHA", "operator", "camera 1/1 from nobody"),
        ("BRAVO", "operator", "camera 1/1 from ALPHA"),
        ("", "released", "an operator lets it go (was BRAVO)"),
        ("", "automatic", "the pause is over"),
    ]


def test_judgements_have_a_name() -> None:
    """Who confirmed, who declined, and what it was."""
    flight = story()
    check_row(flight, "judgement", "j1", callsign="ALPHA", result="confirmed", principal_id="alpha")
    row = check_row(flight, "judgement", "j2", callsign="ALPHA", result="declined")
    assert row.asked.endswith(": car at 31UFT4994049980")


@settings(max_examples=60, deadline=None)
@given(draws)
def test_rows_agree_with_the_core(drawn: list[Draw]) -> None:
    """One row an order with the core's result, and every arrival stands in exactly one row."""
    flight = fly(drawn)
    rows = rows_of(flight)
    found = {f"{row.principal_id}/{row.command_id}": row for row in rows if row.what == "order"}
    assert {key: row.detail for key, row in found.items() if row.result} == {
        key: order.detail for key, order in flight.state.orders.items() if order.state in FINAL
    }
    assert {key: row.mav_result for key, row in found.items()} == {
        key: order.mav_result for key, order in flight.state.orders.items()
    }
    arrivals = [one.seq for one in flight.records if one.kind.name in ("order_received", "order_malformed")]
    told = Counter(seq for row in rows if row.what in ("order", "reused id", "malformed") for seq in row.seqs)
    assert {seq: told[seq] for seq in arrivals} == dict.fromkeys(arrivals, 1)
    assert [seq for seq in told if told[seq] > 1] == []
    answers = [one.seq for one in flight.records if one.kind.name == "send_ack"]
    assert [seq for seq in answers if told[seq] != 1] == []
    assert [one.seq for one in flight.records if one.kind.role is Role.OBSERVATION and told[one.seq] > 1] == []


def test_a_repeat_that_is_not_answered_is_counted() -> None:
    """Two answers a second are enough, but the audit has every arrival; a repeat of nothing that is known is none."""
    flight = Flight()
    for send in range(1, 7):
        flight.tell(point_at_place("a", send=send), 10)
    flight.tell(answered(flight.effect()), 1)
    row = check_row(flight, "order", "a", result="accepted", duplicates=5)
    arrived = [record.seq for record in flight.records if record.kind.name == "order_received"]
    assert set(arrived) <= set(row.seqs)
    answers = [record for record in flight.records if record.kind.name == "send_ack"]
    assert len(answers) == 4


def test_hands_on_the_gimbal() -> None:
    """One row for each change, with who had it before."""
    story = Story()
    for line in ("control 0/0", "control 0/0", "control 255/190", "control 1/191 ours"):
        story.tell(line)
    hands = [(row.asked, row.result, row.detail) for row in rows_of(story.flight) if row.what == "gimbal"]
    assert hands == [
        ("control of gimbal 1/1", "nobody", "as its manager says first"),
        ("control of gimbal 1/1", "255/190", "was nobody"),
        ("control of gimbal 1/1", "this node", "was 255/190"),
    ]


def test_a_zoom_is_a_row_like_any_order() -> None:
    """With its effect's outcome."""
    story = Story()
    for line in ("lens zooms", "order a zoom", "sent a", "answered a 0"):
        story.tell(line)
    asked = {"verb": "zoom_camera", "asked": "zoom to 40 %, camera 1"}
    check_row(story.flight, "order", "a", result="accepted", attempts=1, **asked)
