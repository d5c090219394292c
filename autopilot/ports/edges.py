"""The Protocols between the node and its adapters, and the plain values that cross them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, Protocol

from google.protobuf.message import Message

from autopilot.trust.clock import Clock as Clock
from autopilot.trust.fetching import Fetch as Fetch
from autopilot.trust.verdict import Sealed
from events.schema.flight_pb2 import CheckpointCosigned


class InputClass(Enum):
    """Classes of the inbox; each has a bound of its own and a way of overflowing (design, section 3)."""

    ORDER = "order"  # full: the newest is refused, and its issuer is told
    OUTCOME = "outcome"  # full: the adapter keeps it and offers it again
    TELEMETRY = "telemetry"  # full: the oldest is dropped and counted
    FRAME = "frame"  # full: the oldest is dropped and counted


class Offer(Protocol):
    """Hands an observation to the node. May be called from any thread; never blocks, never raises."""

    def __call__(self, input_class: InputClass, observation: Message) -> bool:
        """Return False when the inbox refused it (only ORDER and OUTCOME can be refused)."""


class Performer(Protocol):
    """Performs effects of one port; must not block and must not raise.

    Called on the asyncio loop; that of the vehicle on the node's thread, so that what leaves, leaves at once.

    What came of it is offered as an observation that names `seq`.
    """

    def perform(self, seq: int, effect: Message, recorded_mono_ns: int) -> None:
        """Perform the effect that record `seq` holds; lives count from `recorded_mono_ns`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Where a camera was and where it looked, for the edge's own geometry (floats allowed here)."""

    mono_ns: int  # monotonic time of this pose, interpolated
    latitude_deg: float
    longitude_deg: float
    altitude_m: float  # above mean sea level
    height_m: float  # above the ground that is assumed flat (home level)
    camera_yaw_deg: float  # from true north, clockwise, -180..360
    camera_pitch_deg: float  # up positive: -90 looks straight down
    camera_roll_deg: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleFacts:
    """What is known of the vehicle at a moment, for the self-test. None where it was not told."""

    linked: bool  # its heartbeat is heard
    commandable: bool  # it is known how its autopilot numbers its modes
    armed: bool
    fix_type: int | None  # GPS_FIX_TYPE: 3 and above has a height
    satellites: int | None
    hdop_e2: int | None  # horizontal dilution of precision, in 0.01
    charge_percent: int | None
    voltage_mv: int | None
    home: tuple[float, float, float] | None  # latitude and longitude in degrees, metres above mean sea level
    heard_ms_ago: Mapping[str, int]  # by what was heard: "heartbeat", "fix", "battery", "home", ...


class EyesFacts(NamedTuple):
    """What is known of a camera and its detector at a moment, for the self-test. None where nothing came yet."""

    frame_ms_ago: int | None  # the newest frame, with something in it or not
    detector_us: int | None  # how long the detector took for the newest frame that says so


class PoseSource(Protocol):
    """Knows the camera's pose at a moment."""

    def pose_at(self, mono_ns: int) -> Pose | None:
        """Return the pose at `mono_ns` (monotonic clock of this machine), or None where it is not known."""


class Consistency(NamedTuple):
    """That a log of so many records goes on from a shorter one (RFC 9162, section 2.1.4)."""

    old_root: bytes
    path: tuple[bytes, ...]


class Proving(Protocol):
    """Works out consistency proofs of this node's flights."""

    def ask(
        self, flight_number: int, old_size: int, new_size: int, reply: Callable[[Consistency | None], None]
    ) -> bool:
        """Begin to; False when too many wait. May be called from any thread; never blocks, never raises.

        `reply` is called once, on another thread; None: there is no such log.
        """


class CosignatureJudge(Protocol):
    """Says whether a cosignature is one of this node's log. May be called from any thread; never raises."""

    def __call__(self, message: Sealed, note: str) -> CheckpointCosigned | str:
        """Return what is to be recorded, or the name of what is wrong."""
