"""Things on flat ground around the route, and the boxes that a detector would give of them.

All from one seed: where things are, who walks, what is missed, what is seen where nothing is. One
of them is a decoy: a thing that the detector takes for a person and a person does not. The camera
is a pinhole with square pixels at the gimbal's place; `autopilot.geo.image_point` is the projection.
What this does not do: draw a picture, or know MAVLink and sockets.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from autopilot.geo import image_point
from autopilot.geo.ground import STEEP_PITCH_DEG
from autopilot.sim.gimbal import Gimbal
from autopilot.sim.route import Motion, Route
from autopilot.wire.detections_pb2 import BoxDetection, DetectionBatch

FIELD_OF_VIEW_DEG = 60.0
WIDTH_PX, HEIGHT_PX = 1280, 720
FRAMES_PER_S = 12.0
MODEL = "simulated"

MISSED = 0.10  # of what is in view, a frame
FALSE_ALARM = 0.02  # a frame
BOX_NOISE = 0.02  # standard deviation of an edge, in parts of the box
SMALLEST_PX = 6.0
LOWEST_M = 1.0  # a camera that is lower sees nothing worth a box
SPACING_M = 16.0

# Class as the detector names it, width and height in metres, typical confidence, whether it walks.
SORTS: tuple[tuple[str, float, float, float, bool], ...] = (
    ("person", 0.6, 1.75, 0.78, False),
    ("car", 4.2, 1.5, 0.86, False),
    ("person", 0.9, 1.2, 0.52, False),  # the decoy
    ("person", 0.6, 1.7, 0.74, True),
    ("truck", 7.0, 3.0, 0.82, False),
    ("dog", 0.9, 0.7, 0.62, True),
    ("bicycle", 1.7, 1.1, 0.64, False),
    ("person", 0.6, 1.8, 0.76, True),
    ("car", 4.2, 1.5, 0.84, False),
)
DECOY = 2
WALK_M = 2.0  # radius of a walker's loop: it stays one thing
WALK_M_S = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Thing:
    """Something that stands or walks on the ground, metres from home."""

    class_name: str
    east_m: float
    north_m: float
    width_m: float
    height_m: float
    confidence: float
    walks: bool
    decoy: bool

    def at(self, seconds: float) -> tuple[float, float]:
        """Return east and north at a time; walkers go round in a small loop."""
        if not self.walks:
            return self.east_m, self.north_m
        angle = seconds * WALK_M_S / WALK_M
        return self.east_m + WALK_M * math.sin(angle), self.north_m + WALK_M * math.cos(angle)


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraView:
    """The camera's pose as `autopilot.geo` wants it."""

    height_m: float
    camera_yaw_deg: float
    camera_pitch_deg: float
    camera_roll_deg: float = 0.0


class World:
    """The things around a route and the detector that sees them."""

    def __init__(self, seed: int, route: Route) -> None:
        self.things = _things(random.Random(f"things {seed}"), route)
        self._chance = random.Random(f"detector {seed}")
        self._frame = 0

    def look(self, seconds: float, captured_ns: int, motion: Motion, gimbal: Gimbal) -> DetectionBatch:
        """Return what the detector finds in a frame that is captured now; `latency_us` is the caller's to set."""
        view = CameraView(
            height_m=motion.up_m,
            camera_yaw_deg=motion.yaw_deg + gimbal.yaw_deg,
            camera_pitch_deg=gimbal.pitch_deg,
        )
        batch = DetectionBatch(
            camera=1,
            frame_seq=self._frame,
            captured_ns=captured_ns,
            model=MODEL,
            field_of_view_cdeg=round(FIELD_OF_VIEW_DEG * 100),
            width_px=WIDTH_PX,
            height_px=HEIGHT_PX,
        )
        self._frame += 1
        if motion.up_m >= LOWEST_M:
            batch.detections.extend(self._seen(seconds, motion, view))
            batch.detections.extend(self._imagined())
        return batch

    def _seen(self, seconds: float, motion: Motion, view: CameraView) -> list[BoxDetection]:
        boxes = []
        for thing in self.things:
            east_m, north_m = thing.at(seconds)
            box = box_of(thing, east_m - motion.east_m, north_m - motion.north_m, view)
            if box is not None and self._chance.random() >= MISSED:
                boxes.append(self._noisy(thing, box))
        # At the edge of the image noise can leave nothing of a box; a detector would not report that.
        return [box for box in boxes if box.x_min_e4 < box.x_max_e4 and box.y_min_e4 < box.y_max_e4]

    def _noisy(self, thing: Thing, box: tuple[float, float, float, float]) -> BoxDetection:
        width, height = box[2] - box[0], box[3] - box[1]
        edges = [
            edge + self._chance.gauss(0, BOX_NOISE) * size
            for edge, size in zip(box, (width, height, width, height), strict=True)
        ]
        confidence = min(max(self._chance.gauss(thing.confidence, 0.05), 0.2), 0.98)
        return _detection(thing.class_name, confidence, edges)

    def _imagined(self) -> list[BoxDetection]:
        if self._chance.random() >= FALSE_ALARM:
            return []
        x, y = self._chance.uniform(0, 0.95), self._chance.uniform(0, 0.9)
        edges = [x, y, x + self._chance.uniform(0.01, 0.05), y + self._chance.uniform(0.02, 0.1)]
        name = self._chance.choice(("person", "dog", "boat"))
        return [_detection(name, self._chance.uniform(0.25, 0.5), edges)]


def box_of(thing: Thing, east_m: float, north_m: float, view: CameraView) -> tuple[float, float, float, float] | None:
    """Return the box (x_min, y_min, x_max, y_max; 0 to 1) of a thing at this offset from the camera's foot, or None.

    It stands on its box's lower edge, in the middle; seen from straight above it lies around it
    (`autopilot.geo.standing_point` reads boxes the same way). None: not in view, or too small.
    """
    foot = image_point(view, east_m, north_m, FIELD_OF_VIEW_DEG, WIDTH_PX, HEIGHT_PX)
    if foot is None or not (0 < foot[0] < 1 and 0 < foot[1] < 1):
        return None
    slant_m = math.hypot(east_m, north_m, view.height_m)
    px_a_metre = WIDTH_PX / 2 / math.tan(math.radians(FIELD_OF_VIEW_DEG) / 2) / slant_m
    width = thing.width_m * px_a_metre / WIDTH_PX
    if view.camera_pitch_deg <= STEEP_PITCH_DEG:
        height = thing.width_m * px_a_metre / HEIGHT_PX
        top, bottom = foot[1] - height / 2, foot[1] + height / 2
    else:
        seen_m = thing.height_m * math.cos(math.radians(view.camera_pitch_deg)) + 0.3 * thing.width_m
        top, bottom = foot[1] - seen_m * px_a_metre / HEIGHT_PX, foot[1]
    if (bottom - top) * HEIGHT_PX < SMALLEST_PX:
        return None
    return foot[0] - width / 2, top, foot[0] + width / 2, bottom


def _detection(class_name: str, confidence: float, edges: list[float]) -> BoxDetection:
    x_min, y_min, x_max, y_max = (min(max(round(edge * 10_000), 0), 10_000) for edge in edges)
    return BoxDetection(
        class_name=class_name,
        confidence_e4=round(confidence * 10_000),
        x_min_e4=min(x_min, x_max),
        y_min_e4=min(y_min, y_max),
        x_max_e4=max(x_min, x_max),
        y_max_e4=max(y_min, y_max),
    )


def _things(chance: random.Random, route: Route) -> tuple[Thing, ...]:
    """Set things along the circle, in the order in which a camera that looks ahead meets them."""
    ring_m = route.radius_m + 4 + 0.5 * route.height_m
    count = max(3, min(len(SORTS), int(math.tau * ring_m / SPACING_M)))
    things = []
    for index, (class_name, width_m, height_m, confidence, walks) in enumerate(SORTS[:count]):
        ahead_deg = 40 + 360 * (index + chance.uniform(-0.15, 0.15)) / count
        bearing = math.radians(route.bearing_deg + 180 + ahead_deg)
        away_m = ring_m + chance.uniform(-0.2, 0.2) * route.height_m
        things.append(
            Thing(
                class_name=class_name,
                east_m=route.centre_m[0] + away_m * math.sin(bearing),
                north_m=route.centre_m[1] + away_m * math.cos(bearing),
                width_m=width_m,
                height_m=height_m,
                confidence=confidence,
                walks=walks,
                decoy=index == DECOY,
            )
        )
    return tuple(things)
