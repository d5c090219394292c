"""Bytes of a datagram into plain values, or into named rejections; it never raises.

A datagram is read for itself: what is left of a broken one never swallows the next. Only the
messages in `READERS` are decoded, each is checked for finite numbers and for its range before
it becomes a value. What this does not do: decide whether the sender is the vehicle, or remember
anything.

Where a frame begins and ends is in `frames`. Whoever calls may refuse whole frames before they are
read; the signature itself is skipped here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from pymavlink.dialects.v20 import common as dialect

from autopilot.adapters.vehicle import ingress_flight
from autopilot.adapters.vehicle.extensions import extension
from autopilot.adapters.vehicle.fitness import Unfit as _Unfit
from autopilot.adapters.vehicle.fitness import finite as _finite
from autopilot.adapters.vehicle.fitness import on_earth as _on_earth
from autopilot.adapters.vehicle.fitness import within as _within
from autopilot.adapters.vehicle.frames import MAGIC, SIGNED, length_of, message_id
from autopilot.adapters.vehicle.heard import (
    Answer,
    Attitude,
    CameraInformation,
    CameraSettings,
    GimbalAttitude,
    GimbalLimits,
    GimbalStatus,
    Heard,
    Heartbeat,
    Position,
    Rejected,
    Sender,
    SystemTime,
    Timesync,
    Version,
)
from autopilot.adapters.vehicle.pointing import forward_and_right

# The dialect lets an environment variable switch the checksum off; a node never may.
dialect.MAVLINK_IGNORE_CRC = 0

_DECODER = dialect.MAVLink(None)  # its `decode` keeps nothing from one frame to the next

HEADING_UNKNOWN = 65535
ARMED = 128  # MAV_MODE_FLAG_SAFETY_ARMED
NO_AUTOPILOT = 8  # MAV_AUTOPILOT_INVALID
YAW_LOCK, YAW_IN_VEHICLE, YAW_IN_EARTH = 16, 32, 64  # GIMBAL_DEVICE_FLAGS
QUATERNION_NORM = (0.9, 1.1)
YEARS_MS = (1_420_070_400_000, 4_102_444_800_000)  # 2015 (MAVLink 2 began to count there) to 2100
YAW_AXIS, ENDLESS_YAW, ANY_AXIS = 256, 2048, 4 | 32 | 256  # GIMBAL_MANAGER_CAP_FLAGS
HAS_ZOOM = 64  # CAMERA_CAP_FLAGS_HAS_BASIC_ZOOM
PERCENT_MAX = 100


def admit_all(frame: bytes) -> str:
    """Refuse nothing."""
    del frame
    return ""


def read(datagram: bytes, admit: Callable[[bytes], str] = admit_all) -> Iterator[Heard | Rejected]:
    """Yield what a datagram holds, in its order. Messages that nobody here needs are passed over in silence.

    `admit` judges every whole frame before anything of it is read, and returns the name of what is wrong, or "".
    """
    at = 0
    while at < len(datagram):
        frame = datagram[at:]
        if frame[0] != MAGIC:
            yield Rejected("garbage")
            return
        length = length_of(frame)
        if length is None or length > len(frame):
            yield Rejected("truncated")
            return
        refusal = admit(frame[:length])
        outcome = Rejected(refusal) if refusal else _message(frame[:length])
        if outcome is not None:
            yield outcome
        at += length


def _message(frame: bytes) -> Heard | Rejected | None:
    """Return what one frame says; None for a message that is of no interest."""
    if frame[2] & ~SIGNED:
        return Rejected("incompatible")
    reader = READERS.get(message_id(frame))
    if reader is None:
        return None
    try:
        message = _DECODER.decode(bytearray(frame))
    except dialect.MAVError:
        return Rejected("bad checksum")
    try:
        return reader(message, Sender(system=frame[5], component=frame[6]))
    except _Unfit as unfit:
        return Rejected(str(unfit))


def _heartbeat(message: Any, sender: Sender) -> Heartbeat | None:
    """Pass on an autopilot's; ground stations and cameras say that they are none (MAVLink guide, Heartbeat)."""
    if message.autopilot == NO_AUTOPILOT:
        return None
    _within(sender.system != 0 and sender.component != 0)
    return Heartbeat(
        sender=sender,
        autopilot=message.autopilot,
        vehicle_type=message.type,
        armed=bool(message.base_mode & ARMED),
        custom_mode=message.custom_mode,
    )


def _answer(message: Any, sender: Sender) -> Answer:
    return Answer(
        sender=sender,
        command=message.command,
        result=message.result,
        progress=message.progress,
        target=Sender(system=message.target_system, component=message.target_component),
    )


def _position(message: Any, sender: Sender) -> Position:
    _on_earth(message.lat, message.lon, message.alt, message.relative_alt)
    _within(message.hdg < 36_000 or message.hdg == HEADING_UNKNOWN)
    return Position(
        sender=sender,
        boot_ms=message.time_boot_ms,
        latitude_e7=message.lat,
        longitude_e7=message.lon,
        altitude_mm=message.alt,
        height_mm=message.relative_alt,
        north_cm_s=message.vx,
        east_cm_s=message.vy,
        down_cm_s=message.vz,
        heading_cdeg=None if message.hdg == HEADING_UNKNOWN else message.hdg,
    )


def _attitude(message: Any, sender: Sender) -> Attitude:
    _finite(message.roll, message.pitch, message.yaw, message.yawspeed)
    _within(abs(message.yaw) <= 2 * math.pi and abs(message.yawspeed) <= 50)
    return Attitude(
        sender=sender,
        boot_ms=message.time_boot_ms,
        yaw_deg=math.degrees(message.yaw),
        yaw_rate_deg_s=math.degrees(message.yawspeed),
    )


def _gimbal_attitude(message: Any, sender: Sender) -> GimbalAttitude:
    """Frame of yaw: its flag; where neither is set YAW_LOCK tells it (MAVLink definition of message 285).

    ArduPilot's servo mount sets 44 or 60: yaw from the nose in both, though in the second it is locked to north.
    """
    _finite(*message.q)
    _within(QUATERNION_NORM[0] <= math.hypot(*message.q) <= QUATERNION_NORM[1])
    pitch_deg, yaw_deg = forward_and_right(*message.q)
    flags = message.flags
    from_north = bool(flags & YAW_IN_EARTH) or (not flags & YAW_IN_VEHICLE and bool(flags & YAW_LOCK))
    return GimbalAttitude(
        sender=sender, boot_ms=message.time_boot_ms, pitch_deg=pitch_deg, yaw_deg=yaw_deg, from_north=from_north
    )


def _gimbal_limits(message: Any, sender: Sender) -> GimbalLimits:
    """The message has radians, the command that uses them degrees. NaN, and 0 for all four, is "not told"."""
    pitch, yaw = (message.pitch_min, message.pitch_max), (message.yaw_min, message.yaw_max)
    silent = not any(pitch + yaw)
    flags = message.cap_flags
    return GimbalLimits(
        sender=sender,
        pitch_deg=None if silent else _span(*pitch),
        yaw_deg=None if silent else _span(*yaw),
        has_yaw=bool(flags & YAW_AXIS) if flags & ANY_AXIS else None,
        turns_endlessly=bool(flags & ENDLESS_YAW),
    )


def _system_time(message: Any, sender: Sender) -> SystemTime | None:
    """Zero means that the autopilot does not know the time (MAVLink definition of message 2)."""
    if message.time_unix_usec == 0:
        return None
    wall_ms = message.time_unix_usec // 1000
    _within(YEARS_MS[0] <= wall_ms < YEARS_MS[1])
    return SystemTime(sender=sender, wall_ms=wall_ms)


def _timesync(message: Any, sender: Sender) -> Timesync:
    """The dialect drops whom it is for."""
    system, component = extension(message, 16, "BB")
    target = Sender(system=system, component=component)
    return Timesync(sender=sender, tc1_ns=message.tc1, ts1_ns=message.ts1, target=target)


def _version(message: Any, sender: Sender) -> Version:
    return Version(
        sender=sender,
        capabilities=message.capabilities,
        software_version=message.flight_sw_version,
        board_version=message.board_version,
    )


def _span(lowest: float, highest: float) -> tuple[float, float] | None:
    if math.isnan(lowest) or math.isnan(highest):
        return None
    _finite(lowest, highest)
    _within(lowest <= highest and max(abs(lowest), abs(highest)) <= 2 * math.pi)
    return math.degrees(lowest), math.degrees(highest)


def _gimbal_status(message: Any, sender: Sender) -> GimbalStatus:
    """Half an id is nobody's: who controls a gimbal has a system and a component."""
    system, component = message.primary_control_sysid, message.primary_control_compid
    _within((system == 0) == (component == 0))
    return GimbalStatus(sender=sender, primary=Sender(system=system, component=component))


def _camera_information(message: Any, sender: Sender) -> CameraInformation:
    return CameraInformation(sender=sender, zooms=bool(message.flags & HAS_ZOOM))


def _camera_settings(message: Any, sender: Sender) -> CameraSettings:
    zoom = message.zoomLevel
    if math.isnan(zoom):
        return CameraSettings(sender=sender, zoom_percent=None)
    _finite(zoom)
    _within(0 <= zoom <= PERCENT_MAX)
    return CameraSettings(sender=sender, zoom_percent=zoom)


READERS: dict[int, Callable[[Any, Sender], Heard | None]] = {
    dialect.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    dialect.MAVLINK_MSG_ID_COMMAND_ACK: _answer,
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _position,
    dialect.MAVLINK_MSG_ID_ATTITUDE: _attitude,
    dialect.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: _gimbal_attitude,
    dialect.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION: _gimbal_limits,
    dialect.MAVLINK_MSG_ID_SYSTEM_TIME: _system_time,
    dialect.MAVLINK_MSG_ID_TIMESYNC: _timesync,
    dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION: _version,
    dialect.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: _gimbal_status,
    dialect.MAVLINK_MSG_ID_CAMERA_INFORMATION: _camera_information,
    dialect.MAVLINK_MSG_ID_CAMERA_SETTINGS: _camera_settings,
    **ingress_flight.READERS,
}
