"""A waypoint put exactly before one planned item, also in the middle of a search, which an office knows as one.

The office puts it behind the search that it interrupts; here it goes to where it was asked for, if the straight legs to
it, on from it and past its old place are allowed. Otherwise the plan stays as the office has it.
"""

from __future__ import annotations

from dataclasses import replace

from autopilot.geo.airspace import Metres
from autopilot.planning.items import DO_CHANGE_SPEED, NAV_RETURN_TO_LAUNCH, PlannedItem, numbered
from autopilot.planning.plan import Plan
from autopilot.wire.mission import Vertex

_WITHOUT_PLACE = (DO_CHANGE_SPEED, NAV_RETURN_TO_LAUNCH)


def with_middle(plan: Plan, waypoint_id: str, index: int) -> Plan:
    """Return the plan with a waypoint's one item before the item that was `index` without it."""
    own = [item for item in plan.items if item.source == waypoint_id]
    rest = [item for item in plan.items if item.source != waypoint_id]
    if len(own) != 1 or not 0 < index < len(rest) or own[0].seq == index:
        return plan
    was = own[0].seq
    legs = [(rest[:was], rest[was:]), (rest[:index], own), (own, rest[index:])]
    if not all(_allowed(plan, before, after) for before, after in legs):
        return plan
    without = [replace(marker, seq=marker.seq - (marker.seq > was)) for marker in plan.breakpoints]
    return replace(
        plan,
        items=numbered([*rest[:index], *own, *rest[index:]]),
        breakpoints=tuple(replace(marker, seq=marker.seq + (marker.seq >= index)) for marker in without),
    )


def _allowed(plan: Plan, before: list[PlannedItem], after: list[PlannedItem]) -> bool:
    """Whether the fences allow the straight leg from the last place before to the first after."""
    ends = [item for item in before if item.command not in _WITHOUT_PLACE][-1:]
    begins = [item for item in after if item.command not in _WITHOUT_PLACE][:1]
    points: list[Metres] = [
        plan.site.metres(Vertex(latitude=item.lat_e7 / 1e7, longitude=item.lon_e7 / 1e7)) for item in (*ends, *begins)
    ]
    return len(points) == 2 and plan.site.airspace.allows(*points)
