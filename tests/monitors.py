"""What the monitors say about a whole flight, for tests that hold flights against them."""

from __future__ import annotations

from collections.abc import Sequence

from events import Record
from statecharts.monitors import Watch
from statecharts.monitors.monitor import order_of as order_of

Steps = Sequence[Sequence[Record]]


def complaints(steps: Steps) -> list[str]:
    """Return what all monitors say about a flight."""
    watch = Watch()
    return [f"{breach.name}: step {breach.seq}: {breach.words}" for step in steps for breach in watch.see(step)]
