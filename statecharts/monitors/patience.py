"""What a mission must wait for: the chart `mission`, from outside, as far as it is about time and about being believed.

Three properties. A step that is tried again takes its time before. A pause is not undone by a vehicle that says what
it had said before it was told to hold. And nothing is waited at but the waypoint that was asked for, by the plan that
has it. What is not known of the past is allowed. Vehicle 1 is the one that flies missions.
"""

from __future__ import annotations

from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import BaselineCarried, Limits, NodeStarted
from events.schema.mission_pb2 import MissionPlanned, MissionUploaded, PostWaypoint
from events.schema.safety_pb2 import FLIGHT_MODE_MISSION, FLIGHT_MODE_RETURN
from events.schema.vehicle_pb2 import VehicleLinkChanged, VehicleStateReported
from statecharts.monitors.monitor import NS_PER_MS, Monitor, Said, Step
from statecharts.state import State

VEHICLE = 1
TRIED = ("uploading", "readying", "arming", "engaging", "starting")
_OWN_MODES = (FLIGHT_MODE_MISSION, FLIGHT_MODE_RETURN)
_DEMANDING = ("unreachable", "overruled", "complying", "pending", "landing", "returning")  # of the chart `safety`


class Patience(Monitor):
    """A mission tries no faster than it may, keeps a pause, and waits where it was asked to."""

    kinds = (
        *("moved", "vehicle_state_reported", "vehicle_link_changed", "node_started"),
        *("baseline_carried", "mission_planned", "post_waypoint", "upload_mission", "mission_uploaded"),
    )

    def __init__(self, limits: Limits, whole: bool) -> None:
        super().__init__(limits, whole)
        self._since_ns: int | None = None  # when the present step was begun: flight_ns
        self._mode = 0
        self._stopped_in: int | None = None  # the mode that it was told to leave, and not seen to have left
        self._asked = 0  # how often it was told
        self._failsafes: dict[str, str] = {}
        self._planned_by = self._posted = self._upload = -1
        self._held = False  # the vehicle holds the newest plan

    def resume(self, state: State) -> None:
        """Take over what a start finds."""
        vehicle, plan = state.vehicles.get(VEHICLE), state.plans.get(VEHICLE)
        if vehicle is not None:
            self._mode = vehicle.flight_mode
        if plan is not None:
            self._planned_by = plan.effect_seq
        if (mission := state.missions.get(VEHICLE)) is not None:
            self._posted, self._upload = mission.middle_seq, mission.effect_seq
            self._held = mission.held_seq > mission.plan_seq
        self._failsafes = {key: failsafe.state for key, failsafe in state.failsafes.items()}

    def look(self, step: Step) -> Said:
        """Hold each move of the mission against what was said and done before."""
        if len(step) > 1 and step[1].kind.name == "step_failed":
            return
        for record in step:
            self._hear(record)
            match record.message:
                case Moved(chart="safety", instance=name, to_state=to):
                    self._failsafes[name] = to
                case Moved(chart="mission") as change:
                    yield from self._judge(record, change, step[0])
                    self._note(record, change)

    def _hear(self, record: Record) -> None:
        match record.message:
            case VehicleStateReported(vehicle=1, flight_mode=mode):
                self._mode = mode
                self._stopped_in = self._stopped_in if mode == self._stopped_in else None
            case VehicleLinkChanged(vehicle=1) | NodeStarted():
                self._stopped_in = None
            case BaselineCarried(state=carried) if carried.HasField("mission"):
                self._planned_by, self._held = 0, carried.mission.held
                self._posted = 0 if carried.mission.HasField("middle_item") else -1
            case MissionPlanned(effect_seq=seq):
                self._planned_by, self._held = seq, False
            case PostWaypoint():
                self._posted = record.seq
            case MissionUploaded(effect_seq=seq):
                self._held = self._held or seq == self._upload
        if record.kind.name == "upload_mission":
            self._upload, self._held = record.seq, False

    def _note(self, record: Record, change: Moved) -> None:
        self._since_ns = record.at.flight_ns
        again = change.from_state == change.to_state == "paused"
        self._asked = self._asked + 1 if again else 1
        stopped = change.to_state == "paused" and self._mode in _OWN_MODES
        self._stopped_in = self._mode if stopped else None

    def _judge(self, record: Record, change: Moved, first: Record) -> Said:
        words = f"record {record.seq}: {change.from_state} to {change.to_state}"
        again = change.from_state == change.to_state in TRIED
        sooner = isinstance(first.message, VehicleLinkChanged | MissionPlanned)  # heard again, or another plan
        if again and not sooner and self._since_ns is not None:
            taken_ns = record.at.flight_ns - self._since_ns
            if taken_ns < self.limits.mission_step_ms * NS_PER_MS:
                yield "tries_take_their_time", f"{words} after {taken_ns // NS_PER_MS} ms"
        if self._stopped_in is not None and not self._is_enough(change):
            yield "a_pause_is_kept", f"{words}, and the vehicle was not seen in another mode"
        if change.to_state == "following" and not (self._held and self._planned_by == self._posted):
            yield "waits_at_its_waypoint", f"{words}, and the vehicle does not hold the plan that has the waypoint"

    def _is_enough(self, change: Moved) -> bool:
        """Whether a vehicle that says what it had said is to be believed; other ways out of a pause are not its own."""
        if change.to_state == "returning":
            own = (state for name, state in self._failsafes.items() if name.startswith(f"{VEHICLE}/"))
            return self._asked >= self.limits.mission_tries or any(state in _DEMANDING for state in own)
        return change.to_state != "flying"
