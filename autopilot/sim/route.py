"""The aircraft's own route: up, once around a circle that begins and ends at home, down. A pure function of time.

All of it scales with the seconds that it may take, so a flight of 15 s is a small one. The circle's
bearing comes from the seed. Nothing here knows MAVLink, a gimbal or a clock.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

STABILIZE, AUTO, RTL = 0, 3, 6  # custom_mode of ArduCopter

ARM, TAKE_OFF, AT_HEIGHT, BACK, DOWN, DISARM = 0.04, 0.06, 0.17, 0.80, 0.93, 0.95  # parts of the whole time
SHORTEST_S = 15.0
CLIMB_M_S = 4.0
HEIGHT_M = (6.0, 30.0)
SPEED_M_S = 4.0  # mean on the circle; 1.5 times that at its fastest
RADIUS_MAX_M = 40.0
_STEP_S = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """The aircraft at a moment; metres from home, metres and degrees a second."""

    east_m: float
    north_m: float
    up_m: float
    yaw_deg: float  # from north, clockwise, 0 to 360
    east_m_s: float
    north_m_s: float
    up_m_s: float
    yaw_deg_s: float
    armed: bool
    mode: int  # custom_mode


class Route:
    """A flight of `seconds` (at least 15); raises ValueError for a shorter one."""

    def __init__(self, seed: int, seconds: float) -> None:
        if seconds < SHORTEST_S:
            raise ValueError(f"a flight takes at least {SHORTEST_S:g} s, not {seconds:g}")
        self.seconds = seconds
        self.bearing_deg = random.Random(f"route {seed}").uniform(0, 360)
        self.height_m = min(max(CLIMB_M_S * (AT_HEIGHT - TAKE_OFF) * seconds, HEIGHT_M[0]), HEIGHT_M[1])
        self.radius_m = min(SPEED_M_S * (BACK - AT_HEIGHT) * seconds / math.tau, RADIUS_MAX_M)
        self.centre_m = _point(self.bearing_deg, self.radius_m)

    def at(self, seconds: float) -> Motion:
        """Return the aircraft `seconds` after the start; before it stands, after it has landed it stands."""
        east_m, north_m, up_m, heading_deg = self._pose(seconds)
        later = self._pose(seconds + _STEP_S)
        part = seconds / self.seconds
        return Motion(
            east_m=east_m,
            north_m=north_m,
            up_m=up_m,
            yaw_deg=heading_deg % 360,
            east_m_s=(later[0] - east_m) / _STEP_S,
            north_m_s=(later[1] - north_m) / _STEP_S,
            up_m_s=(later[2] - up_m) / _STEP_S,
            yaw_deg_s=(later[3] - heading_deg) / _STEP_S,
            armed=ARM <= part < DISARM,
            mode=self._mode(part),
        )

    def _mode(self, part: float) -> int:
        if not ARM <= part < DISARM:
            return STABILIZE
        return AUTO if part < BACK else RTL

    def _pose(self, seconds: float) -> tuple[float, float, float, float]:
        """Return east, north, up (m) and the heading, which is not wrapped."""
        part = seconds / self.seconds
        up_m = self.height_m * (_eased(part, TAKE_OFF, AT_HEIGHT) - _eased(part, BACK, DOWN))
        from_centre_deg = self.bearing_deg + 180 + 360 * _eased(part, AT_HEIGHT, BACK)
        east_m, north_m = _point(from_centre_deg, self.radius_m)
        return self.centre_m[0] + east_m, self.centre_m[1] + north_m, up_m, from_centre_deg + 90


def _eased(part: float, begin: float, end: float) -> float:
    """Return how much of the way from begin to end is done, with a soft start and stop."""
    x = min(max((part - begin) / (end - begin), 0.0), 1.0)
    return x * x * (3 - 2 * x)


def _point(bearing_deg: float, distance_m: float) -> tuple[float, float]:
    bearing = math.radians(bearing_deg)
    return distance_m * math.sin(bearing), distance_m * math.cos(bearing)
