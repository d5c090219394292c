"""What must come before a mission flies, and what a mission must leave alone: the chart `mission`, from outside.

It takes orders, plans, uploads and self-tests for what the log says of them; a step that failed changed nothing and is
passed over. Vehicle 1 is the one that flies missions.
"""

from __future__ import annotations

from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import BaselineCarried, Limits
from events.schema.mission_pb2 import MissionUploaded
from events.schema.orders_pb2 import MISSION_BEGIN, OrderReceived
from events.schema.safety_pb2 import SetVehicleMode
from statecharts.monitors.monitor import Monitor, Said, Step, moves_of
from statecharts.state import State

VEHICLE = 1
_ASKED = ("arm_vehicle", "start_mission")
_OFFICE = ("fetch_mission", "post_waypoint", "push_observations")
_OWN = (*_OFFICE, "run_selftest", "upload_mission", "set_mission_item", *_ASKED)
_OVER = ("syncing", "done", "aborted")
_TAKEN = ("somebody", "armed already")  # how the reason begins where the vehicle is left to somebody else


class Missions(Monitor):
    """No motor turns before plan, self-test and order; a vehicle that somebody took is not commanded."""

    kinds = (
        *("moved", "order_received", "mission_planned", "mission_uploaded", "baseline_carried"),
        *("set_vehicle_mode", *_OWN),
    )

    def __init__(self, limits: Limits, whole: bool) -> None:
        super().__init__(limits, whole)
        self._plan_seq = self._upload_seq = -1
        self._held = False  # the vehicle holds the newest plan
        self._tested = False
        self._begun = False
        self._taken = False  # the vehicle is left to somebody else

    def resume(self, state: State) -> None:
        """Take over what a start finds."""
        mission, selftest = state.missions.get(VEHICLE), state.selftests.get(VEHICLE)
        if mission is not None:
            self._plan_seq, self._upload_seq = mission.plan_seq, mission.held_seq
            self._held, self._begun = mission.held_seq > mission.plan_seq, mission.begun
        self._tested = selftest is not None and selftest.state == "passed"

    def look(self, step: Step) -> Said:
        """Follow what is known, and hold each effect against what must have come before it."""
        if len(step) > 1 and step[1].kind.name == "step_failed":
            return
        self._hear_order(step)
        mover = ""
        for record in step:
            self._hear(record)
            if isinstance(change := record.message, Moved):
                mover = change.chart if change.chart in ("safety", "mission") else mover
            yield from self._judge(record, mover)

    def _hear_order(self, step: Step) -> None:
        order = step[0].message
        if isinstance(order, OrderReceived) and order.mission.verb == MISSION_BEGIN:
            self._begun |= any(move.to_state == "accepted" for move in moves_of(step, "command"))

    def _hear(self, record: Record) -> None:
        match record.message:
            case Moved(chart="selftest", to_state=state):
                self._tested = state == "passed"
            case Moved(chart="mission", to_state=state, because=because):
                self._begun = self._begun and state not in _OVER
                self._taken = state == "paused" and because.startswith(_TAKEN)
            case BaselineCarried(state=carried):
                self._held, self._begun = carried.mission.held, carried.mission.begun
            case MissionUploaded(effect_seq=seq):
                self._held = self._held or seq == self._upload_seq > self._plan_seq
        match record.kind.name:
            case "mission_planned":
                self._plan_seq, self._held = record.seq, False
            case "upload_mission":
                self._upload_seq, self._held = record.seq, False

    def _judge(self, record: Record, mover: str) -> Said:
        name = record.kind.name
        words = f"record {record.seq}: {name}"
        if name in _OWN and not self.limits.mission_enabled:
            yield "mission_is_off", f"{words} on a node that flies no missions"
        if name == "arm_vehicle" and not self._held:
            yield "checked_before_arming", f"{words}, and the vehicle does not hold the newest plan"
        if name in _ASKED and not self._tested:
            yield "checked_before_arming", f"{words}, and no self-test has passed"
        if name in _ASKED and self.limits.mission_begun_by_order and not self._begun:
            yield "begun_by_order", f"{words}, and nobody ordered the mission to begin"
        own = isinstance(mode := record.message, SetVehicleMode) and not mode.order and mover == "mission"
        if self._taken and (own or name in (*_ASKED, "set_mission_item")):
            yield "taken_is_left_alone", f"{words} to a vehicle that somebody else has"
