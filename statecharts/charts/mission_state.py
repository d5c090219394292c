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
    MissionUploadFailed,
    PostWaypoint,
    WaypointPosted,
)
from events.schema.safety_pb2 import (
    FLIGHT_MODE_LAND,
    FLIGHT_MODE_LOITER,
    FLIGHT_MODE_MISSION,
    FLIGHT_MODE_RETURN,
    SetVehicleMode,
)
from events.schema.vehicle_pb2 import CommandAnswered, CommandUnanswered, VehicleLinkChanged, VehicleStateReported
from statecharts.charts.mission import CHART, MAY_BEGIN
from statecharts.facts import Mission, Vehicle
from statecharts.part import Evolve
from statecharts.state import State
from statecharts.words import MAV_RESULTS

NS_PER_MS = 1_000_000
VEHICLE = 1
_KEY = (CHART.name, str(VEHICLE))  # of the mission's deadline
# The adapter answers within the life of an effect; this much later the core stops waiting for it.
OUTCOME_GRACE_MS = 5_000
GOING_ON = (0, 5)  # MAV_RESULT accepted, in progress
HOMEWARD = (20, 21)  # MAV_CMD_NAV_RETURN_TO_LAUNCH, MAV_CMD_NAV_LAND
ASKING = ("uploading", "readying", "arming", "engaging", "starting", "aborting")  # what waits for the vehicle
COMPLYING = (FLIGHT_MODE_RETURN, FLIGHT_MODE_LAND)  # what an aborted mission waits for
OWN_MODES = (FLIGHT_MODE_MISSION, FLIGHT_MODE_RETURN)  # in which only a command of this node stops the vehicle
_HAVING = ("engaging", "starting", "returning", "paused")  # in which it has the vehicle before that was seen to fly


def mission(state: State) -> Mission:
    """Return how far the mission of the vehicle got."""
    return state.missions.get(VEHICLE) or Mission()


def is_lingering(state: State) -> bool:
    """Whether the vehicle was told to leave its mode as this state was entered, and was not seen in another yet.

    While the mission waits for it, that is: after a silence of the vehicle it is believed as it is.
    """
    mode = (state.vehicles.get(VEHICLE) or Vehicle()).flight_mode
    return mode in OWN_MODES and mode == mission(state).entered_mode and _KEY in state.deadlines


def must_be_stopped(state: State) -> bool:
    """Whether the vehicle is where only a command of this node stops it, and by its doing: a pilot's is left alone."""
    vehicle, now = state.vehicles.get(VEHICLE) or Vehicle(), mission(state)
    return vehicle.armed and vehicle.flight_mode in OWN_MODES and (now.flown or now.state in _HAVING)


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
        _aim_at_middle(state)


def _ask_mode(state: State, record: Record) -> None:
    effect = record.message
    assert isinstance(effect, SetVehicleMode)
    if effect.order:
        return  # what an operator orders beside the mission is not the mission's
    _put(state, effect_seq=record.seq)
    if effect.mode == FLIGHT_MODE_LOITER and mission(state).state == "paused":
        _wait_a_step(state, record)  # it may not have heard it


def _post(state: State, record: Record) -> None:
    posted = record.message
    assert isinstance(posted, PostWaypoint)
    _put(state, middle_item=posted.before_item, middle_seq=record.seq, middle_ahead=False)


def _posted(state: State, record: Record) -> None:
    posted = record.message
    assert isinstance(posted, WaypointPosted)
    if posted.failure and posted.effect_seq == mission(state).middle_seq:
        _put(state, middle_item=-1)


def has_middle(state: State) -> bool:
    """Whether the newest plan is the one that has the waypoint that was asked for in the middle."""
    plan, now = state.plans.get(VEHICLE), mission(state)
    return now.middle_item >= 0 and plan is not None and plan.effect_seq == now.middle_seq


def _aim_at_middle(state: State) -> None:
    """Let a vehicle that holds the plan with the waypoint in the middle go there, also where it is past its number.

    Until now the numbers were of the plan before. Where the office was slow the vehicle turns back for it: somebody
    wants to look at what is there.
    """
    now = mission(state)
    if has_middle(state):
        ahead = now.next_item <= now.middle_item
        _put(state, middle_ahead=ahead, next_item=min(now.next_item, now.middle_item))


def _progress(state: State, record: Record) -> None:
    """Take the farther of what was reached and what is flown to: ArduPilot does not name every item it reaches.

    A waypoint in the middle that was passed while the mission was at something else is not waited at any more.
    """
    report = record.message
    assert isinstance(report, MissionProgressReported)
    reached = report.reached_item + 1 if report.HasField("reached_item") else 0
    current = report.current_item if report.HasField("current_item") else 0
    item, now = max(reached, current), mission(state)
    _put(state, next_item=item)
    if not (has_middle(state) and now.held_seq > now.plan_seq):
        return
    if item <= now.middle_item:
        _put(state, middle_ahead=True)
    elif now.middle_ahead and now.state != "flying":
        _put(state, middle_item=-1)


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
    changes: dict[str, Any] = {"state": change.to_state, "tries": 0, "refusal": "", "entered_mode": vehicle.flight_mode}
    if change.to_state == change.from_state:
        changes["tries"] = mission(state).tries + 1
    if change.to_state == "flying":
        changes["flown"] = True
    if change.from_state == "following" != change.to_state:
        changes["middle_item"] = -1  # it was waited there
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
        state.deadlines.drop(_KEY)  # nothing is asked until the vehicle is heard
    elif change.to_state in ("uploading", "syncing"):
        limits = state.flight.limits
        life_ms = limits.upload_ms if change.to_state == "uploading" else limits.push_ms
        state.deadlines.put(_KEY, record.at.flight_ns + (life_ms + OUTCOME_GRACE_MS) * NS_PER_MS)
    elif change.to_state in (*ASKING, "landed"):
        _wait_a_step(state, record)
    else:
        state.deadlines.drop(_KEY)


def _wait_a_step(state: State, record: Record) -> None:
    state.deadlines.put(_KEY, record.at.flight_ns + state.flight.limits.mission_step_ms * NS_PER_MS)


def _silent(state: State, record: Record) -> None:
    """Wait for no answer of a vehicle that is not heard: it is asked again when it is."""
    change = record.message
    here = isinstance(change, NodeStarted) or (isinstance(change, VehicleLinkChanged) and change.vehicle == VEHICLE)
    if (
        here
        and not (isinstance(change, VehicleLinkChanged) and change.up)
        and mission(state).state in (*ASKING, "paused")
    ):
        state.deadlines.drop(_KEY)


def _started(state: State, record: Record) -> None:
    """Forget what was to come of before the start: a waypoint that is not in the plan, an order on the ground.

    Nobody waits for the office's answer any more; asked anew, it would have the waypoint twice. The order to begin was
    given to what was there before.
    """
    _silent(state, record)
    if mission(state).middle_item >= 0 and not has_middle(state):
        _put(state, middle_item=-1)
    vehicle = state.vehicles.get(VEHICLE)
    if mission(state).begun and not (vehicle is not None and vehicle.armed):
        _put(state, begun=False)


def _reported(state: State, record: Record) -> None:
    """Wait no longer for a vehicle that is seen to hold or to return, and again where it no longer returns."""
    report, now = record.message, mission(state)
    assert isinstance(report, VehicleStateReported)
    if report.vehicle != VEHICLE:
        return
    if now.entered_mode == FLIGHT_MODE_RETURN != report.flight_mode:
        _put(state, entered_mode=report.flight_mode)  # it has stopped returning: when it returns again, it means it
    if now.state == "paused" and not (report.armed and report.flight_mode == now.entered_mode):
        state.deadlines.drop(_KEY)  # whatever it does now it says by itself
    if now.state == "aborting" and report.flight_mode in COMPLYING:
        state.deadlines.drop(_KEY)
    elif now.state == "aborting" and _KEY not in state.deadlines:
        _wait_a_step(state, record)


def _refused(state: State, record: Record) -> None:
    """Note that the present step was refused, and in which words; an upload is tried again sooner than its time."""
    outcome, words = record.message, ""
    assert isinstance(outcome, CommandAnswered | CommandUnanswered | MissionUploadFailed)
    if isinstance(outcome, CommandUnanswered | MissionUploadFailed):
        words = outcome.because
    elif outcome.mav_result not in GOING_ON:
        words = MAV_RESULTS.get(outcome.mav_result, f"MAV_RESULT {outcome.mav_result}")
    if not words or outcome.effect_seq != mission(state).effect_seq:
        return
    _put(state, refusal=words)
    if isinstance(outcome, MissionUploadFailed) and _KEY in state.deadlines:
        _wait_a_step(state, record)


EVOLVE: dict[str, Evolve] = {
    "mission_planned": _plan,
    "fetch_mission": _ask,
    "upload_mission": _ask_upload,
    "mission_uploaded": _uploaded,
    "mission_upload_failed": _refused,
    "command_answered": _refused,
    "command_unanswered": _refused,
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
