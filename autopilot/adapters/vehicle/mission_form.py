"""A plan as the items that a vehicle is given, and what each autopilot is known to give back for them.

What is given: MAV_FRAME_GLOBAL_RELATIVE_ALT, the height above home. ArduPilot keeps home at 0, so a placeholder goes
first and the plan begins at 1. PX4 takes commands without a place in MAV_FRAME_MISSION only. A parameter 4 that is
unset is NaN where the command has a yaw; ArduPilot has no use for that yaw, so it is given 0.

What comes back (ArduPilot: `AP_Mission::mavlink_int_to_mission_cmd` and `mission_cmd_to_mavlink_int`; PX4:
`MavlinkMissionManager::parse_mavlink_mission_item` and `format_mavlink_mission_item`; the first also seen on a copter):

| | ArduPilot | PX4 |
|---|---|---|
| item 0 | home, whatever was given | the plan's first |
| frame | 3; 0 where the command has no place | 3 or 6; 2 where it has no place |
| NAV_WAYPOINT | copter: p1 whole seconds; plane: p2, p3 whole metres up to 255; the rest 0 | p3 is 0; p4 as a turn |
| NAV_LAND | p1 whole; p4 is 1, or -1 for a negative one | p1 is 0, p2 whole; p4 as a turn |
| NAV_TAKEOFF | p1 whole; the rest 0 | p1 to p3 are 0; p4 as a turn |
| NAV_RETURN_TO_LAUNCH | all 0 | as given |
| DO_CHANGE_SPEED | p1 whole, p4 is 0 | as given |
| height | whole centimetres, cut off | float32 |
| autocontinue | 1 | as given; behind the last it says nothing |

Of another autopilot nothing is known: it has to give back what it was given.

Plain values in and out; nothing here sends.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from dataclasses import replace

from autopilot.adapters.vehicle.fitness import LATITUDE_MAX_E7, LONGITUDE_MAX_E7
from autopilot.adapters.vehicle.heard import Item
from autopilot.adapters.vehicle.modes import Family
from events.schema.mission_pb2 import PlannedItem

NAV_WAYPOINT, NAV_RETURN_TO_LAUNCH, NAV_LAND, NAV_TAKEOFF, DO_CHANGE_SPEED = 16, 20, 21, 22, 178
LOCATED = frozenset({NAV_WAYPOINT, NAV_LAND, NAV_TAKEOFF})
# Everything that a mission of this node may hold: a closed list, as that of commands is.
ITEM_COMMANDS = LOCATED | {NAV_RETURN_TO_LAUNCH, DO_CHANGE_SPEED}

GLOBAL, MISSION, RELATIVE, GLOBAL_INT, RELATIVE_INT = 0, 2, 3, 5, 6  # MAV_FRAME
HEIGHT_M = (-500.0, 20_000.0)
WHOLE_MAX = 0xFFFF  # ArduPilot keeps a first parameter in 16 bits
_SAME_FRAME = {GLOBAL_INT: GLOBAL, RELATIVE_INT: RELATIVE}
_CENTIMETRE_M = 0.011  # one, and what float32 makes of it
_TURN_DEG = 0.01  # PX4 keeps a yaw in radians, in float32
_FLOAT32 = 1e-6


class Unflyable(ValueError):
    """The plan must not or can not be given to this vehicle; the text says why."""


def given(items: Sequence[PlannedItem], family: Family) -> tuple[Item, ...]:
    """Return the items as they are given to a vehicle, numbered as it counts. Raises Unflyable."""
    if not items:
        raise Unflyable("no items")
    plan = [_item(number, item, family) for number, item in enumerate(items)]
    if family.is_ardupilot:
        plan.insert(0, _home(plan))
    last = len(plan) - 1
    return tuple(replace(item, seq=seq, current=seq == 0, goes_on=seq != last) for seq, item in enumerate(plan))


def _home(plan: Sequence[Item]) -> Item:
    """ArduPilot keeps its own home there; what is given is only to be a place."""
    place = next((item for item in plan if item.command in LOCATED), None)
    if place is None:
        raise Unflyable("no item has a place")
    return replace(place, command=NAV_WAYPOINT, frame=GLOBAL, parameters=(0.0, 0.0, 0.0, 0.0), z=0.0)


def _item(number: int, planned: PlannedItem, family: Family) -> Item:
    located = planned.command in LOCATED
    if planned.command not in ITEM_COMMANDS:
        raise Unflyable(f"item {number}: command {planned.command} is not on the list")
    if located != planned.HasField("place"):
        raise Unflyable(f"item {number}: command {planned.command} with a place: {not located}")
    x, y, z = _place(number, planned) if located else (0, 0, 0.0)
    return Item(
        seq=number,
        frame=MISSION if family is Family.PX4 and not located else RELATIVE,
        command=planned.command,
        current=False,
        goes_on=True,
        parameters=_parameters(planned, family),
        x=x,
        y=y,
        z=z,
    )


def _place(number: int, planned: PlannedItem) -> tuple[int, int, float]:
    x, y, height_m = planned.place.latitude_e7, planned.place.longitude_e7, planned.height_mm / 1000
    if (x == 0 and y == 0) or abs(x) > LATITUDE_MAX_E7 or abs(y) > LONGITUDE_MAX_E7:
        raise Unflyable(f"item {number}: the place is not on the Earth")
    if not HEIGHT_M[0] <= height_m <= HEIGHT_M[1]:
        raise Unflyable(f"item {number}: height {height_m} m is outside {HEIGHT_M}")
    return x, y, _float32(height_m)


def _parameters(planned: PlannedItem, family: Family) -> tuple[float, float, float, float]:
    unset = math.nan if planned.command in LOCATED and not family.is_ardupilot else 0.0
    fourth = _float32(planned.parameter_4_e3 / 1000) if planned.HasField("parameter_4_e3") else unset
    first, second, third = (
        _float32(value_e3 / 1000)
        for value_e3 in (planned.parameter_1_e3, planned.parameter_2_e3, planned.parameter_3_e3)
    )
    if family.is_ardupilot and planned.command in LOCATED and not 0 <= first <= WHOLE_MAX:
        raise Unflyable(f"parameter 1 of command {planned.command} is {first}: 0 to {WHOLE_MAX} are kept")
    return first, second, third, fourth


def _float32(value: float) -> float:
    return ctypes.c_float(value).value


def kept(item: Item, family: Family) -> Item:
    """Return what a vehicle is known to give back for an item that it was given."""
    if family.is_ardupilot:
        return _kept_by_ardupilot(item, family)
    if family is Family.PX4:
        return _kept_by_px4(item)
    return item


def _kept_by_ardupilot(item: Item, family: Family) -> Item:
    first, second, third, fourth = item.parameters
    whole = float(math.trunc(first))
    match item.command:
        case 16 if family is Family.PLANE:
            parameters = (0.0, _byte(second), _byte(third), 0.0)
        case 21:
            parameters = (whole, 0.0, 0.0, -1.0 if fourth < 0 else 1.0)
        case 178:
            parameters = (whole, second, third, 0.0)
        case 20:
            parameters = (0.0, 0.0, 0.0, 0.0)
        case _:
            parameters = (whole, 0.0, 0.0, 0.0)
    if item.command in LOCATED:
        return replace(item, parameters=parameters)
    return replace(item, parameters=parameters, frame=GLOBAL, x=0, y=0, z=0.0)


def _kept_by_px4(item: Item) -> Item:
    first, second, _, fourth = item.parameters
    match item.command:
        case 16:
            return replace(item, parameters=(first, second, 0.0, fourth))
        case 21:
            return replace(item, parameters=(0.0, float(math.trunc(second)), 0.0, fourth))
        case 22:
            return replace(item, parameters=(0.0, 0.0, 0.0, fourth))
    return item


def _byte(value: float) -> float:
    return float(min(255, math.trunc(abs(value))))


def difference(sent: Item, back: Item, family: Family) -> str:
    """Return what of an item came back otherwise than it may, in words; empty where nothing did."""
    expected = kept(sent, family)
    if family.is_ardupilot and sent.seq == 0:
        return "" if back.command == NAV_WAYPOINT else f"item 0 is command {back.command}, not home"
    if back.command != expected.command:
        return f"command {back.command} for {expected.command}"
    if _frame(back) != _frame(expected):
        return f"frame {back.frame} for {expected.frame}"
    if (back.x, back.y) != (expected.x, expected.y):
        return f"place {back.x}, {back.y} for {expected.x}, {expected.y}"
    if expected.goes_on and not back.goes_on and not family.is_ardupilot:
        return "autocontinue 0 for 1"
    if abs(back.z - expected.z) > (_CENTIMETRE_M if family.is_ardupilot else _FLOAT32 * max(1.0, abs(expected.z))):
        return f"height {back.z} for {expected.z}"
    return _parameter_difference(expected, back, family)


def _parameter_difference(expected: Item, back: Item, family: Family) -> str:
    for number, (wanted, got) in enumerate(zip(expected.parameters, back.parameters, strict=True), start=1):
        turns = family is Family.PX4 and number == 4 and expected.command in LOCATED
        if not _same(wanted, got, turns=turns):
            return f"parameter {number} {got} for {wanted}"
    return ""


def _same(wanted: float, got: float, *, turns: bool) -> bool:
    if math.isnan(wanted) or math.isnan(got):
        return math.isnan(wanted) and math.isnan(got)
    if turns:
        return abs((got - wanted + 180) % 360 - 180) <= _TURN_DEG
    return abs(got - wanted) <= _FLOAT32 * max(1.0, abs(wanted))


def _frame(item: Item) -> int:
    return _SAME_FRAME.get(item.frame, item.frame)
