"""Effects as orders: which command carries each, in which form, and whether it may be sent again.

| effect | command | form | sent again | why |
|---|---|---|---|---|
| PointAtPlace | DO_SET_ROI_LOCATION | INT | yes | a late copy looks where it was to look |
| PointAtAngles | DO_GIMBAL_MANAGER_PITCHYAW | LONG | yes | absolute angles |
| ReleasePointing | DO_SET_ROI_NONE | LONG | yes | lets go of what is let go |
| TakeGimbal, GiveUpGimbal | DO_GIMBAL_MANAGER_CONFIGURE | LONG | yes | who has it is seen, not believed |
| SetZoom | SET_CAMERA_ZOOM | LONG | yes | an absolute zoom |
| SetVehicleMode RETURN, LAND | DO_SET_MODE | LONG | yes | the safe end, and again is no more than once |
| SetVehicleMode, other modes | DO_SET_MODE | LONG | no | a late copy would take the aircraft from a pilot |
| ArmVehicle | COMPONENT_ARM_DISARM | LONG | no | a late copy would start motors that somebody stopped |
| StartMission | MISSION_START | LONG | no | a late copy would take the aircraft from a pilot; PX4 arms on it |
| SetMissionItem | DO_SET_MISSION_CURRENT | LONG | no | a late copy would send it back to where it has been |
| FlyToPlace | DO_REPOSITION | INT | no | a late copy would take the aircraft from a pilot |

What is sent once and not answered is the core's to decide again: it sees the mode, the arming and the progress.

Not every autopilot knows DO_SET_MISSION_CURRENT. One that answers UNSUPPORTED is sent the message that it superseded,
MISSION_SET_CURRENT, once; nothing acknowledges it, the progress shows it (MAVLink guide, Mission Protocol).

A place never goes as COMMAND_LONG to ArduPilot, which reads the altitude there as above home; to others it may, where
they ask for it. No encoding here.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

from google.protobuf.message import Message

from autopilot.adapters.vehicle.heard import Sender
from autopilot.adapters.vehicle.modes import Kind
from events.schema.mission_pb2 import ArmVehicle, SetMissionItem, StartMission
from events.schema.safety_pb2 import FlightMode, FlyToPlace, SetVehicleMode
from events.schema.vehicle_pb2 import GiveUpGimbal, PointAtAngles, PointAtPlace, ReleasePointing, SetZoom, TakeGimbal

SET_ROI_LOCATION, SET_ROI_NONE, SET_CAMERA_ZOOM, GIMBAL_PITCHYAW, GIMBAL_CONFIGURE = 195, 197, 531, 1000, 1001
SET_MODE, REPOSITION, SET_MISSION_CURRENT, MISSION_START, ARM_DISARM = 176, 192, 224, 300, 400

UNSUPPORTED, LONG_ONLY, INT_ONLY, UNSUPPORTED_FRAME = 3, 7, 8, 9  # MAV_RESULT
SAFE_ENDS = (FlightMode.FLIGHT_MODE_RETURN, FlightMode.FLIGHT_MODE_LAND)

COMMAND_OF: dict[type[Message], int] = {
    PointAtPlace: SET_ROI_LOCATION,
    PointAtAngles: GIMBAL_PITCHYAW,
    ReleasePointing: SET_ROI_NONE,
    TakeGimbal: GIMBAL_CONFIGURE,
    GiveUpGimbal: GIMBAL_CONFIGURE,
    SetZoom: SET_CAMERA_ZOOM,
    SetVehicleMode: SET_MODE,
    ArmVehicle: ARM_DISARM,
    StartMission: MISSION_START,
    SetMissionItem: SET_MISSION_CURRENT,
    FlyToPlace: REPOSITION,
}
PLACES = (PointAtPlace, FlyToPlace)
IN_THE_AIR = (FlyToPlace, StartMission)  # refused while disarmed: an autopilot would take them, PX4 would arm


# Effects of one lane take each other's place; those of different lanes leave beside each other.
_LANES: tuple[tuple[type[Message], ...], ...] = (
    (PointAtPlace, PointAtAngles, ReleasePointing),
    (TakeGimbal, GiveUpGimbal),
    (SetZoom,),
)
_LANE_OF = {effect: lane for lane, effects in enumerate(_LANES, start=1) for effect in effects}


def lane_of(effect: Message) -> int:
    """Return the lane of an effect on what the vehicle carries; 0 for one of its flight."""
    return _LANE_OF.get(type(effect), 0)


class Form(Enum):
    """How a command is packed."""

    LONG = "COMMAND_LONG"
    INT = "COMMAND_INT"
    INT_OTHER_FRAME = "COMMAND_INT, MAV_FRAME_GLOBAL_INT"
    MESSAGE = "MISSION_SET_CURRENT"


_EVERY_FORM = frozenset(Form)
_NOT_LONG = _EVERY_FORM - {Form.LONG}


class Rank(IntEnum):
    """What goes before what: a return or landing before everything, one that nobody ordered before that."""

    PLAIN = 0
    SAFE_END = 1
    FAILSAFE = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """An effect on its way to the vehicle."""

    effect_seq: int
    effect: Message
    command: int  # MAV_CMD that carries it
    deadline_ns: int  # monotonic; nothing is sent from here on
    kind: Kind | None = None  # of the vehicle that it is for
    target: Sender | None = None  # who is to take it; None: the autopilot
    gimbal: int = 0  # lane of what the vehicle carries, whose newest wins; 0: it is of the flight
    form: Form = Form.LONG
    forms: frozenset[Form] = _EVERY_FORM  # that it may be asked for in
    again: bool = True  # harmless when it is late
    rank: Rank = Rank.PLAIN

    def has_message(self, result: int) -> bool:
        """Whether a vehicle with this answer is told by a message instead."""
        return result == UNSUPPORTED and isinstance(self.effect, SetMissionItem)

    @property
    def flight(self) -> bool:
        """Whether it is of the flight, not of the gimbal."""
        return self.gimbal == 0


def order_of(
    effect_seq: int, effect: Message, deadline_ns: int, kind: Kind | None, target: Sender | None = None
) -> Order:
    """Return the order for an effect of `COMMAND_OF`; raises KeyError for another."""
    placed = isinstance(effect, PLACES)
    forms = _NOT_LONG if placed and kind is not None and kind.family.is_ardupilot else _EVERY_FORM
    return Order(
        effect_seq=effect_seq,
        effect=effect,
        command=COMMAND_OF[type(effect)],
        deadline_ns=deadline_ns,
        kind=kind,
        target=target,
        gimbal=lane_of(effect),
        form=Form.INT if placed else Form.LONG,
        forms=forms,
        again=lane_of(effect) > 0 or _is_safe_end(effect),
        rank=_rank(effect),
    )


def _is_safe_end(effect: Message) -> bool:
    return isinstance(effect, SetVehicleMode) and effect.mode in SAFE_ENDS


def _rank(effect: Message) -> Rank:
    if not _is_safe_end(effect):
        return Rank.PLAIN
    assert isinstance(effect, SetVehicleMode)
    return Rank.SAFE_END if effect.order else Rank.FAILSAFE


def other_form(form: Form, result: int) -> Form | None:
    """Return the form that an answer asks for instead of one, or None where it asks for none."""
    return {
        (Form.INT, LONG_ONLY): Form.LONG,
        (Form.INT_OTHER_FRAME, LONG_ONLY): Form.LONG,
        (Form.LONG, INT_ONLY): Form.INT,
        (Form.INT, UNSUPPORTED_FRAME): Form.INT_OTHER_FRAME,
    }.get((form, result))
