"""Clocks of the shell: the host's, and the flight's that the core sees. Nothing below reads a clock by itself."""

from __future__ import annotations

from pathlib import Path

from autopilot.node.joining import Reading
from autopilot.ports.edges import Clock
from autopilot.trust.freshness import NS_PER_MS, known_time
from events.records import Moment

_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


def boot_id() -> str:
    """Return the kernel's id of this boot."""
    return _BOOT_ID.read_text().strip()


def read_clocks(clock: Clock) -> Reading:
    """Read a computer's clocks; the wall clock once, to the millisecond, with how far it is believed.

    A clock that does not say how far it is to be believed counts as trusted.
    """
    known = known_time(clock)
    return Reading(clock.mono_ns(), known.now_ms * NS_PER_MS, known.quality)


class FlightClock:
    """Gives every observation its moment; flight time starts at 0 and never goes back."""

    def __init__(self, clock: Clock, boot: int, start_ns: int = 0) -> None:
        """Start a flight, or go on with one at `start_ns` of it."""
        self._clock = clock
        self.boot = boot
        self._newest_ns = start_ns
        self._offset_ns = clock.mono_ns() - start_ns

    def now(self) -> Moment:
        """Return the present moment."""
        mono_ns, wall_ns, quality = read_clocks(self._clock)
        self._newest_ns = max(mono_ns - self._offset_ns, self._newest_ns)
        return Moment(self._newest_ns, mono_ns, self.boot, wall_ns, quality)

    def peek_ns(self) -> int:
        """Return the flight time without giving it to a record. From any thread."""
        return self._clock.mono_ns() - self._offset_ns

    def seconds_until(self, flight_ns: int) -> float:
        """Return how long until a moment of the flight; negative when it has passed."""
        return (flight_ns - self.peek_ns()) / 1e9
