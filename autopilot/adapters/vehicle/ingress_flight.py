"""Readers of what a vehicle says of its flight: reception, battery, home, landed, mission progress, mission transfer.

Each takes a decoded message and its sender, and returns a value, None (nothing of interest), or raises Unfit.
`ingress` does the framing and calls them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import common as dialect

from autopilot.adapters.vehicle.extensions import extension
from autopilot.adapters.vehicle.fitness import LATITUDE_MAX_E7, LONGITUDE_MAX_E7, finite, on_earth, within
from autopilot.adapters.vehicle.heard import (
    Battery,
    Current,
    Fix,
    Home,
    Item,
    ItemCount,
    ItemGiven,
    ItemRequest,
    Landed,
    MissionAnswer,
    Reached,
    Reception,
    Sender,
)

FIX_3D = 3
FIX_TYPES = range(9)  # GPS_FIX_TYPE
VOLTAGE_UNKNOWN = 0xFFFF
VOLTAGE_MAX_MV = 500_000  # ten cells at their limit, tenfold
CELLS = 10
MISSION = 0  # MAV_MISSION_TYPE: fences and rally points are not read
NO_MISSION, NOT_STARTED = 1, 2  # MISSION_STATE
FRAMES = range(22)  # MAV_FRAME
PARAMETER_MAX = 1e7  # above anything a parameter of a mission means, below what float32 can't tell apart by ones


def _to(message: Any) -> Sender:
    return Sender(system=message.target_system, component=message.target_component)


def _reception(message: Any, sender: Sender) -> Fix | Reception:
    within(message.fix_type in FIX_TYPES)
    reception = Reception(
        sender=sender,
        fix_type=message.fix_type,
        satellites=None if message.satellites_visible == 255 else message.satellites_visible,
        hdop_e2=None if message.eph == 0xFFFF else message.eph,
    )
    if message.fix_type < FIX_3D:
        return reception
    on_earth(message.lat, message.lon, message.alt)
    return Fix(
        sender=sender,
        latitude_e7=message.lat,
        longitude_e7=message.lon,
        altitude_mm=message.alt,
        reception=reception,
    )


def _charge(percent: int) -> int | None:
    """-1 means that the vehicle does not know."""
    within(-1 <= percent <= 100)
    return None if percent < 0 else percent


def _system_status(message: Any, sender: Sender) -> Battery:
    voltage_mv = message.voltage_battery
    return Battery(
        sender=sender,
        charge_percent=_charge(message.battery_remaining),
        voltage_mv=None if voltage_mv == VOLTAGE_UNKNOWN else voltage_mv,
        whole=True,
    )


def _battery_status(message: Any, sender: Sender) -> Battery | None:
    """Cells that are not there are 65535; a battery whose cells are not known tells its voltage in the first ones."""
    if message.id != 0:
        return None
    cells_mv = [cell for cell in message.voltages if cell != VOLTAGE_UNKNOWN]
    within(len(cells_mv) <= CELLS and sum(cells_mv) <= VOLTAGE_MAX_MV)
    return Battery(
        sender=sender,
        charge_percent=_charge(message.battery_remaining),
        voltage_mv=sum(cells_mv) if cells_mv else None,
        whole=False,
    )


def _home(message: Any, sender: Sender) -> Home:
    on_earth(message.latitude, message.longitude, message.altitude)
    return Home(
        sender=sender, latitude_e7=message.latitude, longitude_e7=message.longitude, altitude_mm=message.altitude
    )


def _landed(message: Any, sender: Sender) -> Landed | None:
    """0 means that it does not know."""
    within(message.landed_state <= 4)
    return Landed(sender=sender, landed_state=message.landed_state) if message.landed_state else None


def _current(message: Any, sender: Sender) -> Current:
    begun = message.mission_state not in (NO_MISSION, NOT_STARTED)
    return Current(sender=sender, seq=message.seq, begun=begun)


def _reached(message: Any, sender: Sender) -> Reached:
    return Reached(sender=sender, seq=message.seq)


def _request(message: Any, sender: Sender) -> ItemRequest | None:
    if message.mission_type != MISSION:
        return None
    return ItemRequest(sender=sender, target=_to(message), seq=message.seq)


def _answer(message: Any, sender: Sender) -> MissionAnswer | None:
    if message.mission_type != MISSION:
        return None
    (opaque_id,) = extension(message, 4, "I")
    return MissionAnswer(sender=sender, target=_to(message), result=message.type, opaque_id=opaque_id)


def _count(message: Any, sender: Sender) -> ItemCount | None:
    if message.mission_type != MISSION:
        return None
    (opaque_id,) = extension(message, 5, "I")
    return ItemCount(sender=sender, target=_to(message), count=message.count, opaque_id=opaque_id)


def _item(message: Any, sender: Sender) -> ItemGiven | None:
    """Parameters may be unset (NaN); they may not be infinite, nor the height unset."""
    if message.mission_type != MISSION:
        return None
    parameters = (message.param1, message.param2, message.param3, message.param4)
    finite(message.z, *(value for value in parameters if not math.isnan(value)))
    within(all(math.isnan(value) or abs(value) <= PARAMETER_MAX for value in (*parameters, message.z)))
    within(message.frame in FRAMES and abs(message.x) <= LATITUDE_MAX_E7 and abs(message.y) <= LONGITUDE_MAX_E7)
    item = Item(
        seq=message.seq,
        frame=message.frame,
        command=message.command,
        current=bool(message.current),
        goes_on=bool(message.autocontinue),
        parameters=parameters,
        x=message.x,
        y=message.y,
        z=message.z,
    )
    return ItemGiven(sender=sender, target=_to(message), item=item)


READERS: dict[int, Callable[[Any, Sender], Any]] = {
    dialect.MAVLINK_MSG_ID_SYS_STATUS: _system_status,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: _reception,
    dialect.MAVLINK_MSG_ID_MISSION_REQUEST: _request,
    dialect.MAVLINK_MSG_ID_MISSION_REQUEST_INT: _request,
    dialect.MAVLINK_MSG_ID_MISSION_CURRENT: _current,
    dialect.MAVLINK_MSG_ID_MISSION_COUNT: _count,
    dialect.MAVLINK_MSG_ID_MISSION_ITEM_REACHED: _reached,
    dialect.MAVLINK_MSG_ID_MISSION_ACK: _answer,
    dialect.MAVLINK_MSG_ID_MISSION_ITEM_INT: _item,
    dialect.MAVLINK_MSG_ID_BATTERY_STATUS: _battery_status,
    dialect.MAVLINK_MSG_ID_HOME_POSITION: _home,
    dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: _landed,
}
