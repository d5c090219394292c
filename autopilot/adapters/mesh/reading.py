"""What every order is read with: ranges, ids and places. A breach raises Unreadable, which names the field."""

from __future__ import annotations

import re
from collections.abc import Callable

from autopilot.trust.verdict import Unreadable
from events.schema.common_pb2 import Place

Locate = Callable[[int, int, int], Place | None]
"""Latitude and longitude in 1e-7 degrees, altitude AMSL in millimetres; None while there is no origin."""

_UUID = re.compile("[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")
LATITUDE_E7_MAX = 900_000_000
LONGITUDE_E7_MAX = 1_800_000_000
ALTITUDE_DM_MIN, ALTITUDE_DM_MAX = -5_000, 200_000  # -500 m to 20 km AMSL: no ground lies outside


def require_range(name: str, value: int, lowest: int, highest: int) -> None:
    """Raise Unreadable for a number outside its range."""
    if not lowest <= value <= highest:
        raise Unreadable(f"{name}: {value} is outside {lowest} to {highest}")


def require_uuid(name: str, text: str) -> None:
    """Raise Unreadable for what is no UUID in its one spelling: the dedup key must not have two."""
    if not _UUID.fullmatch(text):
        raise Unreadable(f"{name}: is no UUID in lower case with hyphens")


def read_place(name: str, lat_e7: int, lon_e7: int, altitude_dm: int, locate: Locate) -> Place:
    """Return a place of the wire; bare before the origin, and the core refuses it as it refuses any order."""
    require_range(f"{name}.lat_e7", lat_e7, -LATITUDE_E7_MAX, LATITUDE_E7_MAX)
    require_range(f"{name}.lon_e7", lon_e7, -LONGITUDE_E7_MAX, LONGITUDE_E7_MAX)
    require_range(f"{name}.altitude_dm", altitude_dm, ALTITUDE_DM_MIN, ALTITUDE_DM_MAX)
    altitude_mm = altitude_dm * 100
    bare = Place(latitude_e7=lat_e7, longitude_e7=lon_e7, altitude_mm=altitude_mm)
    return locate(lat_e7, lon_e7, altitude_mm) or bare
