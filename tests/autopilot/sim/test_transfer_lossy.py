"""The mission protocol on bad links and in any order: nothing upsets the vehicle, and PX4 takes no wrong mission."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from autopilot.sim.lossy import Weather
from autopilot.sim.vehicle import PersonalityName
from tests.autopilot.sim.ground import Ground, Row, at, ground
from tests.autopilot.sim.test_transfer import BOTH, KEPT, count, legs, opaque_id

WEATHER = st.builds(
    Weather,
    lost=st.sampled_from([0.0, 0.1, 0.3]),
    twice=st.sampled_from([0.0, 0.3]),
    overtaken=st.sampled_from([0.0, 0.3]),
    late_s=st.sampled_from([0.0, 0.2, 2.0]),
)


@given(WEATHER, st.integers(0, 1_000), st.integers(2, 8))
@settings(max_examples=25, deadline=None, derandomize=True)
def test_px4_never_takes_a_wrong_mission_silently(weather: Weather, seed: int, length: int) -> None:
    """On any link the mission on board is the old one or the new one, whole; and an accepted id is that of the new."""
    station = ground("px4", seed=seed)
    old, new = legs(5, 30.0), legs(length, 60.0)
    assert station.upload(old) == KEPT
    vehicle = station.vehicle
    olds = list(vehicle.flight.items)
    reference = ground("px4")
    assert reference.upload(new) == KEPT
    news = list(reference.vehicle.flight.items)
    vehicle.inward.weather = vehicle.outward.weather = weather
    station.heard.clear()
    result = station.upload(new, within_s=15)
    assert vehicle.flight.items in (olds, news)
    accepted = [opaque_id(ack, 4) for ack in station.of("MISSION_ACK") if ack.type == KEPT]
    assert set(accepted) <= {reference.vehicle.transfer.mission_id}
    assert result != KEPT or vehicle.flight.items == news


@given(WEATHER, st.integers(0, 1_000))
@settings(max_examples=12, deadline=None, derandomize=True)
def test_what_is_downloaded_is_what_is_on_board(weather: Weather, seed: int) -> None:
    for name in BOTH:
        station = ground(name, seed=seed)
        rows = legs(6)
        assert station.upload(rows) == KEPT
        clear = station.download()
        station.vehicle.inward.weather = station.vehicle.outward.weather = weather
        assert station.download(within_s=10) in (None, clear)


MESSAGES = st.sampled_from(["count", "item", "list", "request", "request_int", "clear", "ack", "set_current"])


def message_of(station: Ground, kind: str, number: int, small: int) -> Any:
    """Return a message of a kind with some numbers."""
    x, y = at(5, 5)
    makers: dict[str, Callable[[], Any]] = {
        "count": lambda: count(number % 12, small % 3),
        "item": lambda: station.item(number % 5, Row(small, small % 12, x=x, y=y, z=float(number))),
        "list": lambda: dialect.MAVLink_mission_request_list_message(1, 1, small % 3),
        "request": lambda: dialect.MAVLink_mission_request_message(1, 1, number, 0),
        "request_int": lambda: dialect.MAVLink_mission_request_int_message(1, 1, number % 6, 0),
        "clear": lambda: dialect.MAVLink_mission_clear_all_message(1, 1, small % 3),
        "ack": lambda: dialect.MAVLink_mission_ack_message(1, 1, small % 16, 0),
        "set_current": lambda: dialect.MAVLink_mission_set_current_message(1, 1, number % 6),
    }
    return makers[kind]()


@given(st.lists(st.tuples(MESSAGES, st.integers(0, 65_535), st.integers(0, 255)), max_size=30), st.sampled_from(BOTH))
@settings(max_examples=40, deadline=None, derandomize=True)
def test_no_order_of_messages_upsets_it(story: list[tuple[str, int, int]], name: PersonalityName) -> None:
    station = ground(name)
    for kind, number, small in story:
        station.send(message_of(station, kind, number, small))
        station.pass_time(0.05)
    station.pass_time(9)
    assert station.download() is not None
