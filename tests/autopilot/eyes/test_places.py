"""Detections get places: from a fixed pose, from telemetry, or a reason why not."""

import dataclasses
import math

import pytest

from autopilot.adapters.eyes.places import Places
from autopilot.geo import Origin
from autopilot.ports.config import EyesSection, FixedPose
from autopilot.ports.edges import Pose
from events.schema.eyes_pb2 import Detection, FrameObserved
from tests.autopilot.eyes.tiny import batch

GROUPS = {"person": ("person",), "animal": ("dog", "horse")}
OBLIQUE = Pose(
    mono_ns=0,
    latitude_deg=47.0,
    longitude_deg=8.0,
    altitude_m=550,
    height_m=50,
    camera_yaw_deg=90,
    camera_pitch_deg=-45,
)
STEEP = dataclasses.replace(OBLIQUE, camera_pitch_deg=-90.0, camera_yaw_deg=0.0)
MIDDLE_FOOT = ("person", 8000, 4900, 4000, 5100, 5000)  # stands in the middle of the image


class Telemetry:
    """Knows one pose, and remembers for when it was asked."""

    def __init__(self, pose: Pose | None) -> None:
        self.pose, self.asked = pose, list[int]()

    def pose_at(self, mono_ns: int) -> Pose | None:
        self.asked.append(mono_ns)
        return self.pose


def observed(
    telemetry: Pose | None, *boxes: tuple[str, int, int, int, int, int], origin: bool = True, **settings: object
) -> FrameObserved:
    """Observe boxes through a lens of 90 degrees and 2:1."""
    section = EyesSection.model_validate({"field_of_view_deg": 90, **settings})
    here = Origin()
    if origin:
        here.set(47, 8, 400)
    return Places(section, here, Telemetry(telemetry), GROUPS).observed(
        batch(*boxes, frame_seq=7, latency_us=30), 1, 1234
    )


def check_place(detection: Detection, east_m: float, north_m: float, altitude_m: float = 500) -> None:
    """Say where a detection stands, from an origin straight below the camera."""
    assert detection.no_place_because == ""
    assert detection.place.east_mm / 1000 == pytest.approx(east_m, abs=0.02)
    assert detection.place.north_mm / 1000 == pytest.approx(north_m, abs=0.02)
    assert detection.place.altitude_mm == round(altitude_m * 1000)


def check_no_place(frame: FrameObserved, because: str) -> None:
    """Say why the one detection has no place."""
    (detection,) = frame.detections
    assert detection.no_place_because == because
    assert not detection.HasField("place")
    assert not detection.HasField("width_mm")


def test_a_person_in_the_middle() -> None:
    """At 45 degrees down and looking east: as far east as the camera is high, on the ground's altitude."""
    (detection,) = observed(OBLIQUE, MIDDLE_FOOT).detections
    check_place(detection, 50, 0)
    assert detection.place.mgrs.startswith("32T")
    assert detection.place.error_major_mm == pytest.approx(1000 * math.hypot(100 * math.radians(1), 2, 2), rel=0.01)
    assert detection.place.error_bearing_cdeg == 9000
    assert detection.width_mm == pytest.approx(1000 * 0.02 * 2 * 50 * math.sqrt(2), abs=5)
    assert not detection.HasField("length_mm")


def test_from_above_the_centre_counts_and_there_is_a_length() -> None:
    """Straight down a box of a tenth of the image is 10 m wide and 5 m long here."""
    (detection,) = observed(STEEP, ("horse", 8000, 5000, 4000, 6000, 5000)).detections
    check_place(detection, 5, 2.5)
    assert (detection.width_mm, detection.length_mm) == (10_000, 5_000)


def test_everything_of_the_frame_is_kept() -> None:
    """Numbers, times and boxes as they came; the pose is asked for at the time of capture."""
    frame = observed(OBLIQUE, MIDDLE_FOOT)
    assert (frame.vehicle, frame.camera, frame.frame_seq, frame.captured_ns, frame.latency_us) == (1, 1, 7, 1234, 30)
    detection = frame.detections[0]
    assert (detection.class_name, detection.confidence_e4) == ("person", 8000)
    assert (detection.x_min_e4, detection.y_min_e4, detection.x_max_e4, detection.y_max_e4) == (4900, 4000, 5100, 5000)
    telemetry = Telemetry(OBLIQUE)
    Places(EyesSection(), Origin(), telemetry, GROUPS).observed(batch(), 1, 77)
    assert telemetry.asked == [77]


def test_classes_in_no_group_are_left_out() -> None:
    """The order of the others stays."""
    frame = observed(OBLIQUE, ("dog", 5, 0, 0, 1, 9000), ("kite", 9, 0, 0, 1, 9000), MIDDLE_FOOT)
    assert [detection.class_name for detection in frame.detections] == ["dog", "person"]


def test_reasons_for_no_place() -> None:
    """Each reason in the words of the schema."""
    check_no_place(observed(None, MIDDLE_FOOT), "no position")
    check_no_place(observed(OBLIQUE, MIDDLE_FOOT, origin=False), "no position")
    check_no_place(observed(dataclasses.replace(OBLIQUE, camera_yaw_deg=math.nan), MIDDLE_FOOT), "no attitude")
    check_no_place(observed(dataclasses.replace(OBLIQUE, latitude_deg=math.nan), MIDDLE_FOOT), "no position")
    check_no_place(observed(dataclasses.replace(OBLIQUE, latitude_deg=95), MIDDLE_FOOT), "no position")
    check_no_place(observed(dataclasses.replace(OBLIQUE, camera_pitch_deg=5), MIDDLE_FOOT), "above the horizon")
    check_no_place(observed(OBLIQUE, MIDDLE_FOOT, range_max_m=40), "too far")


def test_a_fixed_pose_comes_before_telemetry() -> None:
    """A camera on a mast stands where the configuration says."""
    pose = FixedPose(latitude_deg=47, longitude_deg=8, altitude_m=410, height_m=10, yaw_deg=180, pitch_deg=-45)
    (detection,) = observed(None, MIDDLE_FOOT, pose=pose).detections
    check_place(detection, 0, -10, altitude_m=400)


def test_the_batch_knows_its_own_zoom() -> None:
    """A batch's field of view counts before the configured one."""
    section, origin = EyesSection(field_of_view_deg=10), Origin()
    origin.set(47, 8, 400)
    sent = batch(("person", 1, 9000, 0, 10_000, 10_000), field_of_view_cdeg=9000)
    (detection,) = Places(section, origin, Telemetry(STEEP), GROUPS).observed(sent, 1, 0).detections
    check_place(detection, 45, 0)
