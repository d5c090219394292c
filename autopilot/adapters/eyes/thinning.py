"""Which frames are worth a record: each with something in it, and of the others as few as tell that the eyes work.

The first frame after one with something in it is always told, so that "nothing there any more" comes without delay;
then one each `empty_frame_period_s`, with the number of those between. Time is that of the captures.
"""

from __future__ import annotations

from events.schema.eyes_pb2 import FrameObserved


class Empties:
    """Passes frames on, or counts them."""

    def __init__(self, period_s: float) -> None:
        self._period_ns = round(period_s * 1e9)
        self._told_ns: int | None = None  # capture of the newest empty frame that was told; None: tell the next
        self._untold = 0

    def begin(self) -> None:
        """Tell the next frame, whatever is in it: the source is another."""
        self._told_ns = None

    def news(self, frame: FrameObserved) -> bool:
        """Return whether to record a frame; it then says how many before it were not."""
        if not frame.detections and not self._due(frame.captured_ns):
            self._untold += 1
            return False
        if self._untold:
            frame.empty_before, self._untold = self._untold, 0
        self._told_ns = None if frame.detections else frame.captured_ns
        return True

    def _due(self, captured_ns: int) -> bool:
        if self._told_ns is None:
            return True
        return not 0 <= captured_ns - self._told_ns < self._period_ns  # a capture time that goes back is a new source
