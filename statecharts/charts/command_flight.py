"""Guards of the chart `command` about the flight and its mission: what may be asked, when, and to which place.

A place that the vehicle is to fly to is held against the fences before the vehicle is asked, and so is the straight way
there from where it is, where that is known. An autopilot would fly it, and the failsafe would have to bring it back. A
vehicle that is outside a fence while a person holds that failsafe off may be ordered straight back in: over each fence
once, inwards.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from events.schema.common_pb2 import Place
from events.schema.safety_pb2 import OVERRIDE_FENCE_RETURN
from statecharts import geometry
from statecharts.charts.mission import MAY_BEGIN, MAY_PAUSE, MAY_RESUME, OVER, STATES
from statecharts.charts.safety_part import failsafe_flies

if TYPE_CHECKING:
    from statecharts.charts.command import Facts

MISSION_VERBS = ("mission", "acknowledge")
VEHICLE = 1  # orders name no vehicle: there is one

# In which states of the mission what may be asked of it.
MAY_ASK: dict[str, tuple[str, ...]] = {
    "begin": MAY_BEGIN,
    "pause": MAY_PAUSE,
    "resume": MAY_RESUME,
    "abort": tuple(state for state in STATES if state not in OVER),
}


def flight_off(facts: Facts) -> bool:
    """Orders of the flight are switched off on this node."""
    return facts.order.verb in ("fly", "mode") and not facts.state.flight.limits.flight_enabled


def mission_off(facts: Facts) -> bool:
    """No missions are flown by this node."""
    return facts.order.verb in MISSION_VERBS and not facts.state.flight.limits.mission_enabled


def unknown_mode(facts: Facts) -> bool:
    """The order names a mode, or something to do with the mission, that this node does not know."""
    if facts.order.verb == "mission":
        return not facts.order.asked
    return facts.order.verb == "mode" and facts.received is not None and not facts.received.set_flight_mode.mode


def not_at_that(facts: Facts) -> bool:
    """The mission is not where this can be asked of it."""
    now = facts.state.missions.get(VEHICLE)
    state = "idle" if now is None else now.state
    return facts.order.verb == "mission" and state not in MAY_ASK.get(facts.order.asked, ())


def begins_armed(facts: Facts) -> bool:
    """The mission is to begin with a vehicle that is armed: somebody else has it."""
    vehicle = facts.state.vehicles.get(VEHICLE)
    return facts.order.verb == "mission" and facts.order.asked == "begin" and vehicle is not None and vehicle.armed


def mission_unheard(facts: Facts) -> bool:
    """The mission is to be paused or resumed while the vehicle is not heard, and there is a plan to fly."""
    vehicle, planned = facts.state.vehicles.get(VEHICLE), VEHICLE in facts.state.plans
    return _holds_or_resumes(facts) and planned and (vehicle is None or not vehicle.link)


def against_failsafe(facts: Facts) -> bool:
    """The mission is to be paused or resumed while a failsafe brings the vehicle home or down."""
    return _holds_or_resumes(facts) and failsafe_flies(facts.state, VEHICLE)


def _holds_or_resumes(facts: Facts) -> bool:
    return facts.order.verb == "mission" and facts.order.asked in ("pause", "resume")


def no_such_report(facts: Facts) -> bool:
    """No self-test waits for a person's word, or the order names another report."""
    now = facts.state.selftests.get(VEHICLE)
    if facts.order.verb != "acknowledge" or facts.received is None:
        return False
    waits = now is not None and now.state == "awaiting"
    return not waits or now is None or now.effect_seq != facts.received.acknowledge_selftest.report_id


def on_the_ground(facts: Facts) -> bool:
    """The vehicle is not armed: an autopilot would take such an order all the same, and keep it for later."""
    vehicle = facts.state.vehicles.get(VEHICLE)
    return facts.order.verb in ("fly", "mode") and (vehicle is None or not vehicle.armed)


def named_place(facts: Facts) -> Place | None:
    """Return the place that an order names; None where it names none."""
    asked = facts.received
    if asked is None:
        return None
    if asked.HasField("fly_to_place"):
        return asked.fly_to_place.place
    return asked.point_at_place.place if asked.HasField("point_at_place") else None


def _broken(facts: Facts, *, way: bool = False) -> str:
    """Return how the place to fly to breaks the fences, or the way there; `geometry.OK` where it does not."""
    place = named_place(facts)
    if facts.order.verb != "fly" or place is None:
        return geometry.OK
    to = place.east_mm, place.north_mm
    here = facts.state.whereabouts.get(VEHICLE) if way else None
    start = to if here is None else (here.spot.east_mm, here.spot.north_mm)
    fences = tuple(facts.state.fences.values())
    if _fence_is_held_off(facts) and geometry.enters_once(fences, start, to):
        return geometry.OK
    return geometry.judge(fences, start, to)


def _fence_is_held_off(facts: Facts) -> bool:
    held = facts.state.overrides.get((VEHICLE, OVERRIDE_FENCE_RETURN))
    return held is not None and held.until_ns > facts.now_ns


def outside_inclusion(facts: Facts) -> bool:
    """The place to fly to is not inside every inclusion."""
    return _broken(facts) == geometry.INCLUSION_EXIT


def inside_exclusion(facts: Facts) -> bool:
    """The place to fly to is inside an exclusion."""
    return _broken(facts) == geometry.EXCLUSION_ENTRY


def through_fence(facts: Facts) -> bool:
    """The straight way to the place leads through a fence, and not just back in while that may be.

    Where the vehicle is not known the place alone counts.
    """
    return _broken(facts, way=True) != geometry.OK
