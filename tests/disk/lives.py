"""A node's life on a disk, driven by hand: the real loop, flights and seal, a clock that the test moves, no threads."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from random import Random
from unittest.mock import patch

from google.protobuf.message import Message

from autopilot.node.flights import Flights, Session
from autopilot.node.loop import NodeLoop, Stop
from autopilot.node.sealing import Sealer
from autopilot.ports.config import Config
from autopilot.ports.edges import InputClass
from events import Record
from events.kinds import Role
from events.schema.orders_pb2 import OrderReceived
from events.store import Head, SqliteStore, StoreFailed, reserve, sqlite
from tests.autopilot.node.nodes import FakeClock, PatientInbox, config, heard_vehicle, identity, vehicle_state
from tests.autopilot.trust.world import people
from tests.disk.promises import Committed, Performed, Promise, Sealed, print_of
from tests.flights import answered, frame, point_at_place, position, published
from tests.monitors import order_of

Witness = Callable[[Promise], None]
ORDERS = 6
# Small, so that a short life moves its WAL into the database several times, and a start costs little.
IDLE_PAGES, RESERVE_BYTES = 14, 1 << 16


@cache
def settings() -> Config:
    """Return the configuration of every life."""
    return config(flight={"close_after_s": 5})


@contextmanager
def small() -> Iterator[None]:
    """Let the log move its WAL early and reserve little."""
    with patch.object(sqlite, "IDLE_PAGES", IDLE_PAGES), patch.object(reserve, "RESERVE_BYTES", RESERVE_BYTES):
        yield


@contextmanager
def folder() -> Iterator[Path]:
    """Lend an empty folder, in memory where the system has one."""
    memory = "/dev/shm"
    with tempfile.TemporaryDirectory(prefix="disk-", dir=memory if os.access(memory, os.W_OK) else None) as made:
        yield Path(made)


@contextmanager
def witnessed(witness: Witness) -> Iterator[None]:
    """Tell `witness` of every commit of records and checkpoints, when it has returned."""
    append, add_checkpoint = SqliteStore.append, SqliteStore.add_checkpoint

    def appended(store: SqliteStore, records: Sequence[Record]) -> Head:
        head = append(store, records)
        synced = sum(record.kind.sync or record.kind.role is Role.EFFECT for record in records)
        if records:
            witness(Committed(store.flight_id, records[0].seq, b"".join(map(print_of, records)), synced))
        return head

    def added(store: SqliteStore, size: int, note: str) -> None:
        add_checkpoint(store, size, note)
        witness(Sealed(store.flight_id, size))

    with patch.object(SqliteStore, "append", appended), patch.object(SqliteStore, "add_checkpoint", added):
        yield


@dataclass
class Life:
    """One process of the node, from start to end."""

    root: Path
    clock: FakeClock
    random: Random
    witness: Witness
    boot_id: str
    loop_of: type[NodeLoop] = NodeLoop
    performed: list[Record] = field(default_factory=list)
    sessions: list[Session] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Make the loop; nothing is opened yet."""
        sealer = Sealer(people().wasp, self.clock, self.random.randbytes)
        self.flights = Flights(self.root, identity(self.boot_id, settings()), self.clock, self.random.randbytes, sealer)
        self.inbox = PatientInbox(settings().limits, self.clock)
        self.loop = self.loop_of(
            self.flights,
            self.inbox,
            self.clock,
            settings().limits,
            close_after_s=settings().flight.close_after_s,
            on_session=self.sessions.append,
            on_records=lambda _: None,
            perform=self._perform,
            on_end=lambda: None,
        )

    @property
    def session(self) -> Session:
        """The open session."""
        return self.sessions[-1]

    def start(self) -> Life:
        """Open a flight, as the loop's thread does first."""
        self.loop._open(self.flights.open(lambda _: None))
        return self

    def turn(self, after_ms: int = 0) -> None:
        """Let time pass and go round once."""
        self.clock.pass_ms(after_ms)
        self.loop._turn(self.session)

    def tell(self, *observations: Message, after_ms: int = 0) -> None:
        """Offer observations and go round once."""
        for observation in observations:
            orders = isinstance(observation, OrderReceived)
            self.inbox.offer(InputClass.ORDER if orders else InputClass.OUTCOME, observation)
        self.turn(after_ms)

    def stop(self) -> None:
        """End as the daemon does at SIGTERM."""
        self.loop._finish(self.session, Stop())

    def let_go(self) -> None:
        """Close the connections: what that does to the disk is nobody's business any more."""
        for session in self.sessions:
            with suppress(StoreFailed):
                session.store.close()

    def outcomes(self, *ports: str, newest: int | None = None) -> list[Message]:
        """Return a good outcome of what was performed on these ports, or of the newest alone; more than once, too."""
        asked = [record for record in self.performed if record.kind.port in ports]
        seqs = [(record.kind.port, record.seq) for record in asked[-(newest or len(asked) or 1) :]]
        return [answered(seq) if port == "vehicle" else published(seq) for port, seq in seqs]

    def _perform(self, record: Record) -> None:
        self.performed.append(record)
        flight = self.session.store.flight_id
        self.witness(Performed(flight, record.seq, print_of(record), order_of(record)))


def order(number: int, send: int = 1) -> OrderReceived:
    """Return an operator's order; each looks elsewhere."""
    return point_at_place(f"a{number}", 1000 * number, 2000, order_seq=number, send=send)


def live(life: Life, chance: Random, orders: Sequence[int]) -> None:
    """Arm, take orders, see things, and land or not; what is answered, in time or at all, is chance."""
    life.tell(*heard_vehicle(), after_ms=50)
    for number in orders:
        life.tell(order(number), after_ms=chance.choice([20, 700]))
        if chance.random() < 0.7:
            life.tell(*life.outcomes("vehicle", newest=1), after_ms=40)
        if chance.random() < 0.7:
            life.tell(*life.outcomes("mesh", newest=1), after_ms=30)
        for seen in range(chance.randrange(3)):
            life.tell(position(100 * seen, 200), frame(number * 10 + seen), after_ms=chance.choice([20, 110]))
        life.turn(after_ms=chance.choice([150, 1200, 11_000]))


def land(life: Life, chance: Random) -> None:
    """Disarm and wait until the flight is over and the next one has begun; sometimes an outcome never comes."""
    answered_all = chance.random() < 0.8
    life.tell(*life.outcomes("vehicle"), vehicle_state(armed=False), after_ms=40)
    for _ in range(4):
        life.tell(*(life.outcomes("mesh") if answered_all else ()), after_ms=chance.choice([1_300, 2_600]))
