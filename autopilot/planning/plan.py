"""A whole mission planned: its items for the vehicle, what is searched, how far and how long it is, and what to know.

Legs between authored places are flown straight, as they were drawn; one that breaks a fence is refused, with the
corners of a way around it. The ways to, within and on from a searched region are the node's own, and go around by
themselves. Times are estimates: cruise speed, the configured wind, turns; no climb, no acceleration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from autopilot.geo.routing import TooManyCorners
from autopilot.geo.sweep import Sweep
from autopilot.planning.course import Course, Leg
from autopilot.planning.items import (
    NAV_LAND,
    Autopilot,
    PlannedItem,
    Spot,
    land,
    numbered,
    placeholder,
    takeoff,
    without_nan,
)
from autopilot.planning.site import Site, lay_out
from autopilot.ports.config import MissionSection
from autopilot.wire.mission import Mission, MissionLimits, MissionProblem, MissionRefused

_COVERED = 0.98  # of a region: seeing less of it is worth a word
_SLIVER = 0.001  # of a region: a fence that takes less is the same line drawn twice
_APART_M = 50.0  # home and return point this far apart are two places
_LOW_M = 5.0  # above home: under it there are fences, hedges and people


@dataclass(frozen=True, slots=True, kw_only=True)
class Breakpoint:
    """Where a mission is taken up again after the camera has followed something."""

    item: str  # id of the mission item
    seq: int  # of the planned item that comes next


@dataclass(frozen=True, slots=True, kw_only=True)
class Searched:
    """What is known of a region before it is searched."""

    item: str  # id of the mission item
    area_m2: float  # what the fences leave of it
    outside_m2: float  # what they took away
    lanes: int
    heading_deg: float  # of the lanes, 0 to 180
    spacing_m: float  # between lanes
    swath_m: float  # what one lane shows
    crab_deg: float  # the largest on the lanes
    length_m: float  # of the lanes and the ways between them
    time_s: float
    coverage: float  # expected, 0 to 1
    frame_period_s: float  # a picture at least this often, for the forward overlap


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """A mission as it is to be flown. Metres are east and north of home."""

    mission: Mission
    airframe: str
    home: Spot
    items: tuple[PlannedItem, ...]
    breakpoints: tuple[Breakpoint, ...]
    searched: tuple[Searched, ...]
    length_m: float
    time_s: float
    notes: tuple[str, ...]  # what whoever flies it should know
    site: Site
    legs: tuple[Leg, ...]
    sweeps: tuple[Sweep, ...]


def mission_limits(settings: MissionSection) -> MissionLimits:
    """Return how large a mission may be."""
    return MissionLimits(
        bytes_max=settings.max_bytes,
        items_max=settings.max_items,
        fences_max=settings.max_fences,
        vertices_max=settings.max_vertices,
    )


def make_plan(
    mission: Mission, settings: MissionSection, field_of_view_deg: float, home: tuple[float, float] | None = None
) -> Plan | MissionRefused:
    """Plan a mission, or say everything that is wrong with it. Never raises for what a mission may hold.

    `home` is latitude and longitude in degrees; None: the mission's return point. `field_of_view_deg` is horizontal.
    """
    back = mission.return_point
    site, problems = lay_out(mission, home or (back.latitude, back.longitude), settings)
    if site is None or problems:
        return MissionRefused(problems)
    course = Course(mission, site, settings, field_of_view_deg)
    try:
        course.fly()
    except TooManyCorners as error:
        return _refused("$.geofences", str(error), "simplify them")
    if course.problems:
        return MissionRefused(tuple(course.problems))
    if all(leg.kind == "return" for leg in course.legs):
        return _refused("$.items", "have nothing to fly to", "add a waypoint, a search or a region_search")
    made = _made(mission, site, settings, course)
    if len(made.items) > settings.max_planned:
        return _refused(
            "$.items",
            f"need {len(made.items)} items on the vehicle, more than {settings.max_planned}",
            "search from higher up, split the mission, or raise max_planned",
        )
    return made


def for_vehicle(plan: Plan, autopilot: Autopilot) -> tuple[PlannedItem, ...]:
    """Return the plan's items as this autopilot wants them uploaded.

    ArduPilot keeps home at 0 whatever is sent there, so a placeholder goes first; and it reads a yaw of NaN back as 0,
    so 0 is what it is sent. PX4 takes the plan as it is: there 0 would be a yaw to the north.
    """
    if autopilot == "px4":
        return plan.items
    return numbered([placeholder(plan.home), *map(without_nan, plan.items)])


def _refused(path: str, reason: str, fix: str) -> MissionRefused:
    return MissionRefused((MissionProblem(path=path, reason=reason, fix=fix),))


def _made(mission: Mission, site: Site, settings: MissionSection, course: Course) -> Plan:
    before, after = _ends(mission, site, settings, course)
    return Plan(
        mission=mission,
        airframe=settings.airframe,
        home=site.spot((0.0, 0.0), 0.0),
        items=numbered([*before, *course.items, *after]),
        breakpoints=tuple(Breakpoint(item=item, seq=index + len(before)) for item, index in course.breakpoints),
        searched=tuple(_searched(item, plan, settings, speed_mps) for item, plan, speed_mps in course.sweeps),
        length_m=sum(leg.length_m for leg in course.legs),
        time_s=course.time_s,
        notes=_notes(mission, site, settings, course),
        site=site,
        legs=tuple(course.legs),
        sweeps=tuple(plan for _, plan, _ in course.sweeps),
    )


def _ends(
    mission: Mission, site: Site, settings: MissionSection, course: Course
) -> tuple[list[PlannedItem], list[PlannedItem]]:
    """Return what a copter does before and after the items: it takes off, and lands unless it has landed."""
    if settings.airframe == "plane":
        return [], []
    heights = [leg.height_m for leg in course.legs if leg.height_m is not None]
    up_m = max(settings.takeoff_height_m, heights[0])
    start = takeoff(site.spot((0.0, 0.0), up_m))
    if course.items[-1].command == NAV_LAND:
        return [start], []
    return [start], [land(site.spot(site.return_point, mission.return_point.altitude_m))]


def _searched(item: str, plan: Sweep, settings: MissionSection, speed_mps: float) -> Searched:
    fastest_mps = speed_mps + (settings.wind_mps if settings.airframe == "plane" else 0.0)
    return Searched(
        item=item,
        area_m2=plan.region.area,
        outside_m2=plan.outside_m2,
        lanes=len(plan.lanes),
        heading_deg=plan.heading_deg,
        spacing_m=plan.spacing_m,
        swath_m=plan.seen.across_m,
        crab_deg=plan.crab_deg,
        length_m=plan.length_m,
        time_s=plan.time_s,
        coverage=plan.coverage,
        frame_period_s=plan.seen.along_m * (1 - settings.forward_overlap) / fastest_mps,
    )


def _notes(mission: Mission, site: Site, settings: MissionSection, course: Course) -> tuple[str, ...]:
    """Return what is no mistake and yet worth knowing before the flight."""
    notes = []
    index_of = {item.id: index for index, item in enumerate(mission.items)}
    for item, plan, _ in course.sweeps:
        if plan.coverage < _COVERED:
            notes.append(
                f"items[{index_of[item]}]: {100 * (1 - plan.coverage):.1f} % of the region is not seen, because lanes "
                f"keep {settings.fence_margin_m:g} m from the fences"
            )
        if plan.outside_m2 > _SLIVER * (plan.region.area + plan.outside_m2):
            notes.append(
                f"items[{index_of[item]}]: {plan.outside_m2 / 10_000:.2f} ha of the region are forbidden by the fences "
                "and not searched"
            )
    away_m = math.hypot(*site.return_point)
    if away_m > _APART_M and any(item.kind == "return" and item.at is None for item in mission.items):
        notes.append(f"a return goes to where the vehicle started, {away_m:.0f} m from the return point")
    low = [
        index
        for index, item in enumerate(mission.items)
        if item.at and item.kind != "return" and item.at.altitude_m < _LOW_M
    ]
    notes += [f"items[{index}] is less than {_LOW_M:g} m above home" for index in low]
    if not any(fence.kind == "INCLUSION" for fence in mission.geofences):
        notes.append("no INCLUSION: nothing bounds the flight but its reach")
    return tuple(notes)
