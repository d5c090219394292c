"""The local frame: known places, the projection against the geodesic, H3 and MGRS, the bounds of the Earth."""

import math

import pytest
from geographiclib.geodesic import Geodesic
from h3.api import basic_int as h3
from hypothesis import given
from hypothesis import strategies as st

from autopilot.geo import LocalFrame, Origin, offset, with_error
from events.schema.common_pb2 import Place

ZURICH = LocalFrame(47.3977, 8.5456, 488.0)


def check_place(place: Place, east_m: float, north_m: float, within_m: float) -> None:
    """Say that a place lies at this offset from its frame's origin."""
    assert place.east_mm / 1000 == pytest.approx(east_m, abs=within_m)
    assert place.north_mm / 1000 == pytest.approx(north_m, abs=within_m)


@pytest.mark.parametrize(
    ("latitude_deg", "longitude_deg", "mgrs"),
    [
        (0.0, 0.0, "31NAA6602100000"),
        (42.0, -93.0, "15TWG0000049776"),  # on a central meridian the northing is 0.9996 of the meridian's arc
        (-42.0, -93.0, "15GWP0000050223"),
        (38.8977, -77.0365, "18SUJ2339407395"),
    ],
)
def test_mgrs_of_known_places(latitude_deg: float, longitude_deg: float, mgrs: str) -> None:
    """The string at 1 m, also south of the equator and on a central meridian."""
    assert ZURICH.place(latitude_deg, longitude_deg, 0).mgrs == mgrs


def test_mgrs_zone_that_norway_widened() -> None:
    """Bergen lies in 32V, though its longitude would be zone 31's."""
    assert ZURICH.place(60.39, 5.32, 0).mgrs.startswith("32VK")


def test_h3_cell_is_of_resolution_10_and_holds_the_place() -> None:
    """The cell's centre is nearer than the longest edge, and the integer is a real index."""
    place = ZURICH.place(47.4, 8.55, 500)
    assert h3.get_resolution(place.h3_cell) == 10
    assert h3.is_valid_cell(place.h3_cell)
    centre = h3.cell_to_latlng(place.h3_cell)
    assert h3.great_circle_distance(centre, (47.4, 8.55), unit="m") < 90


def test_a_degree_of_latitude_and_longitude_at_the_equator() -> None:
    """110.574 km and 111.320 km: the lengths of a degree that every table of WGS84 has."""
    frame = LocalFrame(0, 0, 0)
    check_place(frame.place(1, 0, 0), 0, 110_574.4, within_m=0.1)
    check_place(frame.place(0, 1, 0), 111_319.5, 0, within_m=0.1)


def test_quantised_first_so_equal_integers_make_equal_places() -> None:
    """A position in floats and the same one in 1e-7 degrees give one place, field by field."""
    place = ZURICH.place(47.39771234, 8.54561234, 488.1234)
    assert place == ZURICH.place_e7(473977123, 85456123, 488123)
    assert (place.latitude_e7, place.longitude_e7, place.altitude_mm) == (473977123, 85456123, 488123)


def test_longitude_wraps_and_the_date_line_is_no_wall() -> None:
    """180 degrees is -180, and 0.1 degree across the date line is as long as anywhere."""
    frame = LocalFrame(0, 179.95, 0)
    assert frame.place(0, 180, 0).longitude_e7 == -1_800_000_000
    check_place(frame.place(0, -179.95, 0), 11_131.95, 0, within_m=0.1)


@given(
    st.floats(-85, 85),
    st.floats(-180, 179.99),
    st.floats(-50_000, 50_000),
    st.floats(-50_000, 50_000),
)
def test_east_north_round_trip(latitude_deg: float, longitude_deg: float, east_m: float, north_m: float) -> None:
    """The place at an offset has that offset, to the 1e-7 degrees in which it is kept."""
    check_place(LocalFrame(latitude_deg, longitude_deg, 0).from_east_north(east_m, north_m, 0), east_m, north_m, 0.012)


@given(st.floats(-89, 89), st.floats(-180, 180), st.floats(-5000, 5000), st.floats(-5000, 5000))
def test_offset_goes_as_far_as_it_is_told(
    latitude_deg: float, longitude_deg: float, east_m: float, north_m: float
) -> None:
    """The geodesic back to the start is as long as the offset."""
    end = offset(latitude_deg, longitude_deg, east_m, north_m)
    back = Geodesic.WGS84.Inverse(*end, latitude_deg, longitude_deg)
    assert back["s12"] == pytest.approx(math.hypot(east_m, north_m), abs=1e-6)


@pytest.mark.parametrize(
    ("position", "words"),
    [
        ((91, 0, 0), "latitude"),
        ((-90.1, 0, 0), "latitude"),
        ((math.nan, 0, 0), "not finite"),
        ((0, math.inf, 0), "not finite"),
        ((0, 0, math.nan), "not finite"),
        ((0, 0, 2.1e6), "altitude"),
    ],
)
def test_what_is_not_on_the_earth_is_refused(position: tuple[float, float, float], words: str) -> None:
    """Neither a place nor an origin is made of it."""
    for made in (LocalFrame, ZURICH.place, Origin().set):
        with pytest.raises(ValueError, match=words):
            made(*position)


def test_origin_has_no_places_before_it_is_set() -> None:
    """None first; then its own place is the zero of the frame."""
    origin = Origin()
    assert origin.place(47, 8, 0) is None
    assert origin.place_e7(470000000, 80000000, 0) is None
    check_place(origin.set(47, 8, 400), 0, 0, within_m=0)
    assert origin.frame is not None
    assert origin.place(47.001, 8, 400) == origin.frame.place_e7(470010000, 80000000, 400000)
    assert origin.place_e7(470010000, 80000000, 400000) == origin.place(47.001, 8, 400)


def test_error_ellipse_is_written_in_millimetres_and_as_an_axis() -> None:
    """180 degrees is the same axis as 0; what does not fit the field is cut."""
    place = with_error(ZURICH.place(47.4, 8.5, 0), 12.3456, 2.0, 179.999)
    assert (place.error_major_mm, place.error_minor_mm, place.error_bearing_cdeg) == (12346, 2000, 0)
    assert with_error(Place(), 1e9, 1, 91.5).error_major_mm == 2**32 - 1
    assert not ZURICH.place(47.4, 8.5, 0).HasField("error_major_mm")
