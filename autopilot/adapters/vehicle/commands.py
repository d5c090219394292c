"""One command in flight for each target and command id: answers matched, re-sent, timed out, superseded.

Theory of operation. COMMAND_ACK names a command, not an instance of it (MAVLink guide, Command
Protocol), so two of the same id to one target must never be in flight together: an answer could
not be told from the other's. The rest waits in its order.

An answer may be late. After a command that was given up, or that left more than once, answers to it
may still come for `late_answer_s`; so is it after a command of the flight, of which a network may
deliver the answer twice. Until then
- what is sent once only waits;
- what may be sent again leaves at once, but answers are counted as late and not believed, and it is
  sent again until one can be.
So a late answer never becomes the answer of another command. One exception is left open: after a
pointing that was answered at its first sending the next leaves and is believed at once, for the
gimbal's arrival is measured anyway.

Pointing. What waits is the newest for each gimbal; an older one that waits is superseded and never
leaves. One that is in flight when a newer one comes is not sent again, else a late copy could undo
the newer, but its answer is still awaited and reported.

Failsafes. A return or a landing that nobody ordered goes before everything that waits and takes the
place of what is in flight under its id: it leaves in the same turn, whatever the answers do. Commands
of the flight that wait are told that they are superseded, for they would undo it.

An answer IN_PROGRESS ends the re-sends and starts a longer wait. LONG_ONLY, INT_ONLY and
UNSUPPORTED_MAV_FRAME are answered once with another form of the same, then believed. Nothing is sent
after the effect's life; an answer that comes a moment later is reported, for it is what happened.

Plain values in and out, time is an argument: no socket, no clock, no encoding.
"""

from __future__ import annotations

from dataclasses import dataclass

from google.protobuf.message import Message

from autopilot.adapters.vehicle.heard import Answer, Sender
from autopilot.adapters.vehicle.orders import INT_ONLY, LONG_ONLY, Form, Order, other_form
from autopilot.ports.config import VehicleSection
from events.schema.vehicle_pb2 import CommandAnswered, CommandSent, CommandUnanswered

IN_PROGRESS = 5  # MAV_RESULT
LATE, UNMATCHED = "late answer", "unmatched answer"
_S = 1_000_000_000
_Slot = tuple[Sender, int]  # target and command id


@dataclass(frozen=True, slots=True, kw_only=True)
class Send:
    """Wish of the exchange: encode and send this, then call `sent`."""

    order: Order
    target: Sender
    form: Form
    confirmation: int  # 0 for the first, +1 for each re-send


@dataclass(slots=True, kw_only=True)
class _Flight:
    """An order whose answer is awaited."""

    order: Order
    target: Sender
    form: Form
    due_ns: int
    doubt_ns: int = 0  # until then an answer may be another's
    switched: bool = False  # it was asked for in another form
    tries: int = 1  # how often it was to be sent
    attempts: int = 0  # how often bytes left
    progress: int | None = None  # of the last IN_PROGRESS; None before
    progress_ns: int = 0  # when the first came
    superseded: bool = False


class Exchange:
    """The command protocol of one link."""

    def __init__(self, settings: VehicleSection) -> None:
        self._timeout_ns = round(settings.answer_timeout_s * _S)
        self._patience_ns = round(settings.in_progress_timeout_s * _S)
        self._longest_ns = round(settings.in_progress_longest_s * _S)
        self._late_ns = round(settings.late_answer_s * _S)
        self._tries_max = settings.attempts
        self._target: Sender | None = None
        self._flying: dict[_Slot, _Flight] = {}
        self._late: dict[_Slot, int] = {}  # until when answers to one that is over may come
        self._waiting: list[Order] = []
        self._out: list[Send | Message] = []

    def aim(self, target: Sender | None) -> None:
        """Say which autopilot takes commands; None while there is no vehicle."""
        self._target = target

    def submit(self, now_ns: int, order: Order) -> None:
        """Take an order; what it makes pointless is superseded."""
        for older in [waiting for waiting in self._waiting if _undone_by(waiting, order)]:
            self._waiting.remove(older)
            self.refuse(older.effect_seq, "superseded")
        for slot, flight in list(self._flying.items()):
            flight.superseded = flight.superseded or _undone_by(flight.order, order)
            if order.rank >= flight.order.rank and slot == (self._target, order.command) and order.rank:
                self._give_up(now_ns, slot, flight, "superseded")
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

    def hear(self, now_ns: int, answer: Answer) -> Order | str:
        """Return the order that this answers, or the name of a rejection; the outcome is reported."""
        slot = (answer.sender, answer.command)
        flight = self._flying.get(slot)
        if flight is None:
            return LATE if now_ns < self._late.get(slot, 0) else UNMATCHED
        form = other_form(flight.form, answer.result)
        asks_for_this = flight.switched and answer.result in (LONG_ONLY, INT_ONLY) and form is None
        if now_ns < flight.doubt_ns or asks_for_this:
            return LATE
        if answer.result == IN_PROGRESS:
            self._in_progress(now_ns, flight, answer)
        elif form in flight.order.forms and not flight.switched and now_ns < flight.order.deadline_ns:
            flight.form, flight.switched = form, True
            self._wish(now_ns, flight, confirmation=0)
        else:
            del self._flying[slot]
            if flight.order.flight or flight.attempts > 1:
                self._late[slot] = now_ns + self._late_ns
            self._report(flight, answer)
            if flight.order.has_message(answer.result) and now_ns < flight.order.deadline_ns and not flight.superseded:
                self._out.append(Send(order=flight.order, target=flight.target, form=Form.MESSAGE, confirmation=0))
            self._launch(now_ns)
        return flight.order

    def tick(self, now_ns: int) -> None:
        """Do what is due."""
        self._late = {slot: until_ns for slot, until_ns in self._late.items() if now_ns < until_ns}
        for slot, flight in list(self._flying.items()):
            if flight.due_ns <= now_ns:
                self._overdue(now_ns, slot, flight)
        self._launch(now_ns)

    def due_ns(self) -> int | None:
        """Return when `tick` must be called next, or None."""
        moments = [flight.due_ns for flight in self._flying.values()]
        for order in self._waiting:
            moments.append(order.deadline_ns)
            target = order.target or self._target
            slots = [until_ns for slot, until_ns in self._late.items() if slot == (target, order.command)]
            moments += slots
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
            elif self._may_leave(now_ns, slot := (order.target or self._target, order.command), order):
                self._waiting.remove(order)
                flight = _Flight(order=order, target=slot[0], form=order.form, due_ns=0)
                flight.doubt_ns = self._late.get(slot, 0)
                self._flying[slot] = flight
                self._wish(now_ns, flight, confirmation=0)

    def _may_leave(self, now_ns: int, slot: _Slot, order: Order) -> bool:
        """Nothing is in flight under its id; and no answer is still to come, where it can't be sent again."""
        return slot not in self._flying and (order.again or now_ns >= self._late.get(slot, 0))

    def _drop(self, order: Order, because: str) -> None:
        self._waiting.remove(order)
        self.refuse(order.effect_seq, because)

    def _wish(self, now_ns: int, flight: _Flight, confirmation: int) -> None:
        """Wish it to be sent; what is sent once is waited for as long as what is sent `attempts` times."""
        waits = 1 if flight.order.again else self._tries_max
        flight.due_ns = now_ns + waits * self._timeout_ns
        self._out.append(Send(order=flight.order, target=flight.target, form=flight.form, confirmation=confirmation))

    def _overdue(self, now_ns: int, slot: _Slot, flight: _Flight) -> None:
        """Send again, or give up."""
        spent = flight.tries >= self._tries_max and now_ns >= flight.doubt_ns + self._timeout_ns
        over = flight.progress is not None or flight.superseded or not flight.order.again or spent
        if over or now_ns >= flight.order.deadline_ns:
            self._give_up(now_ns, slot, flight, "no answer" if flight.attempts else "no vehicle")
            return
        self._wish(now_ns, flight, confirmation=min(flight.tries, 255))
        flight.tries += 1

    def _give_up(self, now_ns: int, slot: _Slot, flight: _Flight, because: str) -> None:
        """Report that nothing came of it; answers to it may still come."""
        del self._flying[slot]
        if flight.attempts:
            self._late[slot] = now_ns + self._late_ns
        self._out.append(
            CommandUnanswered(effect_seq=flight.order.effect_seq, attempts=flight.attempts, because=because)
        )

    def _in_progress(self, now_ns: int, flight: _Flight, answer: Answer) -> None:
        """Wait longer, but not for ever; what changed is reported."""
        if flight.progress is None:
            flight.progress_ns = now_ns
        flight.due_ns = min(now_ns + self._patience_ns, flight.progress_ns + self._longest_ns)
        if flight.progress != answer.progress:
            flight.progress = answer.progress
            self._report(flight, answer)

    def _report(self, flight: _Flight, answer: Answer) -> None:
        self._out.append(
            CommandAnswered(
                effect_seq=flight.order.effect_seq,
                mav_result=answer.result,
                progress=answer.progress,
                attempts=flight.attempts,
            )
        )


def _undone_by(older: Order, newer: Order) -> bool:
    """Whether an order makes no sense once a newer one is there."""
    if newer.flight:
        return older.flight and newer.rank > older.rank
    return older.gimbal == newer.gimbal
