"""Missions, self-tests and failsafes in one line of words each: the part of `describe` that is about flying.

It shows what the record says and concludes nothing from it. Integer formatting only.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from events.schema import mission_pb2, safety_pb2
from events.schema.common_pb2 import Place
from events.schema.mission_pb2 import (
    MissionPlanned,
    MissionProgressReported,
    MissionUnavailable,
    MissionUploaded,
    MissionUploadFailed,
    PostWaypoint,
    PushReported,
    SelftestReported,
)
from events.schema.safety_pb2 import BatteryReported, OverrideBegun, SetVehicleMode
from projections.words import NS_PER_MS, coordinates, metres, scaled, seconds

MODES: dict[int, str] = {
    safety_pb2.FLIGHT_MODE_UNSPECIFIED: "no mode that is known",
    safety_pb2.FLIGHT_MODE_MISSION: "mission",
    safety_pb2.FLIGHT_MODE_LOITER: "loiter",
    safety_pb2.FLIGHT_MODE_GUIDED: "guided",
    safety_pb2.FLIGHT_MODE_RETURN: "return",
    safety_pb2.FLIGHT_MODE_LAND: "land",
}
SCOPES: dict[int, str] = {
    safety_pb2.OVERRIDE_SCOPE_UNSPECIFIED: "nothing that is known",
    safety_pb2.OVERRIDE_BATTERY_RETURN: "the return at low battery",
    safety_pb2.OVERRIDE_LINK_RETURN: "the return after a lost link",
    safety_pb2.OVERRIDE_FENCE_RETURN: "the return at a fence",
}
VERDICTS: dict[int, str] = {
    mission_pb2.SELFTEST_VERDICT_UNSPECIFIED: "not told",
    mission_pb2.SELFTEST_PASS: "pass",
    mission_pb2.SELFTEST_DEGRADED: "degraded",
    mission_pb2.SELFTEST_FAIL: "fail",
    mission_pb2.SELFTEST_SKIPPED: "skipped",
}
_HOLDS: dict[int, str] = {
    mission_pb2.VEHICLE_HOLDS_UNSPECIFIED: "what it has now nobody knows",
    mission_pb2.VEHICLE_HOLDS_OLD: "it has what it had before",
    mission_pb2.VEHICLE_HOLDS_MIXED: "it has a mixture",
    mission_pb2.VEHICLE_HOLDS_NOTHING: "it has none now",
}


def named(names: dict[int, str], number: int) -> str:
    """Return the name of an enumeration's number; a number without one as itself."""
    return names.get(number, str(number))


def _where(place: Place) -> str:
    return coordinates(place.latitude_e7, place.longitude_e7)


def _planned(one: MissionPlanned) -> str:
    craft = "fixed wing" if one.fixed_wing else "multirotor"
    return f"mission {one.mission_id}, {craft}: {len(one.items)} items, {len(one.fences)} fences"


def _unavailable(one: MissionUnavailable) -> str:
    again = "given up" if one.final else "goes on trying"
    return f"no mission: {one.because}; {one.attempts} attempts, {again}"


def _post(one: PostWaypoint) -> str:
    return f"ask the mission office for a waypoint at {_where(one.place)}, finding {one.poi_id}"


def pushed(one: PushReported) -> str:
    """Return what became of a push, in words."""
    took = f"{one.observations} observations and {one.ignored_items} ignored items are with the mission office"
    if not one.because:
        return took
    again = "this flight keeps them" if one.final else "goes on trying"
    return f"{took}, {one.left} are not: {one.because}; {one.attempts} posts, {again}"


def _uploaded(one: MissionUploaded) -> str:
    return f"vehicle took upload {one.effect_seq}: {one.items} items read back, {one.attempts} attempts"


def _upload_failed(one: MissionUploadFailed) -> str:
    return f"vehicle did not take upload {one.effect_seq}: {one.because}; {named(_HOLDS, one.holds)}"


def _progress(one: MissionProgressReported) -> str:
    reached = f", reached {one.reached_item}" if one.HasField("reached_item") else ""
    at = f"at item {one.current_item}" if one.HasField("current_item") else "before the first item"
    return f"vehicle {one.vehicle} is {at}{reached}"


def _tested(one: SelftestReported) -> str:
    odd = [entry for entry in one.items if entry.verdict != mission_pb2.SELFTEST_PASS]
    found = ", ".join(f"{entry.name} {named(VERDICTS, entry.verdict)} ({entry.words})" for entry in odd)
    return f"self-test {one.effect_seq} of vehicle {one.vehicle}: {found or 'all pass'}"


def _mode(one: SetVehicleMode) -> str:
    for_whom = f" for {one.order}" if one.order else ""
    because = f": {one.because}" if one.because else ""
    return f"put vehicle {one.vehicle} into {named(MODES, one.mode)}{for_whom}{because}"


def _battery(one: BatteryReported) -> str:
    charge = f"{one.charge_percent} %" if one.HasField("charge_percent") else "unknown"
    volts = f", {scaled(one.voltage_mv, 3)} V" if one.HasField("voltage_mv") else ""
    return f"battery of vehicle {one.vehicle}: {charge}{volts}"


def _override(one: OverrideBegun) -> str:
    held = seconds(one.held_for_ms * NS_PER_MS)
    return f"{one.callsign or one.principal_id} holds off {named(SCOPES, one.scope)} for {held} s: {one.reason}"


def _of_vehicle(words: str) -> Callable[[Any], str]:
    return lambda one: f"{words} vehicle {one.vehicle}"


WORDS: dict[str, Callable[[Any], str]] = {
    "mission_planned": _planned,
    "mission_unavailable": _unavailable,
    "fetch_mission": _of_vehicle("fetch the mission of"),
    "post_waypoint": _post,
    "waypoint_posted": lambda one: (
        f"the mission office took waypoint {one.effect_seq}"
        if not one.failure
        else f"the mission office did not take waypoint {one.effect_seq}: {one.failure}"
    ),
    "push_observations": lambda one: f"push what was seen in mission {one.mission_id} to the mission office",
    "push_reported": lambda one: f"push {one.effect_seq}: {pushed(one)}",
    "upload_mission": lambda one: f"put {len(one.items)} items of mission {one.mission_id} into vehicle {one.vehicle}",
    "mission_uploaded": _uploaded,
    "mission_upload_failed": _upload_failed,
    "mission_progress_reported": _progress,
    "start_mission": _of_vehicle("start the mission of"),
    "set_mission_item": lambda one: f"vehicle {one.vehicle} shall go on with item {one.item}",
    "arm_vehicle": _of_vehicle("arm"),
    "run_selftest": _of_vehicle("test"),
    "selftest_reported": _tested,
    "set_vehicle_mode": _mode,
    "fly_to_place": lambda one: (
        f"fly vehicle {one.vehicle} to {_where(one.place)}, {metres(one.place.altitude_mm)} m AMSL"
    ),
    "battery_reported": _battery,
    "home_reported": lambda one: f"home of vehicle {one.vehicle} is {_where(one.place)}",
    "operator_heard": lambda one: f"{one.callsign or one.principal_id} is heard",
    "override_begun": _override,
    "property_broken": lambda one: f"this node broke property {one.property} at record {one.at_seq}: {one.words}",
    "override_ended": lambda one: f"{named(SCOPES, one.scope)} is no longer held off: {one.because}",
}
