"""Time as trust sees it: injected, so that tests and the simulator bring their own."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Monotonic time for rates, wall time for what is signed."""

    def mono_ns(self) -> int:
        """Monotonic nanoseconds of this boot."""

    def wall_ns(self) -> int:
        """Wall clock in nanoseconds since 1970."""


class HostClock:
    """The clocks of this computer, taken as right. BOOTTIME goes on through suspend, unlike MONOTONIC."""

    def mono_ns(self) -> int:
        """Monotonic nanoseconds of this boot."""
        return time.clock_gettime_ns(time.CLOCK_BOOTTIME)

    def wall_ns(self) -> int:
        """Wall clock in nanoseconds since 1970."""
        return time.time_ns()


def wall_ms(clock: Clock) -> int:
    """Wall clock in milliseconds since 1970, the unit of everything that is signed."""
    return clock.wall_ns() // 1_000_000
