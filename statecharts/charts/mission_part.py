"""What the chart `mission` says. The rows are in `mission.py`, the changes of state in `mission_state.py`."""

from __future__ import annotations

from google.protobuf.message import Message

from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.mission_pb2 import (
    ArmVehicle,
    FetchMission,
    MissionPlanned,
    MissionUnavailable,
    MissionUploaded,
    MissionUploadFailed,
    PostWaypoint,
    PushObservations,
    PushReported,
    SetMissionItem,
    StartMission,
    UploadMission,
)
from events.schema.safety_pb2 import (
    FLIGHT_MODE_GUIDED,
    FLIGHT_MODE_LOITER,
    FLIGHT_MODE_MISSION,
    FLIGHT_MODE_RETURN,
    FlightMode,
    SetVehicleMode,
)
from events.schema.vehicle_pb2 import CommandAnswered, CommandUnanswered, PointAtAngles, VehicleLinkChanged
from statecharts.charts.link import followings
from statecharts.charts.mission import CHART
from statecharts.charts.mission_guards import Facts
from statecharts.charts.mission_state import (
    EVOLVE,
    HOMEWARD,
    VEHICLE,
    has_middle,
    is_lingering,
    mission,
    must_be_stopped,
)
from statecharts.charts.safety_part import failsafe_flies
from statecharts.charts.selftest import selftest
from statecharts.facts import Vehicle
from statecharts.part import Part
from statecharts.state import State
from statecharts.table import Answer, moved

MAV_ACCEPTED, MAV_IN_PROGRESS = 0, 5
_OF_THE_OFFICE = ("checking", "syncing")  # states that ask the mission office, not the vehicle
_STOPPING = ("pause", "time_passed", "refused", "upload_failed")  # into a pause; else somebody has the vehicle


def decide(state: State, record: Record) -> tuple[Message, ...]:
    """Return the mission's move, and the effects that the state it moves to asks for."""
    trigger = _trigger(state, record)
    if not trigger:
        return ()
    row = CHART.ask(mission(state).state, trigger, _facts(state, record))
    if row.answer is not Answer.MOVE:
        return ()
    if row.target == row.source == "flying":
        return (moved(CHART, str(VEHICLE), row), _post(state))
    may = row.target in _OF_THE_OFFICE or _may_command(state)
    effects = _effects(state, trigger, row.target, row.because) if may else ()
    change = moved(CHART, str(VEHICLE), row)
    if trigger in ("refused", "upload_failed"):
        change.because += f": {mission(state).refusal}"
    return (change, *effects)


def _may_command(state: State) -> bool:
    """Whether the vehicle is heard and no failsafe is bringing it down: then it is asked for nothing else."""
    vehicle = state.vehicles.get(VEHICLE)
    return vehicle is not None and vehicle.link and not failsafe_flies(state, VEHICLE)


def _trigger(state: State, record: Record) -> str:
    """Return what a record means to this chart; "" for nothing."""
    match record.message:
        case Moved() as change:
            return _heard(state, change)
        case VehicleLinkChanged(vehicle=vehicle, up=up):
            return "linked" if up and vehicle == VEHICLE else ""
        case CommandAnswered() | CommandUnanswered() as outcome:
            return _outcome(state, outcome)
        case MissionUploaded(effect_seq=seq) | MissionUploadFailed(effect_seq=seq):
            own = seq == mission(state).effect_seq
            return {"mission_uploaded": "uploaded"}.get(record.kind.name, "upload_failed") if own else ""
        case PushReported() as report:
            return _push(state, report)
        case SetVehicleMode(order=order):
            return "" if order else "failsafe"
    if record.kind.name == "time_passed":
        return "time_passed" if state.passed(CHART.name, record.at.flight_ns) else ""
    return _TRIGGERS[record.kind.name]


_TRIGGERS = {
    "node_started": "node_started",
    "mission_planned": "planned",
    "mission_unavailable": "unavailable",
    "vehicle_state_reported": "reported",
    "mission_progress_reported": "progressed",
}


def _heard(state: State, change: Moved) -> str:
    """Return what another chart's move means here."""
    if change.chart == "selftest":
        return "tested" if change.to_state == "passed" else ""
    if change.chart == "scan":
        began, ended = change.to_state == "following", change.from_state == "following"
        return "follow_began" if began and not ended else "follow_ended" if ended and not began else ""
    if change.chart != "command" or change.to_state != "accepted":
        return ""
    order = state.orders[change.instance]
    return order.asked if order.verb == "mission" else ""


def _outcome(state: State, outcome: CommandAnswered | CommandUnanswered) -> str:
    if outcome.effect_seq != mission(state).effect_seq:
        return ""
    if isinstance(outcome, CommandUnanswered):
        return "refused"
    if outcome.mav_result == MAV_IN_PROGRESS:
        return ""
    return "accepted" if outcome.mav_result == MAV_ACCEPTED else "refused"


def _push(state: State, report: PushReported) -> str:
    if report.effect_seq != mission(state).effect_seq:
        return ""
    return "not_pushed" if report.because else "pushed"


def _facts(state: State, record: Record) -> Facts:
    limits, now = state.flight.limits, mission(state)
    vehicle = state.vehicles.get(VEHICLE) or Vehicle()
    plan = state.plans.get(VEHICLE)
    message = record.message
    item = plan.items[now.next_item] if plan is not None and now.next_item < len(plan.items) else None
    begins_alone = not limits.mission_begun_by_order
    return Facts(
        enabled=limits.mission_enabled,
        tested=plan is not None and selftest(state).state == "passed",
        may_begin=(begins_alone or now.begun) and not vehicle.armed,
        flown_already=begins_alone and not now.begun and plan is not None and plan.revision == now.flown_revision,
        pilot=limits.pilot_starts or (plan is not None and plan.fixed_wing),
        last_try=now.tries + 1 >= limits.mission_tries,
        refused=bool(now.refusal),
        final=not isinstance(message, MissionUnavailable | PushReported) or message.final,
        armed=vehicle.armed,
        mode=vehicle.flight_mode,
        flown=now.flown,
        holds_plan=now.held_seq > now.plan_seq,
        lingers=is_lingering(state),
        failsafe=failsafe_flies(state, VEHICLE),
        left_mission=now.entered_mode == FLIGHT_MODE_MISSION != vehicle.flight_mode,
        homeward=item is not None and item.command in HOMEWARD,
        at_middle=now.middle_ahead and has_middle(state) and now.middle_item < now.next_item,
        followed=any(followings(state)),
        by_waypoint=limits.follow_by_waypoint and now.middle_item < 0 and item is not None,
        pushes=limits.push_ms > 0,
    )


def _effects(state: State, trigger: str, target: str, because: str) -> tuple[Message, ...]:
    """Return what is to be done on entering a state; the last of them is what the state waits for."""
    limits, now = state.flight.limits, mission(state)
    life_ms = limits.own_command_life_ms
    match target:
        case "checking":
            return (FetchMission(vehicle=VEHICLE),)
        case "uploading":
            plan = _plan(state)
            life_ms, mission_id = limits.upload_ms, plan.mission_id
            return (UploadMission(vehicle=VEHICLE, mission_id=mission_id, items=plan.items, life_ms=life_ms),)
        case "readying":
            return (_mode(FLIGHT_MODE_GUIDED, because, life_ms),)
        case "arming":
            return (ArmVehicle(vehicle=VEHICLE, life_ms=life_ms),)
        case "engaging":
            item = SetMissionItem(vehicle=VEHICLE, item=now.next_item, life_ms=life_ms)
            mode = _mode(FLIGHT_MODE_MISSION, because, life_ms)
            return (item, mode) if now.flown else (mode,)
        case "starting":
            return (StartMission(vehicle=VEHICLE, life_ms=life_ms),)
        case "flying" if not now.flown:
            return _look_down(state)
        case "following":
            return (_mode(FLIGHT_MODE_LOITER, because, life_ms),)
        case "paused" if trigger in _STOPPING and must_be_stopped(state):
            return (_mode(FLIGHT_MODE_LOITER, because, life_ms),)
        case "aborting":
            return (_mode(FLIGHT_MODE_RETURN, because, life_ms),)
        case "syncing":
            return (PushObservations(vehicle=VEHICLE, mission_id=_plan(state).mission_id, life_ms=limits.push_ms),)
    return ()


def _look_down(state: State) -> tuple[Message, ...]:
    """Turn the cameras that nobody holds as the mission was planned for."""
    limits = state.flight.limits
    free = (one for one in state.cameras.values() if one.state == "automatic" and one.gimbal)
    return tuple(
        PointAtAngles(
            vehicle=one.vehicle,
            camera=one.camera,
            gimbal=one.gimbal,
            pitch_cdeg=limits.mission_pitch_cdeg,
            yaw_cdeg=0,
            yaw_locked=False,
            life_ms=limits.own_command_life_ms,
        )
        for one in free
    )


def _mode(mode: FlightMode.ValueType, because: str, life_ms: int) -> SetVehicleMode:
    return SetVehicleMode(vehicle=VEHICLE, mode=mode, because=f"mission: {because}", life_ms=life_ms)


def _post(state: State) -> PostWaypoint:
    """Ask for a waypoint at what is followed, before the item that the vehicle flies to and at that item's height."""
    plan, now = _plan(state), mission(state)
    poi_id = next(followings(state)).poi_id
    height_mm = next((one.height_mm for one in plan.items[now.next_item :] if one.HasField("place")), 0)
    return PostWaypoint(
        vehicle=VEHICLE,
        mission_id=plan.mission_id,
        place=state.pois[poi_id].spot.place,
        height_mm=height_mm,
        before_item=now.next_item,
        poi_id=poi_id,
    )


def _plan(state: State) -> MissionPlanned:
    return state.plans[VEHICLE]


PART = Part(
    chart=CHART,
    alphabet=frozenset(
        {
            *_TRIGGERS,
            *("moved", "vehicle_link_changed", "command_answered", "command_unanswered"),
            *("mission_uploaded", "mission_upload_failed", "push_reported", "set_vehicle_mode", "time_passed"),
        }
    ),
    decide=decide,
    evolve=EVOLVE,
)
