"""The process that looks: reads camera or file, runs the detector, writes batches to stdout.

    python -m autopilot.adapters.eyes.child < settings.json

The settings are one line of JSON on stdin: the `[eyes]` section, and `camera`, the number that
goes into every batch. Each batch is a `DetectionBatch` behind a 4-byte big-endian length; the
last one of a source that ended says why. Words go to stderr, one line a trouble.

Exit codes (sysexits): 0 the source ended, 69 the camera is not there, 78 what is configured
can never work. The process ends by itself when nobody reads its output any more.
"""

from __future__ import annotations

import os

# Read by OpenCV when it is imported: its decoders' chatter would bury the one line that matters.
os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

import json
import sys
from typing import BinaryIO

import cv2

from autopilot.adapters.eyes import coco
from autopilot.adapters.eyes.detector import Detector, ModelRefused
from autopilot.adapters.eyes.framing import framed
from autopilot.adapters.eyes.judging import WHOLE_E4
from autopilot.adapters.eyes.video import Frame, SourceLost, SourceRefused, boot_ns, frames
from autopilot.ports.config import EyesSection
from autopilot.wire.detections_pb2 import BoxDetection, DetectionBatch

EX_OK, EX_UNAVAILABLE, EX_CONFIG = 0, 69, 78


def watch(settings: EyesSection, camera: int, out: BinaryIO) -> None:
    """Write a batch for every frame, then one that says why the source ended.

    Raises `ModelRefused`, `SourceRefused`, `SourceLost` and, when nobody reads on, `BrokenPipeError`.
    """
    cv2.setNumThreads(settings.threads)
    detector = Detector(
        settings.model, settings.classes or coco.NAMES, settings.confidence, settings.overlap, settings.threads
    )
    seq = -1
    for frame in frames(settings):
        seq = frame.seq
        _write(out, batch_of(frame, detector, camera, settings.field_of_view_deg))
    because = "frame limit" if settings.frames and seq + 1 >= settings.frames else "end of file"
    _write(out, DetectionBatch(camera=camera, frame_seq=seq + 1, model=detector.name, ended_because=because))


def batch_of(frame: Frame, detector: Detector, camera: int, field_of_view_deg: float) -> DetectionBatch:
    """Return what the detector finds in a frame."""
    found = detector.detect(frame.image)
    boxes = [_box(name, score, corners) for name, score, corners in found]
    return DetectionBatch(
        camera=camera,
        frame_seq=frame.seq,
        captured_ns=frame.captured_ns,
        latency_us=(boot_ns() - frame.read_ns) // 1000,
        model=detector.name,
        detections=[box for box in boxes if box.x_min_e4 < box.x_max_e4 and box.y_min_e4 < box.y_max_e4],
        field_of_view_cdeg=round(field_of_view_deg * 100),
        width_px=frame.image.shape[1],
        height_px=frame.image.shape[0],
    )


def _box(name: str, score: float, corners: tuple[float, float, float, float]) -> BoxDetection:
    """Return one box in fixed point."""
    x_min, y_min, x_max, y_max = (round(corner * WHOLE_E4) for corner in corners)
    return BoxDetection(
        class_name=name,
        confidence_e4=min(round(score * WHOLE_E4), WHOLE_E4),
        x_min_e4=x_min,
        y_min_e4=y_min,
        x_max_e4=x_max,
        y_max_e4=y_max,
    )


def _write(out: BinaryIO, batch: DetectionBatch) -> None:
    """Write one batch at once."""
    out.write(framed(batch.SerializeToString()))
    out.flush()


def main() -> int:
    """Run with settings from stdin; return the exit code."""
    # Libraries print to descriptor 1 when they feel like it; the batches get one of their own.
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)
        told = json.loads(sys.stdin.readline())
        camera = told.pop("camera")
        try:
            watch(EyesSection.model_validate(told), camera, out)
        except (ModelRefused, SourceRefused) as error:
            print(error, file=sys.stderr)
            return EX_CONFIG
        except SourceLost as error:
            print(error, file=sys.stderr)
            return EX_UNAVAILABLE
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), out.fileno())  # closing must not fail once more
    return EX_OK


if __name__ == "__main__":
    sys.exit(main())
