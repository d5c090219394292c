"""What leaves the node: acks one after another, status newest wins.

One thread owns the link's outgoing side, because a put that blocks (a slow link, a peer that has
just died) must not stop the node's loop or Zenoh's callbacks. Acks that can't leave are kept for
`ACK_PATIENCE_S`; then the log is told that they did not. On a dead link nothing else is lost: the
issuer publishes its order again, and the stored result is the answer.
"""

from __future__ import annotations

import sys
import threading
import traceback
from collections import deque
from dataclasses import dataclass

from autopilot.adapters.mesh.link import LinkDown, Wire
from autopilot.ports.edges import InputClass, Offer
from autopilot.trust.clock import Clock, wall_ms
from autopilot.trust.envelope import MessageType, Packer, PackError
from autopilot.trust.limits import TTL_MS_MAX
from autopilot.wire.keys import ack_key, status_key
from events.schema.orders_pb2 import AckPublished
from events.schema.waypoint_pb2 import CommandAck, NodeStatus

ACK_PATIENCE_S = TTL_MS_MAX / 1000  # as long as an order can live: nobody waits for a later answer
ACKS_WAITING_MAX = 1024  # as the node's own bound on outcomes
STATUS_TTL_MS = 10_000  # an older status misleads
POLL_S = 0.1  # how often a link that is down is looked at while something waits


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """An ack to seal once the link is there."""

    effect_seq: int | None  # record that asked for it; None: the adapter's own, which nobody records
    in_reply_to: bytes
    ack: CommandAck
    give_up_mono_ns: int


class Outbox:
    """Seals and publishes what the node says."""

    def __init__(self, node: str, wire: Wire, packer: Packer, clock: Clock, offer: Offer) -> None:
        self._node = node
        self._wire = wire
        self._packer = packer
        self._clock = clock
        self._offer = offer
        self._answers: deque[Answer] = deque()
        self._outcomes: deque[AckPublished] = deque()
        self._status: NodeStatus | None = None
        self._wake = threading.Condition()
        self._stopped = False
        self._thread = threading.Thread(target=self._run, name="mesh-outbox", daemon=True)

    def start(self) -> None:
        """Begin to send."""
        self._thread.start()

    def stop(self) -> None:
        """Send what can leave now, then end."""
        with self._wake:
            self._stopped = True
            self._wake.notify()
        if self._thread.is_alive():
            self._thread.join(timeout=5)

    def answer(self, answer: Answer) -> None:
        """Queue an ack; when too many wait, say at once that this one did not leave."""
        with self._wake:
            if len(self._answers) < ACKS_WAITING_MAX:
                self._answers.append(answer)
            else:
                self._conclude(answer, "too many answers wait")
            self._wake.notify()

    def status(self, status: NodeStatus) -> None:
        """Replace the status that waits."""
        with self._wake:
            self._status = status
            self._wake.notify()

    def turn(self) -> bool:
        """Send what can be sent and tell what came of it; return whether something still waits."""
        with self._wake:
            status, self._status = self._status, None
        linked = self._wire.linked()
        if status is not None and linked:
            self._send_status(status)
        for _ in range(len(self._answers)):
            answer = self._answers.popleft()
            if linked:
                self._conclude(answer, self._send_ack(answer))
            elif self._clock.mono_ns() >= answer.give_up_mono_ns:
                self._conclude(answer, "no link")
            else:
                self._answers.append(answer)
        while self._outcomes and self._offer(InputClass.OUTCOME, self._outcomes[0]):
            self._outcomes.popleft()
        return bool(self._answers or self._outcomes)

    def _send_ack(self, answer: Answer) -> str:
        """Return why it did not leave; empty when it did."""
        key_expr = ack_key(self._node, answer.ack.command_id)
        ack = CommandAck()
        ack.CopyFrom(answer.ack)
        ack.acked_at_ms = wall_ms(self._clock)
        content = ack.SerializeToString(deterministic=True)
        try:
            packed = self._packer.pack(
                MessageType.ACK, key_expr, content, ttl_ms=TTL_MS_MAX, in_reply_to=answer.in_reply_to
            )
            self._wire.put(key_expr, packed.envelope, urgent=True)
        except (PackError, LinkDown) as error:
            return str(error)
        return ""

    def _send_status(self, status: NodeStatus) -> None:
        key_expr = status_key(self._node)
        content = status.SerializeToString(deterministic=True)
        try:
            packed = self._packer.pack(MessageType.STATUS, key_expr, content, ttl_ms=STATUS_TTL_MS)
            self._wire.put(key_expr, packed.envelope, urgent=False)
        except (PackError, LinkDown):
            return  # the next one comes within a second

    def _conclude(self, answer: Answer, failure: str) -> None:
        if answer.effect_seq is not None:
            outcome = AckPublished(effect_seq=answer.effect_seq)
            if failure:
                outcome.failure = failure
            self._outcomes.append(outcome)

    def _run(self) -> None:
        waiting = False
        while not self._stopped:
            with self._wake:
                idle = self._status is None and not self._answers and not self._outcomes
                if not self._stopped and (idle or (waiting and self._status is None)):
                    self._wake.wait(POLL_S if waiting else None)
            waiting = self._surely_turned()
        self.turn()

    def _surely_turned(self) -> bool:
        """Turn; a defect over one message must not silence all that come after it."""
        try:
            return self.turn()
        except Exception:  # noqa: BLE001 - the boundary of the thread
            print(f"autopilot: an answer or a status failed:\n{traceback.format_exc()}", file=sys.stderr, flush=True)
            return False
