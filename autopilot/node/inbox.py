"""The inbox: everything that can happen to the node waits here, bounded by class (design, section 3).

Frames and telemetry drop their oldest; orders and outcomes are refused when there is no room, so that whoever offers
them can say so, or offer again. What is lost is counted. It decides nothing and keeps no order between classes: what
waits is taken orders first.
"""

from __future__ import annotations

import threading
from collections import deque

from google.protobuf.message import Message

from autopilot.ports.config import LimitsSection
from autopilot.ports.edges import Clock, InputClass
from events.schema.orders_pb2 import OrderReceived

# Taken in this order: an order never waits behind a burst of frames.
_ORDER_OF_TAKING = (InputClass.ORDER, InputClass.OUTCOME, InputClass.TELEMETRY, InputClass.FRAME)
_DROPS_OLDEST = frozenset({InputClass.TELEMETRY, InputClass.FRAME})
# An outcome that is refused is offered again; whatever else does not get in is gone.
_COUNTED = (InputClass.ORDER, InputClass.TELEMETRY, InputClass.FRAME)


class Inbox:
    """Bounded queues with one door. Any thread may offer; one thread takes."""

    def __init__(self, limits: LimitsSection, clock: Clock) -> None:
        self._clock = clock
        self._stall_ns = int(limits.commit_stall_s * 1e9)
        self._bounds = {
            InputClass.ORDER: limits.inbox_orders,
            InputClass.OUTCOME: limits.inbox_outcomes,
            InputClass.TELEMETRY: limits.inbox_telemetry,
            InputClass.FRAME: limits.inbox_frames,
        }
        self._queues: dict[InputClass, deque[tuple[int, Message]]] = {each: deque() for each in _ORDER_OF_TAKING}
        self._dropped = dict.fromkeys(_COUNTED, 0)
        self._something = threading.Condition()
        self._woken = False
        self._closed_to_orders = False
        self._slow = False
        self._committing_since_ns: int | None = None

    def offer(self, input_class: InputClass, observation: Message) -> bool:
        """Take an observation in; see `ports.edges.Offer`."""
        with self._something:
            queue = self._queues[input_class]
            full = len(queue) >= self._bounds[input_class]
            lost = full or (input_class is InputClass.ORDER and self._refuses_orders())
            if lost and input_class in _COUNTED:
                self._dropped[input_class] += 1
            if lost and input_class not in _DROPS_OLDEST:
                return False
            if lost:
                queue.popleft()
            queue.append((self._clock.mono_ns(), observation))
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
                    came_ns, observation = queue.popleft()
                    _age(observation, self._clock.mono_ns() - came_ns)
                    taken.append(observation)
            return taken

    def take_dropped(self) -> dict[InputClass, int]:
        """Return what was dropped or refused for good since the last call, classes with nothing left out."""
        with self._something:
            dropped = {each: count for each, count in self._dropped.items() if count}
            self._dropped = dict.fromkeys(_COUNTED, 0)
        return dropped

    def wake(self) -> None:
        """Make a waiting `take` return."""
        with self._something:
            self._woken = True
            self._something.notify()

    def close_to_orders(self) -> None:
        """Take no more orders: the node is about to end."""
        self._closed_to_orders = True

    def commit_began(self) -> None:
        """Note that the disk is at work; from `commit_stall_s` on orders are refused, also while it still is."""
        self._committing_since_ns = self._clock.mono_ns()

    def commit_ended(self) -> None:
        """Note that the disk is done; after a slow commit orders are refused until one is quick."""
        since_ns, self._committing_since_ns = self._committing_since_ns, None
        self._slow = since_ns is not None and self._clock.mono_ns() - since_ns > self._stall_ns

    def disk_rested(self) -> None:
        """Note that the disk had time to recover; where it did not, the next commit says so."""
        self._slow = False

    @property
    def empty(self) -> bool:
        """Whether nothing waits."""
        return not any(self._queues.values())

    def has_room(self, input_class: InputClass) -> bool:
        """Whether less than half of a class's queue is taken: for a source that can wait."""
        return len(self._queues[input_class]) * 2 < self._bounds[input_class]

    def _refuses_orders(self) -> bool:
        since_ns = self._committing_since_ns
        stalls = since_ns is not None and self._clock.mono_ns() - since_ns > self._stall_ns
        return self._closed_to_orders or self._slow or stalls


def _age(observation: Message, waited_ns: int) -> None:
    """Take the time in the inbox off an order's lives: they count from its record, which is still to be made."""
    waited_ms = -(-waited_ns // 1_000_000)
    if isinstance(observation, OrderReceived):
        observation.life_ms = max(observation.life_ms - waited_ms, 0)
