"""How the chart `mission` changes its part of the state. The rows are in `mission.py`."""

from __future__ import annotations

from typing import Any

from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.mission_pb2 import MissionPlanned, MissionProgressReported, PostWaypoint, WaypointPosted
from events.schema.safety_pb2 import SetVehicleMode
from statecharts.charts.mission import CHART, MAY_BEGIN
from statecharts.facts import Mission
from statecharts.part import Evolve
from statecharts.state import State

NS_PER_MS = 1_000_000
VEHICLE = 1
# The adapter answers within the life of an effect; this much later the core stops waiting for it.
OUTCOME_GRACE_MS = 5_000
HOMEWARD = (20, 21)  # MAV_CMD_NAV_RETURN_TO_LAUNCH, MAV_CMD_NAV_LAND
ASKING = ("readying", "arming", "engaging", "starting", "aborting", "landed")  # what waits for mission_step_ms


def mission(state: State) -> Mission:
    """Return how far the mission of the vehicle got."""
    return state.missions.get(VEHICLE) or Mission()


def _put(state: State, /, **changes: Any) -> None:
    state.missions.put(VEHICLE, mission(state)._replace(**changes))


def _plan(state: State, record: Record) -> None:
    plan = record.message
    assert isinstance(plan, MissionPlanned)
    state.plans.put(VEHICLE, plan)


def _ask(state: State, record: Record) -> None:
    _put(state, effect_seq=record.seq)


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
    changes: dict[str, Any] = {"state": change.to_state, "tries": 0}
    if change.to_state == change.from_state:
        changes["tries"] = mission(state).tries + 1
    if change.to_state == "flying":
        changes["flown"] = True
    if change.to_state in ("checking", "idle"):
        changes |= {"flown": False, "next_item": 0, "middle_item": -1}
    if change.to_state == "done" and mission(state).flown:
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
    limits = state.flight.limits
    waits_ms = {"uploading": limits.upload_ms + OUTCOME_GRACE_MS} | dict.fromkeys(ASKING, limits.mission_step_ms)
    if change.to_state in waits_ms:
        until_ns = record.at.flight_ns + waits_ms[change.to_state] * NS_PER_MS
        state.deadlines.put((CHART.name, change.instance), until_ns)
    else:
        state.deadlines.drop((CHART.name, change.instance))


EVOLVE: dict[str, Evolve] = {
    "mission_planned": _plan,
    "fetch_mission": _ask,
    "upload_mission": _ask,
    "arm_vehicle": _ask,
    "start_mission": _ask,
    "set_vehicle_mode": _ask_mode,
    "post_waypoint": _post,
    "waypoint_posted": _posted,
    "mission_progress_reported": _progress,
    "moved": _apply_move,
}
