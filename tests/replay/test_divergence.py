"""A log that was changed and sealed again: the first decision that comes out otherwise is found and named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from events import NO_CAUSE, Record, encode, make_record
from events.schema.common_pb2 import Moved
from replay.verify import verify
from tests.flights import (
    Flight,
    detection,
    frame,
    gimbal,
    point_at_place,
    resealed,
    story,
)
from tests.replay.changes import (
    at,
    changed,
    check_diverges,
    forged,
    renumbered,
    small,
)


def test_a_changed_field_is_found() -> None:
    """With its path, both values, and what led to it."""
    flight = small()
    seq = at(flight, "point_at_place")
    wrong = type(flight.records[seq].message)()
    wrong.CopyFrom(flight.records[seq].message)
    wrong.place.latitude_e7 += 1  # type: ignore[attr-defined]
    first = check_diverges(changed(flight.records, seq, wrong), seq, "field", "place.latitude_e7")
    assert (first.kind, first.recorded, first.replayed) == ("point_at_place", "521002703", "521002702")
    assert [(shown.seq, shown.kind) for shown in first.causes] == [(seq, "point_at_place"), (5, "order_received")]


def test_an_entry_of_a_list_is_found() -> None:
    """By its index."""
    flight = Flight()
    records = flight.tell(frame(1, detection(0, 0), detection(90_000, 0)))
    wrong = type(records[1].message)()
    wrong.CopyFrom(records[1].message)
    wrong.sightings[1].diff = 2  # type: ignore[attr-defined]
    seq = records[1].seq
    first = check_diverges(changed(flight.records, seq, wrong), seq, "field", "sightings[1].diff")
    assert (first.recorded, first.replayed) == ("EXISTING", "NEW")
    del wrong.sightings[1]  # type: ignore[attr-defined]
    first = check_diverges(changed(flight.records, seq, wrong), seq, "field", "sightings")
    assert (first.recorded, first.replayed) == ("1 entries", "2 entries")


def test_a_field_that_is_absent_is_not_one_that_is_empty() -> None:
    """Presence counts."""
    flight = small()
    seq = at(flight, "send_ack", 2)
    first = check_diverges(forged(flight, seq, mav_result=None), seq, "field", "mav_result")
    assert (first.recorded, first.replayed) == ("absent", "0")
    seq = at(flight, "point_at_place")
    first = check_diverges(forged(flight, seq, poi_id=""), seq, "field", "poi_id")
    assert (first.recorded, first.replayed) == ("''", "absent")


def test_the_same_fields_in_other_bytes_are_found() -> None:
    """Bytes are what is hashed, so bytes are what must be the same."""
    flight = small()
    seq = at(flight, "moved")
    old = flight.records[seq]
    body = old.body + encode(Moved(because=old.message.because))  # type: ignore[attr-defined]
    records = [*flight.records[:seq], replace(old, body=body), *flight.records[seq + 1 :]]
    first = check_diverges(records, seq, "encoding")
    assert first.recorded == body.hex()
    records[seq] = replace(old, body=b"\xff\xff")
    verdict = verify(resealed(records))
    assert verdict.first is not None
    assert (verdict.first.seq, verdict.first.what) == (seq, "encoding")


def test_a_missing_decision_is_found() -> None:
    """At the place where it should be, with the observation that asks for it."""
    flight = small()
    seq = at(flight, "send_ack", 2)
    records = renumbered([*flight.records[:seq], *flight.records[seq + 1 :]], seq, -1)
    first = check_diverges(records, seq, "missing in the log")
    assert (first.kind, first.recorded) == ("send_ack", "no such decision")
    assert [shown.kind for shown in first.causes][:3] == ["send_ack", "command_answered", "point_at_place"]


def test_a_missing_decision_in_the_middle_is_found() -> None:
    """What follows it in the step is not to blame."""
    flight = small()
    seq = at(flight, "camera_taken")
    records = renumbered([*flight.records[:seq], *flight.records[seq + 1 :]], seq, -1)
    first = check_diverges(records, seq, "missing in the log")
    assert first.kind == "camera_taken"


def test_a_needless_decision_is_found() -> None:
    """One that nothing asks for, in the middle and at the end of a step."""
    flight = small()
    for kind in ("camera_taken", "gimbal_reported"):
        seq = at(flight, kind)
        cause = flight.records[seq].cause if flight.records[seq].cause != NO_CAUSE else flight.records[seq - 1].cause
        moved = Moved(chart="scan", instance="1/2", from_state="zoomed_out", to_state="blocked", because="forged")
        extra = make_record(seq, cause, flight.records[seq - 1].at, moved)
        later = renumbered(flight.records, seq, 1)
        first = check_diverges([*later[:seq], extra, *later[seq:]], seq, "only in the log")
        assert (first.kind, first.replayed) == ("moved", "no such decision")


def test_decisions_in_another_order_are_found() -> None:
    """Order is by seq, and it is decided."""
    flight = small()
    seq = at(flight, "camera_taken")
    one, other = flight.records[seq], flight.records[seq + 1]
    swapped = [replace(other, seq=seq), replace(one, seq=seq + 1)]
    check_diverges([*flight.records[:seq], *swapped, *flight.records[seq + 2 :]], seq, "order")


def test_another_kind_is_found() -> None:
    """Both sides in words."""
    flight = small()
    seq = at(flight, "camera_taken")
    moved = Moved(chart="camera", instance="1/1", from_state="operator", to_state="released", because="forged")
    first = check_diverges(changed(flight.records, seq, moved), seq, "kind")
    assert first.recorded.startswith("moved: camera 1/1")
    assert first.replayed.startswith("camera_taken: ALPHA has camera 1/1")


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("cause", lambda one: replace(one, cause=one.cause - 1)),
        ("flight_ns", lambda one: replace(one, at=one.at._replace(flight_ns=one.at.flight_ns + 1))),
        ("clock_quality", lambda one: replace(one, at=one.at._replace(clock_quality=1))),
        ("version", lambda one: replace(one, version=one.version + 1)),
    ],
)
def test_another_header_is_found(field: str, change: Callable[[Record], Record]) -> None:
    """Cause, moment and version are decided as well."""
    flight = small()
    seq = at(flight, "camera_taken")
    records = list(flight.records)
    records[seq] = change(records[seq])
    verdict = verify(resealed(records))
    assert verdict.first is not None
    assert (verdict.first.seq, verdict.first.what, verdict.first.field) == (seq, "header", field)


def test_a_changed_observation_shows_in_what_it_led_to() -> None:
    """The observation itself is what the world said; the decisions no longer follow from it."""
    flight = small()
    seq = at(flight, "gimbal_reported")
    records = changed(flight.records, seq, gimbal(-2_000, 3_000, at(flight, "point_at_place"), 4_000))
    first = check_diverges(records, seq + 1, "only in the log")
    assert [shown.kind for shown in first.causes] == ["moved", "gimbal_reported", "point_at_place", "order_received"]


def test_a_divergence_stays_local() -> None:
    """What follows is judged from what was recorded, so a second change is a second finding."""
    flight = story()
    aims = [one.seq for one in flight.records if isinstance(one.message, Moved) and one.message.chart == "aim"]
    once = forged(flight, aims[1], because="forged")
    check_diverges(once, aims[1], "field", "because")
    flight.records = once
    check_diverges(forged(flight, aims[4], because="forged"), aims[1], "field", "because", further=1)


def test_the_state_goes_on_from_what_was_recorded() -> None:
    """A recorded refusal that differs is the stored result that later repeats are told."""
    flight = Flight()
    flight.tell(point_at_place("a", roles=()))
    flight.tell(point_at_place("a", roles=(), send=2), 50)
    seq = at(flight, "moved")
    check_diverges(forged(flight, seq, because="forged"), seq, "field", "because", further=1)


def test_a_forgery_that_no_chart_can_apply_does_not_end_the_replay() -> None:
    """It is a divergence like any other."""
    flight = story()
    seq = at(flight, "sightings_classified")
    wrong = type(flight.records[seq].message)()
    wrong.CopyFrom(flight.records[seq].message)
    wrong.sightings[0].detection = 99  # type: ignore[attr-defined]
    check_diverges(changed(flight.records, seq, wrong), seq, "field", "sightings[0].detection")
