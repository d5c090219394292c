"""Where a flight begins, goes on and ends (design, section 4). Runs on the node's thread only.

Before a log is opened for writing it is examined; a damaged one stays as it was found, and the flight that is begun in
its place names its head. A start goes on with the open flight when it is of this boot and this logic. Otherwise the
open flight is closed with its reason, and the next one begins with a manifest and the baseline that the last one hands
over. Flight time is not joined across boots here: another boot begins another flight.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from google.protobuf.message import Message

from autopilot.node.clock import FlightClock
from autopilot.node.restoring import Keeper, Resuming
from autopilot.node.sealing import Known, Sealer, Sealing
from autopilot.ports.edges import Clock
from events.chain import SECRET_BYTES
from events.records import NO_CAUSE, Moment, Record, make_record, read_record
from events.schema import flight_pb2
from events.schema.state_pb2 import CarriedState
from events.schema.vehicle_pb2 import VehicleStateReported
from events.store import Appender, Flight, StoreFailed, create_flight, flights_in, open_flight
from events.store.recovery import Action, Finding, KeptLog, examine
from statecharts import LOGIC, State, carry_over, charts_digest, restore, step, steps_of

RandomBytes = Callable[[int], bytes]
OnRecords = Callable[[tuple[Record, ...]], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """What a manifest says of the node itself."""

    node: str
    public_key: bytes
    deployment_id: str
    software: str
    boot_id: str
    configuration: flight_pb2.Configuration
    models: tuple[flight_pb2.Model, ...] = ()


@dataclass(slots=True)
class Session:
    """The open flight: its log, its state, its clock."""

    flight: Flight
    store: Appender
    state: State
    clock: FlightClock
    due: int | None = None
    closed: bool = False
    kept: bool = False  # it, or a flight after it, is damaged: nothing more is written in it
    started: flight_pb2.NodeStarted = field(default_factory=flight_pb2.NodeStarted)
    last: Moment | None = None
    logic: int = LOGIC
    flown: bool = False  # the vehicle was armed in this flight
    sealing: Sealing | None = None  # None: nobody signs what this node records
    known: Known | None = None  # where it was started from a snapshot
    fresh: list[Record] = field(default_factory=list)  # recorded while opening: their effects are still to be performed

    def observe(self, observation: Message) -> tuple[Record, ...]:
        """Take an observation through the core and return the records, which are not durable yet."""
        record = make_record(self.state.next_seq.value, NO_CAUSE, self.clock.now(), observation)
        result = step(self.state, record)
        self.due = result.due
        return result.records


class Flights:
    """Opens, continues and ends the flights of a node."""

    def __init__(
        self,
        root: Path,
        identity: Identity,
        clock: Clock,
        random_bytes: RandomBytes = os.urandom,
        sealer: Sealer | None = None,
        keeper: Keeper | None = None,
    ) -> None:
        self._root = root
        self._identity = identity
        self._clock = clock
        self._random = random_bytes
        self._sealer = sealer
        self._keeper = keeper

    def open(self, on_records: OnRecords) -> Session:
        """Return the session to record in; what is in its log is told to `on_records` first.

        That is everything, or what follows the snapshot that it is started from.

        Raises StoreFailed, and UnknownKind or BodyBroken for a log of a newer version.
        """
        flights = flights_in(self._root)
        number = flights[-1].number + 1 if flights else 1
        last, found = self._last(flights, on_records)
        if last is None or last.kept:
            return self._begin(number, last, on_records, found)
        if not last.closed and (reason := self._why_not_go_on(last)) is not None:
            self.close(last, reason, on_records)
        if last.closed:
            return self._begin(number, last, on_records, found)
        return self._go_on(last, on_records, found)

    def close(self, session: Session, reason: flight_pb2.CloseReason.ValueType, on_records: OnRecords) -> None:
        """Record the end of a flight. Everything before must be durable already. Raises StoreFailed."""
        self._record(session, [flight_pb2.FlightClosed(reason=reason)], on_records)
        session.closed = True
        if session.sealing is None and self._sealer is not None:
            session.sealing = self._sealer.reopen(session.flight, session.store, session.state, session.known)
            self._keep(session)
        if session.sealing is not None:
            session.sealing.close(session.clock.peek_ns())

    def follow(self, session: Session, on_records: OnRecords) -> Session:
        """Begin the flight after a closed one and let go of that one's log."""
        return self._begin(session.flight.number + 1, session, on_records)

    def _last(self, flights: list[Flight], on_records: OnRecords) -> tuple[Session | None, list[Message]]:
        """Return the newest flight that has records, and what its opening log is to be told of what was found."""
        found: list[Message] = []
        for flight in reversed(flights):
            resuming = None if self._keeper is None else self._keeper.resuming(flight)
            finding = examine(flight.folder, None if resuming is None else resuming.vouched)
            match finding.action:
                case Action.REFUSE:
                    raise StoreFailed(f"{flight.folder}: {finding.detail}")
                case Action.KEEP_AND_BEGIN:
                    found.append(_damaged(finding))
                case Action.CUT_AND_SAY | Action.GO_ON_AND_SAY:
                    found.append(_recovered(finding))
            if finding.end.seq >= 0:
                store = KeptLog(finding) if finding.action is Action.KEEP_AND_BEGIN else open_flight(flight)
                session = Session(flight, store, State(), FlightClock(self._clock, 1))
                self._load(session, on_records, resuming)
                session.kept = any(isinstance(one, flight_pb2.LogDamaged) for one in found)
                return session, found
        return None, found

    def _load(self, session: Session, on_records: OnRecords, resuming: Resuming | None) -> None:
        start = 0 if resuming is None else resuming.resume(session)
        for recorded in steps_of(map(read_record, session.store.stored(start))):
            session.due = restore(session.state, recorded)
            _note(session, recorded[0])
            on_records(recorded)
        if session.last is not None:
            session.clock = FlightClock(self._clock, self._boot_after(session, session.last), session.last)

    def _why_not_go_on(self, session: Session) -> flight_pb2.CloseReason.ValueType | None:
        if session.started.boot_id != self._identity.boot_id:
            return flight_pb2.CLOSE_REBOOTED
        armed = any(vehicle.armed for vehicle in session.state.vehicles.values())
        if session.logic != LOGIC and not armed:
            return flight_pb2.CLOSE_LOGIC_CHANGED
        return None

    def _go_on(self, session: Session, on_records: OnRecords, found: Sequence[Message]) -> Session:
        assert session.last is not None
        outage_ns = session.clock.now().flight_ns - session.last.flight_ns
        opening = [self._started(session.started.start + 1, outage_ns), *self._sealed(session), *found]
        self._record(session, opening, on_records)
        return session

    def _begin(
        self, number: int, before: Session | None, on_records: OnRecords, found: Sequence[Message] = ()
    ) -> Session:
        flight_id = self._random(16)
        flight, store = create_flight(self._root, number, flight_id, self._random(SECRET_BYTES))
        session = Session(flight, store, State(), FlightClock(self._clock, before.clock.boot if before else 1))
        carried = CarriedState()
        if before is not None and before.last is not None:
            carried = carry_over(before.state, before.last.flight_ns)
        opening = [self._manifest(number, flight_id, before), flight_pb2.BaselineCarried(state=carried)]
        self._record(session, [*opening, self._started(1, 0), *self._sealed(session), *found], on_records)
        if before is not None:
            before.store.close()
        return session

    def _sealed(self, session: Session) -> list[Message]:
        """Open the seal of a session; return what its log is to be told of it."""
        if self._sealer is None:
            return []
        sealing = session.sealing = self._sealer.open(session.flight, session.store, session.state, session.known)
        self._keep(session)
        refused = [flight_pb2.SealRefused(because=sealing.refusal)] if sealing.refusal else []
        return [flight_pb2.LogKeyCertified(certificate=sealing.certificate), *refused]

    def _keep(self, session: Session) -> None:
        if self._keeper is not None:
            self._keeper.keep(session)

    def _boot_after(self, session: Session, last: Moment) -> int:
        """Return the number of the present boot, which is the one after the log's where the kernel says so."""
        return last.boot + (session.started.boot_id != self._identity.boot_id)

    def _started(self, start: int, outage_ns: int) -> flight_pb2.NodeStarted:
        return flight_pb2.NodeStarted(boot_id=self._identity.boot_id, start=start, outage_ns=outage_ns)

    def _record(self, session: Session, observations: Sequence[Message], on_records: OnRecords) -> None:
        steps = [session.observe(observation) for observation in observations]
        session.store.append([record for records in steps for record in records])
        for records in steps:
            _note(session, records[0])
            on_records(records)
            session.fresh.extend(records)

    def _manifest(self, number: int, flight_id: bytes, before: Session | None) -> flight_pb2.FlightOpened:
        identity = self._identity
        manifest = flight_pb2.FlightOpened(
            flight_id=flight_id,
            flight_number=number,
            node=identity.node,
            node_public_key=identity.public_key,
            deployment_id=identity.deployment_id,
            software=identity.software,
            logic=LOGIC,
            charts_digest=charts_digest(),
            configuration=identity.configuration,
            models=identity.models,
            platform=f"{platform.system()} {platform.machine()}",
            python=platform.python_version(),
        )
        if before is not None:
            manifest.previous_flight_id = before.store.flight_id
            manifest.previous_seq, manifest.previous_leaf = before.store.head
        return manifest


def _note(session: Session, observation: Record) -> None:
    session.last = observation.at
    match observation.message:
        case flight_pb2.NodeStarted():
            session.started = observation.message
        case flight_pb2.FlightOpened():
            session.logic = observation.message.logic
        case flight_pb2.FlightClosed():
            session.closed = True
        case VehicleStateReported(armed=True):
            session.flown = True


def _recovered(finding: Finding) -> flight_pb2.LogRecovered:
    end = finding.end
    found = f"{finding.words()}: {finding.action.value}"
    return flight_pb2.LogRecovered(
        flight_id=finding.flight_id, found=found, last_seq=max(end.seq, 0), last_leaf=end.leaf
    )


def _damaged(finding: Finding) -> flight_pb2.LogDamaged:
    said = flight_pb2.LogDamaged(flight_id=finding.flight_id, folder=finding.folder.name, found=finding.words())
    if finding.end.seq >= 0:
        said.last_seq, said.last_leaf = finding.end
    if finding.head_file is not None and finding.head_file.head.seq >= 0:
        said.head_file_seq, said.head_file_leaf = finding.head_file.head
    return said
