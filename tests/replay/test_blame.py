"""Who is to blame for a divergence: each cause by the test that shows it, and by no guess."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from events import Record, make_record
from events.schema.flight_pb2 import FlightOpened, NodeStarted
from replay.blame.findings import Cause, Weight
from replay.verify import verify
from statecharts import logic
from tests.flights import (
    Flight,
    detection,
    frame,
    gimbal,
    limits,
    point_at_place,
    release,
    resealed,
    story,
)
from tests.replay.blaming import check_blamed, look, ordered, pointed, put, sighted, without
from tests.replay.changes import at, changed, forged, renumbered, small
from tests.torture.liftings import Lifted
from tests.torture.patches import BODIES, ROWS
from tests.torture.recorder import under


@pytest.mark.parametrize(
    ("name", "recorded", "words"),
    [
        ("pointed", {"arrival_tolerance_cdeg": 50}, "arrival_tolerance_cdeg"),
        ("pointed", {"operator_hold_ms": 45_000}, "operator_hold_ms 45000 instead of 60000"),
        ("ordered", {"command_enabled": False}, "command_enabled False instead of True"),
        ("ordered", {"camera_roles": []}, "camera_roles none instead of camera"),
        ("sighted", {"sightings_to_ask": 5}, "sightings_to_ask"),
        ("sighted", {"same_object_mm": 900}, "same_object_mm"),
        ("sighted", {"ask_confidence_e4": 9_000}, "ask_confidence_e4"),
    ],
)
def test_a_limit_that_was_another(name: str, recorded: dict[str, Any], words: str) -> None:
    """It is named, with a value under which the whole flight comes out."""
    flight = {"pointed": pointed, "ordered": ordered, "sighted": sighted}[name](**recorded)
    check_blamed(under(flight.records, limits()), Cause.CONFIGURATION, Weight.WHOLE, words)


def test_a_limit_that_nobody_would_write_is_fitted() -> None:
    """It explains as much, and weighs less."""
    records = under(sighted(same_object_mm=1_003).records, limits(same_object_mm=999))
    check_blamed(records, Cause.CONFIGURATION, Weight.WHOLE, "same_object_mm 1000 instead of 999")
    records = under(pointed(operator_hold_ms=44_987).records, limits())
    found = look(records)
    weights = [one.weight for one in found.findings if one.cause is Cause.CONFIGURATION]
    assert weights == [Weight.FITTED], found.plain()


def test_time_that_runs_backwards() -> None:
    """Two observations were exchanged with their moments."""
    flight = small()
    seq = at(flight, "command_sent")
    one, other = flight.records[seq], flight.records[seq + 1]
    assert other.kind.name == "moved"
    later = at(flight, "command_answered")
    there = flight.records[later]
    records = put(flight.records, seq, at=there.at, kind=there.kind, body=there.body, message=there.message)
    records = put(records, later, at=one.at, kind=one.kind, body=one.body, message=one.message)
    check_blamed(records, Cause.REORDERED, Weight.PROVED, f"time runs backwards from record {seq} to {later}")


def test_a_clock_that_is_off() -> None:
    """Flight time was changed, and the monotonic clock tells."""
    flight = pointed()
    seq = at(flight, "time_passed")
    step_of = [one.seq for one in flight.records if one.seq == seq or one.cause == seq]
    moment = flight.records[seq].at
    moved = moment._replace(flight_ns=moment.flight_ns - 7_000_000)
    records = [replace(one, at=moved) if one.seq in step_of else one for one in flight.records]
    check_blamed(records, Cause.REORDERED, Weight.PROVED, f"record {seq} is -7000000 ns off the monotonic clock")


def test_a_moment_that_is_another() -> None:
    """All clocks agree, so only the deadline tells that it came too early."""
    flight = pointed()
    seq = at(flight, "time_passed")
    moment = flight.records[seq].at
    by_ns = 7_345_000
    moved = moment._replace(flight_ns=moment.flight_ns - by_ns, mono_ns=moment.mono_ns - by_ns)
    records = [replace(one, at=moved) if seq in (one.seq, one.cause) else one for one in flight.records]
    check_blamed(records, Cause.REORDERED, Weight.FITTED, f"record {seq} moved in time by 7 ms")


def test_a_decision_at_the_moment_of_another() -> None:
    """It was made on the neighbour."""
    flight = small()
    seq, other = at(flight, "camera_taken"), at(flight, "command_sent")
    records = put(flight.records, seq, at=flight.records[other].at)
    check_blamed(records, Cause.REORDERED, Weight.PROVED, f"record {seq} was decided at the moment of record {other}")


def test_neighbours_that_were_exchanged() -> None:
    """Without a trace in the clocks: they come out when they are exchanged back."""
    flight = small()
    seq, other = at(flight, "command_sent"), at(flight, "command_answered")
    one, there = flight.records[seq], flight.records[other]
    records = put(flight.records, seq, kind=there.kind, body=there.body, message=there.message)
    records = put(records, other, kind=one.kind, body=one.body, message=one.message)
    words = f"records {seq} and {other} exchanged: comes out as recorded, the rest of the flight too"
    check_blamed(records, Cause.REORDERED, Weight.WHOLE, words)


def test_a_decision_on_nothing() -> None:
    """Its observation was taken out of the log; its moment, or its cause, is nowhere."""
    flight = small()
    seq = at(flight, "command_answered")
    records = renumbered([one for one in flight.records if one.seq != seq], seq + 1, -1)
    check_blamed(records, Cause.MISSING, Weight.PROVED, "at a moment at which nothing was observed")
    there = flight.records[at(flight, "command_sent")].at
    records = [replace(one, at=there) if one.cause == seq else one for one in records]
    check_blamed(records, Cause.MISSING, Weight.PROVED, f"follows from record {seq}, which is no observation before")


def test_a_move_from_where_nothing_was() -> None:
    """A step was taken out, whole: the moves behind it begin where those before it do not end."""
    flight = pointed()
    flight.tell(release("b", order_seq=2), 100)
    flight.wait(2_000)
    flight.tell(point_at_place("c", order_seq=3), 100)
    records = without(flight.records, at(flight, "order_received", 1))
    check_blamed(records, Cause.MISSING, Weight.PROVED, "moves camera 1/1 from released; by the log it was automatic")


def test_an_answer_to_a_repeat_that_came_once() -> None:
    """The first time is missing."""
    flight = Flight()
    flight.tell(point_at_place("a", roles=()), 100)
    flight.tell(point_at_place("a", roles=(), send=2), 100)
    records = without(flight.records, at(flight, "order_received"))
    check_blamed(records, Cause.MISSING, Weight.WHOLE, "answers order alpha/a as one that came before")


def test_an_answer_to_an_order_that_never_came() -> None:
    """A start gives owed answers again; the order that is answered is not in the log."""
    flight = Flight()
    flight.tell(point_at_place("a", roles=()), 100)
    flight.tell(NodeStarted(boot_id="boot", start=2, outage_ns=1), 100)
    records = without(flight.records, at(flight, "order_received"))
    check_blamed(records, Cause.MISSING, Weight.WHOLE, "answers order alpha/a, which no record brought")


def test_distances_that_were_never_right() -> None:
    """They tell of other code, not of something that was not seen."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        BODIES["no square root"](monkeypatch)
        records = sighted().records
    check_blamed(records, Cause.CODE, Weight.LEFT, "sightings_classified")


def test_an_object_that_was_never_seen() -> None:
    """Numbers of objects have no gaps; distances are those to where the log has them."""
    flight = Flight()
    flight.tell(frame(1, detection(0, 0)), 80)
    flight.tell(frame(2, detection(900_000, 0)), 80)
    flight.tell(frame(3, detection(-900_000, 0)), 80)
    records = without(flight.records, at(flight, "frame_observed", 1))
    check_blamed(records, Cause.MISSING, Weight.WHOLE, "names object 3; the log put 1 on the map before")
    flight = sighted()
    records = without(flight.records, at(flight, "frame_observed", 3))
    check_blamed(records, Cause.MISSING, Weight.WHOLE, "meets object 1 1000 mm from where it was; by the log")


def test_an_input_that_left_no_decision() -> None:
    """Nothing speaks of it, but with it put in the decisions come out."""
    flight = ordered()
    records = without(flight.records, at(flight, "vehicle_link_changed"))
    check_blamed(records, Cause.MISSING, Weight.WHOLE, "link up of vehicle 1, put in before record")


@pytest.mark.parametrize("name", sorted(ROWS))
def test_other_rows(name: str) -> None:
    """The manifest tells; what else could explain it does not count."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        ROWS[name](monkeypatch)
        records = _much().records
    if verify(resealed(records)).first is not None:
        check_blamed(records, Cause.CODE, Weight.DIFFERS, "other rows of charts")


def _much() -> Flight:
    flight = pointed(scan_enabled=True)
    flight.tell(point_at_place("v", roles=("viewer",), who="viewer"), 50)
    flight.tell(point_at_place("a0", order_seq=0), 50)
    for number in range(1, 6):
        flight.tell(frame(number, detection(1_000 * number, 0)), 80)
    flight.wait(20_000)
    return flight


def test_other_software_and_another_logic(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the manifest; software only where somebody says which this is."""
    records = forged(story(), 22, because="forged")
    check_blamed(records, Cause.CODE, Weight.OLDER, "software 0.1.0, here 0.2.0", software="0.2.0")
    check_blamed(records, Cause.CODE, Weight.LEFT, "or the log was written by somebody else", software="0.1.0")
    check_blamed(records, Cause.CODE, Weight.LEFT, "(no row of ours gives this reason)")
    flown = logic.LOGIC
    monkeypatch.setattr(logic, "LOGIC", 77)
    check_blamed(records, Cause.CODE, Weight.DIFFERS, f"logic {flown}, here 77")


def test_another_body_of_a_guard() -> None:
    """By elimination: chart, row and guard are named."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        BODIES["details are cut"](monkeypatch)
        records = story().records
    found = check_blamed(records, Cause.CODE, Weight.LEFT, "command", software="0.1.0")
    assert "does not explain it" in [one.result for one in found.findings]


def test_a_lifting_that_was_forgotten() -> None:
    """Tenths of a degree, read as hundredths: read ten times larger, everything comes out."""
    flight = pointed(arrival_tolerance_cdeg=50)
    seqs = [one.seq for one in flight.records if one.kind.name == "gimbal_reported"]
    stored = {
        seq: gimbal(-100, 100, at(flight, "point_at_place"), error) for seq, error in zip(seqs, (8, 3), strict=True)
    }
    words = "gimbal_reported.error_cdeg"
    far = [make_record(one.seq, one.cause, one.at, _far(one)) if one.seq in seqs else one for one in flight.records]
    check_blamed(far, Cause.UPCAST, Weight.WHOLE, words, lifting=Lifted(dict(stored)))


def _far(record: Record) -> Any:
    message = type(record.message)()
    message.CopyFrom(record.message)
    message.error_cdeg *= 100  # type: ignore[attr-defined]
    return message


def test_a_lifting_that_no_other_reading_explains_is_suspected() -> None:
    """The step changes with it, and that is all that is known."""
    flight = pointed()
    seq = at(flight, "gimbal_reported")
    records = forged(flight, seq + 1, because="forged")
    lifted = Lifted({seq: gimbal(-100, 100, at(flight, "point_at_place"), 8_000)})
    words = "gimbal_reported was lifted and the step changes with gimbal_reported as it was stored"
    found = check_blamed(records, Cause.UPCAST, Weight.SUSPECTED, words, lifting=lifted)
    assert found.findings[0].result == "may explain it"


def test_other_rows_say_less_where_records_were_lifted() -> None:
    """Other code is expected there, so what explains everything counts for more."""
    records = under(pointed(operator_hold_ms=45_000).records, limits())
    opening = FlightOpened()
    opening.ParseFromString(records[0].body)
    opening.charts_digest = bytes(32)
    records = changed(records, 0, opening)
    check_blamed(records, Cause.CODE, Weight.DIFFERS, "other rows of charts")
    lifted = Lifted({4: records[4].message})
    check_blamed(records, Cause.CONFIGURATION, Weight.WHOLE, "operator_hold_ms 45000", lifting=lifted)


def test_a_limit_that_explains_one_step_of_many_does_not_count() -> None:
    """It must take away at least half of what differs behind."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        BODIES["role by name"](monkeypatch)
        flight = Flight()
        flight.tell(point_at_place("a"), 100)
        for number in range(1, 5):
            flight.tell(point_at_place(f"b{number}", order_seq=number, who="bravo", roles=("viewer",)), 100)
    check_blamed(flight.records, Cause.CODE, Weight.LEFT, "guard role_missing")


def test_a_lifting_that_has_no_part_is_not_blamed() -> None:
    """And one that has a part, but that no other reading explains, is suspected and no more."""
    flight = pointed(operator_hold_ms=45_000)
    seq = at(flight, "command_answered")
    right = Lifted({seq: flight.records[seq].message})
    found = check_blamed(
        under(flight.records, limits()), Cause.CONFIGURATION, Weight.WHOLE, "operator_hold_ms", lifting=right
    )
    upcast = next(one for one in found.findings if one.cause is Cause.UPCAST)
    assert (upcast.weight, upcast.result) == (Weight.NOTHING, "does not explain it")
