"""Orders of the flight on the wire: as they are composed on the ground, so a node reads them; ranges name the field."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from autopilot.adapters.mesh.flight_orders import HELD_FOR_MS_MAX, REASON_CHARACTERS, read_flight_order
from autopilot.ground import compose
from autopilot.trust.verdict import Unreadable
from events.schema import orders_pb2, safety_pb2
from events.schema.common_pb2 import Place
from events.schema.orders_pb2 import (
    AcknowledgeSelftestOrder,
    FlyToPlaceOrder,
    FollowPoiOrder,
    OverrideSafetyOrder,
)
from events.schema.waypoint_pb2 import DeviceCommand, MissionCommand, SafetyOverride, SetFlightMode
from tests.checks import check_equal

POI = "0190b5a2-0000-8000-8000-000000000001"
MODES = {
    "return": safety_pb2.FLIGHT_MODE_RETURN,
    "loiter": safety_pb2.FLIGHT_MODE_LOITER,
    "guided": safety_pb2.FLIGHT_MODE_GUIDED,
    "land": safety_pb2.FLIGHT_MODE_LAND,
    "mission": safety_pb2.FLIGHT_MODE_UNSPECIFIED,
    "LAND": safety_pb2.FLIGHT_MODE_UNSPECIFIED,
}
SCOPES = {
    "battery_return": safety_pb2.OVERRIDE_BATTERY_RETURN,
    "link_return": safety_pb2.OVERRIDE_LINK_RETURN,
    "fence_return": safety_pb2.OVERRIDE_FENCE_RETURN,
    "battery_land": safety_pb2.OVERRIDE_SCOPE_UNSPECIFIED,
}
VERBS = {
    "begin": orders_pb2.MISSION_BEGIN,
    "pause": orders_pb2.MISSION_PAUSE,
    "resume": orders_pb2.MISSION_RESUME,
    "abort": orders_pb2.MISSION_ABORT,
    "skip": orders_pb2.MISSION_VERB_UNSPECIFIED,
}


def located(latitude_e7: int, longitude_e7: int, altitude_mm: int) -> Place:
    """Return a place with a mark of its own."""
    return Place(latitude_e7=latitude_e7, longitude_e7=longitude_e7, altitude_mm=altitude_mm, mgrs="31U")


def read(command: DeviceCommand) -> Any:
    """Return what a node reads."""
    return read_flight_order(command, located)


def check_unreadable(field: str, command: DeviceCommand) -> None:
    """Check that the error names the field."""
    with pytest.raises(Unreadable, match=f"^{field}: "):
        read(command)


def test_what_is_composed_is_what_is_read() -> None:
    """Each order, with every field of it."""
    place = located(521_000_000, -43_000_000, 120_500)
    check_equal(read(compose.fly(52.1, -4.3, 120.5)), FlyToPlaceOrder(place=place))
    check_equal(read(compose.acknowledge(17)), AcknowledgeSelftestOrder(report_id=17))
    check_equal(read(compose.follow(POI)), FollowPoiOrder(poi_id=POI, camera=1))
    check_equal(read(compose.follow(POI, 2)), FollowPoiOrder(poi_id=POI, camera=2))
    made = OverrideSafetyOrder(scope=SCOPES["fence_return"], reason="landing here", held_for_ms=90_500)
    check_equal(read(compose.override("fence_return", 90.5, "landing here")), made)
    check_equal(read(compose.release()), None)


def test_words_that_are_not_known_are_unspecified() -> None:
    """The core answers them; a mode's name counts letter by letter."""
    for word, mode in MODES.items():
        check_equal(read(DeviceCommand(set_flight_mode=SetFlightMode(mode=word))).mode, mode)
    for word, scope in SCOPES.items():
        asked = DeviceCommand(safety_override=SafetyOverride(scope=word, held_for_ms=1))
        check_equal((read(asked).scope, read(asked).held_for_ms), (scope, 1))
    for word, verb in VERBS.items():
        check_equal(read(DeviceCommand(mission_command=MissionCommand(verb=word))).verb, verb)


@pytest.mark.parametrize(
    ("field", "command"),
    [
        ("fly_to_waypoint.lat_e7", lambda: compose.fly(90.1, 0, 0)),
        ("fly_to_waypoint.lon_e7", lambda: compose.fly(0, -180.1, 0)),
        ("fly_to_waypoint.altitude_dm", lambda: compose.fly(0, 0, 20_001)),
        ("safety_override.held_for_ms", lambda: compose.override("link_return", 0, "")),
        ("safety_override.held_for_ms", lambda: compose.override("link_return", HELD_FOR_MS_MAX / 1000 + 1, "")),
        ("safety_override.reason", lambda: compose.override("link_return", 1, "x" * (REASON_CHARACTERS + 1))),
        ("poi_follow.poi_id", lambda: compose.follow(POI.upper())),
    ],
)
def test_what_cannot_be_read_names_the_field(field: str, command: Callable[[], DeviceCommand]) -> None:
    """Numbers outside their range, texts that are too long, ids that are none."""
    check_unreadable(field, command())


def test_the_bounds_themselves_are_inside() -> None:
    """The longest reason and the longest time."""
    asked = compose.override("link_return", HELD_FOR_MS_MAX / 1000, "x" * REASON_CHARACTERS)
    assert isinstance(read(asked), OverrideSafetyOrder)
