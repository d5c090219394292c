"""The watch: shows each step to the monitors that it concerns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from events.kinds import KINDS, Role
from events.records import NO_CAUSE, Record
from events.schema.flight_pb2 import FlightOpened, Limits
from statecharts.monitors.cameras import CAMERAS
from statecharts.monitors.failsafes import Failsafes
from statecharts.monitors.findings import FINDINGS
from statecharts.monitors.missions import Missions
from statecharts.monitors.monitor import Monitor
from statecharts.monitors.moves import MovesJoin
from statecharts.monitors.orders import ORDERS
from statecharts.monitors.patience import Patience
from statecharts.monitors.vehicle import VEHICLE
from statecharts.state import State


class Breach(NamedTuple):
    """A property that a step broke."""

    name: str
    words: str
    seq: int  # of the step's observation


class Watch:
    """Watches one flight."""

    def __init__(self, state: State | None = None) -> None:
        """Watch from the manifest on; or from a start on, where the state is the one that the start found."""
        whole = state is None
        limits = Limits() if state is None else state.flight.limits
        own: tuple[type[Monitor], ...] = (*CAMERAS, *FINDINGS, *VEHICLE, Failsafes, Missions, Patience)
        kinds: tuple[type[Monitor], ...] = (MovesJoin, *ORDERS, *own)
        self._monitors = [kind(limits, whole) for kind in kinds]
        self._masks: dict[str, int] = {}
        for place, monitor in enumerate(self._monitors):
            for name in monitor.kinds or [kind.name for kind in KINDS]:
                self._masks[name] = self._masks.get(name, 0) | 1 << place
        self._numbered = [(1 << place, monitor) for place, monitor in enumerate(self._monitors)]
        self._next_seq = 0 if state is None else state.next_seq.value
        if state is not None:
            for monitor in self._monitors:
                monitor.resume(state)

    def see(self, step: Sequence[Record]) -> list[Breach]:
        """Return what an observation and its decisions broke; of one property and step it is told once."""
        if isinstance(opened := step[0].message, FlightOpened):
            for monitor in self._monitors:
                monitor.limits = opened.configuration.limits
        mask = 0
        for record in step:
            mask |= self._masks.get(record.kind.name, 0)
        found = [Breach("in_order", words, step[0].seq) for words in self._out_of_order(step)]
        for place, monitor in self._numbered:
            if mask & place:
                found += [Breach(name, words, step[0].seq) for name, words in monitor.look(step)]
        return found

    def _out_of_order(self, step: Sequence[Record]) -> Iterator[str]:
        """Records follow each other without a gap; a decision has its step's moment and an earlier cause in it."""
        first = step[0]
        if first.cause != NO_CAUSE or first.kind.role is not Role.OBSERVATION:
            yield f"step {first.seq} does not begin with an observation"
        for record in step:
            if record.seq != self._next_seq:
                yield f"record {record.seq} comes where {self._next_seq} should"
            if record is not first and (record.at != first.at or not first.seq <= record.cause < record.seq):
                yield f"record {record.seq} does not follow from its step"
            self._next_seq = record.seq + 1
