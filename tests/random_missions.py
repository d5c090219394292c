"""Missions by chance, for `random_flights`: plans, tests, uploads, progress, modes, charges and orders of the flight.

"onwards" tells what leads on from where the mission is, so that flights of chance get into the air; the rest is told
at any time. Nothing here checks anything.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from google.protobuf.message import Message

from events.schema import safety_pb2
from events.schema.mission_pb2 import Fence, MissionProgressReported, MissionUnavailable
from events.schema.orders_pb2 import OverrideSafetyOrder
from events.schema.safety_pb2 import BatteryReported
from events.schema.vehicle_pb2 import VehicleStateReported
from tests import flying
from tests.flights import Flight, place, received
from tests.stories_of_safety import SAFE_LIMITS

LIMITS: dict[str, Any] = flying.LIMITS | SAFE_LIMITS | {"flight_roles": ["camera"]}
ITEMS = ("takeoff,go,go,home", "takeoff,go,land", "go,go")
MODES = ("mission", "mission", "guided", "loiter", "return", "land")
VERDICTS = ("pass", "pass,degraded", "fail", "skipped,pass")
WHO = ("alpha", "bravo", "viewer")


def _planned(_flight: Flight, one: int, two: int, three: int) -> Message:
    """Return a plan with up to two fences: an inclusion, and an exclusion in it."""
    corners = [[(-9_000, -9_000), (9_000 * one, -9_000), (9_000, 9_000)], [(two, 0), (two + 900, 0), (two, 900)]]
    fences = [
        Fence(inclusion=number == 0, vertices=[place(*corner) for corner in fence])
        for number, fence in enumerate(corners[: three % 3])
    ]
    return flying.planned("abc"[one % 3], ITEMS[two % 3], fences=fences, fixed_wing=three > 4)


def _asked(flight: Flight, one: int, two: int, three: int) -> Message:
    """Return an order of the flight or its mission, or one that holds a failsafe off."""
    who, name = WHO[one % 3], f"m{len(flight.records)}"
    roles, order_seq = ("viewer",) if one % 3 == 2 else ("camera",), 100 + len(flight.records)
    values: dict[str, Any] = {"roles": roles, "who": who, "order_seq": order_seq}
    if three == 5:
        scope = (safety_pb2.OVERRIDE_BATTERY_RETURN, safety_pb2.OVERRIDE_FENCE_RETURN)[two % 2]
        override = OverrideSafetyOrder(scope=scope, reason="why", held_for_ms=1_000 * (1 + two))
        return received(name, override_safety=override, **values)
    verb = (*flying.VERBS, "fly", "go-into")[(two + three) % 6]
    return flying.asked(name, verb, ["loiter"], {"to": f"{one},{three}"}, values)


def _state(_flight: Flight, one: int, two: int, _three: int) -> VehicleStateReported:
    return flying.state(MODES[two % 6] if one else "none", armed=one > 1)


def _onwards(flight: Flight, one: int, two: int, three: int) -> Message:
    """Return what leads on from where the mission is."""
    mission = flight.state.missions.get(1)
    match "idle" if mission is None else mission.state:
        case "selftest":
            return flying.reported(flight.records, "pass")
        case "ready":
            return flying.asked(f"b{len(flight.records)}", "begin", [], {}, {"roles": ("camera",), "order_seq": 90})
        case "uploading":
            return flying.READERS["uploaded"](flight.records, [], {})
        case "readying" | "starting":
            return flying.READERS["did"](flight.records, ["0"], {})
        case "arming" | "waiting_for_pilot":
            return flying.state("guided")
        case "engaging" | "flying" | "following" | "paused":
            return flying.state("mission") if two else _progress(flight, one, two, three)
        case "returning" | "aborting" | "landed":
            return flying.state(armed=False)
    vehicle = flight.state.vehicles.get(1)
    if vehicle is not None and vehicle.armed:
        return flying.state(armed=False)
    return _planned(flight, one, two, three)


def _progress(_flight: Flight, one: int, two: int, _three: int) -> MissionProgressReported:
    return MissionProgressReported(vehicle=1, current_item=one, reached_item=two)


def times(what: str, three: int) -> int:
    """Return how often a draw is told: what leads onwards up to eleven times, so that some flights fly; no wait is."""
    return {"wait": 0, "onwards": 1 + 2 * three}.get(what, 1)


Make = Callable[[Flight, int, int, int], Message]
MAKE: dict[str, Make] = {
    "onwards": _onwards,
    "planned": _planned,
    "unavailable": lambda _flight, one, two, _three: MissionUnavailable(because="gone", attempts=one, final=two > 2),
    "report": lambda flight, one, _two, _three: flying.reported(flight.records, VERDICTS[one % 4]),
    "uploaded": lambda flight, _one, _two, _three: flying.READERS["uploaded"](flight.records, [], {}),
    "upload_failed": lambda flight, _one, _two, _three: flying.READERS["not-uploaded"](flight.records, [], {}),
    "progress": _progress,
    "asked": _asked,
    "state": _state,
    "did": lambda flight, one, _two, _three: flying.READERS["did"](flight.records, ["0045"[one % 4]], {}),
    "battery": lambda _flight, one, two, _three: BatteryReported(
        vehicle=1, charge_percent=10 * one + two, voltage_mv=22_000
    ),
}
LIKELY = ("onwards", "onwards", "onwards", "asked", "state")
