"""A node without its world: loop, flights and inbox on a clock that the test moves, one turn at a time.

Nothing here runs in a thread or waits; the log is a real one in a folder of the test. The store can be told to be
slow or to fail, and it keeps in one list what was written and what was performed, in their order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from google.protobuf.message import Message

from autopilot.node import flights as flights_module
from autopilot.node.flights import Flights, Identity, Session
from autopilot.node.inbox import Inbox
from autopilot.node.limits import configuration_message
from autopilot.node.loop import NodeLoop
from autopilot.ports.config import Config
from autopilot.ports.edges import InputClass
from events import Record
from events.records import read_record
from events.schema.flight_pb2 import OriginSet
from events.schema.vehicle_pb2 import VehicleLinkChanged, VehicleStateReported
from events.store import Head, SqliteStore, StoreFailed, flights_in, read_flight
from events.store.flights import Flight
from statecharts import LOGIC, logic
from tests.checks import is_rung
from tests.flights import NODE_KEY, place

NS_PER_MS = 1_000_000
BOOT = "boot-1"


@dataclass
class FakeClock:
    """A clock that moves when it is told to."""

    mono: int = 50_000_000_000
    wall: int = 1_790_000_000_000_000_000

    def mono_ns(self) -> int:
        """Nanoseconds since this boot."""
        return self.mono

    def wall_ns(self) -> int:
        """Nanoseconds since 1970."""
        return self.wall

    def pass_ms(self, milliseconds: float) -> None:
        """Let time pass."""
        self.mono += int(milliseconds * NS_PER_MS)
        self.wall += int(milliseconds * NS_PER_MS)


class PatientInbox(Inbox):
    """An inbox that remembers how long it was to wait, and never does."""

    wanted_s: float | None = None

    def take(self, timeout_s: float | None, most: int) -> list[Message]:
        """Return what is there."""
        self.wanted_s = timeout_s
        return super().take(0, most)


@dataclass
class Disk:
    """How the store behaves, and everything that happened, in order: "append 3-7", "perform 4"."""

    clock: FakeClock
    takes_ms: float = 0
    fails_at: int | None = None  # number of the append, from 0, that fails
    appends: int = 0
    happened: list[str] = field(default_factory=list)


class ToldStore:
    """A real store that does what the disk is told."""

    def __init__(self, store: SqliteStore, disk: Disk) -> None:
        self._store, self._disk = store, disk

    def __getattr__(self, name: str) -> Any:
        return getattr(self._store, name)

    def append(self, records: Sequence[Record]) -> Head:
        """Write, late or not at all."""
        self._disk.clock.pass_ms(self._disk.takes_ms)
        number, self._disk.appends = self._disk.appends, self._disk.appends + 1
        if number == self._disk.fails_at:
            raise StoreFailed("the disk is full, for a test")
        head = self._store.append(records)
        self._disk.happened.append(f"append {records[0].seq}-{records[-1].seq}")
        return head


def config(**sections: dict[str, Any]) -> Config:
    """Return a configuration that takes orders from role "camera"."""
    given = {"node": {"keys": "k", "flights": "f", "projections": "p"}}
    taken = {"command": {"enabled": True, "camera_roles": ["camera"], "roi_turns_vehicle": "warn"}}
    return Config.model_validate(given | taken | sections)


def identity(boot_id: str = BOOT, settings: Config | None = None) -> Identity:
    """Return what the node's manifest says."""
    return Identity(
        node="node-1",
        public_key=NODE_KEY,
        deployment_id="test",
        software="0.1.0",
        boot_id=boot_id,
        configuration=configuration_message(settings or config()),
    )


def chance() -> Callable[[int], bytes]:
    """Return a source of bytes that differ and are the same in every run."""
    counter = iter(range(1, 256))
    return lambda length: bytes([next(counter)]) * length


class Node:
    """A node's loop, driven by hand. Another one on the same folder is the next start of the daemon."""

    def __init__(
        self,
        root: Path,
        clock: FakeClock,
        monkeypatch: pytest.MonkeyPatch,
        *,
        settings: Config | None = None,
        boot_id: str = BOOT,
        random: Callable[[int], bytes] | None = None,
        outage_longest_h: float = 24.0,
    ) -> None:
        self.root, self.clock, self.disk = root, clock, Disk(clock)
        settings = settings or config()
        _tell_stores(monkeypatch, self.disk)
        self.inbox = PatientInbox(settings.limits, clock)
        self.flights = Flights(
            root, identity(boot_id, settings), clock, random or chance(), outage_longest_h=outage_longest_h
        )
        self.heard: list[Record] = []
        self.sessions: list[Session] = []
        self.performed: list[Record] = []
        self.ended = False
        self.loop = NodeLoop(
            self.flights,
            self.inbox,
            clock,
            settings.limits,
            close_after_s=settings.flight.close_after_s,
            on_session=self.sessions.append,
            on_records=self.heard.extend,
            perform=self._perform,
            on_end=self._end,
        )

    @property
    def session(self) -> Session:
        """The session that is recorded in."""
        return self.sessions[-1]

    def start(self) -> Node:
        """Open a flight, as the loop's thread does first."""
        self.loop._open(self.flights.open(self.heard.extend))
        return self

    def turn(self, after_ms: float = 0) -> None:
        """Let time pass and go round once."""
        self.clock.pass_ms(after_ms)
        self.loop._turn(self.session)

    def tell(self, *observations: Message, input_class: InputClass = InputClass.OUTCOME, after_ms: float = 0) -> None:
        """Offer observations and go round once."""
        for observation in observations:
            assert self.inbox.offer(input_class, observation)
        self.turn(after_ms)

    def kill(self) -> None:
        """Let go of the log without a word, as a dead process does."""
        self.session.store.close()

    def log(self, number: int = -1) -> list[Record]:
        """Return what is durable in a flight."""
        return log_of(flights_in(self.root)[number])

    def kinds(self, number: int = -1) -> list[str]:
        """Return the kinds of what is durable in a flight."""
        return [record.kind.name for record in self.log(number)]

    def _perform(self, record: Record) -> None:
        if not is_rung(record):
            self.performed.append(record)
        self.disk.happened.append(f"perform {record.seq}")

    def _end(self) -> None:
        self.ended = True


def log_of(flight: Flight) -> list[Record]:
    """Return a flight's records, read through a connection of its own."""
    reader = read_flight(flight.folder)
    try:
        return [read_record(stored) for stored in reader.stored()]
    finally:
        reader.close()


def heard_vehicle(*, armed: bool = True) -> tuple[Message, ...]:
    """Return what a vehicle that is there makes the node observe."""
    state = VehicleStateReported(vehicle=1, system_id=1, autopilot=3, vehicle_type=2, armed=armed, custom_mode=4)
    return OriginSet(place=place(0, 0), source="configured"), VehicleLinkChanged(vehicle=1, up=True), state


def vehicle_state(*, armed: bool) -> VehicleStateReported:
    """Return a heartbeat's news."""
    return VehicleStateReported(vehicle=1, system_id=1, autopilot=3, vehicle_type=2, armed=armed, custom_mode=4)


def of_kind(records: Sequence[Record], kind: str) -> Iterator[Any]:
    """Yield the messages of one kind."""
    return (record.message for record in records if record.kind.name == kind)


def _tell_stores(monkeypatch: pytest.MonkeyPatch, disk: Disk) -> None:
    from events.store import create_flight, open_flight

    def create(root: Path, number: int, flight_id: bytes, secret: bytes) -> tuple[Flight, ToldStore]:
        flight, store = create_flight(root, number, flight_id, secret)
        return flight, told(store)

    def told(store: SqliteStore) -> ToldStore:
        store._connection.pragma("synchronous", 0)  # no power is cut here, and the tests are many
        return ToldStore(store, disk)

    monkeypatch.setattr(flights_module, "create_flight", create)
    monkeypatch.setattr(flights_module, "open_flight", lambda flight: told(open_flight(flight)))


def update(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the software be one of a later logic."""
    monkeypatch.setattr(flights_module, "LOGIC", LOGIC + 1)
    monkeypatch.setattr(logic, "LOGIC", LOGIC + 1)
