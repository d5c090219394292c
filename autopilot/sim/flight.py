"""How the body of an aircraft moves: a multirotor or a fixed wing, in steps of a fixed length.

A body is told what is wished of it (fly a leg, stay, rise, come down, rest) and moves as far as its
limits and the wind let it in one step. It knows no mode, no mission, no MAVLink, no clock and no
chance: the same wishes give the same flight. East, north and up are metres from home; the ground is
flat and lies at up 0. Turning, climbing and gaining speed take time; tilt isn't modelled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

STEP_S = 0.05  # one step; 20 a second are finer than anything that is told about the flight
GRAVITY_M_S2 = 9.81
GROUND_M = 0.02  # lower than this is on the ground


@dataclass(slots=True)
class Body:
    """Where an aircraft is and how it moves over the ground; edit it as you like."""

    east_m: float = 0.0
    north_m: float = 0.0
    up_m: float = 0.0
    yaw_deg: float = 0.0  # where the nose points, from north, clockwise
    east_m_s: float = 0.0
    north_m_s: float = 0.0
    up_m_s: float = 0.0
    yaw_deg_s: float = 0.0
    air_m_s: float = 0.0  # a fixed wing's speed through the air

    @property
    def grounded(self) -> bool:
        """Whether it stands or rolls on the ground."""
        return self.up_m <= GROUND_M

    def move(self, dt_s: float) -> None:
        """Go on for a time as it moves; the ground stops it."""
        self.east_m += self.east_m_s * dt_s
        self.north_m += self.north_m_s * dt_s
        self.up_m += self.up_m_s * dt_s
        if self.up_m <= 0:
            self.up_m = 0.0
            self.up_m_s = max(self.up_m_s, 0.0)


@dataclass(slots=True)
class Wind:
    """Where the air moves to, metres a second."""

    east_m_s: float = 0.0
    north_m_s: float = 0.0

    @property
    def strength_m_s(self) -> float:
        """How fast."""
        return math.hypot(self.east_m_s, self.north_m_s)


@dataclass(frozen=True, slots=True)
class Rest:
    """Stand on the ground; what is in the air falls."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fly:
    """Fly the leg from a start to an end at a height; `stops` where nothing follows at once."""

    start_m: tuple[float, float]
    east_m: float
    north_m: float
    up_m: float
    speed_m_s: float
    stops: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Stay:
    """Stay over a point: a multirotor stands, a fixed wing circles it."""

    east_m: float
    north_m: float
    up_m: float
    speed_m_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Rise:
    """Leave the ground: a multirotor straight up, a fixed wing along its nose."""

    up_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Down:
    """Come down at a point and stop."""

    east_m: float
    north_m: float


Wish = Rest | Fly | Stay | Rise | Down


class Frame(Protocol):
    """What kind of aircraft it is; edit its limits as you like."""

    cruise_m_s: float
    climb_m_s: float
    sink_m_s: float
    near_m: float  # a waypoint is reached within this
    hovers: bool

    def step(self, body: Body, wish: Wish, wind: Wind) -> None:
        """Move the body for one step."""


@dataclass(slots=True)
class Multirotor:
    """Stands still where it likes; wind costs it charge, not its place."""

    cruise_m_s: float = 8.0
    climb_m_s: float = 3.0
    sink_m_s: float = 2.0
    near_m: float = 1.0
    hovers: bool = True
    acceleration_m_s2: float = 3.0
    turn_deg_s: float = 90.0
    touch_m_s: float = 0.7  # the last metres of a landing
    touch_below_m: float = 4.0
    nose_at_m: tuple[float, float] | None = None  # east and north of what the nose has to point at

    def step(self, body: Body, wish: Wish, wind: Wind) -> None:
        """Move the body for one step."""
        del wind
        if isinstance(wish, Rest):
            _fall(body)
            return
        east_m_s, north_m_s = self._level(body, wish)
        _approach(body, east_m_s, north_m_s, self.acceleration_m_s2 * STEP_S)
        rate_m_s = self._upward(body, wish)
        gain_m_s = self.acceleration_m_s2 * STEP_S
        body.up_m_s += _within(rate_m_s - body.up_m_s, gain_m_s)
        self._turn(body, wish)
        body.move(STEP_S)

    def _level(self, body: Body, wish: Wish) -> tuple[float, float]:
        """Return the velocity over the ground that is wished for."""
        if isinstance(wish, Rest | Rise) or body.grounded:
            return 0.0, 0.0
        east_m, north_m = wish.east_m - body.east_m, wish.north_m - body.north_m
        away_m = math.hypot(east_m, north_m)
        speed_m_s = wish.speed_m_s if isinstance(wish, Fly | Stay) else self.cruise_m_s
        floor_m_s = 1.5 if isinstance(wish, Fly) and not wish.stops else 0.0
        # Half of the acceleration is for braking, so that a step too late doesn't overshoot.
        speed_m_s = min(speed_m_s, max(math.sqrt(self.acceleration_m_s2 * away_m), floor_m_s), away_m / STEP_S)
        if isinstance(wish, Fly):
            return self._along(body, wish, speed_m_s)
        return (east_m / away_m * speed_m_s, north_m / away_m * speed_m_s) if away_m > 1e-6 else (0.0, 0.0)

    def _along(self, body: Body, leg: Fly, speed_m_s: float) -> tuple[float, float]:
        """Return the velocity that follows a leg and comes back to its line."""
        ahead_m = carrot(body, leg, max(3.0, speed_m_s))
        east_m, north_m = ahead_m[0] - body.east_m, ahead_m[1] - body.north_m
        away_m = math.hypot(east_m, north_m)
        return (east_m / away_m * speed_m_s, north_m / away_m * speed_m_s) if away_m > 1e-6 else (0.0, 0.0)

    def _upward(self, body: Body, wish: Wish) -> float:
        """Return the climb that is wished for."""
        if isinstance(wish, Down):
            slow = body.up_m < self.touch_below_m
            over = math.hypot(wish.east_m - body.east_m, wish.north_m - body.north_m) < 2.0
            return (-self.touch_m_s if slow else -self.sink_m_s) if over else 0.0
        if isinstance(wish, Rest) or (body.grounded and not isinstance(wish, Rise)):
            return 0.0
        return min(max(1.2 * (wish.up_m - body.up_m), -self.sink_m_s), self.climb_m_s)

    def _turn(self, body: Body, wish: Wish) -> None:
        """Point the nose along a leg."""
        body.yaw_deg_s = 0.0
        if body.grounded:
            return
        if self.nose_at_m is not None:
            east_m, north_m = self.nose_at_m[0] - body.east_m, self.nose_at_m[1] - body.north_m
            _turn(body, math.degrees(math.atan2(east_m, north_m)), self.turn_deg_s)
        elif isinstance(wish, Fly) and math.hypot(wish.east_m - body.east_m, wish.north_m - body.north_m) > 2.0:
            course_deg = math.degrees(math.atan2(wish.east_m - body.east_m, wish.north_m - body.north_m))
            _turn(body, course_deg, self.turn_deg_s)


@dataclass(slots=True)
class FixedWing:
    """Always moves through the air, and the wind moves it with the air."""

    cruise_m_s: float = 18.0
    climb_m_s: float = 4.0
    sink_m_s: float = 3.0
    near_m: float = 25.0
    hovers: bool = False
    turn_deg_s: float = 28.0  # 45 degrees of bank at cruise speed
    lift_off_m_s: float = 12.0
    acceleration_m_s2: float = 4.0
    circle_m: float = 60.0
    glide: float = 0.1  # metres down a metre ahead
    flare_m_s: float = 1.2  # the last metres of a landing, straight on
    flare_below_m: float = 5.0
    look_ahead_s: float = 2.5

    def step(self, body: Body, wish: Wish, wind: Wind) -> None:
        """Move the body for one step."""
        if isinstance(wish, Rest):
            _fall(body)
            body.air_m_s = 0.0
            return
        rolls_out = isinstance(wish, Down) and body.grounded
        wanted_m_s = wish.speed_m_s if isinstance(wish, Fly | Stay) else self.cruise_m_s
        gain_m_s = self.acceleration_m_s2 * STEP_S
        body.air_m_s += _within((0.0 if rolls_out else wanted_m_s) - body.air_m_s, gain_m_s)
        body.yaw_deg_s = 0.0
        if not body.grounded:
            course_deg = self._course_deg(body, wish)
            _turn(body, _into_wind(course_deg, body.air_m_s, wind), self.turn_deg_s)
        # On the ground wheels hold it against the wind.
        blown = 0.0 if body.grounded else 1.0
        yaw = math.radians(body.yaw_deg)
        body.east_m_s = body.air_m_s * math.sin(yaw) + blown * wind.east_m_s
        body.north_m_s = body.air_m_s * math.cos(yaw) + blown * wind.north_m_s
        flies = not rolls_out and (not body.grounded or body.air_m_s >= self.lift_off_m_s)
        body.up_m_s += _within((self._upward(body, wish) if flies else 0.0) - body.up_m_s, 2 * gain_m_s)
        body.move(STEP_S)

    def _course_deg(self, body: Body, wish: Fly | Stay | Rise | Down) -> float:
        """Return the direction over the ground that is wished for."""
        if isinstance(wish, Rise):
            return body.yaw_deg
        if isinstance(wish, Fly):
            east_m, north_m = carrot(body, wish, self.look_ahead_s * self.cruise_m_s)
            return math.degrees(math.atan2(east_m - body.east_m, north_m - body.north_m))
        east_m, north_m = wish.east_m - body.east_m, wish.north_m - body.north_m
        away_m = math.hypot(east_m, north_m)
        towards_deg = math.degrees(math.atan2(east_m, north_m))
        if isinstance(wish, Down):
            return towards_deg if body.up_m >= self.flare_below_m else body.yaw_deg
        # Outside the circle turn towards it, inside away from it; on it fly along it, clockwise.
        return towards_deg - 90 + 60 * min(max((away_m - self.circle_m) / self.circle_m * 1.5, -1.0), 1.5)

    def _upward(self, body: Body, wish: Fly | Stay | Rise | Down) -> float:
        """Return the climb that is wished for."""
        if isinstance(wish, Down):
            away_m = math.hypot(wish.east_m - body.east_m, wish.north_m - body.north_m)
            if body.up_m < self.flare_below_m:
                return -self.flare_m_s
            return min(max(away_m * self.glide - body.up_m, -self.sink_m_s), 0.0)
        return min(max(0.8 * (wish.up_m - body.up_m), -self.sink_m_s), self.climb_m_s)


def carrot(body: Body, leg: Fly, ahead_m: float) -> tuple[float, float]:
    """Return the point of a leg's line that lies ahead of the body's foot on it, at most the leg's end."""
    east_m, north_m = leg.east_m - leg.start_m[0], leg.north_m - leg.start_m[1]
    length_m = math.hypot(east_m, north_m)
    if length_m < 1.0:
        return leg.east_m, leg.north_m
    part = ((body.east_m - leg.start_m[0]) * east_m + (body.north_m - leg.start_m[1]) * north_m) / length_m**2
    part = min(max(part, 0.0) + ahead_m / length_m, 1.0)
    return leg.start_m[0] + part * east_m, leg.start_m[1] + part * north_m


def _fall(body: Body) -> None:
    """Stand, or drop to where one stands."""
    body.yaw_deg_s = body.east_m_s = body.north_m_s = 0.0
    body.up_m_s = 0.0 if body.grounded else body.up_m_s - GRAVITY_M_S2 * STEP_S
    body.move(STEP_S)


def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


def _approach(body: Body, east_m_s: float, north_m_s: float, gain_m_s: float) -> None:
    """Change the velocity over the ground by no more than the gain."""
    east_gain_m_s, north_gain_m_s = east_m_s - body.east_m_s, north_m_s - body.north_m_s
    much_m_s = math.hypot(east_gain_m_s, north_gain_m_s)
    part = 1.0 if much_m_s <= gain_m_s else gain_m_s / much_m_s
    body.east_m_s += part * east_gain_m_s
    body.north_m_s += part * north_gain_m_s


def _turn(body: Body, wanted_deg: float, most_deg_s: float) -> None:
    """Turn the nose the short way round."""
    turn_deg = _within((wanted_deg - body.yaw_deg + 180) % 360 - 180, most_deg_s * STEP_S)
    body.yaw_deg = (body.yaw_deg + turn_deg) % 360
    body.yaw_deg_s = turn_deg / STEP_S


def _into_wind(course_deg: float, air_m_s: float, wind: Wind) -> float:
    """Return where the nose has to point for a course over the ground."""
    course = math.radians(course_deg)
    across_m_s = wind.east_m_s * math.cos(course) - wind.north_m_s * math.sin(course)
    return course_deg - math.degrees(math.asin(min(max(across_m_s / max(air_m_s, 1.0), -0.9), 0.9)))
