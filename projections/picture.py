"""What projection `status` shows: frozen values, integers in fixed point, moments in flight_ns.

`projections.status` fills them from the log.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from events.records import Moment
from events.schema.flight_pb2 import Limits

RESULTS = ("accepted", "rejected", "timeout", "unsupported", "unauthorised")
POI_STATES = ("enqueued", "surfaced", "suppressed", "confirmed", "declined", "expired", "withdrawn")
START = Moment(0, 0, 0, 0, 0)
NOTHING_PANS = "no gimbal that pans: a place to look at turns the vehicle itself"


def key_of(vehicle: int, number: int) -> str:
    """Return how a camera or gimbal is named: "1/1" is number 1 on vehicle 1."""
    return f"{vehicle}/{number}"


def with_row(rows: Mapping[str, Any], key: str, row: Any) -> dict[str, Any]:
    """Return the rows with another one at a key."""
    return {**rows, key: row}


@dataclass(frozen=True, slots=True)
class CameraPicture:
    """A camera and its master."""

    vehicle: int
    camera: int
    gimbal: str  # key of its gimbal, "1/1"; "" where it is fixed
    state: str = "automatic"
    callsign: str = ""
    principal_id: str = ""
    command_id: str = ""
    held_until_ns: int = 0  # flight_ns at which hold or pause runs out; 0: neither
    zoom_e4: int | None = None  # share of its whole range; None while no camera tells


@dataclass(frozen=True, slots=True)
class GimbalPicture:
    """What a gimbal was asked, where it looks, and what is known of it."""

    asked: str = ""  # in words; "" while nothing is asked
    asked_ns: int = 0  # flight_ns
    effect_seq: int = -1
    aim: str = "idle"
    error_cdeg: int | None = None
    arrived_after_ns: int | None = None
    pitch_cdeg: int | None = None
    yaw_cdeg: int | None = None
    order: str = ""  # the order that the aim serves, principal/command_id; "" for the node's own wish
    aim_because: str = ""  # why it drifted or missed
    demanded: bool = False  # where it looks is what its servos were told: nothing measures it
    control: str = ""  # "this node", "nobody", "255/190"; "" while no manager tells
    turns_vehicle: bool = False  # a place to look at turns the vehicle itself

    @property
    def caution(self) -> str:
        """What an operator should know before ordering; "" where there is nothing."""
        return NOTHING_PANS if self.turns_vehicle else ""


@dataclass(frozen=True, slots=True)
class VehiclePicture:
    """A vehicle, its link and where it is."""

    link: bool = False
    armed: bool = False
    custom_mode: int = 0
    latitude_e7: int | None = None
    longitude_e7: int | None = None
    altitude_mm: int | None = None
    height_mm: int | None = None
    heading_cdeg: int | None = None
    battery_percent: int | None = None


@dataclass(frozen=True, slots=True)
class FailsafePicture:
    """A failsafe of a vehicle and how far it is."""

    state: str  # of the chart `safety`
    because: str = ""  # why it commanded, in words; "" where it did not
    commanded_ns: int = 0  # when it last did, flight_ns; 0: never


@dataclass(frozen=True, slots=True)
class OverridePicture:
    """A failsafe that a person holds off."""

    scope: str  # "battery_return", "link_return", "fence_return"
    callsign: str
    principal_id: str
    reason: str
    until_ns: int  # flight_ns


@dataclass(frozen=True, slots=True)
class Question:
    """A point of interest that waits: to be put to an operator, or for the operator's word."""

    poi_id: str
    state: str
    class_name: str
    class_group: str
    confidence_e4: int
    latitude_e7: int
    longitude_e7: int
    mgrs: str
    sightings: int  # from `sightings_to_ask` on, which it was seen at least when it was opened
    decide_by_ns: int = 0  # flight_ns; 0 while it waits to be asked


@dataclass(frozen=True, slots=True)
class Bounds:
    """The manifest's limits that deadlines follow from."""

    operator_hold_ms: int = 0
    release_pause_ms: int = 0
    ask_confidence_e4: int = 0
    decide_shortest_ms: int = 0
    decide_longest_ms: int = 0
    sightings_to_ask: int = 0

    @classmethod
    def of(cls, limits: Limits) -> Bounds:
        """Read them once."""
        return cls(**{name: getattr(limits, name) for name in cls.__slots__})


@dataclass(frozen=True, slots=True)
class MissionPicture:
    """A mission and its self-test, and how far they are."""

    state: str = "idle"
    because: str = ""
    mission_id: str = ""
    items: int = 0
    next_item: int = 0  # index of the first item that is not behind the vehicle
    fences: int = 0
    selftest: str = "idle"
    report_id: int | None = None
    findings: tuple[str, ...] = ()  # items of the self-test that did not simply pass
    unavailable: str = ""  # what stands in the way of having one
    pushed: str = ""  # what became of what the flight saw; empty before a push


@dataclass(frozen=True, slots=True)
class Picture:
    """All that is shown. Mappings are never changed: a change makes new ones."""

    flight_id: bytes = b""
    flight_number: int = 0
    node: str = ""
    software: str = ""
    open: bool = False
    closed_because: str = ""
    starts: int = 0
    health: str = "normal"  # "normal", "safe mode"
    command_enabled: bool = False
    camera_roles: tuple[str, ...] = ()  # who may point the cameras; empty: nobody
    flight_roles: tuple[str, ...] = ()  # who may command the flight; empty: nobody
    cameras: Mapping[str, CameraPicture] = field(default_factory=dict)
    gimbals: Mapping[str, GimbalPicture] = field(default_factory=dict)
    vehicles: Mapping[str, VehiclePicture] = field(default_factory=dict)
    eyes: Mapping[str, str] = field(default_factory=dict)  # camera key: state, and why
    scans: Mapping[str, str] = field(default_factory=dict)  # camera key: state of the chart
    waiting: Mapping[str, Question] = field(default_factory=dict)
    orders: Mapping[str, int] = field(default_factory=lambda: dict.fromkeys(RESULTS, 0))
    orders_malformed: int = 0
    pois: Mapping[str, int] = field(default_factory=lambda: dict.fromkeys(POI_STATES, 0))
    map_objects: int = 0
    ignored: int = 0
    steps_failed: int = 0
    samples_rejected: Mapping[str, int] = field(default_factory=dict)  # by reason
    inputs_dropped: Mapping[str, int] = field(default_factory=dict)  # by class of the inbox
    failsafes_enabled: bool = False  # this node has a say in the flight
    operator_link: str = ""  # state of the chart `link`; "" where it is not watched
    failsafes: Mapping[str, FailsafePicture] = field(default_factory=dict)  # "1/fence": those that ever moved
    overrides: Mapping[str, OverridePicture] = field(default_factory=dict)  # vehicle and number of the scope: "1/2"
    properties_broken: Mapping[str, str] = field(default_factory=dict)  # name: what was seen first
    members: Mapping[int, str] = field(default_factory=dict)  # map object: the waiting question it belongs to
    mission: MissionPicture | None = None  # None where this node flies none
    bounds: Bounds = Bounds()


@dataclass(frozen=True, slots=True)
class Status:
    """The picture after record `head_seq`."""

    head_seq: int = -1
    at: Moment = START
    picture: Picture = Picture()
