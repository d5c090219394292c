"""How each autopilot numbers its flight modes, and what `SetVehicleMode` asks of it.

| mode | ArduCopter | ArduPlane | PX4 (main, sub) |
|---|---|---|---|
| MISSION | 3 AUTO | 10 AUTO | 4, 4 AUTO MISSION |
| LOITER | 5 LOITER | 12 LOITER | 4, 3 AUTO LOITER |
| GUIDED | 4 GUIDED | 15 GUIDED | 4, 3 AUTO LOITER: PX4 takes DO_REPOSITION there, and reports LOITER |
| RETURN | 6 RTL | 11 RTL | 4, 5 AUTO RTL |
| LAND | 9 LAND | 20 QLAND where it hovers, else 11 RTL: a wing can't land where it is | 4, 6 AUTO LAND |

Sources: ArduPilot's `mode.h` of Copter and Plane, PX4's `px4_custom_mode.h`. custom_mode of HEARTBEAT is the number
itself on ArduPilot; on PX4 the main mode is bits 16 to 23 and the sub mode bits 24 to 31. Modes that come to the same
are read as the same (SMART_RTL is a return). A mode that is not in the table is none of ours, never a guess.

Nothing here encodes or remembers.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from events.schema.safety_pb2 import FlightMode

ARDUPILOT, PX4 = 3, 12  # MAV_AUTOPILOT
MULTIROTORS = frozenset({2, 3, 4, 13, 14, 15, 29, 35, 43})  # MAV_TYPE, helicopters among them
FIXED_WINGS = frozenset({1})
HOVERING_WINGS = frozenset({19, 20, 21, 22, 23, 24, 25})  # MAV_TYPE_VTOL_...

_MISSION, _LOITER, _GUIDED = (
    FlightMode.FLIGHT_MODE_MISSION,
    FlightMode.FLIGHT_MODE_LOITER,
    FlightMode.FLIGHT_MODE_GUIDED,
)
_RETURN, _LAND = FlightMode.FLIGHT_MODE_RETURN, FlightMode.FLIGHT_MODE_LAND


class Family(Enum):
    """Whose manners a vehicle has."""

    COPTER = "ArduCopter"
    PLANE = "ArduPlane"
    ARDUPILOT = "another ArduPilot"
    PX4 = "PX4"
    OTHER = "another autopilot"

    @property
    def has_modes(self) -> bool:
        """Whether it is known how it numbers its modes."""
        return self in _ASK

    @property
    def is_ardupilot(self) -> bool:
        """Whether it keeps missions as ArduPilot does."""
        return self in (Family.COPTER, Family.PLANE, Family.ARDUPILOT)


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """What sort of vehicle it is: MAV_AUTOPILOT and MAV_TYPE of its heartbeat."""

    autopilot: int
    vehicle_type: int

    @property
    def family(self) -> Family:
        """Return whose manners it has."""
        if self.autopilot == PX4:
            return Family.PX4
        if self.autopilot != ARDUPILOT:
            return Family.OTHER
        if self.vehicle_type in MULTIROTORS:
            return Family.COPTER
        wings = self.vehicle_type in FIXED_WINGS or self.vehicle_type in HOVERING_WINGS
        return Family.PLANE if wings else Family.ARDUPILOT


@dataclass(frozen=True, slots=True)
class ModeWords:
    """Parameters 2 and 3 of MAV_CMD_DO_SET_MODE; parameter 1 is MAV_MODE_FLAG_CUSTOM_MODE_ENABLED."""

    mode: int
    sub_mode: int = 0


_ASK: dict[Family, dict[FlightMode.ValueType, ModeWords]] = {
    Family.COPTER: {
        _MISSION: ModeWords(3),
        _LOITER: ModeWords(5),
        _GUIDED: ModeWords(4),
        _RETURN: ModeWords(6),
        _LAND: ModeWords(9),
    },
    Family.PLANE: {
        _MISSION: ModeWords(10),
        _LOITER: ModeWords(12),
        _GUIDED: ModeWords(15),
        _RETURN: ModeWords(11),
        _LAND: ModeWords(11),
    },
    Family.PX4: {
        _MISSION: ModeWords(4, 4),
        _LOITER: ModeWords(4, 3),
        _GUIDED: ModeWords(4, 3),
        _RETURN: ModeWords(4, 5),
        _LAND: ModeWords(4, 6),
    },
}
_QLAND = ModeWords(20)

_READ: dict[Family, dict[int, FlightMode.ValueType]] = {
    # 21 SMART_RTL and 27 AUTO_RTL return as well.
    Family.COPTER: {3: _MISSION, 5: _LOITER, 4: _GUIDED, 6: _RETURN, 21: _RETURN, 27: _RETURN, 9: _LAND},
    # 19 QLOITER holds, 21 QRTL returns, 20 QLAND, 25 LOITER_ALT_QLAND and 26 AUTOLAND land.
    Family.PLANE: {
        10: _MISSION,
        12: _LOITER,
        19: _LOITER,
        15: _GUIDED,
        11: _RETURN,
        21: _RETURN,
        20: _LAND,
        25: _LAND,
        26: _LAND,
    },
}
_READ_PX4: dict[tuple[int, int], FlightMode.ValueType] = {
    (4, 4): _MISSION,
    (4, 3): _LOITER,
    (4, 5): _RETURN,
    (4, 6): _LAND,
    (4, 9): _LAND,  # a landing on a beacon
}


def words_for(kind: Kind, mode: FlightMode.ValueType) -> ModeWords | None:
    """Return what asks this vehicle for a mode, or None where nobody knows."""
    if mode == _LAND and kind.family is Family.PLANE and kind.vehicle_type in HOVERING_WINGS:
        return _QLAND
    return _ASK.get(kind.family, {}).get(mode)


def flight_mode(kind: Kind, custom_mode: int) -> FlightMode.ValueType | None:
    """Return what custom_mode of HEARTBEAT means, or None where it is none of ours."""
    if kind.family is Family.PX4:
        return _READ_PX4.get((custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF))
    return _READ.get(kind.family, {}).get(custom_mode)
