"""The monitors in flight: what this node decides is watched as soon as it is done (`statecharts.monitors`).

They look at a step when it is durable and its effects have left, for an order should not wait for those who only watch.
A node that is killed in between says nothing of it; who runs its log again finds the same. A property that is broken is
told once in a flight and start, as an observation in the log, and on standard error; the node flies on, for nobody is
helped by one that stops. Nothing here can stop it either.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Sequence

from events.records import Record
from events.schema.safety_pb2 import PropertyBroken
from statecharts import State
from statecharts.monitors import Watch

MONITORS = "monitors"


class Watching:
    """Watches one session. On the node's thread."""

    def __init__(self, state: State) -> None:
        """Watch from here on; the state is that of the session."""
        self._watch: Watch | None = Watch(state)
        self._told: set[str] = set()

    def see(self, step: Sequence[Record]) -> list[PropertyBroken]:
        """Return what the log is to be told of a step."""
        if self._watch is None:
            return []
        try:
            found = self._watch.see(step)
        except Exception:  # noqa: BLE001 - a monitor that fails must not take the node with it; that it fails is told
            self._watch = None
            print(f"autopilot: the monitors stopped:\n{traceback.format_exc()}", file=sys.stderr, flush=True)
            words = "they stopped: what this node decides is not watched until it starts again"
            return [PropertyBroken(property=MONITORS, words=words, at_seq=step[0].seq)]
        told = []
        for breach in found:
            if breach.name not in self._told:
                self._told.add(breach.name)
                told.append(PropertyBroken(property=breach.name, words=breach.words, at_seq=breach.seq))
                print(f"autopilot: property {breach.name} is broken: {breach.words}", file=sys.stderr, flush=True)
        return told
