"""Causes, consequences, and records in words."""

from __future__ import annotations

from dataclasses import replace

import pytest

from events import kind_named
from replay.causes import chain, consequences
from replay.show import show
from tests.flights import Flight, published, resealed, story


def check_why(flight: Flight, seq: int, causes: list[int], led_to: list[int]) -> None:
    """Check what led to a record and what it led to."""
    assert [shown.seq for shown in chain(flight.store, seq)] == causes
    assert [shown.seq for shown in consequences(flight.store, seq)] == led_to


def test_why_did_the_camera_arrive() -> None:
    """Through the world: arrival, what the gimbal said, the effect, the order; and back."""
    flight = story()
    check_why(flight, 22, [22, 21, 8, 6], [])
    assert [shown.kind for shown in chain(flight.store, 22)] == [
        "moved",
        "gimbal_reported",
        "point_at_place",
        "order_received",
    ]
    check_why(flight, 6, [6], [*range(7, 23), 96])
    check_why(flight, 5, [5], [])


def test_a_record_that_is_not_there() -> None:
    """Is said so."""
    with pytest.raises(LookupError, match="no record 999"):
        chain(story().store, 999)


def test_a_cause_that_lies_ahead_ends_the_chain() -> None:
    """A forged log must not make us run in circles."""
    flight = Flight()
    flight.tell(published(7), 10)
    flight.tell(published(5), 10)
    seq = flight.records[-2].seq
    assert [shown.seq for shown in chain(resealed(flight.records), seq)] == [seq]


def test_a_log_as_lines() -> None:
    """Time, seq, kind, words."""
    lines = list(show(story().store, 5, 8))
    asked = "ALPHA (alpha) orders p1: look at 52.1002702 4.3002941, 0.0 m AMSL (31UFT5002050030), camera 1"
    assert " ".join(lines[1].split()) == f"0.600 6 order_received {asked}"
    assert len(lines) == 3
    assert len(list(show(story().store))) == 121
    assert len(list(show(story().store, kind=kind_named("flight_closed")))) == 1


def test_a_report_that_can_not_be_read_ends_the_chain() -> None:
    """What it answered is in its body, so nothing is known of it; the records before and after still say theirs."""
    flight = story()
    records = [*flight.records[:21], replace(flight.records[21], body=b"\xff"), *flight.records[22:]]
    assert [shown.seq for shown in chain(resealed(records), 22)] == [22, 21]
