"""Effects of the flight as commands with their seven parameters, as each autopilot takes them.

| effect | command | parameters |
|---|---|---|
| SetVehicleMode | DO_SET_MODE | 1 custom mode enabled; 2, 3 mode and sub mode (`modes`) |
| ArmVehicle | COMPONENT_ARM_DISARM | 1: arm; 2: 0, never by force |
| StartMission | MISSION_START | all 0: the whole mission |
| SetMissionItem | DO_SET_MISSION_CURRENT | 1 the item as the vehicle counts: ArduPilot has home at 0 |
| FlyToPlace | DO_REPOSITION | 1 speed as it is (-1); 2 change the mode (1); 4 ArduPilot 0, PX4 unset; place AMSL |

DO_REPOSITION takes ArduPilot to GUIDED and PX4 to AUTO LOITER. ArduPlane reads anything but 0 in parameter 4 as a turn
to the left. Plain values; `egress` packs them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from google.protobuf.message import Message

from autopilot.adapters.vehicle.fitness import LATITUDE_MAX_E7, LONGITUDE_MAX_E7
from autopilot.adapters.vehicle.modes import Family, Kind, words_for
from autopilot.adapters.vehicle.orders import ARM_DISARM, MISSION_START, REPOSITION, SET_MISSION_CURRENT, SET_MODE
from events.schema.common_pb2 import Place
from events.schema.mission_pb2 import ArmVehicle, SetMissionItem, StartMission
from events.schema.safety_pb2 import FlightMode, FlyToPlace, SetVehicleMode

ALTITUDE_M = (-500.0, 20_000.0)  # from below the Dead Sea to above any drone
CUSTOM_MODE_ENABLED, ARM, SPEED_AS_IT_IS, CHANGE_MODE = 1, 1, -1, 1
ITEMS_MAX = 0xFFFE  # items are numbered in 16 bits, and ArduPilot's numbers are one more


class NotEncodable(ValueError):
    """The effect must not or can not be said on this link; the text says why."""


@dataclass(frozen=True, slots=True)
class Words:
    """A command and its parameters. Of one with a place, 5 and 6 are 1e-7 degrees and 7 is metres AMSL."""

    command: int
    parameters: tuple[float, ...] = ()
    placed: bool = False

    @classmethod
    def to(cls, command: int, place: Place, parameters: tuple[float, ...]) -> Words:
        """Return a command to a place; raises NotEncodable for one that is not on the Earth."""
        altitude_m = place.altitude_mm / 1000
        if place.latitude_e7 == 0 and place.longitude_e7 == 0:
            raise NotEncodable("latitude and longitude 0 would cancel the pointing")
        if abs(place.latitude_e7) > LATITUDE_MAX_E7 or abs(place.longitude_e7) > LONGITUDE_MAX_E7:
            raise NotEncodable("the place is not on the Earth")
        if not ALTITUDE_M[0] <= altitude_m <= ALTITUDE_M[1]:
            raise NotEncodable(f"altitude {altitude_m} m is outside {ALTITUDE_M}")
        return cls(command, (*parameters, place.latitude_e7, place.longitude_e7, altitude_m), placed=True)

    def seven(self) -> tuple[float, ...]:
        """Return all seven parameters."""
        return (*self.parameters, *(0.0,) * (7 - len(self.parameters)))


def words_of(effect: Message, kind: Kind | None) -> Words:
    """Return the words for an effect of the flight; raises NotEncodable."""
    if kind is None:
        raise NotEncodable("the vehicle's kind is not known")
    if getattr(effect, "vehicle", 0) != 1:
        raise NotEncodable("this link has vehicle 1")
    match effect:
        case SetVehicleMode():
            return _mode(effect.mode, kind)
        case ArmVehicle():
            return Words(ARM_DISARM, (ARM,))
        case StartMission():
            return Words(MISSION_START)
        case SetMissionItem():
            return _mission_item(effect, kind)
        case FlyToPlace():
            unset = math.nan if kind.family is Family.PX4 else 0.0
            return Words.to(REPOSITION, effect.place, (SPEED_AS_IT_IS, CHANGE_MODE, 0, unset))
    raise NotEncodable(f"{type(effect).__name__} is not for a vehicle")


def _mode(mode: FlightMode.ValueType, kind: Kind) -> Words:
    words = words_for(kind, mode)
    if words is None:
        raise NotEncodable(f"nobody knows how {kind.family.value} numbers mode {mode}")
    return Words(SET_MODE, (CUSTOM_MODE_ENABLED, words.mode, words.sub_mode))


def _mission_item(effect: Any, kind: Kind) -> Words:
    if effect.item >= ITEMS_MAX:
        raise NotEncodable(f"item {effect.item} is more than a vehicle counts")
    return Words(SET_MISSION_CURRENT, (effect.item + (1 if kind.family.is_ardupilot else 0),))
