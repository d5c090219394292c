"""Facts and guards of the chart `mission`: what its rows look at. The rows are in `mission.py`."""

from __future__ import annotations

from dataclasses import dataclass

from events.schema.safety_pb2 import (
    FLIGHT_MODE_GUIDED,
    FLIGHT_MODE_LAND,
    FLIGHT_MODE_LOITER,
    FLIGHT_MODE_MISSION,
    FLIGHT_MODE_RETURN,
)


@dataclass(frozen=True, slots=True)
class Facts:
    """What the guards look at."""

    enabled: bool = False  # this node flies missions
    tested: bool = False  # the self-test has passed
    may_begin: bool = False  # nobody has to order it, or somebody has; and the vehicle is not armed
    flown_already: bool = False  # this revision was flown, and would begin by itself
    pilot: bool = False  # a pilot arms and starts
    last_try: bool = False  # the present step was begun as often as it may be
    refused: bool = False  # the vehicle has refused the present step
    final: bool = True  # it is not tried any more: no mission can be had, or not all was pushed
    armed: bool = False
    mode: int = 0  # FlightMode of the vehicle; 0 where it is none that is known
    flown: bool = False  # the mission was under way in the air in this flight
    holds_plan: bool = False  # the vehicle holds the newest plan, read back
    left_mission: bool = False  # it was in the mission's mode when this state was entered, and is no longer
    lingers: bool = False  # told to leave a mode on entering this state, it was not seen in another yet
    failsafe: bool = False  # a failsafe demands something of it that nobody holds off
    homeward: bool = False  # the item that the vehicle is at brings it home or down
    at_middle: bool = False  # the vehicle has reached the waypoint that was asked for in the middle
    followed: bool = False  # a camera follows something
    by_waypoint: bool = False  # what is followed gets a waypoint
    pushes: bool = False  # there is an office that what was seen is pushed to


def off(facts: Facts) -> bool:
    """No missions are flown by this node."""
    return not facts.enabled


def flown_already(facts: Facts) -> bool:
    """The revision was flown to its end, and nobody ordered it again."""
    return facts.flown_already


def tested_and_begun(facts: Facts) -> bool:
    """The self-test has passed, and the mission may begin."""
    return facts.tested and facts.may_begin


def tested(facts: Facts) -> bool:
    """The self-test has passed."""
    return facts.tested


def may_begin(facts: Facts) -> bool:
    """Nobody has to order it, or somebody has, and the vehicle is not armed yet."""
    return facts.may_begin


def goes_on_trying(facts: Facts) -> bool:
    """The mission is still being looked for, or what was seen still being pushed."""
    return not facts.final


def last_try(facts: Facts) -> bool:
    """The step was begun as often as it may be."""
    return facts.last_try


def was_refused(facts: Facts) -> bool:
    """The vehicle has refused the present step."""
    return facts.refused


def in_air(facts: Facts) -> bool:
    """The mission is under way in the air."""
    return facts.flown and facts.armed


def in_air_with_plan(facts: Facts) -> bool:
    """The mission is under way in the air, and the vehicle holds the newest plan."""
    return in_air(facts) and facts.holds_plan


def holds_plan(facts: Facts) -> bool:
    """The vehicle holds the newest plan."""
    return facts.holds_plan


def in_mission_with_plan(facts: Facts) -> bool:
    """The vehicle says that it flies the mission, by the newest plan."""
    return facts.mode == FLIGHT_MODE_MISSION and facts.holds_plan


def taken(facts: Facts) -> bool:
    """In the air the vehicle has left the mission's mode, and nobody here asked it to."""
    return in_air(facts) and facts.left_mission


def in_mission_or_holding(facts: Facts) -> bool:
    """The vehicle says that it flies the mission still, or that it waits where it is."""
    return facts.mode in (FLIGHT_MODE_MISSION, FLIGHT_MODE_LOITER)


def pilot(facts: Facts) -> bool:
    """A pilot arms and starts."""
    return facts.pilot


def armed(facts: Facts) -> bool:
    """The motors are armed."""
    return facts.armed


def disarmed(facts: Facts) -> bool:
    """The motors are not armed."""
    return not facts.armed


def holding(facts: Facts) -> bool:
    """The vehicle says that it holds, or takes places one by one."""
    return facts.mode in (FLIGHT_MODE_GUIDED, FLIGHT_MODE_LOITER)


def in_mission(facts: Facts) -> bool:
    """The vehicle says that it flies the mission."""
    return facts.mode == FLIGHT_MODE_MISSION


def in_mission_in_air(facts: Facts) -> bool:
    """The vehicle says that it flies the mission, and it had been under way before."""
    return in_air(facts) and facts.mode == FLIGHT_MODE_MISSION


def started_by_pilot(facts: Facts) -> bool:
    """The vehicle says that it is armed and flies the mission."""
    return facts.armed and facts.mode == FLIGHT_MODE_MISSION


def going_home(facts: Facts) -> bool:
    """The vehicle says that it returns or lands."""
    return facts.armed and facts.mode in (FLIGHT_MODE_RETURN, FLIGHT_MODE_LAND)


def landed(facts: Facts) -> bool:
    """The mission was under way in the air, and the motors are off."""
    return facts.flown and not facts.armed


def homeward(facts: Facts) -> bool:
    """The item that the vehicle is at brings it home or down."""
    return facts.homeward


def lingers(facts: Facts) -> bool:
    """The vehicle was told to leave the mode that it is in, and was not seen in another yet."""
    return facts.lingers


def goes_home(facts: Facts) -> bool:
    """The vehicle says that it returns or lands, not only still; a failsafe is believed at once."""
    return going_home(facts) and (facts.failsafe or not facts.lingers)


def goes_home_in_air(facts: Facts) -> bool:
    """The mission was under way in the air, and the vehicle says that it returns or lands, not only still."""
    return facts.flown and goes_home(facts)


def keeps_returning(facts: Facts) -> bool:
    """The vehicle returns, as often as it was asked to hold, or because a failsafe has it."""
    return facts.flown and going_home(facts) and (facts.failsafe or facts.last_try)


def back_in_mission(facts: Facts) -> bool:
    """The vehicle says that it flies the mission, not only still, and it had been under way before."""
    return in_mission_in_air(facts) and not facts.lingers


def outward(facts: Facts) -> bool:
    """The vehicle says that it flies the mission that had been under way, at an item that does not bring it home."""
    return in_mission_in_air(facts) and not facts.homeward


def homeward_in_mission(facts: Facts) -> bool:
    """The vehicle says that it flies the mission, at an item that brings it home."""
    return facts.mode == FLIGHT_MODE_MISSION and facts.homeward


def at_middle(facts: Facts) -> bool:
    """The vehicle has reached the waypoint that was asked for in the middle."""
    return facts.at_middle


def by_waypoint(facts: Facts) -> bool:
    """What is followed gets a waypoint in the mission."""
    return facts.by_waypoint


def pushes(facts: Facts) -> bool:
    """There is a mission office, which what was seen is pushed to."""
    return facts.pushes


def followed(facts: Facts) -> bool:
    """A camera follows something."""
    return facts.followed
