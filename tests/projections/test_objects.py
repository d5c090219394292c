"""Map, observations, mutes and points of interest against the core's own state."""

from __future__ import annotations

from uuid import UUID

import pytest
from hypothesis import given, settings

from events import make_record
from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import BaselineCarried
from projections import objects as fold
from projections import pois as pois_fold
from projections.objects import Objects, observation_id
from projections.pois import Pois
from statecharts import carry_over
from tests.flights import FLIGHT_ID, START_WALL_NS, Flight, detection, frame, judge, opened_well, release, story
from tests.random_flights import Draw, draws, fly


def folded(flight: Flight) -> Objects:
    """Return the map of a flight."""
    objects = fold.start()
    for record in flight.records:
        objects = fold.apply(objects, record)
    return objects


def pois_of(flight: Flight) -> Pois:
    """Return the points of interest of a flight."""
    pois = pois_fold.start()
    for record in flight.records:
        pois = pois_fold.apply(pois, record)
    return pois


def check_map(flight: Flight) -> Objects:
    """Check every object and every mute against the core's, and return the map."""
    objects, state = folded(flight), flight.state
    assert {
        row.number: (row.class_name, row.class_group, row.latitude_e7, row.confidence_e4, row.sightings)
        for row in objects.objects
    } == {
        one.number: (one.class_name, one.class_group, one.spot.place.latitude_e7, one.confidence_e4, one.sightings)
        for one in state.objects.values()
    }
    assert {row.number: (row.poi_id, row.muted_by) for row in objects.objects} == {
        one.number: (one.poi_id, one.muted_by) for one in state.objects.values()
    }
    assert {row.poi_id: (row.class_group, row.muted, row.operator_id) for row in objects.ignored} == {
        key: (one.class_group, one.muted, one.principal_id) for key, one in state.ignored.items()
    }
    return objects


def check_pois(flight: Flight) -> None:
    """Check every point of interest against the core's."""
    pois, state = pois_of(flight), flight.state
    assert {
        row.poi_id: (row.state, row.class_name, row.sightings, row.objects[0], row.decide_by_ns or 0)
        for row in pois.rows
    } == {
        key: (one.state, one.class_name, one.sightings, one.object, one.decide_by_ns) for key, one in state.pois.items()
    }


def check_kept(flight: Flight, *expected: tuple[str, int]) -> None:
    """Check which observations are kept: kind and frame."""
    assert tuple((row.diff_kind, row.frame_seq) for row in folded(flight).observations) == expected


@settings(max_examples=60, deadline=None)
@given(draws)
def test_it_agrees_with_the_core(drawn: list[Draw]) -> None:
    """Objects, memberships, mutes and their counts, points of interest and their sightings."""
    flight = fly(drawn)
    check_map(flight)
    check_pois(flight)


def test_a_whole_story() -> None:
    """With a mute that counts."""
    objects = check_map(story())
    (item,) = objects.ignored
    assert (item.source, item.operator_id, item.muted) == ("local_appended", "alpha", 4)
    check_pois(story())


def test_existing_observations_are_kept_once_a_second() -> None:
    """A new one always, the object counts them all."""
    flight = Flight()
    for number in range(25):
        flight.tell(frame(number, detection(1_000, 1_000)), 100)
    check_kept(flight, ("NEW", 0), ("EXISTING", 10), ("EXISTING", 20))
    assert [row.sightings for row in folded(flight).objects] == [25]
    flight.tell(frame(25, detection(1_000, 1_000), detection(90_000, 0)), 100)
    check_kept(flight, ("NEW", 0), ("EXISTING", 10), ("EXISTING", 20), ("NEW", 25))


def test_an_observation_says_when_where_and_by_whom() -> None:
    """With the moment of its record."""
    flight = Flight()
    seen = detection(1_000, 1_000, "car", 6_543)
    seen.width_mm = 1_800
    flight.tell(frame(7, seen), 250)
    (row,) = folded(flight).observations
    assert (row.uav_id, row.class_name, row.class_group, row.confidence_e4) == ("node-1", "car", "vehicle", 6_543)
    assert (row.width_mm, row.length_mm, row.frame_seq) == (1_800, None, 7)
    assert row.observed_at_wall_ns == START_WALL_NS + 250_000_000
    assert row.observed_at_monotonic_ns == 5_250_000_000


def test_a_size_once_known_stays() -> None:
    """A later sighting without one does not take it away."""
    flight = Flight()
    seen = detection(1_000, 1_000)
    seen.width_mm, seen.length_mm = 500, 600
    flight.tell(frame(1, seen))
    flight.tell(frame(2, detection(1_000, 1_000)), 50)
    assert [(row.width_mm, row.length_mm) for row in folded(flight).objects] == [(500, 600)]


def test_ids_derive_from_the_log() -> None:
    """UUIDv8, one for each sighting, the same every time."""
    ids = [observation_id(FLIGHT_ID, seq, index) for seq in range(20) for index in range(20)]
    assert len(set(ids)) == len(ids)
    assert [UUID(text).version for text in ids] == [8] * len(ids)
    assert ids[0] == observation_id(FLIGHT_ID, 0, 0) != observation_id(bytes(16), 0, 0)


def test_what_was_carried_over() -> None:
    """Objects and mutes of the flight before, without a first sighting in this one."""
    before = story()
    carried = BaselineCarried(state=carry_over(before.state, before.now_ns))
    flight = Flight(*opened_well()[:1], carried, *opened_well()[1:])
    objects = folded(flight)
    assert [(row.first_seen_ns, row.last_seq) for row in objects.objects] == [(None, -1)] * 2
    assert [(row.source, row.muted) for row in objects.ignored] == [("carried", 4)]
    for number in range(3):
        flight.tell(frame(number, detection(40_700, 10_000)), 100)
    (seen,) = [row for row in folded(flight).objects if row.last_seq >= 0]
    assert (seen.first_seen_ns, seen.sightings) == (None, 10)
    assert [row.sightings for row in pois_of(flight).rows] == [10]


def test_a_judgement_has_a_name() -> None:
    """Only where a person judged."""
    flight = Flight()
    for number in range(4):
        flight.tell(frame(number, detection(1_000, 1_000), detection(90_000, 0)), 100)
    first, second = sorted(flight.surfaced())
    flight.tell(judge("j", first, confirmed=True))
    flight.wait(200_000)
    rows = {row.poi_id: row for row in pois_of(flight).rows}
    assert (rows[first].state, rows[first].judged_by, rows[first].judged_callsign) == ("confirmed", "alpha", "ALPHA")
    assert (rows[second].state, rows[second].judged_by) == ("expired", "")


def test_a_judgement_without_an_order_has_no_name() -> None:
    """The newest order is not to blame for what it did not cause."""
    flight = Flight()
    for number in range(4):
        flight.tell(frame(number, detection(1_000, 1_000)), 100)
    (poi_id,) = flight.surfaced()
    flight.tell(release("r"))
    moved = Moved(chart="poi", instance=poi_id, from_state="surfaced", to_state="confirmed", because="forged")
    flight.records.append(make_record(flight.records[-1].seq + 1, 0, flight.moment(), moved))
    assert [(row.state, row.judged_by) for row in pois_of(flight).rows] == [("confirmed", "")]


def test_a_classification_without_its_frame_is_loud() -> None:
    """Never a guess."""
    flight = story()
    record = next(one for one in flight.records if one.kind.name == "sightings_classified")
    with pytest.raises(LookupError, match="a frame that the log does not have"):
        fold.apply(fold.start(), record)
