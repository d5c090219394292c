"""Everything that this node can say to a vehicle: a closed list, and the only functions that encode.

`SENDABLE` names each pair of message and command. Whatever is packed passes `_allow`, which
refuses what is not in it and every number that is not finite, so a new message is a change of
this file and of the test that prints the list. There is nothing in it that arms, changes a mode,
uploads a mission, moves a servo or drops anything.

A place goes as COMMAND_INT in MAV_FRAME_GLOBAL with the altitude above mean sea level: the only
form that ArduPilot and PX4 read alike, and 1e-7 degrees survive in it. Latitude and longitude of
zero are refused, for there autopilots read "cancel". Angles go as COMMAND_LONG in degrees with
both angles set and both rates unset (MAVLink guide, Gimbal Protocol v2): ArduPilot fails a pitch
whose yaw is unset and lets angles win over rates, PX4 passes rates on unconverted. Seed 000 asks
for COMMAND_LONG also for places; float32 degrees are off by up to 1.7 m.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from google.protobuf.message import Message
from pymavlink.dialects.v20 import common as dialect

from autopilot.adapters.vehicle.heard import Sender
from autopilot.adapters.vehicle.pointing import wrapped
from events.schema.vehicle_pb2 import GiveUpGimbal, PointAtAngles, PointAtPlace, ReleasePointing, SetZoom, TakeGimbal

HEARTBEAT, COMMAND_INT, COMMAND_LONG, TIMESYNC = 0, 75, 76, 111
SET_ROI_LOCATION, SET_ROI_NONE, SET_CAMERA_ZOOM, GIMBAL_PITCHYAW, GIMBAL_CONFIGURE = 195, 197, 531, 1000, 1001
SET_MESSAGE_INTERVAL, REQUEST_MESSAGE = 511, 512

# Message and, where it carries one, command.
SENDABLE: frozenset[tuple[int, int | None]] = frozenset(
    {
        (HEARTBEAT, None),
        (TIMESYNC, None),
        (COMMAND_INT, SET_ROI_LOCATION),
        (COMMAND_LONG, SET_ROI_NONE),
        (COMMAND_LONG, GIMBAL_PITCHYAW),
        (COMMAND_LONG, GIMBAL_CONFIGURE),
        (COMMAND_LONG, SET_CAMERA_ZOOM),
        (COMMAND_LONG, SET_MESSAGE_INTERVAL),
        (COMMAND_LONG, REQUEST_MESSAGE),
    }
)

SYSTEM_TIME, AUTOPILOT_VERSION = 2, 148
GPS_RAW, ATTITUDE, GLOBAL_POSITION, GIMBAL_INFORMATION, GIMBAL_STATUS, GIMBAL_ATTITUDE = 24, 30, 33, 280, 281, 285
CAMERA_INFORMATION, CAMERA_SETTINGS = 259, 260

# Streams that may be asked for, with their period in microseconds.
STREAMS_US: dict[int, int] = {
    GLOBAL_POSITION: 200_000,
    ATTITUDE: 100_000,
    GIMBAL_ATTITUDE: 100_000,
    GPS_RAW: 1_000_000,
    GIMBAL_STATUS: 500_000,
    SYSTEM_TIME: 5_000_000,
}
# Messages that may be asked for one by one, of whichever component has them.
REQUESTABLE = (CAMERA_INFORMATION, CAMERA_SETTINGS, GIMBAL_INFORMATION)

ALTITUDE_M = (-500.0, 20_000.0)  # from below the Dead Sea to above any drone
ONBOARD_CONTROLLER, NO_AUTOPILOT = 18, 8  # MAV_TYPE, MAV_AUTOPILOT: never a ground station
ROLL_LOCK, PITCH_LOCK, YAW_LOCK = 4, 8, 16  # GIMBAL_MANAGER_FLAGS
FRAME_GLOBAL = 0
EVERY_GIMBAL = 0
EVERY_COMPONENT = 0
LEAVE, MYSELF, MY_OWN = -1, -2, -3  # MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: as it is, the sender, what the sender has
ZOOM_RANGE = 2  # CAMERA_ZOOM_TYPE: percent of the whole range
ZOOM_E4_MAX = 10_000
UNSET = math.nan
_ANYBODY = Sender(system=0, component=0)

COMMAND_OF: dict[type[Message], int] = {
    PointAtPlace: SET_ROI_LOCATION,
    PointAtAngles: GIMBAL_PITCHYAW,
    ReleasePointing: SET_ROI_NONE,
    TakeGimbal: GIMBAL_CONFIGURE,
    GiveUpGimbal: GIMBAL_CONFIGURE,
    SetZoom: SET_CAMERA_ZOOM,
}


class NotEncodable(ValueError):
    """The effect must not or can not be said on this link; the text says why."""


class _AddressedTimesync(dialect.MAVLink_timesync_message):  # type: ignore[misc]
    """TIMESYNC with the target that the dialect does not know."""

    def __init__(self, tc1_ns: int, ts1_ns: int, target: Sender) -> None:
        super().__init__(tc1_ns, ts1_ns)
        self._target = target

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        payload = self.unpacker.pack(self.tc1, self.ts1)
        addressed = payload + bytes([self._target.system, self._target.component])
        return bytes(self._pack(mav, self.crc_extra, addressed, force_mavlink1))


class Egress:
    """Encodes for one link; keeps nothing but the link's running number."""

    def __init__(self, component: int) -> None:
        self._component = component
        self._mav = dialect.MAVLink(None, 0, component)

    def heartbeat(self, system: int) -> bytes:
        """Return a HEARTBEAT as an onboard controller of the vehicle `system`."""
        return self._pack(
            system,
            dialect.MAVLink_heartbeat_message(ONBOARD_CONTROLLER, NO_AUTOPILOT, 0, 0, dialect.MAV_STATE_ACTIVE, 3),
        )

    def ask_stream(self, system: int, target: Sender, message_id: int) -> bytes:
        """Return the request for one of `STREAMS_US`; raises KeyError for another."""
        return self._pack(system, _long(target, SET_MESSAGE_INTERVAL, 0, message_id, STREAMS_US[message_id]))

    def ask_message(self, system: int, message_id: int) -> bytes:
        """Return the request for one of `REQUESTABLE`, of every component of the vehicle; raises NotEncodable."""
        if message_id not in REQUESTABLE:
            raise NotEncodable(f"message {message_id} is not asked for")
        target = Sender(system=system, component=EVERY_COMPONENT)
        return self._pack(system, _long(target, REQUEST_MESSAGE, 0, message_id))

    def ask_version(self, system: int, target: Sender) -> bytes:
        """Return the request for AUTOPILOT_VERSION."""
        return self._pack(system, _long(target, REQUEST_MESSAGE, 0, AUTOPILOT_VERSION))

    def timesync(self, system: int, target: Sender, tc1_ns: int, ts1_ns: int) -> bytes:
        """Return TIMESYNC for one component: a question with tc1 = 0, else the answer to its ts1."""
        return self._pack(system, _AddressedTimesync(tc1_ns, ts1_ns, target))

    def effect(self, system: int, target: Sender, effect: Message, confirmation: int) -> bytes:
        """Return the command for an effect; raises NotEncodable.

        `confirmation` counts the re-sends; only COMMAND_LONG can carry it (MAVLink guide, Command Protocol).
        """
        return self._pack(system, _command(target, effect, confirmation))

    def _pack(self, system: int, message: Any) -> bytes:
        """Pack what the list allows."""
        _allow(message)
        self._mav.srcSystem = system
        packed = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return packed


def check(effect: Message) -> None:
    """Raise NotEncodable where an effect can't be said, whoever it is for; nothing is packed and no number used up."""
    _command(_ANYBODY, effect, 0)


def _allow(message: Any) -> None:
    """Raise NotEncodable for what the list lacks; the two rates of a gimbal command alone may be unset (NaN)."""
    command = getattr(message, "command", None)
    if (message.get_msgId(), command) not in SENDABLE:
        raise NotEncodable(f"message {message.get_msgId()} with command {command} is not on the list")
    may_be_unset = ("param3", "param4") if command == GIMBAL_PITCHYAW else ()
    for name in message.get_fieldnames():
        if name not in may_be_unset and not math.isfinite(getattr(message, name)):
            raise NotEncodable(f"{name} is not finite")


def _command(target: Sender, effect: Message, confirmation: int) -> Any:
    command = _COMMANDS.get(type(effect))
    if command is None:
        raise NotEncodable(f"{type(effect).__name__} is not for a vehicle")
    return command(target, effect, confirmation)


def _roi(target: Sender, effect: Any, confirmation: int) -> Any:
    del confirmation  # COMMAND_INT has no field for it
    place, altitude_m = effect.place, effect.place.altitude_mm / 1000
    _one_gimbal(effect)
    if place.latitude_e7 == 0 and place.longitude_e7 == 0:
        raise NotEncodable("latitude and longitude 0 would cancel the pointing")
    if abs(place.latitude_e7) > 900_000_000 or abs(place.longitude_e7) > 1_800_000_000:
        raise NotEncodable("the place is not on the Earth")
    if not ALTITUDE_M[0] <= altitude_m <= ALTITUDE_M[1]:
        raise NotEncodable(f"altitude {altitude_m} m is outside {ALTITUDE_M}")
    return dialect.MAVLink_command_int_message(
        target.system,
        target.component,
        FRAME_GLOBAL,
        SET_ROI_LOCATION,
        0,
        0,
        EVERY_GIMBAL,
        0,
        0,
        0,
        place.latitude_e7,
        place.longitude_e7,
        altitude_m,
    )


def _angles(target: Sender, effect: Any, confirmation: int) -> Any:
    _one_gimbal(effect)
    if abs(effect.pitch_cdeg) > 9_000 or effect.yaw_cdeg >= 36_000:
        raise NotEncodable("pitch is outside +-90 degrees or yaw outside 0 to 359.99")
    flags = ROLL_LOCK | PITCH_LOCK | (YAW_LOCK if effect.yaw_locked else 0)
    pitch_deg, yaw_deg = effect.pitch_cdeg / 100, wrapped(effect.yaw_cdeg / 100)
    parameters = (pitch_deg, yaw_deg, UNSET, UNSET, flags, 0, EVERY_GIMBAL)
    return _long(target, GIMBAL_PITCHYAW, confirmation, *parameters)


def _release(target: Sender, effect: Any, confirmation: int) -> Any:
    _one_gimbal(effect)
    return _long(target, SET_ROI_NONE, confirmation)


def _take(target: Sender, effect: Any, confirmation: int) -> Any:
    """As "the sender", not by numbers: what the vehicle takes for our id is what counts."""
    _one_gimbal(effect)
    return _long(target, GIMBAL_CONFIGURE, confirmation, MYSELF, MYSELF, LEAVE, LEAVE)


def _give_up(target: Sender, effect: Any, confirmation: int) -> Any:
    """Only what is ours, so that it throws nobody out who has taken it meanwhile."""
    _one_gimbal(effect)
    return _long(target, GIMBAL_CONFIGURE, confirmation, MY_OWN, MY_OWN, LEAVE, LEAVE)


def _zoom(target: Sender, effect: Any, confirmation: int) -> Any:
    if effect.vehicle != 1 or effect.camera != 1:
        raise NotEncodable(f"vehicle {effect.vehicle}, camera {effect.camera}: this link has vehicle 1, camera 1")
    if effect.zoom_e4 > ZOOM_E4_MAX:
        raise NotEncodable(f"zoom {effect.zoom_e4 / 100} % is more than all of it")
    return _long(target, SET_CAMERA_ZOOM, confirmation, ZOOM_RANGE, effect.zoom_e4 / 100)


def _long(target: Sender, command: int, confirmation: int, *parameters: float) -> Any:
    filled = (*parameters, *(0.0,) * (7 - len(parameters)))
    return dialect.MAVLink_command_long_message(target.system, target.component, command, confirmation, *filled)


_COMMANDS: dict[type[Message], Callable[[Sender, Any, int], Any]] = {
    PointAtPlace: _roi,
    PointAtAngles: _angles,
    ReleasePointing: _release,
    TakeGimbal: _take,
    GiveUpGimbal: _give_up,
    SetZoom: _zoom,
}


def _one_gimbal(effect: Any) -> None:
    """One vehicle with one gimbal a link; it is addressed as "all", which every autopilot knows."""
    if effect.vehicle != 1 or effect.gimbal != 1:
        raise NotEncodable(f"vehicle {effect.vehicle}, gimbal {effect.gimbal}: this link has vehicle 1, gimbal 1")
