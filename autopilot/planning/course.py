"""The flight along a mission's items, one after the other: what each becomes, and every leg on the way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from shapely.geometry import Polygon

from autopilot.geo.airspace import Metres
from autopilot.geo.footprint import footprint
from autopilot.geo.routing import path_length_m
from autopilot.geo.sweep import Flying, NoSweep, Sweep, path_time_s, sweep
from autopilot.geo.wind import Wind
from autopilot.planning.items import PlannedItem, change_speed, land, return_to_launch, waypoint
from autopilot.planning.site import Site, forbidden_by
from autopilot.ports.config import MissionSection
from autopilot.wire.mission import Mission, MissionItem, MissionProblem, Vertex

RING_CORNERS = 8  # a plane goes round a place to search on so many waypoints

LegKind = Literal["leg", "lane", "transit", "return"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """A stretch of the flight, east and north of home in metres."""

    kind: LegKind  # leg: as authored; lane and transit: of a searched region; return: to the end
    path: tuple[Metres, ...]
    height_m: float | None  # above home, at its end; None where the vehicle chooses it
    source: str  # id of the mission item

    @property
    def length_m(self) -> float:
        """Return its length over ground."""
        return path_length_m(self.path)


class Course:
    """What comes of the items; ask `fly` once, then read what it found."""

    def __init__(self, mission: Mission, site: Site, settings: MissionSection, field_of_view_deg: float) -> None:
        self.items: list[PlannedItem] = []
        self.legs: list[Leg] = []
        self.breakpoints: list[tuple[str, int]] = []  # id, index in `items` of what comes next
        self.sweeps: list[tuple[str, Sweep, float]] = []  # id, the search, the speed in m/s
        self.problems: list[MissionProblem] = []
        self.time_s = 0.0
        self._mission, self._site, self._settings = mission, site, settings
        self._field_of_view_deg = field_of_view_deg
        self._wind = Wind(from_deg=settings.wind_from_deg, speed_mps=settings.wind_mps)
        self._plane = settings.airframe == "plane"
        self._speed_mps = settings.cruise_speed_mps
        self._here: Metres = (0.0, 0.0)
        self._height_m = settings.takeoff_height_m
        self._searched = ""  # id of the region that was left last: the way on from it is the node's own

    def fly(self) -> None:
        """Go through all items. Raises `TooManyCorners` for fences that are too intricate."""
        returned = False
        for index, item in enumerate(self._mission.items):
            path = f"$.items[{index}]"
            if returned and item.kind != "target_follow_breakpoint":
                self._wrong(path, "comes after the return, and would never be flown", "put the return last")
                return
            self._one(path, item)
            returned = returned or item.kind == "return"
        if not (self._plane or returned):
            end = self._mission.return_point
            self._to("$.return_point", self._site.return_point, "return", end.altitude_m, "")

    def _one(self, path: str, item: MissionItem) -> None:
        match item.kind:
            case "target_follow_breakpoint":
                self.breakpoints.append((item.id, len(self.items)))
            case "region_search":
                self._region(path, item)
            case "return":
                self._return(path, item)
            case "search" if self._plane:
                self._ring(path, item)
            case _:
                self._waypoint(path, item)

    def _waypoint(self, path: str, item: MissionItem) -> None:
        """A waypoint; a copter that searches a place stays there for a while, and its camera looks around."""
        assert item.at is not None  # the schema asks for it
        hold_s = self._settings.search_hold_s if item.kind == "search" else 0.0
        point = self._site.metres(item.at)
        self._leave(path, point)
        self._speed(item)
        self._to(path, point, "leg", item.at.altitude_m, item.id)
        self.items.append(waypoint(self._site.spot(point, item.at.altitude_m), item.id, hold_s))
        self.time_s += hold_s

    def _ring(self, path: str, item: MissionItem) -> None:
        """Once around a place, for a plane can't stay; the corners lie on the circle."""
        assert item.at is not None  # the schema asks for it
        east, north = self._site.metres(item.at)
        first = math.atan2(self._here[0] - east, self._here[1] - north)
        radius_m = self._settings.search_radius_m
        angles = [first + math.tau * corner / RING_CORNERS for corner in range(RING_CORNERS + 1)]
        ring = [(east + radius_m * math.sin(angle), north + radius_m * math.cos(angle)) for angle in angles]
        if fence := forbidden_by(self._site, ring):
            fix = "move it, or lower search_radius_m"
            self._wrong(path, f"is circled at {radius_m:g} m, which is forbidden by {fence}", fix)
            return
        self._leave(path, ring[0])
        self._speed(item)
        for corner in ring:
            self._to(path, corner, "leg", item.at.altitude_m, item.id)
            self.items.append(waypoint(self._site.spot(corner, item.at.altitude_m), item.id))

    def _region(self, path: str, item: MissionItem) -> None:
        heights = {corner.altitude_m for corner in item.region}
        height_m = heights.pop()
        if heights:
            self._wrong(f"{path}.region", "has corners of different heights", "give all the same altitude_m, or none")
            return
        height_m = self._settings.search_height_m if height_m is None else height_m
        if height_m <= 0:
            self._wrong(f"{path}.region", f"is searched from {height_m:g} m above home", "search from above the ground")
            return
        self._leave(path, None)
        self._speed(item)
        try:
            found = self._swept(item.region, height_m)
        except NoSweep as error:
            reason, _, fix = str(error).partition("; ")
            self._wrong(f"{path}.region", reason, fix)
            return
        self.sweeps.append((item.id, found, self._speed_mps))
        self.items += [waypoint(self._site.spot(point, height_m), item.id) for point in found.path]
        lanes = set(found.lanes)
        for step in zip((self._here, *found.path), found.path, strict=False):
            kind: LegKind = "lane" if step in lanes else "transit"
            self.legs.append(Leg(kind=kind, path=step, height_m=height_m, source=item.id))
        self.time_s += found.time_s
        self._here, self._height_m, self._searched = found.path[-1], height_m, item.id

    def _swept(self, region: Sequence[Vertex], height_m: float) -> Sweep:
        settings = self._settings
        return sweep(
            Polygon([self._site.metres(corner) for corner in region]),
            self._site.airspace,
            self._site.router,
            self._here,
            footprint(height_m, self._field_of_view_deg, settings.aspect),
            settings.side_overlap,
            self._flying(),
            self._wind,
        )

    def _return(self, path: str, item: MissionItem) -> None:
        goal = (0.0, 0.0) if item.at is None else self._site.metres(item.at)
        self._leave(path, goal)
        self._speed(item)
        self._to(path, goal, "return", None if item.at is None else item.at.altitude_m, item.id)
        if item.at is None:
            self.items.append(return_to_launch(item.id))
        else:
            self.items.append(land(self._site.spot(goal, item.at.altitude_m), item.id))

    def _leave(self, path: str, goal: Metres | None) -> None:
        """Fly around fences on the way on from a searched region; the next region finds its own way."""
        source, self._searched = self._searched, ""
        between = self._site.router.between(self._here, goal) if source and goal else ()
        if between is None:
            self._wrong(path, "can't be reached inside the fences", "move it, or change the fences")
        for corner in between or ():
            self._fly((self._here, corner), "transit", self._height_m, source)
            self.items.append(waypoint(self._site.spot(corner, self._height_m), source))

    def _to(self, path: str, goal: Metres, kind: LegKind, height_m: float | None, source: str) -> None:
        """Fly straight, as it was drawn; say so where a fence stands in the way."""
        if self._here != goal and (fence := forbidden_by(self._site, [self._here, goal])):
            self._wrong(path, f"the straight way to it is forbidden by {fence}", self._around(goal))
        self._fly((self._here, goal), kind, height_m, source)

    def _fly(self, path: tuple[Metres, ...], kind: LegKind, height_m: float | None, source: str) -> None:
        self.legs.append(Leg(kind=kind, path=path, height_m=height_m, source=source))
        self.time_s += path_time_s(path, self._flying(), self._wind)
        self._here = path[-1]
        self._height_m = self._height_m if height_m is None else height_m

    def _around(self, goal: Metres) -> str:
        """Return what to do about a fence in the way: the waypoints of a way around it."""
        between = self._site.router.between(self._here, goal)
        if not between:
            return "move it, or change the fence"
        spots = [self._site.spot(corner, 0.0) for corner in between]
        return "go around it on waypoints at " + ", then ".join(
            f"{spot.lat_e7 / 1e7:.6f} {spot.lon_e7 / 1e7:.6f}" for spot in spots
        )

    def _speed(self, item: MissionItem) -> None:
        if item.cruise_speed_mps is not None:
            self._speed_mps = item.cruise_speed_mps
            self.items.append(change_speed(item.cruise_speed_mps, item.id, through_air=self._plane))

    def _flying(self) -> Flying:
        settings = self._settings
        return Flying(speed_mps=self._speed_mps, turn_s=settings.turn_s, crabs=self._plane, run_in_m=settings.run_in_m)

    def _wrong(self, path: str, reason: str, fix: str) -> None:
        self.problems.append(MissionProblem(path=path, reason=reason, fix=fix))
