"""Everything that this node can say to a vehicle: a closed list, and the only functions that encode.

`SENDABLE` names each pair of message and command. Whatever is packed passes `_allow`, which
refuses what is not in it and every number that is not finite, so a new message is a change of
this file and of the test that prints the list. There is nothing in it that disarms, arms by force,
moves a servo or drops anything; what arms, changes a mode or flies somewhere comes of the effects in
`flight_words` alone, and what a mission may hold is the closed list of `mission_form`.

A place goes as COMMAND_INT in MAV_FRAME_GLOBAL with the altitude above mean sea level: the only
form that ArduPilot and PX4 read alike, and 1e-7 degrees survive in it. Latitude and longitude of
zero are refused, for there autopilots read "cancel". Angles go as COMMAND_LONG in degrees with
both angles set and both rates unset (MAVLink guide, Gimbal Protocol v2): ArduPilot fails a pitch
whose yaw is unset and lets angles win over rates, PX4 passes rates on unconverted. Seed 000 asks
for COMMAND_LONG also for places; float32 degrees are off by up to 1.7 m; that form is for those who
ask for it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from google.protobuf.message import Message
from pymavlink.dialects.v20 import common as dialect

from autopilot.adapters.vehicle.flight_words import NotEncodable, Words, words_of
from autopilot.adapters.vehicle.heard import Item, Sender
from autopilot.adapters.vehicle.mission_form import ITEM_COMMANDS
from autopilot.adapters.vehicle.modes import Kind
from autopilot.adapters.vehicle.orders import (
    ARM_DISARM,
    COMMAND_OF,
    GIMBAL_CONFIGURE,
    GIMBAL_PITCHYAW,
    REPOSITION,
    SET_CAMERA_ZOOM,
    SET_MISSION_CURRENT,
    SET_ROI_LOCATION,
    SET_ROI_NONE,
    Form,
)
from autopilot.adapters.vehicle.pointing import wrapped
from autopilot.adapters.vehicle.transfer import Say, Word
from events.schema.vehicle_pb2 import GiveUpGimbal, PointAtAngles, PointAtPlace, ReleasePointing, SetZoom, TakeGimbal

HEARTBEAT, COMMAND_INT, COMMAND_LONG, TIMESYNC = 0, 75, 76, 111
MISSION_REQUEST_LIST, MISSION_COUNT, MISSION_CLEAR_ALL, MISSION_ACK, MISSION_REQUEST_INT = 43, 44, 45, 47, 51
MISSION_SET_CURRENT, MISSION_ITEM_INT = 41, 73
SET_MESSAGE_INTERVAL, REQUEST_MESSAGE = 511, 512

# Message and, where it carries one, command. Each effect's command may go in both forms, for an autopilot may want one.
SENDABLE: frozenset[tuple[int, int | None]] = frozenset(
    {
        (HEARTBEAT, None),
        (TIMESYNC, None),
        *((message, command) for message in (COMMAND_INT, COMMAND_LONG) for command in COMMAND_OF.values()),
        (COMMAND_LONG, SET_MESSAGE_INTERVAL),
        (COMMAND_LONG, REQUEST_MESSAGE),
        (MISSION_SET_CURRENT, None),
        (MISSION_REQUEST_LIST, None),
        (MISSION_COUNT, None),
        (MISSION_CLEAR_ALL, None),
        (MISSION_ACK, None),
        (MISSION_REQUEST_INT, None),
        *((MISSION_ITEM_INT, command) for command in ITEM_COMMANDS),
    }
)

SYSTEM_TIME, AUTOPILOT_VERSION = 2, 148
GPS_RAW, ATTITUDE, GLOBAL_POSITION, GIMBAL_INFORMATION, GIMBAL_STATUS, GIMBAL_ATTITUDE = 24, 30, 33, 280, 281, 285
CAMERA_INFORMATION, CAMERA_SETTINGS = 259, 260
SYSTEM_STATUS, CURRENT, HOME, LANDED = 1, 42, 242, 245

# Streams that may be asked for, with their period in microseconds.
STREAMS_US: dict[int, int] = {
    GLOBAL_POSITION: 200_000,
    ATTITUDE: 100_000,
    GIMBAL_ATTITUDE: 100_000,
    GPS_RAW: 1_000_000,
    GIMBAL_STATUS: 500_000,
    SYSTEM_TIME: 5_000_000,
    SYSTEM_STATUS: 1_000_000,
    CURRENT: 1_000_000,
    LANDED: 1_000_000,
}
# Messages that may be asked for one by one, of whichever component has them.
REQUESTABLE = (CAMERA_INFORMATION, CAMERA_SETTINGS, GIMBAL_INFORMATION, HOME)

ONBOARD_CONTROLLER, NO_AUTOPILOT = 18, 8  # MAV_TYPE, MAV_AUTOPILOT: never a ground station
ROLL_LOCK, PITCH_LOCK, YAW_LOCK = 4, 8, 16  # GIMBAL_MANAGER_FLAGS
FRAME_GLOBAL, FRAME_GLOBAL_INT = 0, 5
EVERY_GIMBAL = 0
EVERY_COMPONENT = 0
LEAVE, MYSELF, MY_OWN = -1, -2, -3  # MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: as it is, the sender, what the sender has
ZOOM_RANGE = 2  # CAMERA_ZOOM_TYPE: percent of the whole range
ZOOM_E4_MAX = 10_000
UNSET = math.nan
_ANYBODY = Sender(system=0, component=0)


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
        words = Words(SET_MESSAGE_INTERVAL, (message_id, STREAMS_US[message_id]))
        return self._pack(system, _long(target, words, 0))

    def ask_message(self, system: int, message_id: int) -> bytes:
        """Return the request for one of `REQUESTABLE`, of every component of the vehicle; raises NotEncodable."""
        if message_id not in REQUESTABLE:
            raise NotEncodable(f"message {message_id} is not asked for")
        target = Sender(system=system, component=EVERY_COMPONENT)
        return self._pack(system, _long(target, Words(REQUEST_MESSAGE, (message_id,)), 0))

    def ask_version(self, system: int, target: Sender) -> bytes:
        """Return the request for AUTOPILOT_VERSION."""
        return self._pack(system, _long(target, Words(REQUEST_MESSAGE, (AUTOPILOT_VERSION,)), 0))

    def timesync(self, system: int, target: Sender, tc1_ns: int, ts1_ns: int) -> bytes:
        """Return TIMESYNC for one component: a question with tc1 = 0, else the answer to its ts1."""
        return self._pack(system, _AddressedTimesync(tc1_ns, ts1_ns, target))

    def effect(
        self,
        system: int,
        target: Sender,
        effect: Message,
        confirmation: int,
        *,
        form: Form | None = None,
        kind: Kind | None = None,
    ) -> bytes:
        """Return the command for an effect; raises NotEncodable.

        `confirmation` counts the re-sends; only COMMAND_LONG can carry it (MAVLink guide, Command Protocol). `form` is
        another than the effect's own where the vehicle asked for it. Effects of the flight need the vehicle's `kind`.
        """
        message = _command(target, effect, confirmation, kind)
        return self._pack(system, message if form is None else _in_form(message, form, confirmation))

    def say(self, system: int, say: Say) -> bytes:
        """Return a message of the mission protocol; raises NotEncodable."""
        to = (say.target.system, say.target.component)
        match say.word:
            case Word.COUNT:
                message = dialect.MAVLink_mission_count_message(*to, say.number)
            case Word.LIST:
                message = dialect.MAVLink_mission_request_list_message(*to)
            case Word.REQUEST:
                message = dialect.MAVLink_mission_request_int_message(*to, say.number)
            case Word.ANSWER:
                message = dialect.MAVLink_mission_ack_message(*to, say.number)
            case Word.CLEAR:
                message = dialect.MAVLink_mission_clear_all_message(*to)
            case Word.ITEM:
                message = _item(to, say.item)
        return self._pack(system, message)

    def _pack(self, system: int, message: Any) -> bytes:
        """Pack what the list allows."""
        _allow(message)
        self._mav.srcSystem = system
        packed = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return packed


def check(effect: Message, kind: Kind | None) -> None:
    """Raise NotEncodable where an effect can't be said to such a vehicle; nothing is packed and no number used up."""
    _command(_ANYBODY, effect, 0, kind)


def _allow(message: Any) -> None:
    """Raise NotEncodable for what the list lacks, and for numbers that are none; `_may_be_unset` has the exceptions."""
    command = getattr(message, "command", None)
    if (message.get_msgId(), command) not in SENDABLE:
        raise NotEncodable(f"message {message.get_msgId()} with command {command} is not on the list")
    if command == ARM_DISARM and (message.param1, message.param2) != (1, 0):
        raise NotEncodable("nothing is disarmed, nor armed by force")
    for name in message.get_fieldnames():
        value = getattr(message, name)
        if not math.isfinite(value) and not (math.isnan(value) and name in _may_be_unset(message)):
            raise NotEncodable(f"{name} is not finite")


def _command(target: Sender, effect: Message, confirmation: int, kind: Kind | None) -> Any:
    """Return the command for an effect: of the gimbal alike for all vehicles, of the flight as its kind takes it."""
    pointing = _POINTING.get(type(effect))
    if pointing is not None:
        return pointing(target, effect, confirmation)
    words = words_of(effect, kind)
    return _int(target, words) if words.placed else _long(target, words, confirmation)


def _roi(target: Sender, effect: Any, confirmation: int) -> Any:
    del confirmation  # COMMAND_INT has no field for it
    _one_gimbal(effect)
    return _int(target, Words.to(SET_ROI_LOCATION, effect.place, (EVERY_GIMBAL, 0, 0, 0)))


def _angles(target: Sender, effect: Any, confirmation: int) -> Any:
    _one_gimbal(effect)
    if abs(effect.pitch_cdeg) > 9_000 or effect.yaw_cdeg >= 36_000:
        raise NotEncodable("pitch is outside +-90 degrees or yaw outside 0 to 359.99")
    flags = ROLL_LOCK | PITCH_LOCK | (YAW_LOCK if effect.yaw_locked else 0)
    pitch_deg, yaw_deg = effect.pitch_cdeg / 100, wrapped(effect.yaw_cdeg / 100)
    return _long(
        target, Words(GIMBAL_PITCHYAW, (pitch_deg, yaw_deg, UNSET, UNSET, flags, 0, EVERY_GIMBAL)), confirmation
    )


def _release(target: Sender, effect: Any, confirmation: int) -> Any:
    _one_gimbal(effect)
    return _long(target, Words(SET_ROI_NONE), confirmation)


def _take(target: Sender, effect: Any, confirmation: int) -> Any:
    """As "the sender", not by numbers: what the vehicle takes for our id is what counts."""
    _one_gimbal(effect)
    return _long(target, Words(GIMBAL_CONFIGURE, (MYSELF, MYSELF, LEAVE, LEAVE)), confirmation)


def _give_up(target: Sender, effect: Any, confirmation: int) -> Any:
    """Only what is ours, so that it throws nobody out who has taken it meanwhile."""
    _one_gimbal(effect)
    return _long(target, Words(GIMBAL_CONFIGURE, (MY_OWN, MY_OWN, LEAVE, LEAVE)), confirmation)


def _zoom(target: Sender, effect: Any, confirmation: int) -> Any:
    if effect.vehicle != 1 or effect.camera != 1:
        raise NotEncodable(f"vehicle {effect.vehicle}, camera {effect.camera}: this link has vehicle 1, camera 1")
    if effect.zoom_e4 > ZOOM_E4_MAX:
        raise NotEncodable(f"zoom {effect.zoom_e4 / 100} % is more than all of it")
    return _long(target, Words(SET_CAMERA_ZOOM, (ZOOM_RANGE, effect.zoom_e4 / 100)), confirmation)


_POINTING: dict[type[Message], Callable[[Sender, Any, int], Any]] = {
    PointAtPlace: _roi,
    PointAtAngles: _angles,
    ReleasePointing: _release,
    TakeGimbal: _take,
    GiveUpGimbal: _give_up,
    SetZoom: _zoom,
}


def _may_be_unset(message: Any) -> tuple[str, ...]:
    """The rates of a gimbal command, the yaw of a fly-to, and the yaw of an item of a mission."""
    if message.command == GIMBAL_PITCHYAW:
        return "param3", "param4"
    return ("param4",) if message.command == REPOSITION or message.get_msgId() == MISSION_ITEM_INT else ()


def _long(target: Sender, words: Words, confirmation: int) -> Any:
    return dialect.MAVLink_command_long_message(
        target.system, target.component, words.command, confirmation, *words.seven()
    )


def _int(target: Sender, words: Words) -> Any:
    *four, latitude_e7, longitude_e7, height_m = words.seven()
    return dialect.MAVLink_command_int_message(
        *(target.system, target.component, FRAME_GLOBAL, words.command, 0, 0),
        *four,
        *(int(latitude_e7), int(longitude_e7), height_m),
    )


def _in_form(message: Any, form: Form, confirmation: int) -> Any:
    """Return the same command in another form, with places in degrees where it is COMMAND_LONG."""
    if form is Form.MESSAGE:
        if message.command != SET_MISSION_CURRENT:
            raise NotEncodable(f"command {message.command} has no message of its own")
        to = (message.target_system, message.target_component)
        return dialect.MAVLink_mission_set_current_message(*to, int(message.param1))
    is_int = message.get_msgId() == COMMAND_INT
    head, four = (message.target_system, message.target_component), [message.param1, message.param2]
    four += [message.param3, message.param4]
    if form is Form.LONG:
        if not is_int:
            return message
        last = (message.x / 1e7, message.y / 1e7, message.z)
        return dialect.MAVLink_command_long_message(*head, message.command, confirmation, *four, *last)
    frame = FRAME_GLOBAL_INT if form is Form.INT_OTHER_FRAME else FRAME_GLOBAL
    last = (message.x, message.y, message.z) if is_int else (int(message.param5), int(message.param6), message.param7)
    return dialect.MAVLink_command_int_message(*head, frame, message.command, 0, 0, *four, *last)


def _item(to: tuple[int, int], item: Item | None) -> Any:
    assert item is not None
    return dialect.MAVLink_mission_item_int_message(
        *to,
        *(item.seq, item.frame, item.command, int(item.current), int(item.goes_on)),
        *item.parameters,
        *(item.x, item.y, item.z),
    )


def _one_gimbal(effect: Any) -> None:
    """One vehicle with one gimbal a link; it is addressed as "all", which every autopilot knows."""
    if effect.vehicle != 1 or effect.gimbal != 1:
        raise NotEncodable(f"vehicle {effect.vehicle}, gimbal {effect.gimbal}: this link has vehicle 1, gimbal 1")
