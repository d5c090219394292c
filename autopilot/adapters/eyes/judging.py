"""Judges what a detector sent: a batch that can be worked with, or the name of what is wrong.

Every number is checked once, here, so that the code behind it needs no doubts. Nothing is
repaired: a detector that sends one impossible box may be wrong about the others too.
"""

from __future__ import annotations

from dataclasses import dataclass

from google.protobuf.message import DecodeError

from autopilot.wire.detections_pb2 import BoxDetection, DetectionBatch

WHOLE_E4 = 10_000
NAME_LONGEST = 64  # characters of a class or model name
SIDE_LONGEST_PX = 65_535
FIELD_OF_VIEW_LARGEST_CDEG = 17_000  # a pinhole sees less than half the world
INT64_MAX = 2**63 - 1


@dataclass(frozen=True, slots=True)
class Rejection:
    """A batch that is not used; `because` is the name it is counted under."""

    because: str


def judged(payload: bytes, camera: int, detections: int) -> DetectionBatch | Rejection:
    """Return the batch, or why it is none: for `camera`, with at most `detections` boxes. Never raises."""
    try:
        batch = DetectionBatch.FromString(payload)
    except DecodeError:
        return Rejection("garbage")
    fault = _fault_of_batch(batch, camera, detections)
    if not fault:
        fault = next(filter(None, map(_fault_of_box, batch.detections)), "")
    return Rejection(fault) if fault else batch


def _fault_of_batch(batch: DetectionBatch, camera: int, detections: int) -> str:
    """Return what is wrong with everything but the boxes; empty for nothing."""
    sides = (batch.width_px, batch.height_px)
    checks = (
        (batch.camera == camera, "unknown_camera"),
        (len(batch.detections) <= detections, "too_many_detections"),
        (len(batch.model) <= NAME_LONGEST and batch.model.isprintable(), "bad_model_name"),
        (batch.ended_because.isprintable() and len(batch.ended_because) <= 200, "bad_reason"),
        (batch.captured_ns <= INT64_MAX and batch.frame_seq <= INT64_MAX, "bad_time"),
        (batch.field_of_view_cdeg <= FIELD_OF_VIEW_LARGEST_CDEG, "bad_field_of_view"),
        (bool(batch.ended_because) or all(0 < side <= SIDE_LONGEST_PX for side in sides), "bad_image_size"),
    )
    return next((name for good, name in checks if not good), "")


def _fault_of_box(box: BoxDetection) -> str:
    """Return what is wrong with a box; empty for nothing."""
    edges = (box.x_min_e4, box.y_min_e4, box.x_max_e4, box.y_max_e4)
    checks = (
        (0 < len(box.class_name) <= NAME_LONGEST and box.class_name.isprintable(), "bad_class_name"),
        (box.confidence_e4 <= WHOLE_E4, "bad_confidence"),
        (all(0 <= edge <= WHOLE_E4 for edge in edges), "box_outside_image"),
        (box.x_min_e4 < box.x_max_e4 and box.y_min_e4 < box.y_max_e4, "empty_box"),
    )
    return next((name for good, name in checks if not good), "")
