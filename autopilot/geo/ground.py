"""A camera over flat ground: from a point in the image to a point on the ground, and back.

A pinhole camera with square pixels and no distortion looks at a horizontal plane that lies
`height_m` below it. Image coordinates are normalised: x from 0 (left) to 1 (right), y from 0
(top) to 1 (bottom). The camera is turned by yaw (from north, clockwise), then pitch (up
positive), then roll (right side down positive), the order of MAVLink's attitudes.

The error ellipse is of first order and rests on three stated standard deviations: 1 degree of
attitude about any axis, 2 m of height (a hill counts here), 2 m of horizontal position. With
d the distance from the camera's foot, h the height and r the slant distance:

    along the line of sight    (r^2/h * attitude)^2 + (d/h * height)^2 + position^2
    across it                  (r * attitude)^2 + position^2

so the major axis always lies along the line of sight, and is long where the view is flat.
There is no terrain and no lens model here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Protocol

ATTITUDE_SIGMA_RAD = math.radians(1.0)
HEIGHT_SIGMA_M = 2.0
POSITION_SIGMA_M = 2.0

STEEP_PITCH_DEG = -75.0  # from here down a box shows its thing from above

_LEVEL = 1e-9  # a unit ray that sinks less than this meets the ground beyond the Earth's rim


class View(Protocol):
    """What of a camera's pose matters to the flat ground; `ports.edges.Pose` has it."""

    @property
    def height_m(self) -> float:
        """Height above the flat ground in metres."""

    @property
    def camera_yaw_deg(self) -> float:
        """Direction of view from true north, clockwise, in degrees."""

    @property
    def camera_pitch_deg(self) -> float:
        """Elevation of the view in degrees, up positive."""

    @property
    def camera_roll_deg(self) -> float:
        """Turn about the line of view in degrees, right side down positive."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundPoint:
    """A point on the ground, relative to the point straight below the camera."""

    east_m: float
    north_m: float
    sigma_major_m: float  # one-sigma error ellipse
    sigma_minor_m: float
    bearing_deg: float  # of the major axis, from north clockwise, 0 to 180


@dataclass(frozen=True, slots=True)
class NoPlace:
    """A point in the image that has no point on the ground, and why."""

    because: Literal["above the horizon", "too far"]


def ground_point(
    view: View,
    x_norm: float,
    y_norm: float,
    horizontal_fov_deg: float,
    width_px: int,
    height_px: int,
    range_max_m: float,
) -> GroundPoint | NoPlace:
    """Return where the line of sight through a point of the image meets the ground.

    `range_max_m` is the largest horizontal distance from the camera's foot. A camera on or
    below the ground sees no ground: "above the horizon".
    """
    right, down = _tangents(horizontal_fov_deg, width_px, height_px)
    ray = (1.0, (2 * x_norm - 1) * right, (2 * y_norm - 1) * down)
    length = math.hypot(*ray)
    north, east, sink = (
        sum(axis[i] * part for axis, part in zip(_axes(view), ray, strict=True)) / length for i in range(3)
    )
    if sink <= _LEVEL or view.height_m <= 0:
        return NoPlace("above the horizon")
    north_m, east_m = north / sink * view.height_m, east / sink * view.height_m
    if math.hypot(north_m, east_m) > range_max_m:
        return NoPlace("too far")
    return _with_ellipse(east_m, north_m, view.height_m)


def image_point(
    view: View,
    east_m: float,
    north_m: float,
    horizontal_fov_deg: float,
    width_px: int,
    height_px: int,
    above_ground_m: float = 0.0,
) -> tuple[float, float] | None:
    """Return normalised image coordinates of a point relative to the camera's foot: `ground_point` backwards.

    The result may lie outside the image (below 0 or above 1). None: the point is behind the camera.
    """
    to_point = (north_m, east_m, view.height_m - above_ground_m)
    forward, rightward, downward = (sum(axis[i] * to_point[i] for i in range(3)) for axis in _axes(view))
    if forward <= 0:
        return None
    right, down = _tangents(horizontal_fov_deg, width_px, height_px)
    return (rightward / forward / right + 1) / 2, (downward / forward / down + 1) / 2


def standing_point(
    x_min: float, y_min: float, x_max: float, y_max: float, camera_pitch_deg: float
) -> tuple[float, float]:
    """Return the point of a box (in the box's own units) that touches the ground.

    Seen obliquely a thing stands on its lower edge; within 15 degrees of straight down the
    box lies around it, and its centre is nearer the truth.
    """
    x_mid = (x_min + x_max) / 2
    if camera_pitch_deg <= STEEP_PITCH_DEG:
        return x_mid, (y_min + y_max) / 2
    return x_mid, y_max


def _tangents(horizontal_fov_deg: float, width_px: int, height_px: int) -> tuple[float, float]:
    """Return the tangents of half the horizontal and half the vertical field of view (square pixels)."""
    right = math.tan(math.radians(horizontal_fov_deg) / 2)
    return right, right * height_px / width_px


def _axes(view: View) -> tuple[tuple[float, float, float], ...]:
    """Return the camera's forward, right and down axes as unit vectors in north, east, down."""
    yaw, pitch = math.radians(view.camera_yaw_deg), math.radians(view.camera_pitch_deg)
    roll = math.radians(view.camera_roll_deg)
    sy, cy, sp, cp, sr, cr = (
        math.sin(yaw),
        math.cos(yaw),
        math.sin(pitch),
        math.cos(pitch),
        math.sin(roll),
        math.cos(roll),
    )
    return (
        (cp * cy, cp * sy, -sp),
        (sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp),
        (cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp),
    )


def _with_ellipse(east_m: float, north_m: float, height_m: float) -> GroundPoint:
    """Return the point with the error ellipse that the file's docstring derives."""
    distance_m = math.hypot(east_m, north_m)
    slant_m = math.hypot(distance_m, height_m)
    major_m = math.hypot(
        slant_m * slant_m / height_m * ATTITUDE_SIGMA_RAD, distance_m / height_m * HEIGHT_SIGMA_M, POSITION_SIGMA_M
    )
    return GroundPoint(
        east_m=east_m,
        north_m=north_m,
        sigma_major_m=major_m,
        sigma_minor_m=math.hypot(slant_m * ATTITUDE_SIGMA_RAD, POSITION_SIGMA_M),
        bearing_deg=math.degrees(math.atan2(east_m, north_m)) % 180,
    )
