"""The rows of the state: frozen values, integers in fixed point, each written by `evolve` alone.

Times are nanoseconds of the flight, distances millimetres from the flight's origin. Rows that records
change are named tuples, which are made several times faster than frozen dataclasses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from events.schema.common_pb2 import Place
from events.schema.flight_pb2 import Limits


def fitting_key(vehicle: int, number: int) -> str:
    """Return the key of a camera or a gimbal: "1/1" is number 1 on vehicle 1."""
    return f"{vehicle}/{number}"


def order_key(principal_id: str, command_id: str) -> str:
    """Return the key of an order: ids of orders are the issuer's own (a public id can't be taken from another)."""
    return f"{principal_id}/{command_id}"


class Spot(NamedTuple):
    """A place as the core computes with it."""

    east_mm: int
    north_mm: int
    place: Place  # as recorded; never changed

    @classmethod
    def of(cls, place: Place) -> Spot:
        """Read a place once: scalars in the state, not messages, are what guards look at."""
        return cls(place.east_mm, place.north_mm, place)

    def within(self, other: Spot, distance_mm: int) -> bool:
        """Whether two places are at most so far apart on the ground."""
        east, north = self.east_mm - other.east_mm, self.north_mm - other.north_mm
        return east * east + north * north <= distance_mm * distance_mm


NOWHERE = Spot(0, 0, Place())


@dataclass(frozen=True, slots=True)
class Manifest:
    """What the flight was opened with, as far as decisions read it."""

    flight_id: bytes
    node: str
    node_public_key: bytes
    limits: Limits  # read only
    camera_roles: tuple[str, ...]
    flight_roles: tuple[str, ...]
    group_of: dict[str, str]  # class name to class group; never changed
    gimbal_of: dict[str, int]  # camera key to gimbal number; never changed


@dataclass(frozen=True, slots=True)
class Arrival:
    """How the newest order arrived, as it was before it changed anything."""

    key: str
    digest: bytes
    in_reply_to: bytes
    known: bool  # an order of this issuer and id was there before
    replayed: bool  # its nonce was there before
    overdue_ms: int  # how long the revocation list had been overdue
    time_uncertain: bool  # it was fresh by the node's challenge, for the time was not known
    before_memory: bool  # it may have been sent before a start that remembers nothing
    order_seq: int
    newest_seq: int  # the device's highest before this one


class Order(NamedTuple):
    """An order and how far it got."""

    principal_id: str
    callsign: str
    command_id: str
    digest: bytes
    state: str
    verb: str  # "point", "zoom", "release", "judge", "override" and so on; "" for an unknown variant
    camera: str  # camera key; "" for none
    gimbal: str  # gimbal key; "" for none
    poi_id: str
    confirmed: bool
    device_key_id: bytes
    order_seq: int
    in_reply_to: bytes
    expires_ns: int
    keep_until_ns: int
    detail: str = ""
    mav_result: int | None = None
    asked: str = ""  # what is asked of the mission: "begin", "pause", "resume" or "abort"
    repeats_answered_ns: tuple[int, ...] = ()  # when repeats were last answered
    at_place: bool = False  # it points at a place, not to angles


class Effect(NamedTuple):
    """A command to the vehicle whose outcome is awaited."""

    order: str  # order key; "" for the node's own wish
    gimbal: str
    done: bool = False  # its outcome is in


class Hold(NamedTuple):
    """What a camera was before an order took it."""

    state: str
    principal_id: str
    callsign: str
    command_id: str
    until_ns: int


class Camera(NamedTuple):
    """Who is the camera's master."""

    vehicle: int
    camera: int
    gimbal: int
    state: str = "automatic"
    principal_id: str = ""
    callsign: str = ""
    command_id: str = ""
    until_ns: int = 0
    before: Hold | None = None  # what it goes back to where the vehicle refuses the order that took it


class Trusted(NamedTuple):
    """What the node's shell goes by, as far as the log has it."""

    list_behind: bool = False  # the list that is held is not the newest that was taken
    root_behind: bool = False  # the same of the TrustRoot
    root_version: int = 0  # highest that was taken
    epoch_id: int = 0  # highest that was taken
    time_floor_ms: int = 0  # milliseconds since 1970


class Aim(NamedTuple):
    """What a gimbal was asked and whether it got there."""

    state: str = "idle"
    effect_seq: int = -1
    order: str = ""
    asked_ns: int = 0
    error_cdeg: int | None = None
    demanded: bool = False  # that is what the servos were told: nothing measures it


class Gimbal(NamedTuple):
    """What a gimbal is, as its manager says; angles in 0.01 degrees, yaw from the vehicle's nose, None: not told."""

    managed: bool
    pans: bool
    turns_vehicle: bool  # a place to look at turns the vehicle itself
    pitch_min_cdeg: int | None = None
    pitch_max_cdeg: int | None = None
    yaw_min_cdeg: int | None = None
    yaw_max_cdeg: int | None = None


class Control(NamedTuple):
    """Who controls a gimbal."""

    state: str = "unknown"
    system_id: int = 0  # as its manager said last; 0: nobody
    component_id: int = 0
    since_ns: int = 0


class Lens(NamedTuple):
    """What a camera can do."""

    zooms: bool


class Vehicle(NamedTuple):
    """What the vehicle reports, as far as decisions read it."""

    link: bool = False
    armed: bool = False
    custom_mode: int = 0
    flight_mode: int = 0  # FlightMode; 0: none of these
    landed_state: int | None = None  # MAV_LANDED_STATE; None: not told
    home: Spot | None = None


class Whereabouts(NamedTuple):
    """Where a vehicle is and how it moves, since its link came up. Apart from the rest, for this may be redacted."""

    spot: Spot
    east_mm_s: int = 0
    north_mm_s: int = 0


class Link(NamedTuple):
    """The link to all operators together."""

    state: str = "unheard"
    since_ns: int | None = None  # silent since: when somebody was last heard, or armed while nobody ever was
    heard: bool = False  # somebody was heard in this flight


class Failsafe(NamedTuple):
    """One failsafe of one vehicle, and what it last commanded."""

    state: str = "ok"
    commanded: str = ""  # "returning" or "landing"; "" for nothing in this flight
    commanded_ns: int = 0


class Override(NamedTuple):
    """A failsafe that a person holds off."""

    vehicle: int
    scope: int  # OverrideScope
    principal_id: str
    callsign: str
    command_id: str
    reason: str
    until_ns: int


class MapObject(NamedTuple):
    """A thing on the map."""

    number: int
    class_name: str
    class_group: str
    spot: Spot
    confidence_e4: int
    sightings: int
    poi_id: str = ""
    muted_by: str = ""


class Poi(NamedTuple):
    """A point of interest and how far a person's decision on it got."""

    poi_id: str
    state: str
    vehicle: int
    camera: int
    object: int
    class_name: str
    class_group: str
    confidence_e4: int
    spot: Spot
    opened_ns: int
    sightings: int = 1
    decide_by_ns: int = 0
    ended_ns: int = 0
    looked: bool = False


class Ignored(NamedTuple):
    """A muted place."""

    poi_id: str
    class_group: str
    spot: Spot
    principal_id: str
    muted: int = 0


class Scan(NamedTuple):
    """What the node itself does with a camera."""

    state: str = "zoomed_out"
    poi_id: str = ""
    captures: tuple[int, ...] = ()  # capture times of the last frames, nanoseconds
    spot: Spot = NOWHERE  # where the node pointed it last


class Selftest(NamedTuple):
    """The self-test of a vehicle and how far it got."""

    state: str = "idle"
    effect_seq: int = -1  # of the newest run; what its report and an acknowledgement name


class Mission(NamedTuple):
    """How far a vehicle's mission got. Its plan is kept beside it."""

    state: str = "idle"
    tries: int = 0  # how often the present step was begun again
    refusal: str = ""  # why the vehicle refused the present step; "" where it did not
    effect_seq: int = -1  # the newest effect, whose outcome the present step waits for
    begun: bool = False  # somebody ordered it to begin
    flown: bool = False  # it was under way in the air
    plan_seq: int = -1  # the newest plan
    held_seq: int = -1  # the upload of what the vehicle holds, read back; -1: it may hold anything
    entered_mode: int = 0  # FlightMode of the vehicle when the present state was entered
    next_item: int = 0  # index in the plan of the first item that is not behind the vehicle
    middle_item: int = -1  # index in the plan of the waypoint that was asked for in the middle; -1: none
    middle_seq: int = -1  # the effect that asked for it, which the plan that has it names
    middle_ahead: bool = False  # by that plan, which the vehicle holds, it was seen not to be behind the vehicle
    flown_revision: str = ""  # what was flown to its end: it does not begin a second time by itself
