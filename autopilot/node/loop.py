"""The one loop: drain, decide, commit, hand over (design, section 3).

One thread owns state and log. What waits in the inbox is taken through the core as a batch; the batch is committed at
once when it holds a SYNC record or an effect whose outcome is awaited, else within `commit_within_ms`; and only what is
durable is handed to the performers. When the disk does not keep up, orders are refused; when it fails, the loop ends
and so does the process, for a write that failed once can't be believed the second time.
"""

from __future__ import annotations

import gc
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass

from google.protobuf.message import Message

from autopilot.node.flights import Flights, Session
from autopilot.node.inbox import Inbox
from autopilot.node.watching import Watching
from autopilot.ports.config import LimitsSection
from autopilot.ports.edges import Clock
from events.kinds import Role, UnknownKind
from events.records import BodyBroken, Record
from events.schema import flight_pb2
from events.schema.mission_pb2 import (
    MissionPlanned,
    MissionUnavailable,
    MissionUploaded,
    MissionUploadFailed,
    PushObservations,
    SelftestReported,
    WaypointPosted,
)
from events.schema.orders_pb2 import AckPublished, SendAck
from events.schema.vehicle_pb2 import CommandAnswered, CommandUnanswered
from events.store import StoreFailed
from events.store.reserve import RESERVE_BYTES

# A batch is at most this long, so that an order behind it does not wait for a whole queue.
BATCH_MOST = 64
# With nothing to do the loop still looks up this often, to let the log's WAL go into the database.
IDLE_S = 1.0
# What is lost is recorded at most this often: a flood must not fill what is left of the disk with counts.
DROPS_APART_NS = 1_000_000_000
# Adapters say these only when they change, so a flight that begins in the same process is told the newest of each.
_STANDING = (
    *("vehicle_link_changed", "vehicle_state_reported", "eyes_changed"),
    *("gimbal_described", "gimbal_control_changed", "camera_described", "camera_zoomed"),
)
_MAV_IN_PROGRESS = 5


@dataclass(frozen=True, slots=True)
class Stop:
    """How the loop shall end: with the flight closed for a reason, where the vehicle is disarmed."""

    reason: flight_pb2.CloseReason.ValueType = flight_pb2.CLOSE_STOPPED


class NodeLoop(threading.Thread):
    """The node's thread. `on_records` and `perform` are called on it, after the records are durable."""

    def __init__(
        self,
        flights: Flights,
        inbox: Inbox,
        clock: Clock,
        limits: LimitsSection,
        *,
        close_after_s: float,
        on_session: Callable[[Session], None],
        on_records: Callable[[tuple[Record, ...]], None],
        perform: Callable[[Record], None],
        on_end: Callable[[], None],
    ) -> None:
        super().__init__(name="node", daemon=True)
        self._flights = flights
        self._inbox = inbox
        self._clock = clock
        self._limits = limits
        self._close_after_ns = int(close_after_s * 1e9)
        self._on_session = on_session
        self._on_records = on_records
        self._perform = perform
        self._on_end = on_end
        self._watching: Watching
        self._asked_to_stop: Stop | None = None
        self._pending: list[Record] = []
        self._unwatched: list[tuple[Record, ...]] = []  # steps that the monitors have not seen
        self._commit_by_ns = 0
        self._disarmed_at_ns: int | None = None
        self._told_of_full_disk = False
        self._tell_dropped_ns = clock.mono_ns()
        self._awaited: set[int] = set()  # effects handed over whose outcome is still to come
        self._standing: dict[tuple[str, int, int], Message] = {}
        self.turned_ns = clock.mono_ns()  # when the loop last went round: whether the node is well
        self.failure: StoreFailed | UnknownKind | BodyBroken | None = None
        self.defect: str = ""

    def stop(self, stop: Stop) -> None:
        """Ask the loop to record what waits, end the flight if it may, and end. From any thread."""
        self._asked_to_stop = stop
        self._inbox.wake()

    def run(self) -> None:
        """Record until asked to stop, or until the store fails."""
        try:
            session = self._open(self._flights.open(self._on_records))
            while self._asked_to_stop is None:
                session = self._turn(session)
            self._finish(session, self._asked_to_stop)
        except (StoreFailed, UnknownKind, BodyBroken) as error:
            self.failure = error
        except Exception:  # noqa: BLE001 - a defect ends the process with its traceback, not a silent thread
            self.defect = traceback.format_exc()
        finally:
            self._on_end()

    def _open(self, session: Session) -> Session:
        self._watching = Watching(session.state)
        self._on_session(session)
        for record in session.fresh:
            self._hand_over(record)
        session.fresh.clear()
        self._watch_arming(session)
        return session

    def _turn(self, session: Session) -> Session:
        batch = self._inbox.take(self._wait_s(session), BATCH_MOST)
        self.turned_ns = self._clock.mono_ns()
        quiet, recorded = not batch and not self._pending, session.state.next_seq.value
        gc.disable()  # looking for garbage takes up to a millisecond of an order; it is made up for behind its effects
        try:
            self._observe(session, batch)
        finally:
            gc.enable()
        if not self._pending:
            session.store.idle()
            if session.sealing is not None:
                session.sealing.turn(armed=_armed(session), flight_ns=session.clock.peek_ns())
        if quiet and session.state.next_seq.value == recorded:
            self._inbox.disk_rested()
        return self._follow_if_over(session)

    def _observe(self, session: Session, batch: list[Message]) -> None:
        if session.due is not None and session.clock.seconds_until(session.due) <= 0:
            self._add(session, flight_pb2.TimePassed())
        if session.store.reserve_spent and not self._told_of_full_disk:
            self._told_of_full_disk = True
            self._add(session, flight_pb2.DiskFull(reserved_bytes=RESERVE_BYTES))
        if self._clock.mono_ns() >= self._tell_dropped_ns:
            self._tell_dropped(session)
        for observation in batch:
            self._add(session, observation)
        while self._pending and (self._must_commit() or self._clock.mono_ns() >= self._commit_by_ns):
            self._commit(session)  # which may leave what the monitors found, to be recorded as well

    def _tell_dropped(self, session: Session) -> None:
        for input_class, count in self._inbox.take_dropped().items():
            self._tell_dropped_ns = self._clock.mono_ns() + DROPS_APART_NS
            self._add(session, flight_pb2.InputsDropped(input_class=input_class.value, count=count))

    def _add(self, session: Session, observation: Message) -> None:
        if not self._pending:
            self._commit_by_ns = self._clock.mono_ns() + self._limits.commit_within_ms * 1_000_000
        records = session.observe(observation)
        self._pending.extend(records)
        self._unwatched.append(records)

    def _must_commit(self) -> bool:
        return any(record.kind.sync or _is_awaited(record) for record in self._pending)

    def _commit(self, session: Session) -> None:
        self._inbox.commit_began()
        session.store.append(self._pending)
        self._inbox.commit_ended()
        if session.store.reserve_spent:
            self._inbox.close_to_orders()
        durable, self._pending = tuple(self._pending), []
        for record in durable:
            self._hand_over(record)
        gc.enable()
        time.sleep(0)  # lets go of the interpreter: whoever performs goes before what is only noted and folded
        for record in durable:
            self._note(session, record)
        self._on_records(durable)
        self._watch(session)
        if session.sealing is not None:
            session.sealing.cosigned.hear(durable)
        self._watch_arming(session)

    def _watch(self, session: Session) -> None:
        """Show the monitors what is durable and handed over; what they find is recorded behind it."""
        steps, self._unwatched = self._unwatched, []
        for step in steps:
            for broken in self._watching.see(step):
                self._add(session, broken)

    def _hand_over(self, record: Record) -> None:
        if _is_awaited(record):
            self._awaited.add(record.seq)
        if record.kind.role is Role.EFFECT:
            self._perform(record)

    def _note(self, session: Session, record: Record) -> None:
        """Note what is awaited no longer, what the next flight will have to be told, and what is said of the flight."""
        if record.kind.role is Role.OBSERVATION:
            session.note(record)
        match record.message:
            case AckPublished(effect_seq=seq) | CommandUnanswered(effect_seq=seq):
                self._awaited.discard(seq)
            case MissionPlanned(effect_seq=seq) | MissionUnavailable(effect_seq=seq, final=True):
                self._awaited.discard(seq)
            case MissionUploaded(effect_seq=seq) | MissionUploadFailed(effect_seq=seq):
                self._awaited.discard(seq)
            case SelftestReported(effect_seq=seq) | WaypointPosted(effect_seq=seq):
                self._awaited.discard(seq)
            case CommandAnswered(effect_seq=seq, mav_result=result) if result != _MAV_IN_PROGRESS:
                self._awaited.discard(seq)
            case message if record.kind.name in _STANDING:
                about = (record.kind.name, getattr(message, "vehicle", 0), getattr(message, "camera", 0))
                self._standing[about] = message

    def _wait_s(self, session: Session) -> float:
        waits = [IDLE_S]
        if session.due is not None:
            waits.append(session.clock.seconds_until(session.due))
        if self._pending:
            waits.append((self._commit_by_ns - self._clock.mono_ns()) / 1e9)
        return max(min(waits), 0.0)

    def _watch_arming(self, session: Session) -> None:
        """Note when the vehicle, armed before in this flight, was seen disarmed."""
        if _armed(session):
            self._disarmed_at_ns = None
        elif session.arming.flown and self._disarmed_at_ns is None:
            self._disarmed_at_ns = self._clock.mono_ns()

    def _follow_if_over(self, session: Session) -> Session:
        if self._told_of_full_disk and not _armed(session):
            self._end(session, flight_pb2.CLOSE_DISK_FULL)
            session.store.close()
            raise StoreFailed("the disk is full; the flight was closed in the space that was reserved: free some space")
        reason = self._why_over(session)
        if reason is None or self._awaited:
            return session  # seqs of one flight mean nothing in the next: its last outcome is waited for
        self._end(session, reason)
        self._disarmed_at_ns = None
        following = self._open(self._flights.follow(session, self._on_records))
        for observation in self._standing.values():
            self._add(following, observation)
        return following

    def _why_over(self, session: Session) -> flight_pb2.CloseReason.ValueType | None:
        """Return why the flight ought to end now; None while it goes on."""
        if _armed(session):
            return None
        if session.arming.abandoned:
            return flight_pb2.CLOSE_ABANDONED
        disarmed_ns = self._disarmed_at_ns
        waited = disarmed_ns is not None and self._clock.mono_ns() - disarmed_ns >= self._close_after_ns
        return flight_pb2.CLOSE_DISARMED if waited else None

    def _finish(self, session: Session, stop: Stop) -> None:
        while batch := self._inbox.take(0, BATCH_MOST):
            self._observe(session, batch)
        self._tell_dropped(session)
        if _armed(session):
            self._commit_rest(session)
        else:
            self._end(session, stop.reason)
        session.store.close()

    def _end(self, session: Session, reason: flight_pb2.CloseReason.ValueType) -> None:
        self._commit_rest(session)
        self._flights.close(session, reason, self._on_records)

    def _commit_rest(self, session: Session) -> None:
        while self._pending:  # a commit may show what is to be recorded still
            self._commit(session)


def _armed(session: Session) -> bool:
    return any(vehicle.armed for vehicle in session.state.vehicles.values())


def _is_awaited(record: Record) -> bool:
    """Whether a record is an effect whose outcome the flight waits for.

    An answer that is not the last word has none; a push may take longer than the flight is open, and its outcome is
    told to no other flight.
    """
    passing = isinstance(record.message, SendAck) and not record.message.final
    passing |= isinstance(record.message, PushObservations)
    return record.kind.role is Role.EFFECT and not passing
