"""Where a flight begins, goes on and ends (design, section 4). Runs on the node's thread only.

Before a log is opened for writing it is examined; a damaged one stays as it was found, and the flight that is begun in
its place names its head. A start goes on with the open flight, also after a reboot: flight time is joined over the
outage (`joining`). A flight begins with a manifest and the baseline that the one before it hands over.

    begins      there is none; the one before is closed; the one before is damaged
    goes on     any start that finds it open, of this boot or another; in the air also under another logic
    ends        STOPPED, INPUT_ENDED    asked to stop, or the input ended, with the vehicle disarmed
                DISARMED                close_after_s after the vehicle disarmed, once no outcome is awaited
                ABANDONED               a boot found disarmed what an earlier one recorded armed
                LOGIC_CHANGED           a start under another logic, on the ground
                DISK_FULL               the disk is full, and the vehicle is disarmed

docs/flights.md names the test of each. When it is over is noticed in `loop`; what happens then is here.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from google.protobuf.message import Message

from autopilot.node.arming import Arming
from autopilot.node.attachments import hand_over
from autopilot.node.clock import FlightClock, read_clocks
from autopilot.node.joining import NO_OUTAGE, Outage, is_same_boot, outage
from autopilot.node.restoring import Keeper, Resuming
from autopilot.node.sealing import Known, Sealer, Sealing
from autopilot.ports.edges import Clock
from events.chain import SECRET_BYTES
from events.records import NO_CAUSE, Moment, Record, make_record, read_record
from events.schema import flight_pb2
from events.schema.state_pb2 import CarriedState
from events.store import Appender, Flight, StoreFailed, create_flight, flights_in, open_flight, remove_begun
from events.store.recovery import Action, Finding, KeptLog, examine
from statecharts import State, carry_over, charts_digest, restore, step, steps_of
from statecharts.logic import LOGIC

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
    arming: Arming = field(default_factory=Arming)
    outage: Outage = NO_OUTAGE  # between the last record and this start
    sealing: Sealing | None = None  # None: nobody signs what this node records
    known: Known | None = None  # where it was started from a snapshot
    fresh: list[Record] = field(default_factory=list)  # recorded while opening: their effects are still to be performed

    def observe(self, observation: Message) -> tuple[Record, ...]:
        """Take an observation through the core and return the records, which are not durable yet."""
        record = make_record(self.state.next_seq.value, NO_CAUSE, self.clock.now(), observation)
        result = step(self.state, record)
        self.due = result.due
        return result.records

    def note(self, observation: Record) -> None:
        """Take in what a durable observation says of the flight itself."""
        self.last = observation.at
        self.arming.note(observation)
        match observation.message:
            case flight_pb2.NodeStarted():
                self.started = observation.message
                self.logic = observation.message.logic or self.logic
            case flight_pb2.FlightOpened():
                self.logic = observation.message.logic
            case flight_pb2.FlightClosed():
                self.closed = True


class Flights:
    """Opens, continues and ends the flights of a node."""

    def __init__(
        self,
        root: Path,
        identity: Identity,
        clock: Clock,
        random_bytes: RandomBytes = os.urandom,
        sealer: Sealer | None = None,
        outage_longest_h: float = 24.0,
        keeper: Keeper | None = None,
    ) -> None:
        self._root = root
        self._outage_longest_ns = int(outage_longest_h * 3600 * 1e9)
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
        try:
            return self._after(number, last, on_records, found)
        except StoreFailed:
            if last is not None:
                _let_go(last.store)
            raise

    def _after(self, number: int, last: Session | None, on_records: OnRecords, found: Sequence[Message]) -> Session:
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
                try:
                    self._load(session, on_records, resuming)
                except StoreFailed:
                    _let_go(store)
                    raise
                session.kept = any(isinstance(one, flight_pb2.LogDamaged) for one in found)
                return session, found
        return None, found

    def _load(self, session: Session, on_records: OnRecords, resuming: Resuming | None) -> None:
        start = 0 if resuming is None else resuming.resume(session)
        for recorded in steps_of(map(read_record, session.store.stored(start))):
            session.due = restore(session.state, recorded)
            session.note(recorded[0])
            on_records(recorded)
        if session.last is not None:
            self._join(session, session.last)

    def _join(self, session: Session, last: Moment) -> None:
        """Let the flight's time go on where the log ends, by as much as it is known to have gone on."""
        now = read_clocks(self._clock)
        same_boot = is_same_boot(last, now, same_id=session.started.boot_id == self._identity.boot_id)
        session.outage = outage(last, now, same_boot=same_boot, longest_ns=self._outage_longest_ns)
        session.clock = FlightClock(self._clock, last.boot + (not same_boot), last.flight_ns + session.outage.ns)

    def _why_not_go_on(self, session: Session) -> flight_pb2.CloseReason.ValueType | None:
        armed = any(vehicle.armed for vehicle in session.state.vehicles.values())
        if session.logic != LOGIC and not armed:
            return flight_pb2.CLOSE_LOGIC_CHANGED
        return None

    def _go_on(self, session: Session, on_records: OnRecords, found: Sequence[Message]) -> Session:
        opening = [self._started(session.started.start + 1, session.outage), *self._sealed(session), *found]
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
        try:
            opening += [self._started(1, NO_OUTAGE), *self._sealed(session), *found]
            self._record(session, opening, on_records)
        except StoreFailed:
            _let_go(store)
            remove_begun(flight)
            raise
        if before is not None:
            if carried.HasField("mission"):
                hand_over(before.flight.folder, flight.folder, carried.mission.plan.json_sha256.hex())
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

    def _started(self, start: int, gone: Outage) -> flight_pb2.NodeStarted:
        started = flight_pb2.NodeStarted(
            boot_id=self._identity.boot_id,
            start=start,
            outage_ns=gone.ns,
            logic=LOGIC,
            software=self._identity.software,
        )
        if gone.unbounded:
            started.outage_unbounded = gone.unbounded
        return started

    def _record(self, session: Session, observations: Sequence[Message], on_records: OnRecords) -> None:
        steps = [session.observe(observation) for observation in observations]
        session.store.append([record for records in steps for record in records])
        for records in steps:
            session.note(records[0])
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


def _let_go(store: Appender) -> None:
    """Close a store that failed, as far as it can be: a later try opens the log anew."""
    with suppress(StoreFailed):
        store.close()


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
