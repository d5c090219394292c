"""What a monitor is, and what most of them ask of a step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import Limits
from events.schema.safety_pb2 import FlyToPlace, SetVehicleMode
from events.schema.vehicle_pb2 import PointAtAngles, PointAtPlace, ReleasePointing, SetZoom
from statecharts.state import State

Step = Sequence[Record]
Said = Iterator[tuple[str, str]]  # property, words

NS_PER_MS = 1_000_000
FINAL = ("accepted", "rejected", "timeout", "unsupported", "unauthorised")


class Monitor:
    """Sees the steps that hold a record of its kinds, and keeps what it needs of them."""

    kinds: tuple[str, ...] = ()  # none: every step

    def __init__(self, limits: Limits, whole: bool) -> None:
        """Watch a flight from its beginning, or one of which the past is not known: what is not known is allowed."""
        self.limits = limits
        self.whole = whole

    def resume(self, state: State) -> None:
        """Take over what a start found; most know enough without."""

    def look(self, step: Step) -> Said:
        """Yield what the step broke."""
        raise NotImplementedError


def moves_of(step: Step, chart: str) -> list[Moved]:
    """Return the moves of a chart in a step."""
    messages = (record.message for record in step)
    return [change for change in messages if isinstance(change, Moved) and change.chart == chart]


def is_forgotten(limits: Limits, judged_ns: int | None, now_ns: int) -> bool:
    """Whether an order that was judged then need not be remembered any more."""
    return judged_ns is not None and now_ns >= judged_ns + limits.dedup_keep_ms * NS_PER_MS


def key_of(principal_id: str, command_id: str) -> str:
    """Return how moves name an order."""
    return f"{principal_id}/{command_id}"


def order_of(record: Record) -> str | None:
    """Return the order that a vehicle effect serves, "" for the node's own wish, None for another record."""
    effect = record.message
    served = isinstance(effect, PointAtPlace | PointAtAngles | ReleasePointing | SetZoom | FlyToPlace | SetVehicleMode)
    return effect.order if served else None  # type: ignore[attr-defined]
