"""What becomes of orders."""

from __future__ import annotations

from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import Limits
from events.schema.orders_pb2 import OrderMalformed, OrderReceived, SendAck
from statecharts.monitors.monitor import FINAL, Monitor, Said, Step, is_forgotten, key_of, moves_of, order_of

SECOND_NS = 1_000_000_000
_SERVING = ("point_at_place", "point_at_angles", "release_pointing", "set_zoom", "fly_to_place", "set_vehicle_mode")


class EffectsAreIntended(Monitor):
    """No effect without its order being intended in the same step and before it; never two for one order."""

    kinds = _SERVING

    def __init__(self, limits: Limits, whole: bool) -> None:
        super().__init__(limits, whole)
        self._served: dict[str, None] = {}

    def look(self, step: Step) -> Said:
        """Hold the effects against the moves before them."""
        intended: list[str] = []
        for record in step:
            change = record.message
            if isinstance(change, Moved) and (change.chart, change.to_state) == ("command", "intended"):
                intended.append(change.instance)
            if order := order_of(record):
                if order not in intended:
                    yield "effects_are_intended", f"record {record.seq} serves {order}, not intended in this step"
                if order in self._served:
                    yield "effects_are_intended", f"record {record.seq} serves {order} a second time"
                self._served[order] = None


class EveryOrderIsAnswered(Monitor):
    """An arrival is answered once in its step; each final move is answered once, finally.

    Only a repeat may go unanswered, after two answers to others within a second.
    """

    kinds = ("order_received", "moved", "send_ack")

    def __init__(self, limits: Limits, whole: bool) -> None:
        super().__init__(limits, whole)
        self._repeats: dict[str, list[int]] = {}

    def look(self, step: Step) -> Said:
        """Count the answers."""
        acks = [message for record in step if isinstance(message := record.message, SendAck)]
        moves = {move.instance: move.to_state for move in moves_of(step, "command")}
        if isinstance(order := step[0].message, OrderReceived):
            yield from self._arrival(step, order, acks, moves)
        for key in [key for key, state in moves.items() if state in FINAL]:
            final = [ack for ack in acks if key_of(ack.principal_id, ack.command_id) == key and ack.final]
            if len(final) != 1:
                yield "every_order_is_answered", f"{key} ended and is answered {len(final)} times"

    def _arrival(self, step: Step, order: OrderReceived, acks: list[SendAck], moves: dict[str, str]) -> Said:
        key, now_ns = key_of(order.issuer.principal_id, order.command_id), step[0].at.flight_ns
        mine = [ack for ack in acks if key_of(ack.principal_id, ack.command_id) == key]
        failed = len(step) > 1 and step[1].kind.name == "step_failed"
        undecided = failed and not any(ack.final for ack in mine)  # it is told, or even that failed
        recent = [at_ns for at_ns in self._repeats.get(key, []) if now_ns < at_ns + SECOND_NS]
        if len(mine) != (0 if len(recent) > 1 else 1) and not (undecided and len(mine) <= 1):
            yield "every_order_is_answered", f"{key} is answered {len(mine)} times"
        if key not in moves:
            self._repeats[key] = [*recent, *(now_ns for _ in mine)]


class AnswersStand(Monitor):
    """The first final answer to an order is the only one: repeats hear the same, and nothing undecided follows.

    An id that was kept for its time is forgotten, and may be judged anew.
    """

    kinds = ("send_ack", "order_received")

    def __init__(self, limits: Limits, whole: bool) -> None:
        super().__init__(limits, whole)
        self._final: dict[str, tuple[object, ...]] = {}
        self._bodies: dict[str, bytes] = {}
        self._judged_ns: dict[str, int] = {}

    def look(self, step: Step) -> Said:
        """Hold each answer against the last word."""
        order = step[0].message
        if isinstance(order, OrderMalformed):
            return
        if isinstance(order, OrderReceived):
            key = key_of(order.issuer.principal_id, order.command_id)
            self._forget(step, key)
            if self._bodies.setdefault(key, order.body_digest) != order.body_digest:
                return  # another body under the id: refused, which is no answer to the order
        for record in step:
            yield from self._answer(record)

    def _forget(self, step: Step, key: str) -> None:
        """Forget an order that is judged anew after its time, and note when it was first judged."""
        now_ns = step[0].at.flight_ns
        if any((move.instance, move.from_state) == (key, "received") for move in moves_of(step, "command")):
            if is_forgotten(self.limits, self._judged_ns.get(key), now_ns):
                self._final.pop(key, None)
                self._bodies.pop(key, None)
            self._judged_ns[key] = now_ns

    def _answer(self, record: Record) -> Said:
        ack = record.message
        if not isinstance(ack, SendAck):
            return
        told, key = (ack.result, ack.detail, ack.mav_result), key_of(ack.principal_id, ack.command_id)
        if key in self._final and (not ack.final or told != self._final[key]):
            yield "answers_stand", f"record {record.seq} takes back what {key} was told"
        if ack.final:
            self._final[key] = told


ORDERS: tuple[type[Monitor], ...] = (EffectsAreIntended, EveryOrderIsAnswered, AnswersStand)
