"""What the vehicle says, as plain values: every number finite, in range, and in a named unit.

Nothing here parses; `ingress` makes these and is the only place that sees a MAVLink message.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Sender:
    """Who sent a message: MAVLink system and component id."""

    system: int
    component: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Heartbeat:
    """HEARTBEAT of an autopilot (those of ground stations and other components are not passed on)."""

    sender: Sender
    autopilot: int  # MAV_AUTOPILOT
    vehicle_type: int  # MAV_TYPE
    armed: bool
    custom_mode: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """COMMAND_ACK. It carries no instance of the command, only its id."""

    sender: Sender
    command: int
    result: int  # raw MAV_RESULT
    progress: int  # percent; 255 unknown
    target: Sender  # whom it answers; 0/0 from peers that do not fill it in


@dataclass(frozen=True, slots=True, kw_only=True)
class Position:
    """GLOBAL_POSITION_INT with a position in it."""

    sender: Sender
    boot_ms: int
    latitude_e7: int
    longitude_e7: int
    altitude_mm: int  # above mean sea level
    height_mm: int  # above home
    north_cm_s: int
    east_cm_s: int
    down_cm_s: int
    heading_cdeg: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Attitude:
    """ATTITUDE, as far as pointing needs it."""

    sender: Sender
    boot_ms: int
    yaw_deg: float  # from north, clockwise
    yaw_rate_deg_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class GimbalAttitude:
    """GIMBAL_DEVICE_ATTITUDE_STATUS as a direction of view."""

    sender: Sender
    boot_ms: int
    pitch_deg: float  # up positive, to the horizon
    yaw_deg: float  # clockwise, from north or from the vehicle's nose
    from_north: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Reception:
    """GPS_RAW_INT: how well satellites are received."""

    sender: Sender
    fix_type: int  # GPS_FIX_TYPE
    satellites: int | None
    hdop_e2: int | None  # horizontal dilution of precision, in 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Fix:
    """GPS_RAW_INT with a 3D fix."""

    sender: Sender
    latitude_e7: int
    longitude_e7: int
    altitude_mm: int  # above mean sea level
    reception: Reception


@dataclass(frozen=True, slots=True, kw_only=True)
class GimbalLimits:
    """GIMBAL_MANAGER_INFORMATION: how far the gimbal turns, lowest and highest in degrees, None where not told."""

    sender: Sender
    pitch_deg: tuple[float, float] | None  # to the horizon, up positive
    yaw_deg: tuple[float, float] | None  # from the vehicle's nose, clockwise
    has_yaw: bool | None  # whether it claims an axis for yaw; None where it claims no axis at all
    turns_endlessly: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class SystemTime:
    """SYSTEM_TIME where the autopilot knows the time, by GPS."""

    sender: Sender
    wall_ms: int  # since 1970; nobody signed it


@dataclass(frozen=True, slots=True, kw_only=True)
class Timesync:
    """TIMESYNC: a question (tc1 is 0) or an answer."""

    sender: Sender
    tc1_ns: int  # time of whoever answers; 0 in a question
    ts1_ns: int  # time of whoever asks, by a clock of its own
    target: Sender  # whom it is for; 0/0 from peers that do not fill it in


@dataclass(frozen=True, slots=True, kw_only=True)
class Version:
    """AUTOPILOT_VERSION, as far as anybody asks."""

    sender: Sender
    capabilities: int  # MAV_PROTOCOL_CAPABILITY
    software_version: int  # major, minor, patch, FIRMWARE_VERSION_TYPE, a byte each
    board_version: int


@dataclass(frozen=True, slots=True, kw_only=True)
class GimbalStatus:
    """GIMBAL_MANAGER_STATUS: who has primary control; 0/0 nobody."""

    sender: Sender
    primary: Sender


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraInformation:
    """CAMERA_INFORMATION, as far as it is used."""

    sender: Sender
    zooms: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSettings:
    """CAMERA_SETTINGS, as far as it is used."""

    sender: Sender
    zoom_percent: float | None  # of its whole range, 0 to 100; None where the camera does not know


@dataclass(frozen=True, slots=True, kw_only=True)
class Battery:
    """SYS_STATUS or BATTERY_STATUS of the first battery."""

    sender: Sender
    charge_percent: int | None
    voltage_mv: int | None
    whole: bool  # of SYS_STATUS, which speaks for the vehicle


@dataclass(frozen=True, slots=True, kw_only=True)
class Home:
    """HOME_POSITION."""

    sender: Sender
    latitude_e7: int
    longitude_e7: int
    altitude_mm: int  # above mean sea level


@dataclass(frozen=True, slots=True, kw_only=True)
class Landed:
    """EXTENDED_SYS_STATE."""

    sender: Sender
    landed_state: int  # MAV_LANDED_STATE


@dataclass(frozen=True, slots=True, kw_only=True)
class Current:
    """MISSION_CURRENT, as the vehicle counts its items."""

    sender: Sender
    seq: int
    begun: bool  # False only where it says that it has no mission, or has not started it


@dataclass(frozen=True, slots=True, kw_only=True)
class Reached:
    """MISSION_ITEM_REACHED, as the vehicle counts its items."""

    sender: Sender
    seq: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ItemRequest:
    """MISSION_REQUEST or MISSION_REQUEST_INT."""

    sender: Sender
    target: Sender
    seq: int


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionAnswer:
    """MISSION_ACK."""

    sender: Sender
    target: Sender
    result: int  # MAV_MISSION_RESULT
    opaque_id: int  # 0: none


@dataclass(frozen=True, slots=True, kw_only=True)
class ItemCount:
    """MISSION_COUNT."""

    sender: Sender
    target: Sender
    count: int
    opaque_id: int  # 0: none


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """Content of MISSION_ITEM_INT, in either direction. Parameters may be NaN, which means unset."""

    seq: int
    frame: int  # MAV_FRAME
    command: int  # MAV_CMD
    current: bool
    goes_on: bool  # autocontinue
    parameters: tuple[float, float, float, float]
    x: int  # 1e-7 degrees where the command has a place
    y: int
    z: float  # metres


@dataclass(frozen=True, slots=True, kw_only=True)
class ItemGiven:
    """MISSION_ITEM_INT."""

    sender: Sender
    target: Sender
    item: Item


Transferred = ItemRequest | MissionAnswer | ItemCount | ItemGiven
Flown = Battery | Home | Landed | Current | Reached | Reception
OfGimbal = GimbalAttitude | GimbalLimits | GimbalStatus
OfCamera = CameraInformation | CameraSettings
Heard = (
    Heartbeat
    | Answer
    | Position
    | Attitude
    | Fix
    | OfGimbal
    | OfCamera
    | Flown
    | Transferred
    | SystemTime
    | Timesync
    | Version
)


@dataclass(frozen=True, slots=True)
class Rejected:
    """Something that was not taken, by name; the names are counted."""

    because: str
