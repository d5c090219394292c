"""What a table says of a flight that is in danger, as observations and orders: the part of `stories` about failsafes.

battery 24                  what is left; "battery -" where the vehicle does not know
at 10,-4 speed=5,0          metres from the origin, metres a second towards east and north
armed return / disarmed     the vehicle's state; without a mode it is in one that means nothing here
fence in=0,0,90,90 out=...  a plan with rectangles: west, south, east, north in metres; "fence" takes all away
heard bravo                 something authentic of an operator
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from google.protobuf.message import Message

from events.schema import safety_pb2
from events.schema.mission_pb2 import Fence, MissionPlanned
from events.schema.orders_pb2 import OrderReceived, OverrideSafetyOrder
from events.schema.safety_pb2 import (
    BatteryReported,
    OperatorHeard,
    OverrideBegun,
    OverrideEnded,
    OverrideScope,
    SetVehicleMode,
)
from events.schema.vehicle_pb2 import PositionReported, VehicleStateReported
from tests import flights

MODES: dict[str, safety_pb2.FlightMode.ValueType] = {
    "mission": safety_pb2.FLIGHT_MODE_MISSION,
    "loiter": safety_pb2.FLIGHT_MODE_LOITER,
    "guided": safety_pb2.FLIGHT_MODE_GUIDED,
    "return": safety_pb2.FLIGHT_MODE_RETURN,
    "land": safety_pb2.FLIGHT_MODE_LAND,
}
SAFE_LIMITS: dict[str, Any] = {
    "flight_enabled": True,
    "flight_roles": ["flight"],
    "battery_return_percent": 25,
    "battery_land_percent": 15,
    "operator_degraded_ms": 5_000,
    "operator_lost_ms": 30_000,
    "operator_lost_following_ms": 30_000,
    "failsafe_again_ms": 5_000,
    "fence_ahead_ms": 2_000,
    "override_longest_ms": 600_000,
}
READ = ("battery", "spot", "flies", "grounded", "fence", "heard")


def observed(verb: str, plain: Sequence[str], named: dict[str, str]) -> Message:
    """Return the observation that the words name."""
    match verb:
        case "battery":
            charge = None if plain[0] == "-" else int(plain[0])
            return BatteryReported(vehicle=1, charge_percent=charge, voltage_mv=22_000)
        case "spot":
            return _position(plain[0], named.get("speed", "0,0"))
        case "fence":
            return planned(named)
        case "heard":
            return OperatorHeard(principal_id=plain[0], callsign=plain[0].upper())
    return state(verb == "flies", plain[0] if plain else "")


def state(armed: bool, mode: str = "") -> VehicleStateReported:
    """Return the vehicle's state, in a mode of this house or in another."""
    report = VehicleStateReported(vehicle=1, system_id=1, autopilot=3, vehicle_type=2, armed=armed, custom_mode=4)
    if mode:
        report.flight_mode = MODES[mode]
    return report


def planned(named: dict[str, str]) -> MissionPlanned:
    """Return a plan with rectangular fences, and nothing to fly."""
    fences = [
        Fence(inclusion=name.startswith("in"), vertices=_corners(*_numbers(words))) for name, words in named.items()
    ]
    return MissionPlanned(vehicle=1, mission_id="m", revision="1", fences=fences)


def override(command_id: str, scope: str, named: dict[str, str], **values: Any) -> OrderReceived:
    """Return an order to hold a failsafe off: "battery" for 60 s unless told otherwise."""
    number = getattr(safety_pb2, f"OVERRIDE_{scope.upper()}_RETURN", safety_pb2.OVERRIDE_SCOPE_UNSPECIFIED)
    held_for_ms = round(1000 * float(named.get("for", 60)))
    asked = OverrideSafetyOrder(scope=number, reason=named.get("because", "why"), held_for_ms=held_for_ms)
    values.setdefault("roles", ("flight",))
    return flights.received(command_id, override_safety=asked, **values)


def safety_words(message: Message) -> str | None:
    """Return a decision about safety in words; None for another, also for a mode that the mission or an order asks."""
    match message:
        case SetVehicleMode(mode=mode, because=because) if because and not because.startswith("mission: "):
            return f"{safety_pb2.FlightMode.Name(mode).removeprefix('FLIGHT_MODE_').lower()}: {because}"
        case OverrideBegun(callsign=who, scope=scope, reason=reason, held_for_ms=held_ms):
            return f"{who} holds {_scope(scope)} {held_ms / 1000:g} s: {reason}"
        case OverrideEnded(scope=scope, because=because):
            return f"{_scope(scope)}: {because}"
    return None


def _scope(number: int) -> str:
    name = OverrideScope.Name(number)  # type: ignore[arg-type]
    return name.removeprefix("OVERRIDE_").removesuffix("_RETURN").lower()


def _position(where: str, speed: str) -> PositionReported:
    report = flights.position(*_numbers(where))
    report.east_mm_s, report.north_mm_s = _numbers(speed)
    return report


def _numbers(words: str) -> list[int]:
    return [round(1000 * float(one)) for one in words.split(",")]


def _corners(west: int, south: int, east: int, north: int) -> list[Any]:
    return [flights.place(*one) for one in ((west, south), (east, south), (east, north), (west, north))]
