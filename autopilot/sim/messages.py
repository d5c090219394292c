"""The messages that the simulated aircraft can send, each made of its state; `BUILDERS` is the whole list.

Like a servo mount under ArduPilot, the gimbal reports its yaw from the vehicle's nose and says so
in the flags. Nothing here decides when a message is sent.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as dialect

from autopilot.geo import LocalFrame, offset
from autopilot.sim.gimbal import PITCH_DEG, Gimbal
from autopilot.sim.route import Motion

ARMED, CUSTOM_MODE = 128, 1  # MAV_MODE_FLAG
ROLL_LOCK, PITCH_LOCK, YAW_LOCK, YAW_IN_VEHICLE = 4, 8, 16, 32  # GIMBAL_DEVICE_FLAGS
TURNS_PITCH = dialect.GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_AXIS
TURNS_YAW = dialect.GIMBAL_MANAGER_CAP_FLAGS_HAS_YAW_AXIS
CAPABILITIES = 8 | 8192 | 262144  # COMMAND_INT, MAVLink 2, gimbal manager


@dataclass(frozen=True, slots=True, kw_only=True)
class Instant:
    """Everything that a message may tell."""

    boot_ms: int
    home: LocalFrame
    motion: Motion
    gimbal: Gimbal
    yaw_locked: bool

    @property
    def boot_us(self) -> int:
        """Microseconds since boot."""
        return self.boot_ms * 1000

    def position_e7(self) -> tuple[int, int]:
        """Return latitude and longitude in 1e-7 degrees."""
        latitude_deg, longitude_deg = offset(
            self.home.latitude_deg, self.home.longitude_deg, self.motion.east_m, self.motion.north_m
        )
        return round(latitude_deg * 1e7), round(longitude_deg * 1e7)


def _heartbeat(now: Instant) -> Any:
    base = CUSTOM_MODE | (ARMED if now.motion.armed else 0)
    status = dialect.MAV_STATE_ACTIVE if now.motion.armed else dialect.MAV_STATE_STANDBY
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, base, now.motion.mode, status, 3
    )


def _sys_status(now: Instant) -> Any:
    del now
    healthy = 0x3F
    return dialect.MAVLink_sys_status_message(healthy, healthy, healthy, 300, 16_400, 1_200, 92, 0, 0, 0, 0, 0, 0)


def _home_position(now: Instant) -> Any:
    home, level = now.home, [1.0, 0.0, 0.0, 0.0]
    return dialect.MAVLink_home_position_message(
        round(home.latitude_deg * 1e7), round(home.longitude_deg * 1e7), home.altitude_mm, 0, 0, 0, level, 0, 0, 0
    )


def _origin(now: Instant) -> Any:
    home = now.home
    return dialect.MAVLink_gps_global_origin_message(
        round(home.latitude_deg * 1e7), round(home.longitude_deg * 1e7), home.altitude_mm, now.boot_us
    )


def _global_position(now: Instant) -> Any:
    motion, height_mm = now.motion, round(now.motion.up_m * 1000)
    return dialect.MAVLink_global_position_int_message(
        now.boot_ms,
        *now.position_e7(),
        now.home.altitude_mm + height_mm,
        height_mm,
        round(motion.north_m_s * 100),
        round(motion.east_m_s * 100),
        round(-motion.up_m_s * 100),
        round(motion.yaw_deg * 100) % 36_000,
    )


def _attitude(now: Instant) -> Any:
    yaw = math.radians((now.motion.yaw_deg + 180) % 360 - 180)
    return dialect.MAVLink_attitude_message(now.boot_ms, 0, 0, yaw, 0, 0, math.radians(now.motion.yaw_deg_s))


def _gps_raw(now: Instant) -> Any:
    altitude_mm = now.home.altitude_mm + round(now.motion.up_m * 1000)
    return dialect.MAVLink_gps_raw_int_message(
        now.boot_us, dialect.GPS_FIX_TYPE_3D_FIX, *now.position_e7(), altitude_mm, 90, 120, 65535, 65535, 14
    )


def _gimbal_attitude(now: Instant) -> Any:
    """Yaw of the mount is from the nose also while it is locked to north (as seen on a servo mount)."""
    pitch, yaw = math.radians(now.gimbal.pitch_deg) / 2, math.radians(now.gimbal.yaw_deg) / 2
    q = [
        math.cos(pitch) * math.cos(yaw),
        -math.sin(pitch) * math.sin(yaw),
        math.sin(pitch) * math.cos(yaw),
        math.cos(pitch) * math.sin(yaw),
    ]
    flags = ROLL_LOCK | PITCH_LOCK | YAW_IN_VEHICLE | (YAW_LOCK if now.yaw_locked else 0)
    return dialect.MAVLink_gimbal_device_attitude_status_message(
        0, 0, now.boot_ms, flags, q, math.nan, math.nan, math.nan, 0
    )


def _gimbal_information(now: Instant) -> Any:
    pitch_min, pitch_max = (math.radians(limit) for limit in PITCH_DEG)
    pan, flags = (math.pi, TURNS_PITCH | TURNS_YAW) if now.gimbal.pans else (0.0, TURNS_PITCH)
    return dialect.MAVLink_gimbal_manager_information_message(
        now.boot_ms, flags, 1, 0.0, 0.0, pitch_min, pitch_max, -pan, pan
    )


def _gimbal_status(now: Instant) -> Any:
    return dialect.MAVLink_gimbal_manager_status_message(
        now.boot_ms, ROLL_LOCK | PITCH_LOCK, 1, *now.gimbal.primary, 0, 0
    )


def _version(now: Instant) -> Any:
    del now
    nothing = [0] * 8
    return dialect.MAVLink_autopilot_version_message(
        CAPABILITIES, 4 << 24 | 6 << 16, 0, 0, 0, nothing, nothing, nothing, 0, 0, 1
    )


BUILDERS: dict[int, Callable[[Instant], Any]] = {
    dialect.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    dialect.MAVLINK_MSG_ID_HOME_POSITION: _home_position,
    dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: _origin,
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _global_position,
    dialect.MAVLINK_MSG_ID_ATTITUDE: _attitude,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: _gps_raw,
    dialect.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: _gimbal_attitude,
    dialect.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION: _gimbal_information,
    dialect.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: _gimbal_status,
    dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION: _version,
}

UNASKED_S: dict[int, float] = {
    dialect.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    dialect.MAVLINK_MSG_ID_HOME_POSITION: 5.0,
    dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 5.0,
}
