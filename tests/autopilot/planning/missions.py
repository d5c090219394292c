"""Missions for tests: written in metres around a place, read as any other."""

from __future__ import annotations

import json
import uuid
from collections.abc import Sequence
from typing import Any

from autopilot.geo import LocalFrame
from autopilot.planning import Plan, make_plan, mission_limits
from autopilot.ports.config import MissionSection
from autopilot.wire.mission import Mission, MissionRefused
from autopilot.wire.mission_reading import read_mission

HOME = (47.5402, 8.7214)
FRAME = LocalFrame(*HOME, 0.0)
MISSION_ID = "8f14e45f-ceea-467f-a9f2-3c1d2b7a5e10"

Metres = tuple[float, float]
SQUARE: list[Metres] = [(50, 50), (350, 50), (350, 250), (50, 250)]
AROUND: list[Metres] = [(-100, -100), (450, -100), (450, 400), (-100, 400)]


def uid(number: int) -> str:
    """Return an item's id."""
    return str(uuid.UUID(int=number + 1))


def vertex(point: Metres, height_m: float | None = None) -> dict[str, float]:
    """Return a point east and north of home as the schema has it."""
    place = FRAME.from_east_north(*point, 0.0)
    made = {"latitude": place.latitude_e7 / 1e7, "longitude": place.longitude_e7 / 1e7}
    return made if height_m is None else made | {"altitude_m": height_m}


def waypoint(point: Metres, height_m: float = 40, **more: Any) -> dict[str, Any]:
    """Return a waypoint without an id."""
    return {"kind": "waypoint", "at": vertex(point, height_m)} | more


def region(points: Sequence[Metres] = SQUARE, height_m: float | None = 50, **more: Any) -> dict[str, Any]:
    """Return a region search without an id."""
    return {"kind": "region_search", "region": [vertex(point, height_m) for point in points]} | more


def fence(points: Sequence[Metres], kind: str = "EXCLUSION") -> dict[str, Any]:
    """Return a geofence."""
    return {"kind": kind, "vertices": [vertex(point) for point in points]}


def tree(*items: dict[str, Any], fences: Sequence[dict[str, Any]] = (), back: Metres = (0, 0)) -> dict[str, Any]:
    """Return a mission as JSON's values."""
    return {
        "schema_version": "1.0.0",
        "mission_id": MISSION_ID,
        "items": [{"id": uid(number)} | item for number, item in enumerate(items)],
        "geofences": list(fences),
        "return_point": vertex(back, 0),
    }


def read(made: dict[str, Any], settings: MissionSection | None = None) -> Mission | MissionRefused:
    """Read a mission as it would come off a wire."""
    return read_mission(json.dumps(made).encode(), mission_limits(settings or MissionSection()))


def plan_of(made: dict[str, Any], home: tuple[float, float] | None = None, **settings: Any) -> Plan | MissionRefused:
    """Read and plan a mission, seen through a lens of 60 degrees."""
    section = MissionSection(**settings)
    mission = read(made, section)
    return mission if isinstance(mission, MissionRefused) else make_plan(mission, section, 60.0, home)


def planned(made: dict[str, Any], home: tuple[float, float] | None = None, **settings: Any) -> Plan:
    """Plan a mission that can be flown."""
    plan = plan_of(made, home, **settings)
    assert isinstance(plan, Plan), str(plan)
    return plan
