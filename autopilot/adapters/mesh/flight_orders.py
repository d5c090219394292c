"""Orders of the flight and of the mission, from their form on the wire to what the core judges.

It reads and checks ranges. Words that this node does not know become "unspecified", which the core answers.
"""

from __future__ import annotations

from autopilot.adapters.mesh.reading import Locate, read_place, require_range, require_uuid
from autopilot.trust.verdict import Unreadable
from events.schema import orders_pb2, safety_pb2
from events.schema.orders_pb2 import (
    AcknowledgeSelftestOrder,
    FlyToPlaceOrder,
    FollowPoiOrder,
    MissionOrder,
    MissionVerb,
    OverrideSafetyOrder,
    SetFlightModeOrder,
)
from events.schema.safety_pb2 import FlightMode, OverrideScope
from events.schema.waypoint_pb2 import DeviceCommand

# What an operator may ask for by name; going on with the mission is asked of the mission.
MODES: dict[str, FlightMode.ValueType] = {
    "return": safety_pb2.FLIGHT_MODE_RETURN,
    "loiter": safety_pb2.FLIGHT_MODE_LOITER,
    "guided": safety_pb2.FLIGHT_MODE_GUIDED,
    "land": safety_pb2.FLIGHT_MODE_LAND,
}
SCOPES: dict[str, OverrideScope.ValueType] = {
    "battery_return": safety_pb2.OVERRIDE_BATTERY_RETURN,
    "link_return": safety_pb2.OVERRIDE_LINK_RETURN,
    "fence_return": safety_pb2.OVERRIDE_FENCE_RETURN,
}
VERBS: dict[str, MissionVerb.ValueType] = {
    "begin": orders_pb2.MISSION_BEGIN,
    "pause": orders_pb2.MISSION_PAUSE,
    "resume": orders_pb2.MISSION_RESUME,
    "abort": orders_pb2.MISSION_ABORT,
}
REASON_CHARACTERS = 200  # a sentence that somebody reads later, not a file
HELD_FOR_MS_MAX = 86_400_000  # a day: more is a mistake; what the node allows is less

FlightOrdered = (
    FlyToPlaceOrder
    | SetFlightModeOrder
    | OverrideSafetyOrder
    | AcknowledgeSelftestOrder
    | MissionOrder
    | FollowPoiOrder
)


def read_flight_order(command: DeviceCommand, locate: Locate) -> FlightOrdered | None:
    """Return what is ordered; None for a variant that is none of these. Raises Unreadable naming the field."""
    match command.WhichOneof("command"):
        case "fly_to_waypoint":
            to = command.fly_to_waypoint
            return FlyToPlaceOrder(place=read_place("fly_to_waypoint", to.lat_e7, to.lon_e7, to.altitude_dm, locate))
        case "set_flight_mode":
            return SetFlightModeOrder(mode=MODES.get(command.set_flight_mode.mode))
        case "safety_override":
            return _override(command)
        case "selftest_acknowledge":
            return AcknowledgeSelftestOrder(report_id=command.selftest_acknowledge.report_id)
        case "mission_command":
            return MissionOrder(verb=VERBS.get(command.mission_command.verb))
        case "poi_follow":
            require_uuid("poi_follow.poi_id", command.poi_follow.poi_id)
            return FollowPoiOrder(poi_id=command.poi_follow.poi_id, camera=command.poi_follow.camera or 1)
    return None


def _override(command: DeviceCommand) -> OverrideSafetyOrder:
    asked = command.safety_override
    if len(asked.reason) > REASON_CHARACTERS:
        raise Unreadable(f"safety_override.reason: has more than {REASON_CHARACTERS} characters")
    require_range("safety_override.held_for_ms", asked.held_for_ms, 1, HELD_FOR_MS_MAX)
    return OverrideSafetyOrder(scope=SCOPES.get(asked.scope), reason=asked.reason, held_for_ms=asked.held_for_ms)
