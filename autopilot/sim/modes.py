"""Flight modes: what an aircraft is doing, and the number by which each kind of autopilot calls it.

The numbers are `custom_mode` of HEARTBEAT: ArduPilot's own, for copters and planes, and PX4's pairs
of main and sub mode (main << 16 | sub << 24). A mode that isn't in a table is unknown there.
"""

from __future__ import annotations

from enum import Enum


class Doing(Enum):
    """What the aircraft flies by."""

    MANUAL = "manual"  # a pilot's sticks
    POSITION = "position"  # a pilot's sticks, and it stays where they are let go
    HOLD = "hold"
    GUIDED = "guided"
    MISSION = "mission"
    RETURN = "return"
    LAND = "land"
    TAKE_OFF = "take off"
    OFFBOARD = "offboard"


def px4_mode(main: int, sub: int = 0) -> int:
    """Return PX4's custom_mode."""
    return main << 16 | sub << 24


ARDUCOPTER: dict[Doing, int] = {
    Doing.MANUAL: 0,
    Doing.MISSION: 3,
    Doing.GUIDED: 4,
    Doing.HOLD: 5,
    Doing.RETURN: 6,
    Doing.LAND: 9,
}
ARDUPLANE: dict[Doing, int] = {
    Doing.MANUAL: 0,
    Doing.MISSION: 10,
    Doing.RETURN: 11,
    Doing.HOLD: 12,
    Doing.TAKE_OFF: 13,
    Doing.GUIDED: 15,
}
PX4: dict[Doing, int] = {
    Doing.MANUAL: px4_mode(1),
    Doing.POSITION: px4_mode(3),
    Doing.TAKE_OFF: px4_mode(4, 2),
    Doing.HOLD: px4_mode(4, 3),
    Doing.MISSION: px4_mode(4, 4),
    Doing.RETURN: px4_mode(4, 5),
    Doing.LAND: px4_mode(4, 6),
    Doing.OFFBOARD: px4_mode(6),
}
NAMES: dict[Doing, str] = {  # as ArduPilot names them in its texts
    Doing.MANUAL: "STABILIZE",
    Doing.POSITION: "POSHOLD",
    Doing.MISSION: "AUTO",
    Doing.GUIDED: "GUIDED",
    Doing.HOLD: "LOITER",
    Doing.RETURN: "RTL",
    Doing.LAND: "LAND",
    Doing.TAKE_OFF: "TAKEOFF",
    Doing.OFFBOARD: "OFFBOARD",
}


def doing_of(table: dict[Doing, int], custom_mode: int) -> Doing | None:
    """Return what a custom_mode means to this autopilot, or None."""
    return next((doing for doing, number in table.items() if number == custom_mode), None)
