"""What every reader of a message asks of its numbers: that they are finite, in range, and on the Earth.

`Unfit` carries the name of a rejection out of a reader; `ingress` turns it into a value.
"""

from __future__ import annotations

import math

LATITUDE_MAX_E7 = 900_000_000
LONGITUDE_MAX_E7 = 1_800_000_000
ALTITUDE_MM = range(-1_000_000, 100_000_001)  # below the Dead Sea, above any aircraft


class Unfit(Exception):
    """Carries the name of a rejection out of a reader."""


def finite(*values: float) -> None:
    """Raise Unfit where a value is no number."""
    if not all(math.isfinite(value) for value in values):
        raise Unfit("not finite")


def within(holds: bool) -> None:
    """Raise Unfit where a range does not hold."""
    if not holds:
        raise Unfit("out of range")


def on_earth(latitude_e7: int, longitude_e7: int, *altitudes_mm: int) -> None:
    """Raise Unfit for no place: zero in both means that the autopilot does not know; no vehicle ever flies there."""
    if latitude_e7 == 0 and longitude_e7 == 0:
        raise Unfit("no position")
    within(abs(latitude_e7) <= LATITUDE_MAX_E7 and abs(longitude_e7) <= LONGITUDE_MAX_E7)
    within(all(altitude in ALTITUDE_MM for altitude in altitudes_mm))
