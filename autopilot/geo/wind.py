"""The wind triangle: how a heading, the wind and the speed through the air add up.

Headings and tracks are degrees from true north, clockwise; the wind is named by where it comes from, as pilots do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Wind:
    """A steady wind."""

    from_deg: float = 0.0  # where it comes from
    speed_mps: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class OnTrack:
    """How a track is flown in a wind."""

    ground_speed_mps: float
    crab_deg: float  # the nose points this far to the right of the track


def on_track(track_deg: float, airspeed_mps: float, wind: Wind) -> OnTrack | None:
    """Return how an aircraft that holds its airspeed flies this track; None where the wind is too strong for it."""
    angle = math.radians(wind.from_deg - track_deg)
    head_mps, from_right_mps = wind.speed_mps * math.cos(angle), wind.speed_mps * math.sin(angle)
    if abs(from_right_mps) >= airspeed_mps:
        return None
    ahead_mps = math.sqrt(airspeed_mps**2 - from_right_mps**2) - head_mps
    if ahead_mps <= 0:
        return None
    return OnTrack(ground_speed_mps=ahead_mps, crab_deg=math.degrees(math.asin(from_right_mps / airspeed_mps)))
