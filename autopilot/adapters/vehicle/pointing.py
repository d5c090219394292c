"""Directions of view: from a quaternion, to a place, and the angle between two.

Angles are degrees, pitch up positive, yaw clockwise. The direction to a place is taken on the
tangent plane at the vehicle, with WGS84's radii of curvature and the drop of the Earth's curve;
against the exact geodesic it is off by less than 0.01 degrees within 10 km. Altitudes are above
mean sea level at both ends, so the geoid cancels. Nothing here knows a link.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

_WGS84_A_M = 6_378_137.0
_WGS84_E2 = 0.006_694_379_990_14
_STEEP = 0.1  # length of the horizontal part of the view under which yaw is read off the right axis


@dataclass(frozen=True, slots=True)
class Direction:
    """Where something looks: pitch to the horizon, up positive; yaw from north, clockwise. Degrees."""

    pitch_deg: float
    yaw_deg: float


def wrapped(angle_deg: float) -> float:
    """Return the angle within -180 (included) to 180 degrees."""
    return (angle_deg + 180) % 360 - 180


def forward_and_right(w: float, x: float, y: float, z: float) -> tuple[float, float]:
    """Return pitch and yaw in degrees of the view that a quaternion (w, x, y, z; x ahead, y right, z down) gives.

    Straight down, where the view has no yaw, yaw is that of the image's right edge less 90
    degrees: a mount that keeps its roll level holds that edge level.
    """
    norm = w * w + x * x + y * y + z * z
    ahead = ((w * w + x * x - y * y - z * z) / norm, 2 * (x * y + w * z) / norm, 2 * (x * z - w * y) / norm)
    right = (2 * (x * y - w * z) / norm, (w * w - x * x + y * y - z * z) / norm)
    pitch_deg = math.degrees(math.asin(max(-1.0, min(1.0, -ahead[2]))))
    if math.hypot(ahead[0], ahead[1]) > _STEEP:
        return pitch_deg, math.degrees(math.atan2(ahead[1], ahead[0]))
    return pitch_deg, math.degrees(math.atan2(-right[0], right[1]))


def direction_to(
    from_: tuple[float, float, float],
    to: tuple[float, float, float],
) -> Direction:
    """Return the direction from one position to another, each latitude, longitude (degrees), altitude (m AMSL)."""
    latitude_rad = math.radians((from_[0] + to[0]) / 2)
    w = 1 - _WGS84_E2 * math.sin(latitude_rad) ** 2
    across_m = _WGS84_A_M / math.sqrt(w)
    along_m = across_m * (1 - _WGS84_E2) / w
    north_m = math.radians(to[0] - from_[0]) * (along_m + from_[2])
    east_m = math.radians(wrapped(to[1] - from_[1])) * (across_m + from_[2]) * math.cos(latitude_rad)
    distance_m = math.hypot(north_m, east_m)
    up_m = to[2] - from_[2] - distance_m**2 / (2 * _WGS84_A_M)
    return Direction(math.degrees(math.atan2(up_m, distance_m)), math.degrees(math.atan2(east_m, north_m)))


def angle_between(one: Direction, other: Direction) -> float:
    """Return the angle between two directions in degrees, 0 to 180; exact also for small ones."""
    a, b = _unit(one), _unit(other)
    chord = math.dist(a, b)
    return math.degrees(2 * math.asin(min(1.0, chord / 2)))


def _unit(direction: Direction) -> tuple[float, float, float]:
    pitch, yaw = math.radians(direction.pitch_deg), math.radians(direction.yaw_deg)
    return math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), math.sin(pitch)
