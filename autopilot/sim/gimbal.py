"""A three-axis gimbal that takes time to move: no more than `rate_deg_s` on each axis.

Angles are of the mount: pitch to the horizon, up positive; yaw from the vehicle's nose, clockwise.
It turns the short way round and reports where it is, not where it is to go. Roll stays level. Who controls it is
kept as the manager keeps it: `take_over` is another station that takes it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from autopilot.sim.route import Motion

PITCH_DEG = (-90.0, 20.0)  # what ArduPilot's servo mount has as limits
REST_PITCH_DEG = -35.0  # where it goes when a place is released and nobody steers


def wrapped(angle_deg: float) -> float:
    """Return the angle within -180 (included) to 180 degrees."""
    return (angle_deg + 180) % 360 - 180


@dataclass(frozen=True, slots=True)
class Angles:
    """Look in a direction; out of range is clamped without a word, as the real one does."""

    pitch_deg: float
    yaw_deg: float
    from_north: bool


@dataclass(frozen=True, slots=True)
class Spot:
    """Look at a point, metres from home."""

    east_m: float
    north_m: float
    up_m: float


REST = Angles(REST_PITCH_DEG, 0.0, False)


@dataclass(slots=True)
class Gimbal:
    """Edit it as you like: `gimbal.rate_deg_s = 10`."""

    rate_deg_s: float = 60.0
    pitch_deg: float = REST_PITCH_DEG
    yaw_deg: float = 0.0
    aim: Angles | Spot = REST
    pans: bool = True  # False: a mount with two axes, whose yaw stays ahead
    primary: tuple[int, int] = (0, 0)  # system and component that control it; 0/0: nobody

    def step(self, dt_s: float, motion: Motion) -> None:
        """Move for a time towards what it is aimed at, from where the aircraft is."""
        pitch_deg, yaw_deg = self.wanted(motion)
        reach_deg = self.rate_deg_s * dt_s
        self.pitch_deg += min(max(pitch_deg - self.pitch_deg, -reach_deg), reach_deg)
        self.yaw_deg = wrapped(self.yaw_deg + min(max(wrapped(yaw_deg - self.yaw_deg), -reach_deg), reach_deg))

    def wanted(self, motion: Motion) -> tuple[float, float]:
        """Return pitch and yaw (from the nose) that fulfil the aim, within the limits."""
        if isinstance(self.aim, Spot):
            east_m, north_m = self.aim.east_m - motion.east_m, self.aim.north_m - motion.north_m
            pitch_deg = math.degrees(math.atan2(self.aim.up_m - motion.up_m, math.hypot(east_m, north_m)))
            yaw_deg = math.degrees(math.atan2(east_m, north_m)) - motion.yaw_deg
        else:
            pitch_deg = self.aim.pitch_deg
            yaw_deg = self.aim.yaw_deg - (motion.yaw_deg if self.aim.from_north else 0.0)
        return min(max(pitch_deg, PITCH_DEG[0]), PITCH_DEG[1]), wrapped(yaw_deg) if self.pans else 0.0

    def take_over(self, system: int, component: int, aim: Angles | Spot) -> None:
        """Let another station take control and look elsewhere."""
        self.primary, self.aim = (system, component), aim

    def configure(self, primary: tuple[int, int], sender: tuple[int, int]) -> None:
        """Change who controls it, with the numbers of MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE.

        -1 leaves it, -2 is the sender, -3 gives up the sender's own, 0 is nobody.
        """
        mine = self.primary == sender
        if -1 in primary or (-3 in primary and not mine):
            return
        self.primary = sender if -2 in primary else (0, 0) if -3 in primary else primary

    def release(self) -> None:
        """Let go of a spot; an angle that was asked for stays."""
        if isinstance(self.aim, Spot):
            self.aim = REST
