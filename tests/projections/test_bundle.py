"""The post-flight bundle: the seed's fields, exact numbers, and the same bytes every time."""

from __future__ import annotations

import json
from decimal import Decimal
from typing import Any

import pytest
from hypothesis import given, settings

from events.records import make_record
from events.schema.flight_pb2 import BaselineCarried, TimePassed
from events.schema.mission_pb2 import MissionPlanned, PushObservations, PushReported
from events.store import MemoryStore
from projections.bundle import build, build_push
from projections.canonical import json_text
from statecharts import carry_over
from tests.flights import FLIGHT_ID, SECRET, Flight, detection, frame, opened_well, read_back, story
from tests.random_flights import Draw, draws, fly

MAP_OBJECT = {  # seed 004, MapObject
    *("h3_cell", "mgrs_key", "class", "class_group", "gps_lat", "gps_lon", "size_width_m", "size_length_m"),
    *("confidence", "first_seen", "last_seen", "mission_id", "source", "pending_upload"),
}
OBSERVATION = {  # seed 004, MapObjectObservation
    *("id", "h3_cell", "class", "class_group", "mission_id", "uav_id", "observed_at_monotonic_ns"),
    *("observed_at_wallclock", "gps_lat", "gps_lon", "mgrs", "size_width_m", "size_length_m", "confidence"),
    *("diff_kind", "photo_ref", "raw_evidence"),
}
IGNORED_ITEM = {  # seed 004, IgnoredItem
    *("id", "mgrs", "h3_cell", "class_group", "decline_time", "operator_id", "mission_id", "retention_scope"),
    *("expires_at", "source", "pending_upload"),
}


def bundle_of(flight: Flight) -> dict[str, Any]:
    """Return the bundle as whoever reads the JSON sees it, with exact decimals."""
    read: dict[str, Any] = json.loads(json_text(build(flight.records)), parse_float=Decimal)
    return read


def check_fields(rows: list[dict[str, Any]], wanted: set[str], count: int) -> None:
    """Check that there are so many rows and each has the seed's fields."""
    assert [sorted(wanted - set(row)) for row in rows] == [[]] * count


def test_it_has_the_fields_of_the_seed() -> None:
    """MapObjectsBundle and what is in it."""
    bundle = bundle_of(story())
    assert (bundle["schema_version"], bundle["mission_id"]) == ("1.0.0", "")
    check_fields(bundle["map_objects"], MAP_OBJECT, 2)
    check_fields(bundle["observations"], OBSERVATION, 3)
    check_fields(bundle["ignored_items"], IGNORED_ITEM, 1)
    assert bundle["as_of"] == "2026-09-21T14:15:43.427Z"


def test_numbers_are_exact() -> None:
    """Degrees, metres and shares as the log has them, not as a float comes near them."""
    flight = Flight()
    seen = detection(12_345, 54_321, confidence_e4=6_543)
    seen.width_mm = 1_001
    flight.tell(frame(1, seen))
    (row,) = bundle_of(flight)["map_objects"]
    assert row["gps_lat"] * 10**7 == seen.place.latitude_e7
    assert row["gps_lon"] * 10**7 == seen.place.longitude_e7
    assert (row["confidence"], row["size_width_m"], row["size_length_m"]) == (Decimal("0.6543"), Decimal("1.001"), None)
    assert row["h3_cell"] == seen.place.h3_cell


def test_the_box_holds_what_was_seen() -> None:
    """North-west first; none where nothing was seen."""
    flight = Flight()
    assert bundle_of(flight)["bbox"] is None
    west, east = detection(-50_000, 10_000), detection(70_000, -20_000)
    flight.tell(frame(1, west, east))
    north_west, south_east = bundle_of(flight)["bbox"]
    assert north_west["latitude"] * 10**7 == west.place.latitude_e7
    assert north_west["longitude"] * 10**7 == west.place.longitude_e7
    assert south_east["latitude"] * 10**7 == east.place.latitude_e7
    assert south_east["longitude"] * 10**7 == east.place.longitude_e7


def test_only_mutes_of_this_flight_are_told() -> None:
    """Carried ones were in the bundle of their own flight; carried objects are told, for they are on the map."""
    before = story()
    carried = BaselineCarried(state=carry_over(before.state, before.now_ns))
    bundle = bundle_of(Flight(*opened_well()[:1], carried, *opened_well()[1:]))
    assert bundle["ignored_items"] == []
    assert [(row["first_seen"], row["sightings"]) for row in bundle["map_objects"]] == [(None, 7), (None, 11)]


def test_the_summary_counts_every_answer_and_state() -> None:
    """Also those that did not occur."""
    flight = bundle_of(story())["flight"]
    assert flight["orders"] == {"accepted": 3, "rejected": 1, "timeout": 2, "unsupported": 2, "unauthorised": 1}
    assert sorted(flight["pois"]) == [
        *("confirmed", "declined", "enqueued", "expired", "suppressed", "surfaced", "withdrawn")
    ]
    assert (flight["records"], flight["open"]) == (121, False)


def test_audit_and_findings_are_in_it() -> None:
    """With the records that they rest on."""
    bundle = bundle_of(story())
    assert [row["command_id"] for row in bundle["audit"] if row["what"] == "malformed"] == ["m1"]
    assert [row["judged_callsign"] for row in bundle["pois"]] == ["ALPHA", "ALPHA"]
    assert [row["seqs"][0] for row in bundle["audit"]] == [row["seq"] for row in bundle["audit"]]


@settings(max_examples=25, deadline=None)
@given(draws)
def test_it_is_the_same_bytes_every_time(drawn: list[Draw]) -> None:
    """From the records as they were made, and as they are read back."""
    store = MemoryStore(FLIGHT_ID, SECRET)
    flight = fly(drawn, store)
    assert json_text(build(flight.records)) == json_text(build(read_back(store)))


def test_a_log_without_a_manifest_gives_none() -> None:
    """There is nothing to say whose it is."""
    with pytest.raises(LookupError, match="no manifest"):
        build(Flight(TimePassed()).records)


def push_of(flight: Flight) -> dict[str, Any]:
    """Return what would be pushed now, as the office reads it."""
    read: dict[str, Any] = json.loads(json_text(build_push(flight.records)), parse_float=Decimal)
    return read


def test_a_push_is_what_this_flight_saw() -> None:
    """The seed's fields, nothing that a flight before handed over, the mission also where it was not planned yet."""
    before = story()
    flight = Flight()
    flight.tell(BaselineCarried(state=carry_over(before.state, before.now_ns)))
    assert push_of(flight) == push_of(Flight()) | {"as_of": push_of(flight)["as_of"]}
    assert (push_of(flight)["bbox"], push_of(flight)["observations"]) == (None, [])
    flight.tell(frame(1, detection(40_000, 10_000)))
    flight.tell(MissionPlanned(vehicle=1, mission_id="m"))
    flight.tell(frame(2, detection(70_000, -20_000)), 2_000)
    push = push_of(flight)
    check_fields(push["observations"], OBSERVATION, 2)
    assert [row["mission_id"] for row in (push, *push["observations"])] == ["m"] * 3
    assert [row["mission_id"] for row in bundle_of(flight)["observations"]] == ["", "m"]
    assert (bundle_of(flight)["mission_id"], push["map_objects"]) == ("m", [])
    flight.tell(PushReported(effect_seq=flight.state.next_seq.value, observations=2, final=True))
    things = [(row["mission_id"], row["pending_upload"]) for row in bundle_of(flight)["map_objects"]]
    assert things == [("", False), ("", True), ("m", False)]  # the second was not seen again
    assert [corner["latitude"] * 10**7 for corner in push["bbox"]] == [
        detection(0, north).place.latitude_e7 for north in (10_000, -20_000)
    ]
    assert push["as_of"] == bundle_of(flight)["as_of"]


def test_what_an_office_took_is_not_pushed_again() -> None:
    """Up to the push that it took whole; what came later is, and so is all of a push that it did not take whole."""
    flight = story()
    whole = push_of(flight)
    check_fields(whole["ignored_items"], IGNORED_ITEM, 1)
    assert (len(whole["observations"]), whole["ignored_items"][0]["pending_upload"]) == (3, True)
    seq = flight.state.next_seq.value
    flight.tell(PushReported(effect_seq=seq, observations=2, left=2, because="shut", final=True))
    assert push_of(flight) | {"as_of": ""} == whole | {"as_of": ""}
    assert {row["pending_upload"] for row in bundle_of(flight)["map_objects"]} == {True}
    flight.tell(PushReported(effect_seq=seq, observations=3, ignored_items=1, final=True))
    assert [push_of(flight)[name] for name in ("observations", "ignored_items", "bbox")] == [[], [], None]
    bundle = bundle_of(flight)
    assert {row["pending_upload"] for row in (*bundle["map_objects"], *bundle["ignored_items"])} == {False}
    flight.tell(frame(20, detection(40_000, 10_000)), 2_000)
    assert len(push_of(flight)["observations"]) == 1
    assert [row["pending_upload"] for row in bundle_of(flight)["map_objects"]] == [True, False]


def test_the_mission_of_a_push_is_that_of_its_effect() -> None:
    """Where the flight took its mission over from the one before, no plan is in its log."""
    flight = story()
    last = flight.records[-1]
    effect = make_record(last.seq + 1, last.seq, last.at, PushObservations(vehicle=1, mission_id="n", life_ms=1))
    assert build_push([*flight.records, effect])["mission_id"] == "n"
