"""Orders that were sent, and which answers to them may be believed.

It publishes nothing and verifies no signature: it is told what left and what the gate opened, and
keeps each order's state. What is known of an order only grows: received, sent, in progress, then one
final answer, which never changes, however answers are delayed, doubled or reordered.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

from google.protobuf.message import DecodeError

from autopilot.trust.envelope import Packed
from autopilot.trust.limits import TTL_MS_MAX
from autopilot.trust.verdict import Sealed, Unreadable
from autopilot.wire.keys import ack_address
from events.schema.waypoint_pb2 import AckResult, CommandAck, NodeStatus, OrderStage, ResultState

REPUBLISH_NS = 1_000_000_000  # an order is published again this often while it lives
LOOK_AGAIN_NS = 100_000_000  # how soon a link that is down is looked at again
GRACE_NS = 2_000_000_000  # an answer may still be on its way when the order's life ends
ENVELOPES_MAX = 4096  # envelopes whose answers are still taken; older ones are forgotten

RESULTS = {
    AckResult.ACK_ACCEPTED: "accepted",
    AckResult.ACK_REJECTED: "rejected",
    AckResult.ACK_TIMEOUT: "timeout",
    AckResult.ACK_UNSUPPORTED: "unsupported",
    AckResult.ACK_UNAUTHORISED: "unauthorised",
}


STAGES = {OrderStage.RECEIVED: "received", OrderStage.SENT: "sent", OrderStage.IN_PROGRESS: "in progress"}
_LADDER = ("", *STAGES.values())
_STATES = ("waiting", "pending", "final")


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What is known of an order."""

    state: str = "waiting"  # "waiting", "pending" (the node has it), "final", "failed" (it never left)
    result: str = ""  # accepted, rejected, timeout, unsupported, unauthorised; "" while nothing is said
    detail: str = ""
    duplicate: bool = False  # it answers a repeat with the first result
    mav_result: int | None = None
    event_seq: int | None = None  # record of the node's log that holds the answer
    acked_at_ms: int = 0  # the node's clock, milliseconds since 1970
    stage: str = ""  # of a pending order: received, sent, in progress; "" where the node did not take it on
    revocation_version: int | None = None  # list that the node holds
    time_quality: int | None = None  # of the node's clock: 0 unset, 1 bounded, 2 trusted


@dataclass(slots=True, kw_only=True, eq=False)
class Order:
    """One order on its way, from its first envelope to its final answer. Changed by the ledger only."""

    node: str
    node_key: bytes
    command_id: str
    content: bytes
    order_seq: int
    ends_mono_ns: int
    due_mono_ns: int
    answer: Answer = field(default_factory=Answer)
    envelopes: list[bytes] = field(default_factory=list)  # as published, oldest first
    row: int = 0  # its pending row in the issuer's store

    @property
    def is_done(self) -> bool:
        """Say whether nothing more will come."""
        return self.answer.state in ("final", "failed")

    def differs(self, known: Answer) -> bool:
        """Say whether another answer came than the one that is known."""
        return self.answer is not known


class Ledger:
    """Every order of one issuer. Safe from several threads."""

    def __init__(self, settled: Callable[[Order, Answer], None] = lambda *_: None) -> None:
        """Make an empty ledger; `settled` is told of a last word before anybody who waits for it."""
        self._settled = settled
        self._open: list[Order] = []
        self._unanswered: list[Order] = []
        self._by_envelope: OrderedDict[bytes, Order] = OrderedDict()
        self._refused: dict[str, int] = {}
        self.changed = threading.Condition()

    def add(self, order: Order) -> None:
        """Take an order that is to be sent."""
        with self.changed:
            self._open.append(order)
            self._unanswered.append(order)
            self.changed.notify_all()

    def overdue(self, now_mono_ns: int) -> list[Order]:
        """Return the orders whose last word has not come in their time, each once."""
        with self.changed:
            over = [
                order for order in self._unanswered if order.is_done or order.ends_mono_ns + GRACE_NS <= now_mono_ns
            ]
            self._unanswered = [order for order in self._unanswered if order not in over]
            return [order for order in over if not order.is_done]

    def due(self, now_mono_ns: int) -> list[Order]:
        """Return the orders to publish now; forget those that are done or whose life is over."""
        with self.changed:
            self._open = [order for order in self._open if not order.is_done and now_mono_ns < order.ends_mono_ns]
            return [order for order in self._open if order.due_mono_ns <= now_mono_ns]

    def next_due(self) -> int | None:
        """Return when an order must be published next, monotonic nanoseconds; None: nothing waits."""
        with self.changed:
            ends = [order.ends_mono_ns + GRACE_NS for order in self._unanswered if not order.is_done]
            return min((*(order.due_mono_ns for order in self._open if not order.is_done), *ends), default=None)

    def postponed(self, order: Order, now_mono_ns: int) -> None:
        """Note that the link was down."""
        order.due_mono_ns = now_mono_ns + LOOK_AGAIN_NS

    def published(self, order: Order, packed: Packed, now_mono_ns: int) -> None:
        """Note an envelope that is about to leave, so that its answer will be known."""
        with self.changed:
            order.due_mono_ns = now_mono_ns + REPUBLISH_NS
            order.envelopes.append(packed.envelope)
            self._by_envelope[packed.digest] = order
            self.changed.notify_all()
            if len(self._by_envelope) > ENVELOPES_MAX:
                self._by_envelope.popitem(last=False)

    def failed(self, order: Order, because: str) -> None:
        """Note that an order can't be sent at all."""
        self._settle(order, Answer(state="failed", detail=because))

    def believe(self, message: Sealed, ack: CommandAck) -> str:
        """Take an authentic ack; return why it was not believed, empty when it was.

        It must answer an envelope of ours, come from the key that the order was bound to, on the
        node's own key expression, and name the order. Anything else is a member of the group
        who answers for others.
        """
        order = self._by_envelope.get(message.in_reply_to)
        address = ack_address(message.key_expr)
        reason = ""
        if order is None or address is None:
            reason = "unknown_envelope"
        elif message.sender.public_key != order.node_key:
            reason = "wrong_signer"
        elif address.node != order.node or message.sender.principal_id != order.node:
            reason = "wrong_route"
        elif not order.command_id == address.command_id == ack.command_id:
            reason = "wrong_order"
        else:
            self._settle(order, _answer(ack))
        if reason:
            with self.changed:
                self._refused[reason] = self._refused.get(reason, 0) + 1
        return reason

    def refused(self) -> dict[str, int]:
        """Return how many authentic acks were not believed, by reason."""
        with self.changed:
            return dict(sorted(self._refused.items()))

    def _settle(self, order: Order, answer: Answer) -> None:
        with self.changed:
            if not order.is_done and _rank(answer) >= _rank(order.answer):
                if answer.state in ("final", "failed"):
                    self._settled(order, answer)
                order.answer = answer
            self.changed.notify_all()


def check_life(life_s: float) -> None:
    """Raise ValueError for a life outside what a node takes."""
    if not 0 < life_s * 1000 <= TTL_MS_MAX:
        raise ValueError(f"an order lives more than 0 and at most {TTL_MS_MAX // 1000} s, not {life_s}")


def read_ack(_message: Sealed, content: bytes) -> CommandAck:
    """Decode an ack. Raises Unreadable; an empty one would read as accepted, so it is refused."""
    ack = CommandAck()
    try:
        ack.ParseFromString(content)
    except DecodeError as error:
        raise Unreadable("the content is no CommandAck") from error
    if not ack.command_id:
        raise Unreadable("command_id: is empty")
    if not ack.acked_at_ms:
        raise Unreadable("acked_at_ms: is 0")
    if ack.result not in RESULTS:
        raise Unreadable("result: is none that a node gives")
    return ack


def read_status(_message: Sealed, content: bytes) -> NodeStatus:
    """Decode a node's status. Raises Unreadable."""
    status = NodeStatus()
    try:
        status.ParseFromString(content)
    except DecodeError as error:
        raise Unreadable("the content is no NodeStatus") from error
    if not status.at_ms:
        raise Unreadable("at_ms: is 0")
    return status


def _rank(answer: Answer) -> tuple[int, int]:
    """Return how much an answer says; nobody who was told more is told less."""
    if answer.state == "failed":
        return len(_STATES), 0
    return _STATES.index(answer.state), _LADDER.index(answer.stage)


def _answer(ack: CommandAck) -> Answer:
    """A node that knows nothing of result_state (seed 000) sends its last word only."""
    return Answer(
        state="pending" if ack.result_state == ResultState.PENDING else "final",
        result=RESULTS[ack.result],
        detail=ack.detail,
        duplicate=ack.duplicate,
        mav_result=ack.mav_result if ack.HasField("mav_result") else None,
        event_seq=ack.event_seq if ack.HasField("event_seq") else None,
        acked_at_ms=ack.acked_at_ms,
        stage=STAGES.get(ack.stage, "") if ack.result_state == ResultState.PENDING else "",
        revocation_version=ack.revocation_version if ack.HasField("revocation_version") else None,
        time_quality=ack.time_quality if ack.HasField("time_quality") else None,
    )
