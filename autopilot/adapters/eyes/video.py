"""Frames from a video file or a camera, each with its number and its time of capture.

A file is read at its own speed (`pace = "real"`: what comes too late is skipped, as a camera
would) or every frame as fast as it is asked for (`"fast"`). A camera always gives the newest.
Runs in the child process only; what to do with a frame is not decided here.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
from cv2.typing import MatLike

from autopilot.ports.config import EyesSection

ASSUMED_HZ = 25.0  # of files that do not say


class SourceRefused(Exception):
    """The source can never work as configured; the text names the key and the fix."""


class SourceLost(Exception):
    """The camera is not there, or not any more; it may come back."""


@dataclass(frozen=True, slots=True)
class Frame:
    """An image and when it was taken."""

    seq: int  # number in the source, from 0; gaps are frames that were skipped
    captured_ns: int  # monotonic; for a file its own time, counted from the start of reading
    read_ns: int  # monotonic, when the image was in memory
    image: MatLike  # height x width x BGR, 8 bits


def boot_ns() -> int:
    """Return monotonic nanoseconds of this boot, counting sleep where the system can (CLOCK_BOOTTIME)."""
    return time.clock_gettime_ns(getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))


def frames(
    settings: EyesSection, now: Callable[[], int] = boot_ns, sleep: Callable[[float], None] = time.sleep
) -> Iterator[Frame]:
    """Yield the frames of the configured source until it ends.

    Raises `SourceRefused` for a file that is none, `SourceLost` for a camera that gives nothing.
    """
    if settings.source == "device":
        yield from _of_device(settings, now)
    else:
        yield from _of_file(settings, now, sleep)


def _of_device(settings: EyesSection, now: Callable[[], int]) -> Iterator[Frame]:
    """Yield what a camera gives; the driver's queue is kept short so that frames are fresh."""
    camera = cv2.VideoCapture(settings.device)
    camera.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    seq = 0
    while not settings.frames or seq < settings.frames:
        if not camera.grab():
            raise SourceLost(f"[eyes] device: camera {settings.device} gives no frame; is it plugged in and free?")
        captured_ns = now()
        good, image = camera.retrieve()
        if good:
            yield Frame(seq, captured_ns, now(), image)
        seq += 1


def _of_file(settings: EyesSection, now: Callable[[], int], sleep: Callable[[float], None]) -> Iterator[Frame]:
    """Yield a file's frames, again and again where it loops; numbers and times go on."""
    seq, start_ns = 0, now()
    while True:
        video = _opened(settings.path)
        hz = video.get(cv2.CAP_PROP_FPS)
        period_ns = 1e9 / (hz if math.isfinite(hz) and hz > 0 else ASSUMED_HZ)
        first = seq
        while (not settings.frames or seq < settings.frames) and video.grab():
            captured_ns = start_ns + round(seq * period_ns)
            if settings.pace == "fast" or _in_time(captured_ns, period_ns, now, sleep):
                good, image = video.retrieve()
                if good:
                    yield Frame(seq, captured_ns, now(), image)
            seq += 1
        video.release()
        if seq == first:
            raise SourceRefused(f"[eyes] path: {settings.path} holds no frame that can be decoded")
        if settings.at_end != "loop" or (settings.frames and seq >= settings.frames):
            return


def _opened(path: str) -> cv2.VideoCapture:
    """Open a video file."""
    if not os.path.isfile(path):
        raise SourceRefused(f"[eyes] path: no file {path}; give the path of a video")
    video = cv2.VideoCapture(path)
    if not video.isOpened():
        raise SourceRefused(f"[eyes] path: {path} is no video that OpenCV can read; try to convert it to MP4 or AVI")
    return video


def _in_time(captured_ns: int, period_ns: float, now: Callable[[], int], sleep: Callable[[float], None]) -> bool:
    """Wait until a frame is due; False when it is late by more than its own length."""
    early_ns = captured_ns - now()
    if early_ns > 0:
        sleep(early_ns / 1e9)
    return early_ns > -period_ns
