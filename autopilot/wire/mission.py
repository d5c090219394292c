"""The mission as plain values: what an office delivers and an operator authored (seed 004, section 4).

The form is `mission-schema.json` beside this file; `autopilot.wire.mission_reading` makes these of bytes. Degrees are
WGS84; altitudes are metres above home, never above the sea or the ground. Nothing here knows where a mission lies on
the Earth, or how it is flown: that is `autopilot.planning`'s business.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

SCHEMA_MAJOR: Final = 1  # of the form that is read here; the first number of `schema_version`
SCHEMA_VERSION: Final = "1.0.0"

ItemKind = Literal["waypoint", "search", "region_search", "return", "target_follow_breakpoint"]
FenceKind = Literal["INCLUSION", "EXCLUSION"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Coordinate:
    """A place with its height above home."""

    latitude: float  # degrees, +-90
    longitude: float  # degrees, +-180
    altitude_m: float  # above home


@dataclass(frozen=True, slots=True, kw_only=True)
class Vertex:
    """A corner of a polygon."""

    latitude: float  # degrees, +-90
    longitude: float  # degrees, +-180
    altitude_m: float | None = None  # above home; a region is searched from it, a geofence ignores it


@dataclass(frozen=True, slots=True, kw_only=True)
class Geofence:
    """Where the vehicle must stay (INCLUSION) or must not be (EXCLUSION), at every height."""

    kind: FenceKind
    vertices: tuple[Vertex, ...]  # in order; the last is joined to the first


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionItem:
    """One thing to do."""

    id: str  # UUID, lower case
    kind: ItemKind
    at: Coordinate | None = None  # of a waypoint and a search; of a return: land there
    region: tuple[Vertex, ...] = ()  # of a region_search
    cruise_speed_mps: float | None = None  # from here on
    target_classes: tuple[str, ...] = ()  # what is looked for, as the detector names it


@dataclass(frozen=True, slots=True, kw_only=True)
class Mission:
    """A mission as it was authored."""

    mission_id: str  # UUID, lower case
    schema_version: str  # x.y.z
    items: tuple[MissionItem, ...]
    geofences: tuple[Geofence, ...]
    return_point: Coordinate


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionLimits:
    """How large a mission may be."""

    bytes_max: int  # of the JSON text
    items_max: int
    fences_max: int
    vertices_max: int  # of one polygon


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionProblem:
    """One thing that is wrong with a mission."""

    path: str  # JSON path, such as $.items[2].at.latitude; "$" is the whole
    reason: str  # what is wrong
    fix: str  # what to do about it

    def __str__(self) -> str:
        return f"{self.path}: {self.reason}; {self.fix}"


@dataclass(frozen=True, slots=True)
class MissionRefused:
    """A mission that is not taken, with everything that is wrong with it."""

    problems: tuple[MissionProblem, ...]

    def __str__(self) -> str:
        return "\n".join(map(str, self.problems))
