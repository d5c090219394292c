"""The messages of a vehicle that flies what it is told, beside those of `messages.py`; `BUILDERS` is the whole list.

They tell what the autopilot believes: a receiver that is wrong makes them wrong. What is sent unasked
is in `UNASKED_S`; everything else has to be asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common as dialect

from autopilot.sim import messages
from autopilot.sim.extended import mission_current
from autopilot.sim.flying import Flight
from autopilot.sim.messages import ARMED, CUSTOM_MODE, Instant
from autopilot.sim.modes import Doing
from autopilot.sim.supplies import CELLS
from autopilot.sim.transfer import Transfer

GPS_SENSOR, BATTERY_SENSOR = 32, 1 << 25  # MAV_SYS_STATUS_SENSOR
SENSORS = 0x3F | BATTERY_SENSOR
CAPABILITIES = 1 | 2 | 4 | 8 | 8192 | 262144  # missions, parameters, COMMAND_INT, MAVLink 2, gimbal manager
LOW_PERCENT = 10
NO_MISSION, NOT_STARTED, ACTIVE, PAUSED, COMPLETE = 1, 2, 3, 4, 5  # MISSION_STATE


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleInstant(Instant):
    """Everything that a message of a vehicle may tell."""

    flight: Flight
    autopilot: int
    version: int
    unix_us: int
    transfer: Transfer


def _heartbeat(now: VehicleInstant) -> Any:
    armed = now.motion.armed
    kind = dialect.MAV_TYPE_QUADROTOR if now.flight.frame.hovers else dialect.MAV_TYPE_FIXED_WING
    base = CUSTOM_MODE | (ARMED if armed else 0)
    state = dialect.MAV_STATE_ACTIVE if armed else dialect.MAV_STATE_STANDBY
    return dialect.MAVLink_heartbeat_message(kind, now.autopilot, base, now.motion.mode, state, 3)


def _sys_status(now: VehicleInstant) -> Any:
    flight, battery = now.flight, now.flight.battery
    health = SENSORS & ~(0 if flight.gps.good else GPS_SENSOR)
    health &= ~(0 if battery.charge_percent > LOW_PERCENT else BATTERY_SENSOR)
    voltage_mv, current_ca = battery.cell_mv * CELLS, round(battery.current_a * 100)
    return dialect.MAVLink_sys_status_message(
        SENSORS, SENSORS, health, 300, voltage_mv, current_ca, battery.remaining_percent, 0, 0, 0, 0, 0, 0
    )


def _battery(now: VehicleInstant) -> Any:
    battery = now.flight.battery
    cells = [battery.cell_mv] * CELLS + [65_535] * (10 - CELLS)
    return dialect.MAVLink_battery_status_message(
        0,
        dialect.MAV_BATTERY_FUNCTION_ALL,
        dialect.MAV_BATTERY_TYPE_LIPO,
        32_767,
        cells,
        round(battery.current_a * 100),
        round(battery.drawn_mah),
        -1,
        battery.remaining_percent,
    )


def _landed(now: VehicleInstant) -> Any:
    return dialect.MAVLink_extended_sys_state_message(0, now.flight.landed_state)


def _time(now: VehicleInstant) -> Any:
    return dialect.MAVLink_system_time_message(now.unix_us, now.boot_ms)


def _gps(now: VehicleInstant) -> Any:
    gps, altitude_mm = now.flight.gps, now.home.altitude_mm + round(now.motion.up_m * 1000)
    return dialect.MAVLink_gps_raw_int_message(
        now.boot_us, gps.fix, *now.position_e7(), altitude_mm, 90, 120, 65535, 65535, gps.satellites
    )


def _version(now: VehicleInstant) -> Any:
    nothing = [0] * 8
    return dialect.MAVLink_autopilot_version_message(
        CAPABILITIES, now.version, 0, 0, 0, nothing, nothing, nothing, 0, 0, 1
    )


def _mission(now: VehicleInstant) -> Any:
    flight, runner = now.flight, now.flight.runner
    first = runner.manner.first
    total, flies = max(len(flight.items) - first, 0), flight.doing is Doing.MISSION
    if total == 0:
        state = NO_MISSION
    elif runner.finished:
        state = COMPLETE
    else:
        state = ACTIVE if runner.running else PAUSED if runner.current else NOT_STARTED
    return mission_current(runner.current, total, state, 1 if flies else 2, now.transfer.mission_id)


BUILDERS: dict[int, Callable[[VehicleInstant], Any]] = {
    **messages.BUILDERS,
    dialect.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    dialect.MAVLINK_MSG_ID_BATTERY_STATUS: _battery,
    dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: _landed,
    dialect.MAVLINK_MSG_ID_SYSTEM_TIME: _time,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: _gps,
    dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION: _version,
    dialect.MAVLINK_MSG_ID_MISSION_CURRENT: _mission,
}

ARDUPILOT_UNASKED_S: dict[int, float] = dict(messages.UNASKED_S)
PX4_UNASKED_S: dict[int, float] = {
    **messages.UNASKED_S,
    dialect.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
    dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
    dialect.MAVLINK_MSG_ID_BATTERY_STATUS: 2.0,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: 1.0,
    dialect.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 0.2,
    dialect.MAVLINK_MSG_ID_ATTITUDE: 0.1,
}
