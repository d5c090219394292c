"""The world: the same from the same seed, and boxes that lead back to where things are."""

from __future__ import annotations

import math
from collections import Counter

import pytest

from autopilot.geo import GroundPoint, ground_point, standing_point
from autopilot.sim.gimbal import Gimbal
from autopilot.sim.route import Motion, Route
from autopilot.sim.world import (
    FIELD_OF_VIEW_DEG,
    HEIGHT_PX,
    MISSED,
    WIDTH_PX,
    CameraView,
    Thing,
    World,
    box_of,
)
from autopilot.wire.detections_pb2 import DetectionBatch

PERSON = Thing(
    class_name="person", east_m=0, north_m=0, width_m=0.6, height_m=1.75, confidence=0.8, walks=False, decoy=False
)


def hovering(east_m: float, north_m: float, up_m: float, yaw_deg: float = 0.0) -> Motion:
    return Motion(
        east_m=east_m,
        north_m=north_m,
        up_m=up_m,
        yaw_deg=yaw_deg,
        east_m_s=0,
        north_m_s=0,
        up_m_s=0,
        yaw_deg_s=0,
        armed=True,
        mode=3,
    )


def flown(seed: int, seconds: float, frames: int = 0) -> list[DetectionBatch]:
    """Return what is seen on a flight with the gimbal at rest, at 12 frames a second."""
    route = Route(seed, seconds)
    world, gimbal = World(seed, route), Gimbal()
    count = frames or int(seconds * 12)
    return [world.look(n / 12, n, route.at(n / 12), gimbal) for n in range(count)]


@pytest.mark.parametrize("pitch_deg", [-20, -35, -60, -74, -80, -90])
@pytest.mark.parametrize("yaw_deg", [0, 75, 200, -30])
def test_a_box_leads_back_to_its_thing(pitch_deg: float, yaw_deg: float) -> None:
    """Through the inverse that the node uses, wherever in the image it stands."""
    view = CameraView(height_m=25, camera_yaw_deg=yaw_deg, camera_pitch_deg=pitch_deg)
    found = 0
    for away_m in (1, 3, 8, 15, 30, 45, 70):
        for aside_deg in (-25, -10, 0, 12, 28):
            bearing = math.radians(yaw_deg + aside_deg)
            east_m, north_m = away_m * math.sin(bearing), away_m * math.cos(bearing)
            box = box_of(PERSON, east_m, north_m, view)
            if box is not None:
                x, y = standing_point(*box, pitch_deg)
                point = ground_point(view, x, y, FIELD_OF_VIEW_DEG, WIDTH_PX, HEIGHT_PX, 1_000)
                assert isinstance(point, GroundPoint)
                assert (point.east_m, point.north_m) == pytest.approx((east_m, north_m), abs=1e-6)
                found += 1
    assert found > 2


def test_no_box_is_empty() -> None:
    """Over twenty worlds, also where noise meets the edge of the image."""
    boxes = [box for seed in range(20) for batch in flown(seed, 60) for box in batch.detections]
    empty = sum(one.x_min_e4 >= one.x_max_e4 or one.y_min_e4 >= one.y_max_e4 for one in boxes)
    assert empty == 0


def test_what_is_not_in_view_has_no_box() -> None:
    view = CameraView(height_m=25, camera_yaw_deg=0, camera_pitch_deg=-30)
    assert box_of(PERSON, 0, -40, view) is None
    assert box_of(PERSON, 40, 40, view) is None
    assert box_of(PERSON, 0, 3_000, view) is None


def test_nothing_is_seen_from_the_ground() -> None:
    world = World(1, Route(1, 60))
    batch = world.look(0, 5, hovering(0, 0, 0.5), Gimbal())
    assert (batch.captured_ns, batch.camera, list(batch.detections)) == (5, 1, [])


def test_the_same_seed_the_same_world() -> None:
    assert flown(3, 20) == flown(3, 20)
    assert [b.detections for b in flown(3, 20)] != [b.detections for b in flown(4, 20)]


def test_frames_are_numbered_and_say_what_the_camera_is() -> None:
    batches = flown(1, 15, 3)
    assert [batch.frame_seq for batch in batches] == [0, 1, 2]
    assert (batches[0].field_of_view_cdeg, batches[0].width_px, batches[0].height_px) == (6000, 1280, 720)


@pytest.mark.parametrize("seconds", [15.0, 25.0, 45.0, 60.0])
@pytest.mark.parametrize("seed", [1, 2, 3, 7])
def test_a_flight_sees_enough_to_ask_about(seed: int, seconds: float) -> None:
    """Also a camera that is never moved meets a real person and, on a longer flight, the decoy."""
    route = Route(seed, seconds)
    world, gimbal, seen = World(seed, route), Gimbal(), Counter[int]()
    for n in range(int(seconds * 12)):
        motion = route.at(n / 12)
        view = CameraView(height_m=motion.up_m, camera_yaw_deg=motion.yaw_deg, camera_pitch_deg=gimbal.pitch_deg)
        if motion.up_m >= 1:
            for index, thing in enumerate(world.things):
                east_m, north_m = thing.at(n / 12)
                seen[index] += box_of(thing, east_m - motion.east_m, north_m - motion.north_m, view) is not None
    long_enough = {index for index, frames in seen.items() if frames >= 12}
    assert 0 in long_enough
    assert len(long_enough) >= min(3, len(world.things))
    assert seconds < 45 or 2 in long_enough


def test_things_are_far_enough_apart_to_be_several() -> None:
    for seed in range(20):
        things = World(seed, Route(seed, 60)).things
        gaps = [
            math.dist((one.east_m, one.north_m), (other.east_m, other.north_m))
            for number, one in enumerate(things)
            for other in things[number + 1 :]
        ]
        assert min(gaps) > 16
        assert sum(thing.decoy for thing in things) == 1


def test_walkers_stay_near() -> None:
    walker = next(thing for thing in World(1, Route(1, 60)).things if thing.walks)
    places = [walker.at(second) for second in range(60)]
    assert all(math.dist(place, (walker.east_m, walker.north_m)) < 2.5 for place in places)
    assert len(set(places)) > 50


def test_it_misses_and_imagines_at_the_rates_it_says() -> None:
    world = World(1, Route(1, 60))
    thing = world.things[0]
    motion, gimbal = hovering(thing.east_m, thing.north_m - 30, 25), Gimbal(pitch_deg=-40)
    batches = [world.look(0, n, motion, gimbal) for n in range(2_000)]
    boxes = [box for batch in batches for box in batch.detections]
    hits = [box for box in boxes if box.class_name == "person" and box.confidence_e4 > 5_500]
    assert len(hits) == pytest.approx(2_000 * (1 - MISSED), abs=60)
    assert 0 < sum(box.confidence_e4 <= 5_000 for box in boxes) < 200
    assert {box.x_min_e4 for box in hits} != {hits[0].x_min_e4}


def test_boxes_keep_to_the_image() -> None:
    for batch in flown(2, 60):
        for box in batch.detections:
            assert 0 <= box.x_min_e4 <= box.x_max_e4 <= 10_000
            assert 0 <= box.y_min_e4 <= box.y_max_e4 <= 10_000
            assert 2_000 <= box.confidence_e4 <= 9_800
