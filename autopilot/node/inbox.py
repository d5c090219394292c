"""The inbox: everything that can happen to the node waits here, bounded by class (design, section 3).

Frames and telemetry drop their oldest and are counted; orders and outcomes are refused when there is no room, so
that whoever offers them can say so, or offer again. It decides nothing and keeps no order between classes: what
waits is taken orders first.
"""

from __future__ import annotations

import threading
from collections import deque

from google.protobuf.message import Message

from autopilot.ports.config import LimitsSection
from autopilot.ports.edges import InputClass

# Taken in this order: an order never waits behind a burst of frames.
_ORDER_OF_TAKING = (InputClass.ORDER, InputClass.OUTCOME, InputClass.TELEMETRY, InputClass.FRAME)
_DROPS_OLDEST = frozenset({InputClass.TELEMETRY, InputClass.FRAME})


class Inbox:
    """Bounded queues with one door. Any thread may offer; one thread takes."""

    def __init__(self, limits: LimitsSection) -> None:
        self._bounds = {
            InputClass.ORDER: limits.inbox_orders,
            InputClass.OUTCOME: limits.inbox_outcomes,
            InputClass.TELEMETRY: limits.inbox_telemetry,
            InputClass.FRAME: limits.inbox_frames,
        }
        self._queues: dict[InputClass, deque[Message]] = {each: deque() for each in _ORDER_OF_TAKING}
        self._dropped = dict.fromkeys(_DROPS_OLDEST, 0)
        self._something = threading.Condition()
        self._woken = False
        self._refuses_orders = False

    def offer(self, input_class: InputClass, observation: Message) -> bool:
        """Take an observation in; see `ports.edges.Offer`."""
        with self._something:
            queue = self._queues[input_class]
            if input_class is InputClass.ORDER and self._refuses_orders:
                return False
            if len(queue) >= self._bounds[input_class]:
                if input_class not in _DROPS_OLDEST:
                    return False
                queue.popleft()
                self._dropped[input_class] += 1
            queue.append(observation)
            self._something.notify()
        return True

    def take(self, timeout_s: float | None, most: int) -> list[Message]:
        """Return at most `most` observations, waiting up to `timeout_s` for the first; empty on a wake or timeout."""
        with self._something:
            if not self._woken and not any(self._queues.values()) and (timeout_s is None or timeout_s > 0):
                self._something.wait(timeout_s)
            self._woken = False
            taken: list[Message] = []
            for each in _ORDER_OF_TAKING:
                queue = self._queues[each]
                while queue and len(taken) < most:
                    taken.append(queue.popleft())
            return taken

    def take_dropped(self) -> dict[InputClass, int]:
        """Return what was dropped since the last call, classes with nothing dropped left out."""
        with self._something:
            dropped = {each: count for each, count in self._dropped.items() if count}
            self._dropped = dict.fromkeys(_DROPS_OLDEST, 0)
        return dropped

    def wake(self) -> None:
        """Make a waiting `take` return."""
        with self._something:
            self._woken = True
            self._something.notify()

    def refuse_orders(self, refuse: bool) -> None:
        """Close or open the door for orders: closed while the disk does not keep up."""
        with self._something:
            self._refuses_orders = refuse

    def has_room(self, input_class: InputClass) -> bool:
        """Whether less than half of a class's queue is taken: for a source that can wait."""
        return len(self._queues[input_class]) * 2 < self._bounds[input_class]
