"""What the schedules of a relay happen to: events in the order of their time, links into the relay, and the node.

The node is the mesh adapter (gate, packer, outbox) over the charts and the log in memory; its vehicle is a stub that
answers as the seed has it.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from random import Random

from google.protobuf.message import Message

from autopilot.adapters.mesh.adapter import MeshAdapter
from autopilot.ports.config import MeshSection
from autopilot.ports.edges import InputClass
from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import TimePassed
from events.schema.orders_pb2 import SendAck
from events.schema.vehicle_pb2 import PointAtAngles
from statecharts.charts.command import FINAL
from tests import flights
from tests.autopilot.trust.world import NOW_MS, FakeClock, FakeWire, people
from tests.flights import NS_PER_MS, Flight

ENDS_MS = 200_000  # every life, delay and deadline of a schedule lies before


@dataclass(eq=False)
class Skewed(FakeClock):
    """The node's clock: the world's, and so much off."""

    world: FakeClock = field(default_factory=FakeClock)
    off_ms: int = 0

    def mono_ns(self) -> int:
        """Monotonic nanoseconds."""
        return self.world.mono_ns()

    def wall_ns(self) -> int:
        """Wall nanoseconds."""
        return self.world.wall_ns() + self.off_ms * NS_PER_MS


class RelayedWire(FakeWire):
    """A link that hands what is put on it to the relay."""

    def __init__(self, carry: Callable[[str, bytes], None]) -> None:
        super().__init__()
        self._carry = carry

    def put(self, key_expr: str, payload: bytes, *, urgent: bool) -> None:
        """Hand it over."""
        self._carry(key_expr, payload)


class Events:
    """What will happen, in the order of its time."""

    def __init__(self, clock: FakeClock) -> None:
        self._clock, self._numbers = clock, count()
        self._waiting: list[tuple[int, int, Callable[[], None]]] = []

    def after(self, delay_ms: int, act: Callable[[], None]) -> None:
        """Let something happen so many milliseconds from now."""
        heapq.heappush(self._waiting, (self._clock.now_ms + max(delay_ms, 0), next(self._numbers), act))

    def run(self, then: Callable[[], None]) -> None:
        """Let everything happen, and `then` after each."""
        while self._waiting and self._waiting[0][0] <= NOW_MS + ENDS_MS:
            self._clock.now_ms, _, act = heapq.heappop(self._waiting)
            act()
            then()


class Node:
    """The node: adapter, charts, log, and a vehicle that is a stub."""

    def __init__(self, events: Events, clock: Skewed, carry: Callable[[str, bytes], None], random: Random) -> None:
        self._events, self._clock, self._random = events, clock, random
        wasp = people().wasp
        bounds = flights.limits(camera_roles=["operator"])
        opening = flights.opened_well(bounds)
        opening[0].node_public_key = wasp.public_key  # type: ignore[attr-defined]
        self.flight = Flight(*opening)
        self._began_ns, self._told_due = clock.mono_ns(), -1
        self.adapter = MeshAdapter(
            MeshSection(), wasp, clock, lambda *_: None, self._offer, wire=RelayedWire(carry), random=random.randbytes
        )
        self._inbox: list[Message] = []
        self.delivered = 0
        self.performed: list[tuple[int, PointAtAngles]] = []  # when, in the world's milliseconds

    def receive(self, key_expr: str, payload: bytes) -> None:
        """Take a sample from the relay, and do all that follows from it."""
        self.delivered += 1
        self.adapter.receive(key_expr, payload)
        self._work()

    def said(self) -> dict[str, list[str]]:
        """Return the last words of each order, as often as there was one."""
        found: dict[str, list[str]] = {}
        for record in self.flight.records:
            move = record.message
            if isinstance(move, Moved) and move.chart == "command" and move.to_state in FINAL:
                found.setdefault(move.instance, []).append(move.to_state)
        return found

    def _offer(self, input_class: InputClass, observation: Message) -> bool:
        assert input_class in (InputClass.ORDER, InputClass.OUTCOME)
        self._inbox.append(observation)
        return True

    def _work(self) -> None:
        while self._inbox:
            self._tell(self._inbox.pop(0))
            self.adapter._outbox.turn()

    def _tell(self, observation: Message) -> None:
        self.flight.now_ns = self._clock.mono_ns() - self._began_ns
        for record in self.flight.tell(observation):
            if isinstance(record.message, SendAck):
                self.adapter.perform(record.seq, record.message, self._clock.mono_ns())
            elif isinstance(record.message, PointAtAngles):
                self._perform(record.seq, record.message)
        due = self.flight.due
        if due is not None and due != self._told_due:
            self._told_due = due
            self._events.after(-(-(due - self.flight.now_ns) // NS_PER_MS), self._pass_time)

    def _pass_time(self) -> None:
        now_ns = self._clock.mono_ns() - self._began_ns
        if self.flight.due is not None and self.flight.due <= now_ns:
            self._inbox.append(TimePassed())
            self._work()

    def _perform(self, seq: int, effect: PointAtAngles) -> None:
        """Be the vehicle: it moves at once, and says so in its own time, or not."""
        self.performed.append((self._clock.world.now_ms, effect))
        answers: list[tuple[int, Message]] = [(0, flights.sent(seq))]
        match self._random.randrange(10):
            case 0:
                answers.append((2_000, flights.unanswered(seq)))
            case 1:
                answers += [
                    (100, flights.answered(seq, 5)),
                    (self._random.randrange(200, 8_000), flights.answered(seq)),
                ]
            case 2:
                answers.append((30, flights.answered(seq, 2)))
            case 3:
                pass
            case _:
                answers.append((self._random.randrange(1, 300), flights.answered(seq)))
        for delay_ms, answer in answers:
            self._events.after(delay_ms, lambda answer=answer: self._hear(answer))  # type: ignore[misc]

    def _hear(self, answer: Message) -> None:
        self._inbox.append(answer)
        self._work()
