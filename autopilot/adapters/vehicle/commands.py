"""One command in flight for each target and command id: answers matched, re-sent, timed out, superseded.

Theory of operation. COMMAND_ACK names a command, not an instance of it (MAVLink guide, Command
Protocol), so two of the same id to one target must never be in flight together: an answer could
not be told from the other's. What waits is the newest pointing for each gimbal; an older one that
waits is superseded and never leaves. One that is in flight when a newer one comes is not sent
again, else a late copy could undo the newer, but its answer is still awaited and reported. What
remains possible: a late answer to a command that was given up is taken for its successor's of the
same id.

An answer IN_PROGRESS ends the re-sends and starts a longer wait. Nothing is sent after the
effect's life; an answer that comes a moment later is reported, for it is what happened.

Plain values in and out, time is an argument: no socket, no clock, no encoding.
"""

from __future__ import annotations

from dataclasses import dataclass

from google.protobuf.message import Message

from autopilot.adapters.vehicle.heard import Answer, Sender
from autopilot.ports.config import VehicleSection
from events.schema.vehicle_pb2 import CommandAnswered, CommandSent, CommandUnanswered

IN_PROGRESS = 5  # MAV_RESULT
_S = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """An effect on its way to the vehicle."""

    effect_seq: int
    effect: Message
    command: int  # MAV_CMD that carries it
    gimbal: int
    deadline_ns: int  # monotonic; nothing is sent from here on
    target: Sender | None = None  # who is to take it; None: the autopilot


@dataclass(frozen=True, slots=True, kw_only=True)
class Send:
    """Wish of the exchange: encode and send this, then call `sent`."""

    order: Order
    target: Sender
    confirmation: int  # 0 for the first, +1 for each re-send


@dataclass(slots=True, kw_only=True)
class _Flight:
    """An order whose answer is awaited."""

    order: Order
    target: Sender
    due_ns: int
    tries: int = 1  # how often it was to be sent
    attempts: int = 0  # how often bytes left
    progress: int | None = None  # of the last IN_PROGRESS; None before
    superseded: bool = False


class Exchange:
    """The command protocol of one link."""

    def __init__(self, settings: VehicleSection) -> None:
        self._timeout_ns = round(settings.answer_timeout_s * _S)
        self._patience_ns = round(settings.in_progress_timeout_s * _S)
        self._tries_max = settings.attempts
        self._target: Sender | None = None
        self._flying: dict[tuple[Sender, int], _Flight] = {}
        self._waiting: list[Order] = []
        self._out: list[Send | Message] = []

    def aim(self, target: Sender | None) -> None:
        """Say which autopilot takes commands; None while there is no vehicle."""
        self._target = target

    def submit(self, now_ns: int, order: Order) -> None:
        """Take an order; what waits for the same gimbal is superseded."""
        for older in [waiting for waiting in self._waiting if waiting.gimbal == order.gimbal]:
            self._waiting.remove(older)
            self.refuse(older.effect_seq, "superseded")
        for flight in self._flying.values():
            flight.superseded = flight.superseded or flight.order.gimbal == order.gimbal
        self._waiting.append(order)
        self._launch(now_ns)

    def refuse(self, effect_seq: int, because: str) -> None:
        """Report that an effect never left."""
        self._out.append(CommandUnanswered(effect_seq=effect_seq, attempts=0, because=because))

    def sent(self, effect_seq: int) -> None:
        """Learn that bytes left; the first time it is reported."""
        for flight in self._flying.values():
            if flight.order.effect_seq == effect_seq:
                flight.attempts += 1
                if flight.attempts == 1:
                    self._out.append(CommandSent(effect_seq=effect_seq))

    def hear(self, now_ns: int, answer: Answer) -> Order | None:
        """Return the order that this answers, or None; the outcome is reported."""
        flight = self._flying.get((answer.sender, answer.command))
        if flight is None:
            return None
        if answer.result == IN_PROGRESS:
            flight.due_ns = now_ns + self._patience_ns
            if flight.progress != answer.progress:
                flight.progress = answer.progress
                self._report(flight, answer)
        else:
            del self._flying[answer.sender, answer.command]
            self._report(flight, answer)
            self._launch(now_ns)
        return flight.order

    def tick(self, now_ns: int) -> None:
        """Do what is due."""
        for key, flight in list(self._flying.items()):
            if flight.due_ns <= now_ns:
                self._overdue(now_ns, key, flight)
        self._launch(now_ns)

    def due_ns(self) -> int | None:
        """Return when `tick` must be called next, or None."""
        moments = [flight.due_ns for flight in self._flying.values()] + [order.deadline_ns for order in self._waiting]
        return min(moments, default=None)

    def take(self) -> list[Send | Message]:
        """Return what is to be sent and reported, in order, and forget it."""
        out, self._out = self._out, []
        return out

    def _launch(self, now_ns: int) -> None:
        """Send what waits for nothing; drop what has expired or has nobody to go to."""
        for order in list(self._waiting):
            if now_ns >= order.deadline_ns:
                self._drop(order, "expired before sending")
            elif self._target is None:
                self._drop(order, "no vehicle")
            elif ((target := order.target or self._target), order.command) not in self._flying:
                self._waiting.remove(order)
                flight = _Flight(order=order, target=target, due_ns=now_ns + self._timeout_ns)
                self._flying[target, order.command] = flight
                self._out.append(Send(order=order, target=target, confirmation=0))

    def _drop(self, order: Order, because: str) -> None:
        self._waiting.remove(order)
        self.refuse(order.effect_seq, because)

    def _overdue(self, now_ns: int, key: tuple[Sender, int], flight: _Flight) -> None:
        """Send again, or give up."""
        given_up = flight.progress is not None or flight.superseded or flight.tries >= self._tries_max
        if given_up or now_ns >= flight.order.deadline_ns:
            del self._flying[key]
            because = "no answer" if flight.attempts else "no vehicle"
            unanswered = CommandUnanswered(
                effect_seq=flight.order.effect_seq, attempts=flight.attempts, because=because
            )
            self._out.append(unanswered)
            return
        self._out.append(Send(order=flight.order, target=flight.target, confirmation=flight.tries))
        flight.tries += 1
        flight.due_ns = now_ns + self._timeout_ns

    def _report(self, flight: _Flight, answer: Answer) -> None:
        self._out.append(
            CommandAnswered(
                effect_seq=flight.order.effect_seq,
                mav_result=answer.result,
                progress=answer.progress,
                attempts=flight.attempts,
            )
        )
