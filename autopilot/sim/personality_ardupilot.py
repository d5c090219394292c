"""The manners of ArduPilot, copter and plane: what it answers to commands and what it keeps of a mission.

Copter's are as seen on a real one: it doesn't arm in AUTO, stays on the ground there until
MISSION_START, starts an empty mission as gladly as any other, takes DO_REPOSITION on the ground and
only as COMMAND_INT, reads the altitude of a COMMAND_LONG as above home. Plane's were read in its
source: it arms in AUTO, and knows no take-off or landing by command. Commands that are not here are
answered by `answers.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from pymavlink.dialects.v20 import common as dialect

from autopilot.geo import LocalFrame
from autopilot.sim.answers import ACCEPTED, ALTITUDE_AMSL_FRAMES, DENIED, FAILED, UNSUPPORTED, Command, Desk
from autopilot.sim.flight import Frame
from autopilot.sim.flying import Flight
from autopilot.sim.missions import (
    LAND,
    LOITER_FOREVER,
    LOITER_TIME,
    LOITER_TURNS,
    NAV,
    PLACES,
    ROI_OLD,
    ROI_PLACE,
    SPEED,
    SPLINE,
    TAKE_OFF,
    WAYPOINT,
    Item,
    Manner,
)
from autopilot.sim.modes import ARDUCOPTER, ARDUPLANE, Doing, doing_of
from autopilot.sim.transfer import ACCEPTED as KEPT
from autopilot.sim.transfer import PARAM1, PARAM5_X, PARAM6_Y, PARAM7, UNSUPPORTED_FRAME, Rules
from autopilot.sim.transfer import UNSUPPORTED as UNKNOWN_ITEM

FORCE = 21196  # MAV_CMD_COMPONENT_ARM_DISARM, param2
CUSTOM_MODE = 1  # MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
CHANGES_MODE = 1  # MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
GIMBAL_ANGLES, DO_LAND_START = 1000, 189
LOCATED = PLACES | {ROI_PLACE, ROI_OLD}
FRAMES = frozenset({0, 2, 3, 5, 6, 10, 11})  # 2 (MISSION) is taken for 0
DO_ITEMS = frozenset({SPEED, DO_LAND_START, 112, 115, 181, 183, 195, 197, 201, 205, 206, 207, 211, 212})
CAMERA_ITEMS = frozenset({203, 222, 531, 532, GIMBAL_ANGLES, 2000, 2001, 2500, 2501})
TERRAIN = frozenset({10, 11})
NAN_AT_4 = frozenset({WAYPOINT, TAKE_OFF, LAND})


class ArduPilot:
    """Answers for a flight; its modes are those of the frame that flies."""

    autopilot = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
    first_mode = Doing.MANUAL
    version = 4 << 24 | 7 << 16  # 4.7.0
    answers_for_others = True  # a command to a component that isn't there is done and answered by 1/1

    def __init__(self, flight: Flight, desk: Desk) -> None:
        self.flight = flight
        self.desk = desk
        self.copter = flight.frame.hovers
        self.modes = ARDUCOPTER if self.copter else ARDUPLANE
        self._handlers: dict[int, Callable[[Command], int]] = {
            dialect.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
            dialect.MAV_CMD_DO_SET_MODE: self._mode,
            dialect.MAV_CMD_NAV_TAKEOFF: self._take_off,
            dialect.MAV_CMD_MISSION_START: self._start,
            dialect.MAV_CMD_DO_SET_MISSION_CURRENT: self._choose,
            dialect.MAV_CMD_DO_REPOSITION: self._reposition,
            dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: self._enter(Doing.RETURN),
            dialect.MAV_CMD_NAV_LOITER_UNLIM: lambda _: self._enter(Doing.HOLD),
            dialect.MAV_CMD_DO_CHANGE_SPEED: self._speed,
            dialect.MAV_CMD_DO_PAUSE_CONTINUE: self._pause,
        }
        if self.copter:
            self._handlers[dialect.MAV_CMD_NAV_LAND] = lambda _: self._enter(Doing.LAND)

    def answer(self, command: Command, sender: tuple[int, int]) -> int:
        """Do it and return the MAV_RESULT; who sends it doesn't matter."""
        del sender
        handler = self._handlers.get(command.command)
        return self.desk.answer(command) if handler is None else handler(command)

    def set_mode(self, custom_mode: int) -> int:
        """Change the mode by its number, as DO_SET_MODE, SET_MODE or a pilot's switch do."""
        doing = doing_of(self.modes, custom_mode)
        return FAILED if doing is None else self._enter(doing)

    def _enter(self, doing: Doing) -> int:
        """Change the mode where that is granted."""
        flight = self.flight
        if doing is Doing.MISSION and self.copter and flight.armed:
            empty = len(flight.runner.items) <= 1
            if empty or (flight.grounded and not flight.runner.starts_with_take_off()):
                flight.say("Mode change to AUTO failed: init failed" if empty else "Auto: Missing Takeoff Cmd")
                return FAILED
        if doing is not Doing.MANUAL and not flight.gps.good:
            flight.say("Mode change failed: requires position")
            return FAILED
        flight.enter(doing)
        return ACCEPTED

    def _arm(self, command: Command) -> int:
        if command.p1 not in (0, 1):
            return UNSUPPORTED
        flight = self.flight
        if command.p1 == 0:
            if not flight.grounded and command.p2 != FORCE:
                return FAILED
            flight.disarm()
            return ACCEPTED
        if flight.armed:
            return ACCEPTED
        if reason := self._unfit():
            flight.say(f"Arm: {reason}")
            return FAILED
        flight.arm()
        return ACCEPTED

    def _unfit(self) -> str:
        """Return why it can't be armed, in ArduPilot's words, or nothing."""
        flight = self.flight
        refuses = {Doing.MISSION, Doing.RETURN, Doing.LAND} if self.copter else {Doing.RETURN}
        if flight.doing in refuses:
            return f"{flight.describe()} mode not armable"
        if flight.doing is not Doing.MANUAL and not flight.gps.good:
            return "GPS 1: Bad fix"
        return "Battery 1 below minimum arming voltage" if flight.battery.charge_percent < 1 else ""

    def _mode(self, command: Command) -> int:
        if not _whole(command.p1) & CUSTOM_MODE:
            return DENIED
        return self.set_mode(_whole(command.p2))

    def _take_off(self, command: Command) -> int:
        flight = self.flight
        if not self.copter:
            return UNSUPPORTED
        fit = flight.armed and flight.doing is Doing.GUIDED and math.isfinite(command.p7)
        if not fit or command.p7 <= flight.seen_m[2]:
            return FAILED
        flight.take_off(command.p7)
        return ACCEPTED

    def _start(self, command: Command) -> int:
        """An empty mission on the ground is started as well: there is nothing that it would check then."""
        if command.p1 or command.p2:
            return DENIED
        result = self._enter(Doing.MISSION)
        self.flight.started = result == ACCEPTED
        return result

    def _choose(self, command: Command) -> int:
        if not self.flight.runner.choose(self.flight, _whole(command.p1)):
            return DENIED
        self.desk.requested.append(dialect.MAVLINK_MSG_ID_MISSION_CURRENT)
        return ACCEPTED

    def _reposition(self, command: Command) -> int:
        flight = self.flight
        if command.frame is None:
            return UNSUPPORTED
        if not (_whole(command.p2) & CHANGES_MODE or flight.doing is Doing.GUIDED):
            return DENIED
        if command.frame not in FRAMES or not math.isfinite(command.p7):
            return DENIED
        if abs(command.p5) > 90 or abs(command.p6) > 180:
            return DENIED
        if self._enter(Doing.GUIDED) != ACCEPTED:
            return FAILED
        place = flight.home.place(command.p5, command.p6, 0.0)
        above_sea = command.frame in ALTITUDE_AMSL_FRAMES
        up_m = command.p7 - flight.home.altitude_m if above_sea else command.p7
        flight.go_to(place.east_mm / 1000, place.north_mm / 1000, up_m)
        return ACCEPTED

    def _speed(self, command: Command) -> int:
        if self.flight.doing is Doing.MANUAL or not command.p2 > 0 or not math.isfinite(command.p2):
            return FAILED
        if command.p1 in (0, 1):
            self.flight.speed_m_s = command.p2
        return ACCEPTED

    def _pause(self, command: Command) -> int:
        if command.p1 not in (0, 1):
            return DENIED
        if self.flight.doing not in (Doing.MISSION, Doing.GUIDED):
            return FAILED
        self.flight.pause(command.p1 == 0)
        return ACCEPTED


def judge(item: Item, seq: int) -> int:
    """Return the MAV_MISSION_RESULT of an item that is uploaded."""
    del seq
    if item.command not in NAV | DO_ITEMS | CAMERA_ITEMS:
        return UNKNOWN_ITEM
    for number, value in enumerate((item.p1, item.p2, item.p3, item.p4)):
        nan_allowed = number == 3 and item.command in NAN_AT_4
        if math.isinf(value) or (math.isnan(value) and not nan_allowed):
            return PARAM1 + number
    if not math.isfinite(item.z):
        return PARAM7
    if item.command not in LOCATED:
        return KEPT
    if abs(item.x) > 900_000_000:
        return PARAM5_X
    if abs(item.y) > 1_800_000_000:
        return PARAM6_Y
    return KEPT if item.frame in FRAMES else UNSUPPORTED_FRAME


# How each parameter is stored: f as it is, i as a whole number, 0 not at all, 1 as 1.
_STORED = {
    WAYPOINT: "i000",
    SPLINE: "i000",
    TAKE_OFF: "i000",
    LAND: "i001",
    LOITER_FOREVER: "00f0",
    LOITER_TURNS: "i0i0",
    LOITER_TIME: "i0f0",
    SPEED: "iff0",
    ROI_PLACE: "0000",
    ROI_OLD: "0000",
    GIMBAL_ANGLES: "iiii",
}


def _stored(how: str, value: float) -> float:
    if how in "01" or math.isnan(value):
        return float(how == "1")
    return float(int(value)) if how == "i" else value


def kept(item: Item, seq: int) -> Item:
    """Return what is left of an item: its storage knows fewer parameters and whole numbers only.

    A frame is what the altitude counts from (0 sea, 3 home, 10 ground); an item without a place has 0.
    """
    del seq
    frame = 0
    if item.command in LOCATED:
        frame = 10 if item.frame in TERRAIN else 3 if item.frame in (3, 6) else 0
    stored = _STORED.get(item.command, "ffff")
    values = (item.p1, item.p2, item.p3, item.p4)
    p1, p2, p3, p4 = (_stored(how, value) for how, value in zip(stored, values, strict=True))
    z = round(item.z, 2) if item.command in LOCATED else item.z  # centimetres
    return replace(item, frame=frame, p1=p1, p2=p2, p3=p3, p4=p4, z=z)


RULES = Rules(
    atomic=False,
    asks_by_int=False,
    retry_s=1.0,
    timeout_s=8.0,
    refusal_ends=False,
    tells_timeout=True,
    has_ids=False,
    capacity=724,
    home_first=True,
    judge=judge,
    kept=kept,
)


def flight_of(frame: Frame, home: LocalFrame) -> Flight:
    """Return a flight with ArduPilot's habits: a copter hovers after its mission, a plane comes home and circles."""
    copter = frame.hovers
    return Flight(
        frame=frame,
        home=home,
        manner=Manner(first=1, tells_each=False),
        doing=Doing.MANUAL,
        after_mission=Doing.MISSION if copter else Doing.RETURN,
        waits_for_start=copter,
        return_up_m=15.0 if copter else 100.0,
        home_first=True,
    )


def _whole(value: float) -> int:
    return int(value) if math.isfinite(value) else -1
