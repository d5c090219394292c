"""The node's side of the mesh: the gate in Zenoh's callback, observations to the inbox, acks and status out.

It decides nothing about an order. What the gate drops is counted by reason and never answered;
what it opens is offered to the node.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Literal

from google.protobuf.message import Message

from autopilot.adapters.mesh.hearing import Hearing, PresenceDoor
from autopilot.adapters.mesh.link import Link, Wire
from autopilot.adapters.mesh.orders import Order, order_malformed, order_received, read_order
from autopilot.adapters.mesh.outbox import ACK_PATIENCE_S, Answer, Outbox
from autopilot.adapters.mesh.reading import Locate
from autopilot.adapters.mesh.trust_client import TrustClient
from autopilot.adapters.mesh.witnesses import CosignatureDoor, ProofDoor
from autopilot.ports.config import MeshSection
from autopilot.ports.edges import Clock, CosignatureJudge, InputClass, Offer, Proving
from autopilot.trust.believing import Believing, Fixed
from autopilot.trust.book import TrustBook
from autopilot.trust.envelope import MessageType, Packer
from autopilot.trust.gate import Gate
from autopilot.trust.identity import Identity
from autopilot.trust.keys import Random
from autopilot.trust.limits import DOCUMENT_BYTES_MAX
from autopilot.trust.tally import Tally
from autopilot.trust.verdict import Malformed, Rejected
from autopilot.wire.keys import cosign_key, order_address, orders_of, presences_of, proof_key
from events.schema.orders_pb2 import AckResult as RecordedResult
from events.schema.orders_pb2 import OrderMalformed, OrderReceived, SendAck
from events.schema.waypoint_pb2 import (
    AckResult,
    CommandAck,
    NodeStatus,
    OrderStage,
    PrincipalKind,
    ResultState,
)

ISSUERS = frozenset({PrincipalKind.OPERATOR})  # nodes and services never command


class MeshAdapter:
    """Orders in, acks and status out, for one node."""

    def __init__(
        self,
        config: MeshSection,
        identity: Identity,
        clock: Clock,
        locate: Locate,
        offer: Offer,
        *,
        wire: Wire | None = None,
        random: Random = os.urandom,
        refusal: Callable[[], str] = lambda: "busy: this node takes no orders just now",
        proving: Proving | None = None,
        judge: CosignatureJudge | None = None,
        book: TrustBook | None = None,
        attending: Iterable[str] = (),
    ) -> None:
        """Make the adapter; `start` opens the session.

        `locate` works out a Place; `offer` hands observations to the node and is called on
        Zenoh's thread and on the outbox's; `refusal` is what to say where it refuses an order.
        `wire` replaces the Zenoh link in tests. With `proving` and `judge` those who watch the
        log find doors of their own (`witnesses`). With `book` what is believed changes in flight; else
        it is `identity` for good, and `clock` is right. Who has a role of `attending` keeps the operators'
        link up, by presence or by an order.
        """
        self._identity = identity
        self._clock = clock
        self._offer, self._refusal = offer, refusal
        self._wire = wire or _link(config)
        self._book = book
        self._believing: Believing = book or Fixed(identity, clock)
        self._gate: Gate[Order] = Gate(
            identity,
            MessageType.ORDER,
            kinds=ISSUERS,
            is_ours=self._is_ours,
            reader=lambda message, content: read_order(message, content, locate),
            clock=clock,
            samples_per_s=config.samples_per_s,
            samples_burst=config.samples_burst,
            believing=self._believing,
        )
        packer = Packer(identity, clock, random, self._believing)
        self._outbox = Outbox(identity.principal_id, self._wire, packer, clock, offer)
        self._taken: Counter[str] = Counter()
        self._fetching = self._fetcher(book) if book else None
        self._proofs = ProofDoor(clock, proving) if proving else None
        self._cosignatures = CosignatureDoor(identity, clock, judge, offer, book) if judge else None
        roles = frozenset(attending)
        self._hearing = Hearing(clock, roles, config.presence_period_s, offer)
        self._presence = PresenceDoor(identity, clock, self._hearing, book) if roles else None

    def start(self) -> None:
        """Open the session and listen; returns at once, also when no router answers yet."""
        node = self._identity.principal_id
        self._wire.subscribe(orders_of(node), self.receive)
        if self._cosignatures is not None:
            self._wire.subscribe(cosign_key(node), self._cosignatures.receive)
        if self._presence is not None:
            self._wire.subscribe(presences_of(node), self._presence.receive)
        if self._proofs is not None:
            self._wire.answer(proof_key(node), self._proofs.receive)
        if self._fetching is not None:
            self._fetching.start()
        self._outbox.start()
        self._wire.start()

    def stop(self) -> None:
        """Send what can leave now, then close."""
        if self._fetching is not None:
            self._fetching.stop()
        self._outbox.stop()
        self._wire.stop()

    def _fetcher(self, book: TrustBook) -> TrustClient:
        """Return what fetches documents for the book from a Directory on the mesh."""
        identity = self._identity
        client = TrustClient(
            self._wire,
            self._clock,
            book.offer,
            deployment_id=identity.deployment_id,
            device_key_id=identity.sign_key.key_id,
        )
        book.ask_through(client)
        return client

    def restore_window(self, nonces: Iterable[tuple[bytes, bytes, int]], *, whole: bool = True) -> None:
        """Remember the log's nonces before `start`: (device_key_id, nonce, milliseconds that remain).

        `whole`: they are all that were alive; else nothing passes that may have been sent before now.
        """
        self._gate.restore(nonces, whole=whole)

    def receive(self, key_expr: str, payload: bytes) -> None:
        """Judge one sample and offer what came of it. Never raises."""
        verdict = self._gate.judge(key_expr, payload)
        if isinstance(verdict, Rejected):
            return
        observation: OrderReceived | OrderMalformed
        observation = order_malformed(verdict) if isinstance(verdict, Malformed) else order_received(verdict)
        if not self._offer(InputClass.ORDER, observation):
            self._refuse(observation)
        self._hearing.hear(verdict.message.sender)

    def perform(self, seq: int, effect: Message, recorded_mono_ns: int) -> None:
        """Perform a `SendAck`: it is sealed and published by the outbox, which offers AckPublished for a last word.

        On a dead link the ack waits ACK_PATIENCE_S from its record; then its outcome is "no link".
        """
        if not isinstance(effect, SendAck):
            return
        ack = CommandAck(
            command_id=effect.command_id,
            result=AckResult.Value(RecordedResult.Name(effect.result)),
            detail=effect.detail,
            result_state=ResultState.FINAL if effect.final else ResultState.PENDING,
            event_seq=seq,
        )
        if effect.duplicate:
            ack.duplicate = True
        if effect.stage:
            ack.stage = OrderStage.ValueType(effect.stage)
        if effect.HasField("mav_result"):
            ack.mav_result = effect.mav_result
        # Nobody waits to hear whether an answer left that is not the last one: the next arrival tells the same.
        self._queue(seq if effect.final else None, effect.in_reply_to, ack, recorded_mono_ns)

    def publish_status(self, status: NodeStatus) -> None:
        """Publish the status with what the node believes; a newer one replaces one that could not leave yet."""
        held, time = self._believing.held, self._believing.time()
        status.revocation_version = held.revocations.version
        status.epoch_id = max(held.epochs, default=0)
        status.time_quality = time.quality
        if time.earliest_ms > held.revocations.next_update_ms:
            status.revocation_stale = True
        if self._book is not None and not time.trusted:
            status.node_challenge = self._book.challenge()
        self._outbox.status(status)

    def tally(self) -> Tally:
        """Return what the gate has counted since start, for the status."""
        return self._gate.tally()

    def take_rejections(self) -> dict[str, int]:
        """Return the rejections since the last call by reason, sorted, none of them 0."""
        totals = Counter(self._gate.tally().rejected)
        totals.update({f"trust: {what}": count for what, count in self._not_taken().items()})
        for door in (self._proofs, self._cosignatures, self._presence):
            totals.update(door.rejected() if door is not None else {})
        fresh = totals - self._taken
        self._taken = totals
        return dict(sorted(fresh.items()))

    def _not_taken(self) -> dict[str, int]:
        return self._book.counts() if self._book is not None else {}

    def _is_ours(self, key_expr: str) -> bool:
        address = order_address(key_expr)
        return address is not None and address.node == self._identity.principal_id

    def _refuse(self, observation: OrderReceived | OrderMalformed) -> None:
        """Refuse what the inbox refused. Not final: nothing was recorded, a later repeat may be taken."""
        ack = CommandAck(
            command_id=observation.command_id,
            result=AckResult.ACK_REJECTED,
            detail=self._refusal(),
            result_state=ResultState.PENDING,
        )
        self._queue(None, observation.in_reply_to, ack, self._clock.mono_ns())

    def _queue(self, seq: int | None, in_reply_to: bytes, ack: CommandAck, recorded_mono_ns: int) -> None:
        held, time = self._believing.held, self._believing.time()
        ack.revocation_version = held.revocations.version
        ack.time_quality = time.quality
        if time.earliest_ms > held.revocations.next_update_ms:
            ack.revocation_stale = True
        give_up_mono_ns = recorded_mono_ns + int(ACK_PATIENCE_S * 1e9)
        self._outbox.answer(Answer(effect_seq=seq, in_reply_to=in_reply_to, ack=ack, give_up_mono_ns=give_up_mono_ns))


def _link(config: MeshSection) -> Link:
    mode: Literal["client", "peer"] = config.mode
    return Link(
        mode=mode,
        connect=config.connect,
        listen=config.listen,
        reconnect_ms=config.reconnect_ms,
        answer_bytes_max=DOCUMENT_BYTES_MAX,
    )
