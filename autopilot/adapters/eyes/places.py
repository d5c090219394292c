"""Gives detections their places: the node's side of the eyes, between a judged batch and the record.

The pose is the vehicle's at the moment of capture, or a fixed one. A detection without a place
keeps the reason instead. Classes in no group are left out: nobody asked about them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from autopilot.geo import GroundPoint, NoPlace, Origin, ground_point, offset, standing_point, with_error
from autopilot.geo.ground import STEEP_PITCH_DEG
from autopilot.ports.config import EyesSection, FixedPose
from autopilot.ports.edges import Pose, PoseSource
from autopilot.wire.detections_pb2 import BoxDetection, DetectionBatch
from events.schema.common_pb2 import Place
from events.schema.eyes_pb2 import Detection, FrameObserved

NO_POSITION = "no position"
NO_ATTITUDE = "no attitude"
_UINT32_MAX = 2**32 - 1


class FixedPoseSource:
    """The pose of a camera that stands still; a `PoseSource`."""

    def __init__(self, fixed: FixedPose) -> None:
        self._fixed = fixed

    def pose_at(self, mono_ns: int) -> Pose:
        """Return the same pose at any time."""
        return Pose(
            mono_ns=mono_ns,
            latitude_deg=self._fixed.latitude_deg,
            longitude_deg=self._fixed.longitude_deg,
            altitude_m=self._fixed.altitude_m,
            height_m=self._fixed.height_m,
            camera_yaw_deg=self._fixed.yaw_deg,
            camera_pitch_deg=self._fixed.pitch_deg,
        )


class Places:
    """Makes `FrameObserved` of batches; floats end here."""

    def __init__(
        self, settings: EyesSection, origin: Origin, poses: PoseSource | None, groups: Mapping[str, Sequence[str]]
    ) -> None:
        self._settings = settings
        self._origin = origin
        self._poses = FixedPoseSource(settings.pose) if settings.pose is not None else poses
        self._classes = frozenset(name for names in groups.values() for name in names)

    def observed(self, batch: DetectionBatch, vehicle: int, captured_ns: int) -> FrameObserved:
        """Return the observation of a judged batch; never raises for what a wire may bring."""
        pose = None if self._poses is None else self._poses.pose_at(captured_ns)
        return FrameObserved(
            vehicle=vehicle,
            camera=batch.camera,
            frame_seq=batch.frame_seq,
            captured_ns=captured_ns,
            latency_us=batch.latency_us,
            detections=[
                self._detection(batch, box, pose) for box in batch.detections if box.class_name in self._classes
            ],
        )

    def _detection(self, batch: DetectionBatch, box: BoxDetection, pose: Pose | None) -> Detection:
        """Return one detection with its place, or with the reason why it has none."""
        detection = Detection(
            class_name=box.class_name,
            confidence_e4=box.confidence_e4,
            x_min_e4=box.x_min_e4,
            y_min_e4=box.y_min_e4,
            x_max_e4=box.x_max_e4,
            y_max_e4=box.y_max_e4,
        )
        missing = self._missing(pose)
        if pose is None or missing:
            detection.no_place_because = missing
            return detection
        sight = _Sight(self._settings, batch, box, pose)
        point = sight.standing()
        place = None if isinstance(point, NoPlace) else _place(self._origin, pose, point)
        if place is None:
            detection.no_place_because = point.because if isinstance(point, NoPlace) else NO_POSITION
            return detection
        detection.place.CopyFrom(place)
        sight.measure(detection)
        return detection

    def _missing(self, pose: Pose | None) -> str:
        """Return what keeps every box of the frame from having a place; empty for nothing."""
        if self._origin.frame is None or pose is None:
            return NO_POSITION
        if not all(map(math.isfinite, (pose.camera_yaw_deg, pose.camera_pitch_deg, pose.camera_roll_deg))):
            return NO_ATTITUDE
        position = (pose.latitude_deg, pose.longitude_deg, pose.altitude_m, pose.height_m)
        return "" if all(map(math.isfinite, position)) else NO_POSITION


class _Sight:
    """One box, seen through one lens from one pose."""

    def __init__(self, settings: EyesSection, batch: DetectionBatch, box: BoxDetection, pose: Pose) -> None:
        self._fov_deg = batch.field_of_view_cdeg / 100 or settings.field_of_view_deg
        self._size = (batch.width_px, batch.height_px)
        self._range_max_m = settings.range_max_m
        self._pose = pose
        self._box = (box.x_min_e4 / 1e4, box.y_min_e4 / 1e4, box.x_max_e4 / 1e4, box.y_max_e4 / 1e4)

    def standing(self) -> GroundPoint | NoPlace:
        """Return where on the ground the thing in the box stands."""
        return self._ground(*standing_point(*self._box, self._pose.camera_pitch_deg))

    def measure(self, detection: Detection) -> None:
        """Write the thing's extent on the ground: its width, and its length where it is seen from above."""
        x_min, y_min, x_max, y_max = self._box
        x_mid, y_mid = standing_point(*self._box, self._pose.camera_pitch_deg)
        width_mm = self._distance_mm((x_min, y_mid), (x_max, y_mid))
        if width_mm is not None:
            detection.width_mm = width_mm
        if self._pose.camera_pitch_deg <= STEEP_PITCH_DEG:
            length_mm = self._distance_mm((x_mid, y_min), (x_mid, y_max))
            if length_mm is not None:
                detection.length_mm = length_mm

    def _ground(self, x_norm: float, y_norm: float) -> GroundPoint | NoPlace:
        """Return the ground point behind a point of the image."""
        return ground_point(self._pose, x_norm, y_norm, self._fov_deg, *self._size, self._range_max_m)

    def _distance_mm(self, one: tuple[float, float], other: tuple[float, float]) -> int | None:
        """Return the distance on the ground between two points of the image; None where one is not on it."""
        a, b = self._ground(*one), self._ground(*other)
        if isinstance(a, NoPlace) or isinstance(b, NoPlace):
            return None
        return min(round(math.hypot(a.east_m - b.east_m, a.north_m - b.north_m) * 1000), _UINT32_MAX)


def _place(origin: Origin, pose: Pose, point: GroundPoint) -> Place | None:
    """Return the place of a ground point at the ground's altitude; None where the pose is not on the Earth."""
    latitude_deg, longitude_deg = offset(pose.latitude_deg, pose.longitude_deg, point.east_m, point.north_m)
    try:
        place = origin.place(latitude_deg, longitude_deg, pose.altitude_m - pose.height_m)
    except ValueError:
        return None
    if place is None:
        return None
    return with_error(place, point.sigma_major_m, point.sigma_minor_m, point.bearing_deg)
