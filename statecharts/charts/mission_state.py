"""How the chart `mission` changes its part of the state. The rows are in `mission.py`."""

from __future__ import annotations

from typing import Any

from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import NodeStarted
from events.schema.mission_pb2 import (
    MissionPlanned,
    MissionProgressReported,
    MissionUploaded,
    PostWaypoint,
    WaypointPosted,
)
from events.schema.safety_pb2 import FLIGHT_MODE_LAND, FLIGHT_MODE_MISSION, FLIGHT_MODE_RETURN, SetVehicleMode
from events.schema.vehicle_pb2 import VehicleLinkChanged, VehicleStateReported
from statecharts.charts.mission import CHART, MAY_BEGIN
from statecharts.facts import Mission, Vehicle
from statecharts.part import Evolve
from statecharts.state import State

NS_PER_MS = 1_000_000
VEHICLE = 1
# The adapter answers within the life of an effect; this much later the core stops waiting for it.
OUTCOME_GRACE_MS = 5_000
HOMEWARD = (20, 21)  # MAV_CMD_NAV_RETURN_TO_LAUNCH, MAV_CMD_NAV_LAND
ASKING = ("uploading", "readying", "arming", "engaging", "starting", "aborting")  # what waits for the vehicle
COMPLYING = (FLIGHT_MODE_RETURN, FLIGHT_MODE_LAND)  # what an aborted mission waits for


def mission(state: State) -> Mission:
    """Return how far the mission of the vehicle got."""
    return state.missions.get(VEHICLE) or Mission()


def _put(state: State, /, **changes: Any) -> None:
    state.missions.put(VEHICLE, mission(state)._replace(**changes))


def _plan(state: State, record: Record) -> None:
    plan = record.message
    assert isinstance(plan, MissionPlanned)
    state.plans.put(VEHICLE, plan)
    _put(state, plan_seq=record.seq)


def _ask(state: State, record: Record) -> None:
    _put(state, effect_seq=record.seq)


def _ask_upload(state: State, record: Record) -> None:
    _put(state, effect_seq=record.seq, held_seq=-1)


def _uploaded(state: State, record: Record) -> None:
    uploaded = record.message
    assert isinstance(uploaded, MissionUploaded)
    if uploaded.effect_seq == mission(state).effect_seq:
        _put(state, held_seq=uploaded.effect_seq)


def _ask_mode(state: State, record: Record) -> None:
    effect = record.message
    assert isinstance(effect, SetVehicleMode)
    if not effect.order:  # what an operator orders beside the mission is not the mission's
        _put(state, effect_seq=record.seq)


def _post(state: State, record: Record) -> None:
    posted = record.message
    assert isinstance(posted, PostWaypoint)
    _put(state, middle_item=posted.before_item)


def _posted(state: State, record: Record) -> None:
    posted = record.message
    assert isinstance(posted, WaypointPosted)
    if posted.failure:
        _put(state, middle_item=-1)


def _progress(state: State, record: Record) -> None:
    """Take the farther of what was reached and what is flown to: ArduPilot does not name every item it reaches."""
    report = record.message
    assert isinstance(report, MissionProgressReported)
    reached = report.reached_item + 1 if report.HasField("reached_item") else 0
    current = report.current_item if report.HasField("current_item") else 0
    _put(state, next_item=max(reached, current))


def _apply_move(state: State, record: Record) -> None:
    change = record.message
    assert isinstance(change, Moved)
    if change.chart == "command":
        _note_beginning(state, change)
    elif change.chart == "scan" and change.from_state == "following" != change.to_state:
        _put(state, middle_item=-1)
    if change.chart != CHART.name:
        return
    vehicle = state.vehicles.get(VEHICLE) or Vehicle()
    changes: dict[str, Any] = {"state": change.to_state, "tries": 0, "entered_mode": vehicle.flight_mode}
    if change.to_state == change.from_state:
        changes["tries"] = mission(state).tries + 1
    if change.to_state == "flying":
        changes["flown"] = True
    if change.to_state in ("checking", "idle"):
        changes |= {"flown": False, "next_item": 0, "middle_item": -1}
    if change.to_state in ("syncing", "done") and mission(state).flown:
        changes |= {"begun": False, "flown_revision": state.plans[VEHICLE].revision}
    if change.to_state == "aborted":
        changes["begun"] = False
    _put(state, **changes)
    _wait(state, record, change)


def _note_beginning(state: State, change: Moved) -> None:
    """Note the order to begin, also where the self-test still runs."""
    if change.to_state != "accepted":
        return
    order = state.orders[change.instance]
    if order.verb == "mission" and order.asked == "begin" and mission(state).state in MAY_BEGIN:
        _put(state, begun=True)


def _wait(state: State, record: Record, change: Moved) -> None:
    if change.to_state in ASKING and not (state.vehicles.get(VEHICLE) or Vehicle()).link:
        state.deadlines.drop((CHART.name, change.instance))  # nothing is asked until the vehicle is heard
    elif change.to_state in (*ASKING, "landed", "syncing") or (change.to_state == "paused" and _flies(state)):
        _wait_from(state, record.at.flight_ns, change.to_state)
    else:
        state.deadlines.drop((CHART.name, change.instance))


def _flies(state: State) -> bool:
    """Whether the vehicle flies the mission: one that is paused then was told to hold, and may not have heard it."""
    vehicle = state.vehicles.get(VEHICLE) or Vehicle()
    return vehicle.armed and vehicle.link and vehicle.flight_mode == FLIGHT_MODE_MISSION


def _wait_from(state: State, now_ns: int, name: str) -> None:
    limits = state.flight.limits
    lives_ms = {"uploading": limits.upload_ms, "syncing": limits.push_ms}
    wait_ms = lives_ms[name] + OUTCOME_GRACE_MS if name in lives_ms else limits.mission_step_ms
    state.deadlines.put((CHART.name, str(VEHICLE)), now_ns + wait_ms * NS_PER_MS)


def _silent(state: State, record: Record) -> None:
    """Wait for no answer of a vehicle that is not heard: it is asked again when it is."""
    change = record.message
    here = isinstance(change, NodeStarted) or (isinstance(change, VehicleLinkChanged) and change.vehicle == VEHICLE)
    if (
        here
        and not (isinstance(change, VehicleLinkChanged) and change.up)
        and mission(state).state in (*ASKING, "paused")
    ):
        state.deadlines.drop((CHART.name, str(VEHICLE)))


def _started(state: State, record: Record) -> None:
    """Forget the order to begin where nothing flies: it was given to what was there before the start."""
    _silent(state, record)
    vehicle = state.vehicles.get(VEHICLE)
    if mission(state).begun and not (vehicle is not None and vehicle.armed):
        _put(state, begun=False)


def _reported(state: State, record: Record) -> None:
    """Wait no longer for a vehicle that is seen to return, and again where it no longer is."""
    report = record.message
    assert isinstance(report, VehicleStateReported)
    key, now = (CHART.name, str(VEHICLE)), mission(state).state
    if report.vehicle == VEHICLE and now == "paused":
        state.deadlines.drop(key)  # whatever it does now it says by itself
    if report.vehicle != VEHICLE or now != "aborting":
        return
    if report.flight_mode in COMPLYING:
        state.deadlines.drop(key)
    elif key not in state.deadlines:
        _wait_from(state, record.at.flight_ns, "aborting")


EVOLVE: dict[str, Evolve] = {
    "mission_planned": _plan,
    "fetch_mission": _ask,
    "upload_mission": _ask_upload,
    "mission_uploaded": _uploaded,
    "vehicle_state_reported": _reported,
    "vehicle_link_changed": _silent,
    "node_started": _started,
    "arm_vehicle": _ask,
    "start_mission": _ask,
    "push_observations": _ask,
    "set_vehicle_mode": _ask_mode,
    "post_waypoint": _post,
    "waypoint_posted": _posted,
    "mission_progress_reported": _progress,
    "moved": _apply_move,
}
