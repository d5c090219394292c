"""The flat ground: cases that can be drawn on paper, the horizon, and the way there and back."""

import math
from dataclasses import dataclass

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from autopilot.geo import GroundPoint, NoPlace, ground_point, image_point, standing_point


@dataclass(frozen=True)
class Camera:
    """A view for tests."""

    height_m: float = 50.0
    camera_yaw_deg: float = 0.0
    camera_pitch_deg: float = -45.0
    camera_roll_deg: float = 0.0


def seen(camera: Camera, x: float, y: float, range_max_m: float = 2000) -> GroundPoint | NoPlace:
    """Project with a lens of 90 degrees and 2:1, whose tangents are 1 and 1/2."""
    return ground_point(camera, x, y, 90, 1000, 500, range_max_m)


def check_ground(camera: Camera, x: float, y: float, east_m: float, north_m: float) -> None:
    """Say where a point of the image lies, both ways."""
    point = seen(camera, x, y)
    assert isinstance(point, GroundPoint)
    assert point.east_m == pytest.approx(east_m, abs=1e-6)
    assert point.north_m == pytest.approx(north_m, abs=1e-6)
    assert image_point(camera, east_m, north_m, 90, 1000, 500) == pytest.approx((x, y), abs=1e-9)


def test_the_middle_of_an_oblique_view() -> None:
    """At 45 degrees down the middle is as far away as the camera is high, in the direction of view."""
    check_ground(Camera(), 0.5, 0.5, 0, 50)
    check_ground(Camera(camera_yaw_deg=90), 0.5, 0.5, 50, 0)
    check_ground(Camera(camera_yaw_deg=-135), 0.5, 0.5, -50 * math.sqrt(0.5), -50 * math.sqrt(0.5))


def test_edges_of_the_image() -> None:
    """Straight down the edges lie a tangent away; north is up, east is right."""
    down = Camera(camera_pitch_deg=-90)
    check_ground(down, 1, 0.5, 50, 0)
    check_ground(down, 0.5, 0, 0, 25)
    check_ground(Camera(camera_pitch_deg=-90, camera_yaw_deg=90), 0.5, 0, 25, 0)
    check_ground(Camera(), 0.5, 1, 0, 50 * math.tan(math.radians(45) - math.atan(0.5)))


def test_roll_lowers_the_right_side() -> None:
    """Rolled by 90 degrees the image's right points down: what stood right is below."""
    check_ground(Camera(camera_pitch_deg=0, camera_roll_deg=90), 1, 0.5, 0, 50)
    check_ground(Camera(camera_pitch_deg=-90, camera_roll_deg=90), 1, 0.5, 0, -50)


@pytest.mark.parametrize(
    ("camera", "y", "because"),
    [
        (Camera(camera_pitch_deg=0), 0.5, "above the horizon"),
        (Camera(camera_pitch_deg=0), 0.2, "above the horizon"),
        (Camera(camera_pitch_deg=30), 0.5, "above the horizon"),
        (Camera(height_m=0), 0.5, "above the horizon"),
        (Camera(height_m=-3), 0.5, "above the horizon"),
        (Camera(camera_pitch_deg=-1), 0.5, "too far"),
    ],
)
def test_no_place_and_why(camera: Camera, y: float, because: str) -> None:
    """Sky has no place, nor has ground beyond the range."""
    assert seen(camera, 0.5, y) == NoPlace(because)  # type: ignore[arg-type]


def test_range_counts_from_the_foot() -> None:
    """50 m away is within 50.1 m and not within 49.9 m."""
    assert isinstance(seen(Camera(), 0.5, 0.5, range_max_m=50.1), GroundPoint)
    assert seen(Camera(), 0.5, 0.5, range_max_m=49.9) == NoPlace("too far")


def test_behind_the_camera_there_is_no_image() -> None:
    """A point south of a camera that looks north is not in its image, however far the plane goes."""
    assert image_point(Camera(camera_pitch_deg=-10), 0, -500, 90, 1000, 500) is None


def test_a_head_is_above_its_feet() -> None:
    """Something tall is drawn upward from where it stands, and not sideways."""
    foot = image_point(Camera(), 0, 60, 90, 1000, 500)
    head = image_point(Camera(), 0, 60, 90, 1000, 500, above_ground_m=1.8)
    assert foot is not None
    assert head is not None
    assert head[0] == pytest.approx(foot[0])
    assert head[1] < foot[1]


@given(
    st.floats(1, 1000),
    st.floats(-180, 360),
    st.floats(-90, 20),
    st.floats(-40, 40),
    st.floats(0, 1),
    st.floats(0, 1),
    st.floats(5, 120),
)
def test_there_and_back(height_m: float, yaw: float, pitch: float, roll: float, x: float, y: float, fov: float) -> None:
    """Every point of the ground is drawn where it was seen."""
    camera = Camera(height_m, yaw, pitch, roll)
    point = ground_point(camera, x, y, fov, 1920, 1080, 1e5)
    assume(isinstance(point, GroundPoint))
    assert isinstance(point, GroundPoint)
    back = image_point(camera, point.east_m, point.north_m, fov, 1920, 1080)
    assert back == pytest.approx((x, y), abs=1e-6)


def test_error_ellipse_straight_down() -> None:
    """Straight below, both axes are attitude times height beside the position's own error."""
    point = seen(Camera(camera_pitch_deg=-90), 0.5, 0.5)
    assert isinstance(point, GroundPoint)
    expected = math.hypot(50 * math.radians(1), 2)
    assert (point.sigma_major_m, point.sigma_minor_m) == pytest.approx((expected, expected))


@given(st.floats(2, 500), st.floats(-80, -3), st.floats(0, 360))
def test_error_ellipse_against_differences(height_m: float, pitch: float, yaw: float) -> None:
    """The closed form is what turning and lifting the camera a little gives."""
    small = 1e-5

    def middle(tilt_deg: float = 0, lift_m: float = 0, aside: float = 0) -> GroundPoint:
        camera = Camera(height_m + lift_m, yaw, pitch + tilt_deg)
        point = ground_point(camera, 0.5 + aside, 0.5, 90, 1000, 500, 1e9)
        assert isinstance(point, GroundPoint)
        return point

    here = middle()

    def moved(other: GroundPoint) -> float:
        return math.hypot(other.east_m - here.east_m, other.north_m - here.north_m)

    along_attitude = moved(middle(tilt_deg=small)) / small
    along_height = moved(middle(lift_m=small)) / small * 2
    across_attitude = moved(middle(aside=small)) / (2 * small) * math.radians(1)
    assert here.sigma_major_m == pytest.approx(math.hypot(along_attitude, along_height, 2), rel=1e-3)
    assert here.sigma_minor_m == pytest.approx(math.hypot(across_attitude, 2), rel=1e-3)
    axis_off = (here.bearing_deg - yaw + 90) % 180 - 90
    assert axis_off == pytest.approx(0, abs=1e-6)


def test_where_a_box_stands() -> None:
    """On its lower edge, or around its centre when seen from above."""
    assert standing_point(0.2, 0.4, 0.4, 0.8, -22) == pytest.approx((0.3, 0.8))
    assert standing_point(0.2, 0.4, 0.4, 0.8, -74.9) == pytest.approx((0.3, 0.8))
    assert standing_point(0.2, 0.4, 0.4, 0.8, -75) == pytest.approx((0.3, 0.6))
