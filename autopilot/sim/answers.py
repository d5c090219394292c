"""How the simulated ArduCopter answers commands, as a real one was seen to.

A table of commands; what is not in it is UNSUPPORTED. The flight is the aircraft's own: commands
that would change it are FAILED. Answers are made here, sent elsewhere. The oddities (an altitude
in COMMAND_LONG counts from home, 0/0/0 cancels, angles out of range are clamped in silence) are
ArduPilot's, and are the reason why the node's egress is as it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import common as dialect

from autopilot.geo import LocalFrame
from autopilot.sim.gimbal import Angles, Gimbal, Spot
from autopilot.sim.messages import BUILDERS

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS = range(6)  # MAV_RESULT

ALTITUDE_AMSL_FRAMES = (0, 5)  # MAV_FRAME_GLOBAL, _GLOBAL_INT
ALTITUDE_HOME_FRAMES = (3, 6, 10, 11)  # _RELATIVE_ALT, _RELATIVE_ALT_INT; terrain is flat here
YAW_LOCK = 16
CAMERA_INFORMATION = 259


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """COMMAND_INT (with a frame; latitude and longitude already in degrees) or COMMAND_LONG (frame None)."""

    command: int
    frame: int | None
    p1: float = 0.0
    p2: float = 0.0
    p3: float = 0.0
    p4: float = 0.0
    p5: float = 0.0
    p6: float = 0.0
    p7: float = 0.0
    sender: tuple[int, int] = (0, 0)  # system and component


@dataclass(slots=True)
class Desk:
    """Takes commands; keeps what they change."""

    home: LocalFrame
    gimbal: Gimbal = field(default_factory=Gimbal)
    periods_s: dict[int, float] = field(default_factory=dict)  # message id: period
    requested: list[int] = field(default_factory=list)  # messages to send once
    texts: list[str] = field(default_factory=list)  # STATUSTEXT to send
    known: frozenset[int] = frozenset(BUILDERS)  # messages that can be asked for

    def answer(self, command: Command) -> int:
        """Do it and return the MAV_RESULT."""
        handler = HANDLERS.get(command.command)
        return UNSUPPORTED if handler is None else handler(self, command)

    def _roi(self, command: Command) -> int:
        place = (command.p5, command.p6, command.p7)
        if command.frame not in (None, *ALTITUDE_AMSL_FRAMES, *ALTITUDE_HOME_FRAMES) or math.isnan(command.p7):
            return DENIED
        if not all(math.isfinite(value) for value in place) or abs(command.p5) > 90 or abs(command.p6) > 180:
            return FAILED
        if not any(place):
            return self._roi_none(command)
        above_sea = command.frame in ALTITUDE_AMSL_FRAMES
        up_m = command.p7 - self.home.altitude_m if above_sea else command.p7
        spot = self.home.place(command.p5, command.p6, 0.0)
        self.gimbal.aim = Spot(spot.east_mm / 1000, spot.north_mm / 1000, up_m)
        return ACCEPTED

    def _roi_none(self, command: Command) -> int:
        del command
        self.gimbal.release()
        return ACCEPTED

    def _pitch_yaw(self, command: Command) -> int:
        pitch_deg, yaw_deg = command.p1, command.p2
        if command.p7 not in (0, 1) or math.isnan(pitch_deg) != math.isnan(yaw_deg):
            return FAILED
        if not math.isfinite(pitch_deg) or not math.isfinite(yaw_deg):
            return ACCEPTED  # rates only, or only a yaw lock: this gimbal stays where it is
        self.gimbal.aim = Angles(pitch_deg, yaw_deg, bool(_whole(command.p5) & YAW_LOCK))
        return ACCEPTED

    def _configure(self, command: Command) -> int:
        ids = (command.p1, command.p2, command.p3, command.p4)
        if not all(-3 <= value <= 255 for value in ids):
            return FAILED
        self.gimbal.configure((int(command.p1), int(command.p2)), command.sender)
        return ACCEPTED

    def _interval(self, command: Command) -> int:
        message_id = _whole(command.p1)
        if message_id not in self.known:
            self.texts.append(f"No ap_message for mavlink id ({message_id})")
            return DENIED
        if not math.isfinite(command.p2):
            return DENIED
        if command.p2 < 0:
            self.periods_s.pop(message_id, None)
        elif command.p2 > 0:
            self.periods_s[message_id] = max(command.p2 / 1e6, 0.02)
        return ACCEPTED

    def _request(self, command: Command) -> int:
        message_id = _whole(command.p1)
        if message_id == CAMERA_INFORMATION:
            return ACCEPTED  # and nothing follows
        if message_id not in self.known:
            return FAILED
        self.requested.append(message_id)
        return ACCEPTED

    def _own_route(self, command: Command) -> int:
        del command
        return FAILED


def _whole(value: float) -> int:
    """Return a parameter as an integer; -1 where it is none."""
    return int(value) if math.isfinite(value) else -1


def _as_int_only(handler: Callable[[Desk, Command], int]) -> Callable[[Desk, Command], int]:
    return lambda desk, command: UNSUPPORTED if command.frame is None else handler(desk, command)


HANDLERS: dict[int, Callable[[Desk, Command], int]] = {
    dialect.MAV_CMD_DO_SET_ROI_LOCATION: Desk._roi,
    dialect.MAV_CMD_DO_SET_ROI: Desk._roi,
    dialect.MAV_CMD_DO_SET_ROI_NONE: Desk._roi_none,
    dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: Desk._pitch_yaw,
    dialect.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: Desk._configure,
    dialect.MAV_CMD_SET_MESSAGE_INTERVAL: Desk._interval,
    dialect.MAV_CMD_REQUEST_MESSAGE: Desk._request,
    dialect.MAV_CMD_COMPONENT_ARM_DISARM: Desk._own_route,
    dialect.MAV_CMD_DO_SET_MODE: Desk._own_route,
    dialect.MAV_CMD_NAV_TAKEOFF: Desk._own_route,
    dialect.MAV_CMD_MISSION_START: Desk._own_route,
    dialect.MAV_CMD_DO_CHANGE_SPEED: Desk._own_route,
    dialect.MAV_CMD_IMAGE_START_CAPTURE: Desk._own_route,
    dialect.MAV_CMD_VIDEO_START_CAPTURE: Desk._own_route,
    dialect.MAV_CMD_DO_REPOSITION: _as_int_only(Desk._own_route),
}
