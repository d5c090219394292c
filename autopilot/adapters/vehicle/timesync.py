"""TIMESYNC: how far the vehicle's clock is from this computer's, and how surely that is known.

We ask with tc1 = 0 and our time in ts1; the vehicle answers with its own time in tc1 and ts1 as it was (MAVLink guide,
"Time Synchronization"). The vehicle's time was tc1 somewhere between question and answer, so the sample with the
shortest round trip says most: of the last samples the quickest are kept, the best of them gives the offset, and how
far they lie apart is the spread. A sample that is far from all others is a vehicle that started again.

Others' questions are answered where they are addressed to us, and only then: two answers to one question are none.
Plain values in and out, time is an argument.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from autopilot.adapters.vehicle.heard import Sender, Timesync
from events.schema.link_pb2 import VehicleTimeCompared

NS_PER_US = 1_000
ASK_FIRST_NS = 1_000_000_000  # until there are enough samples
ASK_NS = 10_000_000_000
ENOUGH = 8  # samples before anything is said
SAMPLES = 32  # kept: about five minutes, in which a crystal of 20 ppm drifts by 6 ms
BEST = 4
AGAIN_NS = 600_000_000_000  # what does not move is told this often
PENDING_MAX = 4  # questions that may still be answered
LATE_NS = 2_000_000_000  # an answer after this says less than nothing
RESTARTED_NS = 1_000_000_000  # a clock that is this far off what it was has begun again


@dataclass(frozen=True, slots=True)
class Sample:
    """One answer."""

    round_trip_ns: int
    offset_ns: int  # vehicle's time less ours


class Timing:
    """Compares the vehicle's clock with ours."""

    def __init__(self, threshold_ms: float) -> None:
        """`threshold_ms`: a move of the offset is news from here on."""
        self._threshold_ns = round(threshold_ms * 1e6)
        self.reset(0)

    def reset(self, now_ns: int) -> None:
        """Begin again: the vehicle is new, or came back."""
        self._samples: deque[Sample] = deque(maxlen=SAMPLES)
        self._pending: deque[int] = deque(maxlen=PENDING_MAX)
        self._ask_ns = now_ns
        self._told: tuple[int, int] | None = None  # when, and which offset

    def ask(self, now_ns: int) -> int | None:
        """Return the ts1 of a question that is due now, or None."""
        if now_ns < self._ask_ns:
            return None
        self._ask_ns = now_ns + (ASK_NS if len(self._samples) >= ENOUGH else ASK_FIRST_NS)
        self._pending.append(now_ns)
        return now_ns

    def due_ns(self) -> int:
        """Return when the next question is due."""
        return self._ask_ns

    def hear(self, now_ns: int, heard: Timesync) -> VehicleTimeCompared | str | None:
        """Take the vehicle's answer; return what is to be recorded, None for nothing new, or why it is no answer."""
        if heard.ts1_ns not in self._pending:
            return "unasked time"
        self._pending.remove(heard.ts1_ns)
        round_trip_ns = now_ns - heard.ts1_ns
        if not 0 <= round_trip_ns <= LATE_NS:
            return "late time"
        sample = Sample(round_trip_ns, heard.tc1_ns - (heard.ts1_ns + now_ns) // 2)
        if self._samples and abs(sample.offset_ns - self._samples[-1].offset_ns) > RESTARTED_NS:
            self._samples.clear()
            self._told = None
        self._samples.append(sample)
        return self._news(now_ns) if len(self._samples) >= ENOUGH else None

    def _news(self, now_ns: int) -> VehicleTimeCompared | None:
        best = sorted(self._samples, key=lambda sample: sample.round_trip_ns)[:BEST]
        offsets = [sample.offset_ns for sample in best]
        if self._told is not None:
            told_ns, offset_ns = self._told
            moved = abs(offsets[0] - offset_ns) > self._threshold_ns
            if not moved and now_ns < told_ns + AGAIN_NS:
                return None
        self._told = now_ns, offsets[0]
        return VehicleTimeCompared(
            vehicle=1,
            offset_us=offsets[0] // NS_PER_US,
            spread_us=(max(offsets) - min(offsets)) // NS_PER_US,
            round_trip_us=best[0].round_trip_ns // NS_PER_US,
            samples=len(self._samples),
        )


def is_question_to(us: Sender, heard: Timesync) -> bool:
    """Say whether somebody asks us, and not everybody, for our time."""
    return heard.tc1_ns == 0 and heard.target == us
