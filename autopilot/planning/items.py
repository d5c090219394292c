"""The translation contract of seed 004: mission items as the plain items of a MAVLink mission.

| mission item | planned items |
|---|---|
| waypoint | one NAV_WAYPOINT |
| region_search | NAV_WAYPOINTs of the sweep, with the ways to it and on from it |
| search (no row in the seed) | copter: one NAV_WAYPOINT that holds; plane: NAV_WAYPOINTs once around the place |
| return | one NAV_RETURN_TO_LAUNCH, or one NAV_LAND at the item's own place |
| target_follow_breakpoint | none; where it stood is kept |
| cruise_speed_mps | one DO_CHANGE_SPEED before the item's own |

A copter's plan begins with NAV_TAKEOFF and ends with NAV_LAND; a plane's does neither. Only commands of the seed's list
are used, which is why a plane circles a place on waypoints.

One departure: the seed wants the speed of DO_CHANGE_SPEED "in param_1". In MAVLink (MAV_CMD 178) parameter 1 is the
kind of speed and parameter 2 the speed in m/s; sent the seed's form, a vehicle would keep its speed, or take one of 0.
So the speed is in parameter 2.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final, Literal

# MAV_CMD and MAV_FRAME, by MAVLink's numbers.
NAV_WAYPOINT: Final = 16
NAV_RETURN_TO_LAUNCH: Final = 20
NAV_LAND: Final = 21
NAV_TAKEOFF: Final = 22
DO_CHANGE_SPEED: Final = 178
COMMAND_NAMES: Final = {
    NAV_WAYPOINT: "NAV_WAYPOINT",
    NAV_RETURN_TO_LAUNCH: "NAV_RETURN_TO_LAUNCH",
    NAV_LAND: "NAV_LAND",
    NAV_TAKEOFF: "NAV_TAKEOFF",
    DO_CHANGE_SPEED: "DO_CHANGE_SPEED",
}
GLOBAL_RELATIVE_ALT: Final = 3

AIRSPEED: Final = 0.0  # SPEED_TYPE: what a plane holds
GROUND_SPEED: Final = 1.0  # what a copter holds
KEEP_THROTTLE: Final = -1.0

Autopilot = Literal["ardupilot", "px4"]
Params = tuple[float, float, float, float | None]

# Parameter 4 is a yaw; None stands for NaN there, "as the vehicle sees fit".
_PLAIN: Final[Params] = (0.0, 0.0, 0.0, None)
_NOTHING: Final[Params] = (0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedItem:
    """One item of a MAVLink mission (MISSION_ITEM_INT), before a vehicle's own manners."""

    seq: int  # its place in the upload, from 0
    command: int  # MAV_CMD
    frame: int = GLOBAL_RELATIVE_ALT  # MAV_FRAME
    current: bool = False  # true of the first alone
    auto_continue: bool = True  # true of all but the last
    params: Params = _PLAIN  # 1 to 4; None: NaN
    lat_e7: int = 0  # degrees; 0 where the command has no place
    lon_e7: int = 0
    height_mm: int = 0  # above home
    source: str = ""  # id of the mission item that it comes from; empty: takeoff, landing, home


@dataclass(frozen=True, slots=True)
class Spot:
    """A place in the units of MISSION_ITEM_INT."""

    lat_e7: int
    lon_e7: int
    height_mm: int  # above home


def waypoint(spot: Spot, source: str, hold_s: float = 0.0) -> PlannedItem:
    """Return a NAV_WAYPOINT; `hold_s` is how long a copter stays, a plane ignores it."""
    return _at(NAV_WAYPOINT, spot, source, (hold_s, 0.0, 0.0, None))


def land(spot: Spot, source: str = "") -> PlannedItem:
    """Return a NAV_LAND."""
    return _at(NAV_LAND, spot, source, _PLAIN)


def takeoff(spot: Spot) -> PlannedItem:
    """Return a NAV_TAKEOFF to the spot's height."""
    return _at(NAV_TAKEOFF, spot, "", _PLAIN)


def return_to_launch(source: str) -> PlannedItem:
    """Return a NAV_RETURN_TO_LAUNCH."""
    return PlannedItem(seq=0, command=NAV_RETURN_TO_LAUNCH, params=_NOTHING, source=source)


def change_speed(speed_mps: float, source: str, *, through_air: bool) -> PlannedItem:
    """Return a DO_CHANGE_SPEED; `through_air`: a plane's airspeed, else speed over ground."""
    kind = AIRSPEED if through_air else GROUND_SPEED
    return PlannedItem(seq=0, command=DO_CHANGE_SPEED, params=(kind, speed_mps, KEEP_THROTTLE, 0.0), source=source)


def numbered(items: Iterable[PlannedItem]) -> tuple[PlannedItem, ...]:
    """Return the items with their places: the first is current, all but the last go on by themselves."""
    all_of_them = list(items)
    last = len(all_of_them) - 1
    return tuple(
        replace(item, seq=seq, current=seq == 0, auto_continue=seq != last) for seq, item in enumerate(all_of_them)
    )


def placeholder(home: Spot) -> PlannedItem:
    """Return what stands for home at the head of an upload."""
    return _at(NAV_WAYPOINT, replace(home, height_mm=0), "", _NOTHING)


def without_nan(item: PlannedItem) -> PlannedItem:
    """Return the item with 0 in the place of NaN."""
    first, second, third, fourth = item.params
    return replace(item, params=(first, second, third, fourth or 0.0))


def _at(command: int, spot: Spot, source: str, params: Params) -> PlannedItem:
    return PlannedItem(
        seq=0,
        command=command,
        params=params,
        lat_e7=spot.lat_e7,
        lon_e7=spot.lon_e7,
        height_mm=spot.height_mm,
        source=source,
    )
