"""A mission laid out on the ground: its places in metres around home, its fences, and what is wrong with them there.

What no schema can see is judged here: polygons that cross themselves, fences that leave home or a waypoint outside,
places beyond reach. All of it is found at once and said with the path of the item and what to do.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from shapely.geometry import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from autopilot.geo import LocalFrame
from autopilot.geo.airspace import TOUCH_M, Airspace, Metres, polygon_fault
from autopilot.geo.routing import Router
from autopilot.planning.items import Spot
from autopilot.ports.config import MissionSection
from autopilot.wire.mission import Coordinate, Mission, MissionProblem, Vertex


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """Where a mission takes place. Metres are east and north of home."""

    frame: LocalFrame
    airspace: Airspace
    router: Router
    fences: tuple[tuple[str, Polygon], ...]  # kind, shape; in the mission's order
    return_point: Metres

    def metres(self, place: Coordinate | Vertex) -> Metres:
        """Return a place of the mission as east and north of home."""
        return _metres(self.frame, place)

    def spot(self, point: Metres, height_m: float) -> Spot:
        """Return a point as a vehicle is told of it; the height is above home."""
        place = self.frame.from_east_north(point[0], point[1], 0.0)
        return Spot(place.latitude_e7, place.longitude_e7, round(height_m * 1000))


def lay_out(
    mission: Mission, home: tuple[float, float], settings: MissionSection
) -> tuple[Site | None, tuple[MissionProblem, ...]]:
    """Return the site and what is wrong with the mission on it; no site where its fences are no polygons.

    `home` is latitude and longitude in degrees.
    """
    frame = LocalFrame(home[0], home[1], 0.0)
    problems = (*_out_of_reach(mission, frame, settings), *_bad_polygons(mission, frame))
    if problems:
        return None, problems
    fences = tuple(
        (fence.kind, Polygon([_metres(frame, corner) for corner in fence.vertices])) for fence in mission.geofences
    )
    airspace = Airspace(
        [shape for kind, shape in fences if kind == "INCLUSION"],
        [shape for kind, shape in fences if kind == "EXCLUSION"],
        settings.fence_margin_m,
        2 * settings.reach_m,
    )
    site = Site(
        frame=frame,
        airspace=airspace,
        router=Router(airspace),
        fences=fences,
        return_point=_metres(frame, mission.return_point),
    )
    return site, tuple(_outside(mission, site))


def forbidden_by(site: Site, path: Sequence[Metres]) -> str:
    """Return the path of the fence that a point or the straight legs through points break; empty where none does."""
    if site.airspace.allows(*path):
        return ""
    shape = Point(path[0]) if len(set(path)) == 1 else LineString(path)
    for index, (kind, fence) in enumerate(site.fences):
        if _breaks(kind, fence, shape):
            return f"$.geofences[{index}] ({kind})"
    return "the reach of the mission"


def _breaks(kind: str, fence: Polygon, shape: BaseGeometry) -> bool:
    if kind == "INCLUSION":
        return not bool(fence.buffer(TOUCH_M).covers(shape))
    return bool(fence.buffer(-TOUCH_M).intersects(shape))


def _out_of_reach(mission: Mission, frame: LocalFrame, settings: MissionSection) -> Iterator[MissionProblem]:
    for path, place in _places(mission):
        away_m = math.hypot(*_metres(frame, place))
        if away_m > settings.reach_m:
            yield MissionProblem(
                path=path,
                reason=f"is {away_m / 1000:.1f} km from home, farther than {settings.reach_m / 1000:g} km",
                fix="check latitude and longitude, or raise reach_m",
            )


def _bad_polygons(mission: Mission, frame: LocalFrame) -> Iterator[MissionProblem]:
    polygons = [(f"$.items[{index}].region", item.region) for index, item in enumerate(mission.items) if item.region]
    polygons += [(f"$.geofences[{index}].vertices", fence.vertices) for index, fence in enumerate(mission.geofences)]
    for path, corners in polygons:
        if fault := polygon_fault([_metres(frame, corner) for corner in corners]):
            yield MissionProblem(path=path, reason=fault, fix="list its corners once, in order around it")


def _outside(mission: Mission, site: Site) -> Iterator[MissionProblem]:
    """Yield the places that the fences forbid: home, the return point, and what is to be flown to."""
    if site.airspace.allowed.is_empty:
        yield MissionProblem(path="$.geofences", reason="leave no room to fly in", fix="let the inclusions overlap")
        return
    places = [("$.return_point", site.return_point)]
    places += [
        (f"$.items[{index}].at", site.metres(item.at))
        for index, item in enumerate(mission.items)
        if item.at is not None
    ]
    for path, point in places:
        if fence := forbidden_by(site, [point]):
            yield MissionProblem(path=path, reason=f"is forbidden by {fence}", fix="move it, or change the fence")
    if fence := forbidden_by(site, [(0.0, 0.0)]):
        yield MissionProblem(
            path="$.geofences",
            reason=f"home is forbidden by {fence}",
            fix="let home lie inside it" if "INCLUSION" in fence else "leave home out of it",
        )


def _metres(frame: LocalFrame, place: Coordinate | Vertex) -> Metres:
    there = frame.place(place.latitude, place.longitude, 0.0)
    return there.east_mm / 1000, there.north_mm / 1000


def _places(mission: Mission) -> Iterator[tuple[str, Coordinate | Vertex]]:
    """Yield every place of a mission with its path."""
    yield "$.return_point", mission.return_point
    for index, item in enumerate(mission.items):
        if item.at is not None:
            yield f"$.items[{index}].at", item.at
        yield from ((f"$.items[{index}].region[{corner}]", place) for corner, place in enumerate(item.region))
    for index, fence in enumerate(mission.geofences):
        yield from ((f"$.geofences[{index}].vertices[{corner}]", place) for corner, place in enumerate(fence.vertices))
