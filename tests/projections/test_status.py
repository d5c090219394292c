"""The status against the core's own state: it presents what was decided, so the two never differ."""

from __future__ import annotations

import json
from collections import Counter

from hypothesis import given, settings

from events.schema.flight_pb2 import BaselineCarried
from projections import status as fold
from projections.picture import POI_STATES, RESULTS, GimbalPicture, Picture, Question, Status
from statecharts import State, carry_over
from tests.flights import (
    Flight,
    answered,
    detection,
    frame,
    gimbal,
    judge,
    opened,
    opened_well,
    point_at_angles,
    point_at_place,
    received,
    story,
)
from tests.random_flights import Draw, draws, fly
from tests.stories import Story


def folded(flight: Flight) -> Status:
    """Return the status after a flight."""
    status = Status()
    for record in flight.records:
        status = fold.apply(status, record)
    return status


def check_agrees(picture: Picture, state: State) -> None:
    """Check all that the status and the core both know; carried orders, which have no callsign, do not count."""
    cameras = {
        key: (one.state, one.principal_id, one.callsign, one.command_id, one.until_ns)
        for key, one in state.cameras.items()
    }
    assert {
        key: (one.state, one.principal_id, one.callsign, one.command_id, one.held_until_ns)
        for key, one in picture.cameras.items()
    } == cameras
    for key, aim in state.aims.items():
        shown = picture.gimbals[key]
        assert (shown.aim, shown.effect_seq, shown.error_cdeg) == (aim.state, aim.effect_seq, aim.error_cdeg)
    waiting = {key: one for key, one in state.pois.items() if one.state in ("enqueued", "surfaced")}
    assert {key: (one.state, one.decide_by_ns) for key, one in picture.waiting.items()} == {
        key: (one.state, one.decide_by_ns) for key, one in waiting.items()
    }
    assert {state_: count for state_, count in picture.pois.items() if count} == dict(
        Counter(one.state for one in state.pois.values())
    )
    assert {result: count for result, count in picture.orders.items() if count} == dict(
        Counter(one.state for one in state.orders.values() if one.state in RESULTS and one.callsign)
    )
    assert (picture.map_objects, picture.ignored) == (len(state.objects), len(state.ignored))
    assert picture.health == state.health.value.replace("_", " ")
    vehicle, reported = picture.vehicles["1"], state.vehicles[1]
    assert (vehicle.link, vehicle.armed, vehicle.custom_mode) == (reported.link, reported.armed, reported.custom_mode)


def check_waiting(status: Status, **expected: object) -> Question:
    """Check the fields of the one question that waits, and return it."""
    (question,) = status.picture.waiting.values()
    assert {name: getattr(question, name) for name in expected} == expected
    return question


@settings(max_examples=60, deadline=None)
@given(draws)
def test_it_agrees_with_the_core(drawn: list[Draw]) -> None:
    """After every flight: masters, deadlines, aims, questions, results, counts."""
    flight = fly(drawn, end=len(drawn) % 2 == 0)
    check_agrees(folded(flight).picture, flight.state)


@settings(max_examples=10, deadline=None)
@given(draws)
def test_it_agrees_at_every_step(drawn: list[Draw]) -> None:
    """Also in between."""
    status, flight = Status(), Flight()
    for record in flight.records:
        status = fold.apply(status, record)
    for what, one, two, three in drawn[:12]:
        before = len(flight.records)
        flight.tell(frame(before, detection(one * 7_000, two * 4_000, confidence_e4=4_000 + three)), 200)
        if what == "order":
            flight.tell(point_at_place(f"o{two}", order_seq=two, send=three), 30)
        for record in flight.records[before:]:
            status = fold.apply(status, record)
        check_agrees(status.picture, flight.state)


def test_a_whole_story() -> None:
    """The counts of a flight that is known, and that it ended."""
    flight = story()
    picture = folded(flight).picture
    check_agrees(picture, flight.state)
    assert picture.orders == {"accepted": 3, "rejected": 1, "timeout": 2, "unsupported": 2, "unauthorised": 1}
    assert picture.orders_malformed == 1
    assert {name: count for name, count in picture.pois.items() if count} == {"confirmed": 1, "declined": 1}
    assert (picture.open, picture.closed_because, picture.starts) == (False, "stopped while disarmed", 2)
    assert (picture.samples_rejected, picture.inputs_dropped) == ({"bad_signature": 3, "stale": 1}, {"frame": 7})
    assert picture.eyes == {"1/1": "lost: the detector ended"}
    assert tuple(picture.pois) == POI_STATES


def test_an_arrival_is_measured_and_timed() -> None:
    """Accepted is not arrived; the time counts from the order."""
    flight = Flight()
    flight.tell(point_at_angles("a", -3_000, 9_000))
    effect = flight.effect()
    flight.tell(gimbal(-1_000, 100, effect, 900), 700)
    shown = folded(flight).picture.gimbals["1/1"]
    assert (shown.aim, shown.arrived_after_ns, shown.error_cdeg) == ("moving", None, 900)
    assert (shown.pitch_cdeg, shown.yaw_cdeg) == (-1_000, 100)
    flight.tell(gimbal(-2_990, 9_010, effect, 20), 1_400)
    shown = folded(flight).picture.gimbals["1/1"]
    assert (shown.aim, shown.arrived_after_ns, shown.error_cdeg) == ("arrived", 2_100_000_000, 20)
    assert shown.asked == "pitch -30.0, yaw 90.0 from north"


def test_a_question_shows_what_a_person_needs() -> None:
    """Where, what, how sure, how often, and until when."""
    flight = Flight()
    for number in range(5):
        flight.tell(frame(number, detection(3_000, 4_000, confidence_e4=7_000)), 100)
    question = check_waiting(
        folded(flight), state="surfaced", class_name="person", confidence_e4=7_000, sightings=5, mgrs="31UFT5000350004"
    )
    assert question.decide_by_ns == flight.state.pois[question.poi_id].decide_by_ns > flight.now_ns
    flight.tell(judge("j", question.poi_id, confirmed=True))
    assert folded(flight).picture.waiting == {}
    assert folded(flight).picture.members == {}


def test_what_was_carried_over_counts() -> None:
    """The map and the mutes of the flight before."""
    before = story()
    carried = BaselineCarried(state=carry_over(before.state, before.now_ns))
    flight = Flight(*opened_well()[:1], carried, *opened_well()[1:])
    check_agrees(folded(flight).picture, flight.state)
    assert folded(flight).picture.map_objects == 2


def test_a_manifest_begins_afresh() -> None:
    """The daemon folds over the ends of flights."""
    status = folded(story())
    again = Flight(opened(flight_number=2))
    status = fold.apply(status, again.records[0])
    assert (status.picture.flight_number, status.picture.open, status.picture.orders_malformed) == (2, True, 0)


def test_a_picture_once_given_never_changes() -> None:
    """It is handed to other threads."""
    flight = story()
    status, before = Status(), []
    for record in flight.records:
        status = fold.apply(status, record)
        before.append((status, json.dumps(fold.plain(status))))
    assert [text for kept, text in before if json.dumps(fold.plain(kept)) != text] == []


def test_what_nothing_shows_changes_nothing() -> None:
    """The picture is the same object: that is what makes it cheap."""
    flight = Flight()
    status = folded(flight)
    flight.tell(received("u"), 10)
    order = flight.records[-3]
    assert order.kind.name == "order_received"
    assert fold.apply(status, order).picture is status.picture


def test_a_hold_that_is_given_back_is_shown_with_what_is_left_of_it() -> None:
    """As the chart has it: the first order's name and its end, not those of the refused one."""
    flight = Flight()
    flight.tell(point_at_place("a"))
    flight.tell(answered(flight.effect()), 10)
    flight.tell(point_at_place("b", order_seq=2), 5_000)
    flight.tell(answered(flight.effect(), mav_result=2), 10)
    shown = Status()
    for record in flight.records:
        shown = fold.apply(shown, record)
    camera, held = shown.picture.cameras["1/1"], flight.state.cameras["1/1"]
    assert (camera.command_id, camera.held_until_ns) == ("a", held.until_ns) == ("a", 60_000_000_000)


def shown_after(story: Story, *lines: str) -> GimbalPicture:
    """Return what is shown of the gimbal after a second for each line."""
    for line in lines:
        story.flight.wait(1_000)
        story.tell(line)
    return folded(story.flight).picture.gimbals["1/1"]


def test_drift_and_who_has_the_gimbal_are_shown() -> None:
    """With the reason; the time stays that of the first arrival; letting go shows none of it."""
    story = Story(drift_cdeg=200, drift_settle_ms=500)
    shown = shown_after(story, "control 0/0", "order a turn", "gimbal a error=40")
    assert (shown.aim, shown.arrived_after_ns, shown.order, shown.control) == (
        "arrived",
        1_000_000_000,
        "alpha/a",
        "nobody",
    )
    shown = shown_after(story, "control 255/190", "gimbal a demanded error=900", "time")
    assert (shown.aim, shown.aim_because, shown.control) == ("drifted", "255/190 took it", "255/190")
    assert (shown.arrived_after_ns, shown.demanded) == (1_000_000_000, True)
    shown = shown_after(story, "gimbal a error=40", "control 1/191 ours")
    assert (shown.aim, shown.aim_because, shown.control, shown.demanded) == ("arrived", "", "this node", False)
    assert shown.arrived_after_ns == 1_000_000_000
    shown = shown_after(story, "order b release")
    assert (shown.aim, shown.asked, shown.order, shown.control) == ("idle", "", "", "this node")
    assert (shown.effect_seq, shown.error_cdeg, shown.arrived_after_ns) == (-1, None, None)
    shown = shown_after(story, "order c point")
    assert shown.asked == "52.1000090 4.3000147, 0.0 m AMSL (31UFT5000150001), WGS84"


def test_what_an_operator_should_know_beforehand_is_shown() -> None:
    """That the vehicle would turn, and how far a camera is zoomed in, also after its master changed."""
    story = Story()
    assert shown_after(story, "described turns").caution.startswith("no gimbal that pans")
    assert shown_after(story, "described pans pitch=-9000,0").caution == ""
    shown_after(story, "zoomed 4000", "order a point")
    status = folded(story.flight)
    assert status.picture.cameras["1/1"].zoom_e4 == 4_000
    assert fold.plain(status)["gimbals"]["1/1"]["caution"] == ""
