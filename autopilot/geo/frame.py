"""Places: WGS84 positions with everything the core needs to handle them in integers.

A place is quantised first (1e-7 degrees, millimetres) and everything else is computed from the
quantised position, so the same integers always give the same place. East and north come from an
azimuthal equidistant projection on WGS84 around the flight's origin: distance and direction from
the origin are exact; 50 km away from it other distances are off by about 1e-5.

The H3 cell is of resolution 10, whose edges are 66 m long on average (H3, table of cell
statistics). It is a key to store and exchange a place under, not a measure of distance.

This file does not know the ground: see `autopilot.geo.ground`.
"""

from __future__ import annotations

import math
import threading
from typing import cast

import mgrs
from h3.api import basic_int as h3
from pyproj import Geod

from events.schema.common_pb2 import Place

H3_RESOLUTION = 10
MGRS_DIGITS = 5  # 1 m

# PROJ's geodesics (Karney 2013): exact to nanometres, and a place must not cost an order its time.
_WGS84 = Geod(ellps="WGS84")
_UINT32_MAX = 2**32 - 1
_HALF_TURN_E7 = 1_800_000_000

# Releases of mgrs before 1.6 keep the zone in C globals and let other threads run meanwhile.
_mgrs = mgrs.MGRS()
_mgrs_lock = threading.Lock()


def offset(latitude_deg: float, longitude_deg: float, east_m: float, north_m: float) -> tuple[float, float]:
    """Return latitude and longitude in degrees of the point at this offset, along the geodesic that starts that way."""
    distance_m = math.hypot(east_m, north_m)
    bearing_deg = math.degrees(math.atan2(east_m, north_m))
    longitude_there_deg, latitude_there_deg, _ = _WGS84.fwd(longitude_deg, latitude_deg, bearing_deg, distance_m)
    return latitude_there_deg, longitude_there_deg


class LocalFrame:
    """The local frame of a flight: azimuthal equidistant on WGS84 around its origin.

    Raises `ValueError` where the origin, or a position given later, is not on the Earth: a
    latitude outside +-90 degrees, anything that is not finite, an altitude beyond 2,000 km.
    """

    def __init__(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> None:
        self._latitude_e7, self._longitude_e7, self.altitude_mm = _quantised(latitude_deg, longitude_deg, altitude_m)
        self.latitude_deg = self._latitude_e7 / 1e7
        self.longitude_deg = self._longitude_e7 / 1e7
        self.altitude_m = self.altitude_mm / 1000

    def place(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Place:
        """Return the place of a WGS84 position; `altitude_m` is above mean sea level."""
        return self.place_e7(*_quantised(latitude_deg, longitude_deg, altitude_m))

    def place_e7(self, latitude_e7: int, longitude_e7: int, altitude_mm: int) -> Place:
        """Return the place of a position that is already quantised (1e-7 degrees, mm above mean sea level)."""
        latitude_e7, longitude_e7, altitude_mm = _on_earth(latitude_e7, longitude_e7, altitude_mm)
        latitude_deg, longitude_deg = latitude_e7 / 1e7, longitude_e7 / 1e7
        east_m, north_m = self._east_north(latitude_deg, longitude_deg)
        return Place(
            latitude_e7=latitude_e7,
            longitude_e7=longitude_e7,
            altitude_mm=altitude_mm,
            h3_cell=h3.latlng_to_cell(latitude_deg, longitude_deg, H3_RESOLUTION),
            mgrs=_mgrs_of(latitude_deg, longitude_deg),
            east_mm=round(east_m * 1000),
            north_mm=round(north_m * 1000),
        )

    def from_east_north(self, east_m: float, north_m: float, altitude_m: float) -> Place:
        """Return the place at this offset from the origin; `altitude_m` is above mean sea level."""
        latitude_deg, longitude_deg = offset(self.latitude_deg, self.longitude_deg, east_m, north_m)
        return self.place(latitude_deg, longitude_deg, altitude_m)

    def _east_north(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Return metres east and north of the origin."""
        bearing_deg, _, distance_m = _WGS84.inv(self.longitude_deg, self.latitude_deg, longitude_deg, latitude_deg)
        bearing = math.radians(bearing_deg)
        return distance_m * math.sin(bearing), distance_m * math.cos(bearing)


class Origin:
    """Holds the frame once it is known; the node sets it, adapters on any thread read it."""

    def __init__(self) -> None:
        self.frame: LocalFrame | None = None

    def set(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Place:
        """Set the origin and return its place (0 mm east, 0 mm north). Raises `ValueError` as `LocalFrame` does."""
        frame = LocalFrame(latitude_deg, longitude_deg, altitude_m)
        self.frame = frame
        return frame.place(latitude_deg, longitude_deg, altitude_m)

    def place(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Place | None:
        """Return the place of a WGS84 position, or None before the origin is set."""
        frame = self.frame
        return None if frame is None else frame.place(latitude_deg, longitude_deg, altitude_m)

    def place_e7(self, latitude_e7: int, longitude_e7: int, altitude_mm: int) -> Place | None:
        """Return the place of a quantised position, or None before the origin is set."""
        frame = self.frame
        return None if frame is None else frame.place_e7(latitude_e7, longitude_e7, altitude_mm)


def with_error(place: Place, sigma_major_m: float, sigma_minor_m: float, bearing_deg: float) -> Place:
    """Write the one-sigma error ellipse into a place that is still being built, and return it.

    Axes above the field's 4,295 km are cut there; the bearing is that of an axis, 0 to 180 degrees.
    """
    place.error_major_mm = min(round(sigma_major_m * 1000), _UINT32_MAX)
    place.error_minor_mm = min(round(sigma_minor_m * 1000), _UINT32_MAX)
    place.error_bearing_cdeg = round(bearing_deg * 100) % 18_000
    return place


def _quantised(latitude_deg: float, longitude_deg: float, altitude_m: float) -> tuple[int, int, int]:
    """Return 1e-7 degrees and millimetres; raise `ValueError` for what is not on the Earth."""
    if not (math.isfinite(latitude_deg) and math.isfinite(longitude_deg) and math.isfinite(altitude_m)):
        raise ValueError(f"position {latitude_deg}, {longitude_deg}, {altitude_m} is not finite")
    return _on_earth(round(latitude_deg * 1e7), round(longitude_deg * 1e7), round(altitude_m * 1000))


def _on_earth(latitude_e7: int, longitude_e7: int, altitude_mm: int) -> tuple[int, int, int]:
    """Return the position with its longitude within [-180, 180) degrees; raise `ValueError` otherwise out of range."""
    if abs(latitude_e7) > _HALF_TURN_E7 // 2:
        raise ValueError(f"latitude {latitude_e7 / 1e7} degrees is outside +-90")
    if abs(altitude_mm) > 2_000_000_000:
        raise ValueError(f"altitude {altitude_mm / 1000} m is outside +-2,000 km")
    longitude_e7 = (longitude_e7 + _HALF_TURN_E7) % (2 * _HALF_TURN_E7) - _HALF_TURN_E7
    return latitude_e7, longitude_e7, altitude_mm


def _mgrs_of(latitude_deg: float, longitude_deg: float) -> str:
    """Return the MGRS string at 1 m."""
    with _mgrs_lock:
        return cast(str, _mgrs.toMGRS(latitude_deg, longitude_deg, MGRSPrecision=MGRS_DIGITS))
