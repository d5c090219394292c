"""A plan as the log has it: places with their east and north, parameters in thousandths."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from typing import NamedTuple

from autopilot.planning import Plan, PlannedItem
from autopilot.planning.items import NAV_LAND, NAV_TAKEOFF, NAV_WAYPOINT
from events.schema import mission_pb2
from events.schema.common_pb2 import Place

WITH_PLACE = frozenset({NAV_WAYPOINT, NAV_LAND, NAV_TAKEOFF})

PlaceOf = Callable[[int, int, int], Place | None]  # 1e-7 degrees, mm above mean sea level


class Home(NamedTuple):
    """Where the vehicle starts from."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float  # above mean sea level


def planned(
    plan: Plan, data: bytes, revision: str, home: Home, place_of: PlaceOf, vehicle: int, seq: int
) -> mission_pb2.MissionPlanned | None:
    """Return what is recorded of a plan; None while nothing has a place. `data` is the mission's JSON."""
    home_mm = round(home.altitude_m * 1000)
    back = plan.mission.return_point
    return_place = place_of(
        round(back.latitude * 1e7), round(back.longitude * 1e7), home_mm + round(back.altitude_m * 1000)
    )
    if return_place is None:
        return None
    return mission_pb2.MissionPlanned(
        vehicle=vehicle,
        mission_id=plan.mission.mission_id,
        revision=revision,
        json_sha256=hashlib.sha256(data).digest(),
        items=[_item(item, home_mm, place_of) for item in plan.items],
        fences=_fences(plan, home_mm, place_of),
        return_place=return_place,
        breakpoints=[marker.seq for marker in plan.breakpoints],
        effect_seq=seq,
        fixed_wing=plan.airframe == "plane",
    )


def _item(item: PlannedItem, home_mm: int, place_of: PlaceOf) -> mission_pb2.PlannedItem:
    first, second, third, fourth = item.params
    made = mission_pb2.PlannedItem(command=item.command)
    if item.source:
        made.source_id = item.source
    if item.command in WITH_PLACE:
        place = place_of(item.lat_e7, item.lon_e7, home_mm + item.height_mm)
        if place is not None:
            made.place.CopyFrom(place)
        made.height_mm = item.height_mm
    if first:
        made.parameter_1_e3 = round(first * 1000)
    if second:
        made.parameter_2_e3 = round(second * 1000)
    if third:
        made.parameter_3_e3 = round(third * 1000)
    if fourth is not None:
        made.parameter_4_e3 = round(fourth * 1000)
    return made


def _fences(plan: Plan, home_mm: int, place_of: PlaceOf) -> Iterator[mission_pb2.Fence]:
    for fence in plan.mission.geofences:
        corners = [
            place_of(round(corner.latitude * 1e7), round(corner.longitude * 1e7), home_mm) for corner in fence.vertices
        ]
        yield mission_pb2.Fence(
            inclusion=fence.kind == "INCLUSION", vertices=[corner for corner in corners if corner is not None]
        )
