"""The manners of PX4: what it answers to commands and what it takes of a mission. Read in its source, not seen.

It refuses for the moment (TEMPORARILY_REJECTED) what its state doesn't allow, and for good (DENIED) a
start without a mission. On the ground and disarmed it takes any mode it knows. MISSION_START arms by
itself. Altitudes of commands are above the sea, whatever frame they name. A gimbal is pointed by who
has primary control, and by nobody else; a place to look at is taken from anybody. A command to
another component isn't answered.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from pymavlink.dialects.v20 import common as dialect

from autopilot.geo import LocalFrame
from autopilot.sim.answers import ACCEPTED, DENIED, TEMPORARILY_REJECTED, UNSUPPORTED, Command, Desk
from autopilot.sim.flight import Frame
from autopilot.sim.flying import Flight
from autopilot.sim.missions import NAV, PLACES, ROI_NONE, ROI_OLD, ROI_PLACE, SPEED, Item, Manner
from autopilot.sim.modes import PX4, Doing, doing_of, px4_mode
from autopilot.sim.transfer import ACCEPTED as KEPT
from autopilot.sim.transfer import INVALID, PARAM1, PARAM5_X, PARAM6_Y, PARAM7, UNSUPPORTED_FRAME, Rules
from autopilot.sim.transfer import UNSUPPORTED as UNKNOWN_ITEM

FORCE = 21196
CUSTOM_MODE = 1
CHANGES_MODE = 1
TAKE_OFF_UP_M = 10.0  # where a take-off names no altitude
DO_ITEMS = frozenset({SPEED, 189, ROI_PLACE, ROI_OLD, ROI_NONE, 203, 205, 206, 530, 531, 532, 1000, 1001, 2000})
MORE_ITEMS = frozenset({2001, 2500, 2501})
LOCATED = PLACES | {ROI_PLACE, ROI_OLD}
FRAMES = frozenset({0, 3, 5, 6})
AUTONOMOUS = frozenset({Doing.MISSION, Doing.HOLD, Doing.RETURN, Doing.LAND, Doing.TAKE_OFF})


class Px4:
    """Answers for a flight."""

    autopilot = dialect.MAV_AUTOPILOT_PX4
    first_mode = Doing.MANUAL
    version = 1 << 24 | 16 << 16  # 1.16.0
    modes = PX4
    answers_for_others = False

    def __init__(self, flight: Flight, desk: Desk) -> None:
        self.flight = flight
        self.desk = desk
        self._handlers: dict[int, Callable[[Command], int]] = {
            dialect.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
            dialect.MAV_CMD_DO_SET_MODE: self._mode,
            dialect.MAV_CMD_NAV_TAKEOFF: self._take_off,
            dialect.MAV_CMD_MISSION_START: self._start,
            dialect.MAV_CMD_DO_SET_MISSION_CURRENT: self._choose,
            dialect.MAV_CMD_DO_REPOSITION: self._reposition,
            dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: self._enter(Doing.RETURN),
            dialect.MAV_CMD_NAV_LAND: lambda _: self._enter(Doing.LAND),
            dialect.MAV_CMD_DO_CHANGE_SPEED: self._speed,
            dialect.MAV_CMD_DO_PAUSE_CONTINUE: lambda _: UNSUPPORTED,
            dialect.MAV_CMD_DO_SET_ROI_LOCATION: self._look_at,
            dialect.MAV_CMD_DO_SET_ROI: self._look_at,
        }

    def answer(self, command: Command, sender: tuple[int, int]) -> int:
        """Do it and return the MAV_RESULT."""
        if command.command == dialect.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE:
            return self._take_gimbal(command, sender)
        points = command.command == dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW
        if points and self.desk.gimbal.primary != sender:
            return DENIED
        handler = self._handlers.get(command.command)
        return self.desk.answer(command) if handler is None else handler(command)

    def set_mode(self, custom_mode: int) -> int:
        """Change the mode by its number, as DO_SET_MODE, SET_MODE or a pilot's switch do."""
        doing = doing_of(self.modes, custom_mode)
        return TEMPORARILY_REJECTED if doing is None else self._enter(doing)

    def _enter(self, doing: Doing) -> int:
        """Change the mode where that is granted: disarmed always, armed where it could be flown."""
        flight = self.flight
        unfit = (doing is Doing.MISSION and not flight.items) or doing is Doing.OFFBOARD
        if flight.armed and (unfit or (doing in AUTONOMOUS and not flight.gps.good)):
            flight.say(f"Switching to mode '{doing.value}' is currently not possible")
            return TEMPORARILY_REJECTED
        flight.enter(doing)
        return ACCEPTED

    def _arm(self, command: Command) -> int:
        if command.p1 not in (0, 1):
            return UNSUPPORTED
        flight = self.flight
        if command.p1 == 0:
            if flight.armed and not flight.grounded and command.p2 != FORCE:
                return TEMPORARILY_REJECTED
            flight.disarm()
            return ACCEPTED
        if not flight.armed and not self._fit():
            flight.say("Arming denied: Resolve system health failures first")
            return TEMPORARILY_REJECTED
        if not flight.armed:
            flight.arm()
        return ACCEPTED

    def _fit(self) -> bool:
        flight = self.flight
        if flight.doing in (Doing.RETURN, Doing.LAND, Doing.OFFBOARD) or (
            flight.doing is Doing.MISSION and not flight.items
        ):
            return False
        return flight.gps.good and flight.battery.charge_percent >= 1

    def _mode(self, command: Command) -> int:
        if not _whole(command.p1) & CUSTOM_MODE:
            return TEMPORARILY_REJECTED
        return self.set_mode(px4_mode(_whole(command.p2) & 0xFF, _whole(command.p3) & 0xFF))

    def _take_off(self, command: Command) -> int:
        """Go to take-off mode; without an altitude to the usual one."""
        flight = self.flight
        up_m = command.p7 - flight.home.altitude_m if math.isfinite(command.p7) else TAKE_OFF_UP_M
        if not flight.grounded or up_m <= 0 or self._enter(Doing.HOLD) != ACCEPTED:
            return TEMPORARILY_REJECTED
        flight.takeoff_up_m = up_m
        flight.enter(Doing.TAKE_OFF)
        return ACCEPTED

    def _start(self, command: Command) -> int:
        """Arm and fly the mission, where there is one and it has the item."""
        flight = self.flight
        if not flight.items:
            flight.say("Mission start denied! No valid mission")
            return DENIED
        first = command.p1
        if not math.isfinite(first) or not -1 <= first < len(flight.items):
            return DENIED
        if self._enter(Doing.MISSION) != ACCEPTED or self._arm(replace(command, p1=1.0, p2=0.0)) != ACCEPTED:
            return TEMPORARILY_REJECTED
        if first > 0:
            flight.runner.choose(flight, int(first))
        return ACCEPTED

    def _choose(self, command: Command) -> int:
        known = self.flight.runner.choose(self.flight, _whole(command.p1)) and self.flight.items
        return ACCEPTED if known else DENIED

    def _reposition(self, command: Command) -> int:
        """Hold somewhere else; only where a change of mode is asked for, and nothing that it doesn't know."""
        flight = self.flight
        if _whole(command.p2) != CHANGES_MODE:
            return UNSUPPORTED
        if self._enter(Doing.HOLD) != ACCEPTED:
            return TEMPORARILY_REJECTED
        place_m = self._place_m(command)
        if place_m is not None:
            flight.go_to(*place_m)
        return ACCEPTED

    def _place_m(self, command: Command) -> tuple[float, float, float] | None:
        """Return where a command points to, or None; it is checked behind the answer, as in PX4."""
        home = self.flight.home
        if not (math.isfinite(command.p5) and math.isfinite(command.p6)):
            return None
        if abs(command.p5) > 90 or abs(command.p6) > 180:
            return None
        place = home.place(command.p5, command.p6, 0.0)
        up_m = command.p7 - home.altitude_m if math.isfinite(command.p7) else self.flight.seen_m[2]
        return place.east_mm / 1000, place.north_mm / 1000, up_m

    def _speed(self, command: Command) -> int:
        if command.p2 > 0 and math.isfinite(command.p2):
            self.flight.speed_m_s = command.p2
        return ACCEPTED

    def _look_at(self, command: Command) -> int:
        """Look at a place: its altitude is above the sea whatever the frame says, and zeros are a place."""
        return self.desk.answer(replace(command, frame=0)) if any((command.p5, command.p6)) else ACCEPTED

    def _take_gimbal(self, command: Command, sender: tuple[int, int]) -> int:
        """Anybody may take control: -1 leaves it, -2 is the sender, -3 gives up the sender's own."""
        self.desk.gimbal.configure((_whole(command.p1), _whole(command.p2)), sender)
        return ACCEPTED


def judge(item: Item, seq: int) -> int:
    """Return the MAV_MISSION_RESULT of an item that is uploaded; a NaN stands for "not set"."""
    del seq
    if item.command not in NAV | DO_ITEMS | MORE_ITEMS:
        return UNKNOWN_ITEM
    for number, value in enumerate((item.p1, item.p2, item.p3, item.p4)):
        if math.isinf(value):
            return PARAM1 + number
    if item.command not in LOCATED:
        return KEPT
    if item.frame not in FRAMES:
        return UNSUPPORTED_FRAME
    if not math.isfinite(item.z):
        return PARAM7
    if abs(item.x) > 900_000_000:
        return PARAM5_X
    if abs(item.y) > 1_800_000_000:
        return PARAM6_Y
    return INVALID if math.isnan(item.p1) else KEPT


def kept(item: Item, seq: int) -> Item:
    """Return an item as it is kept: everything but the frame, which is told in its integer form, 5 or 6."""
    del seq
    frames = {0: 5, 3: 6}
    return (
        replace(item, frame=frames.get(item.frame, item.frame)) if item.command in LOCATED else replace(item, frame=2)
    )


RULES = Rules(
    atomic=True,
    asks_by_int=True,
    retry_s=0.25,
    timeout_s=5.0,
    refusal_ends=True,
    tells_timeout=False,
    has_ids=True,
    capacity=2000,
    home_first=False,
    judge=judge,
    kept=kept,
)


def flight_of(frame: Frame, home: LocalFrame) -> Flight:
    """Return a flight with PX4's habits: it holds after its mission."""
    return Flight(
        frame=frame,
        home=home,
        manner=Manner(first=0, tells_each=True),
        doing=Doing.MANUAL,
        after_mission=Doing.HOLD,
        return_up_m=30.0 if frame.hovers else 100.0,
    )


def _whole(value: float) -> int:
    return int(value) if math.isfinite(value) else -1
