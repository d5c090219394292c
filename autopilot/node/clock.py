"""Clocks of the shell: the host's, and the flight's that the core sees. Nothing below reads a clock by itself."""

from __future__ import annotations

from pathlib import Path

from autopilot.ports.edges import Clock
from events.records import Moment
from events.schema.flight_pb2 import CLOCK_TRUSTED

_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


def boot_id() -> str:
    """Return the kernel's id of this boot."""
    return _BOOT_ID.read_text().strip()


class FlightClock:
    """Gives every observation its moment; flight time starts at 0 and never goes back."""

    def __init__(self, clock: Clock, boot: int, last: Moment | None = None) -> None:
        """Start a flight, or go on after `last`: its time of another boot can't be joined, so none passes between."""
        self._clock = clock
        self.boot = boot
        self._newest_ns = 0 if last is None else last.flight_ns
        joined = last is not None and last.boot == boot
        self._offset_ns = (last.mono_ns if last is not None and joined else clock.mono_ns()) - self._newest_ns

    def now(self) -> Moment:
        """Return the present moment. The host's clock counts as trusted."""
        mono_ns = self._clock.mono_ns()
        self._newest_ns = max(mono_ns - self._offset_ns, self._newest_ns)
        return Moment(self._newest_ns, mono_ns, self.boot, self._clock.wall_ns(), CLOCK_TRUSTED)

    def peek_ns(self) -> int:
        """Return the flight time without giving it to a record. From any thread."""
        return self._clock.mono_ns() - self._offset_ns

    def seconds_until(self, flight_ns: int) -> float:
        """Return how long until a moment of the flight; negative when it has passed."""
        return (flight_ns - self.peek_ns()) / 1e9
