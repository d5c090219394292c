"""An operator's side of the mesh: orders out, answers and status in, believed only when they prove themselves.

A shell and a page both stand on this library:

    with Issuer(load_identity("keys/alice"), ["tcp/127.0.0.1:7447"]) as issuer:
        order = issuer.send("wasp-01", point_at_place(52.1, 4.3, 12))  # a row is durable, then it leaves
        answer = issuer.wait(order, told=print)  # received, sent, in progress, then the last word
        issuer.wait_pointing(order).words()  # "arrived, 0.4 deg off, after 2.1 s"
        issuer.commander("wasp-01", camera=1), issuer.permissions("wasp-01"), issuer.history()

It is a library with a thread. Every method may be called from any thread; what is returned is a value, but for `Order`,
whose `answer` the library replaces. While an order lives it is published each second as a fresh envelope with the same
id, body and number. An ack changes something only when the gate has verified, opened and decoded it, and the ledger
found it to answer an envelope of ours; only then a row is written, and only then waiters are told. While it is open it
takes newer lists, roots, group keys and an own token as they come (`renewed`), and is present where it is told to be
(`attending`).
"""

from __future__ import annotations

import os
import threading
import time
import uuid
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Literal

from autopilot.adapters.mesh.link import Link, LinkDown, Wire
from autopilot.ground.attending import Attendance
from autopilot.ground.following import Commander, Permission, Pointing, permissions, pointing
from autopilot.ground.issued import AuditRow, Begun, IssuedStore, NotRecorded
from autopilot.ground.ledger import GRACE_NS, Answer, Ledger, Order, check_life, read_ack
from autopilot.ground.renewed import Renewed
from autopilot.ground.statuses import NODES, SeenStatus, Statuses
from autopilot.trust.clock import Clock, HostClock, wall_ms
from autopilot.trust.envelope import MessageType, Packer, PackError
from autopilot.trust.gate import Gate
from autopilot.trust.identity import Identity
from autopilot.trust.keys import Random
from autopilot.trust.limits import DOCUMENT_BYTES_MAX, ORDER_TTL_MS
from autopilot.trust.tally import Tally
from autopilot.trust.verdict import Opened
from autopilot.wire.keys import ack_address, acks_of, cosign_key, order_key, proof_key, status_key
from events.schema.waypoint_pb2 import CheckpointCosignature, CommandAck, DeviceCommand, NodeStatus

ANSWER_GRACE_S = GRACE_NS / 1e9
POINTING_S = 15.0  # longer than a node waits for its gimbal


class UnknownNode(Exception):
    """Orders are bound to a node's key, and this node's key is not known."""


class Issuer:
    """Gives orders as one identity and keeps what nodes say of themselves."""

    def __init__(
        self,
        identity: Identity,
        connect: Sequence[str] = (),
        *,
        mode: Literal["client", "peer"] = "client",
        listen: Sequence[str] = (),
        reconnect_ms: int = 500,
        clock: Clock | None = None,
        random: Random = os.urandom,
        wire: Wire | None = None,
    ) -> None:
        """Make an issuer that connects to Zenoh endpoints; `start` begins. `wire` replaces Zenoh in tests."""
        self._identity = identity
        self._clock = clock or HostClock()
        self._random = random
        self._wire = wire or Link(
            mode=mode, connect=connect, listen=listen, reconnect_ms=reconnect_ms, answer_bytes_max=DOCUMENT_BYTES_MAX
        )
        self._believing = Renewed(identity, self._clock, self._wire)
        self._packer = Packer(identity, self._clock, random, self._believing)
        self._store = IssuedStore(identity.folder)
        self._unrecorded: list[str] = []
        self._ledger = Ledger(self._record_last_word)
        self._watched: set[str] = set()
        self._heard = Statuses(self._believing, self._clock, self._watched, self._ledger.changed)
        self.witness = self._heard.witness
        self._attendance = Attendance(self._believing, self._packer, self._wire, self._heard)
        self._stopped = False
        self._thread = threading.Thread(target=self._run, name="issuer", daemon=True)
        self._ack_gate: Gate[CommandAck] = Gate(
            identity,
            MessageType.ACK,
            kinds=NODES,
            is_ours=self._is_watched_ack,
            reader=read_ack,
            clock=self._clock,
            believing=self._believing,
            takes_undated=True,  # an ack names the envelope it answers
        )

    def start(self) -> None:
        """Begin to connect and to send; returns at once, also when no router answers yet."""
        self._believing.start()
        self._wire.start()
        self._thread.start()
        self._attendance.start()

    def stop(self) -> None:
        """Stop sending and close."""
        with self._ledger.changed:
            self._stopped = True
            self._ledger.changed.notify_all()
        if self._thread.is_alive():
            self._thread.join(timeout=5)
        self._attendance.stop()
        self._believing.stop()
        self._wire.stop()
        self._store.close()

    def __enter__(self) -> Issuer:
        self.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self.stop()

    def watch(self, node: str) -> None:
        """Listen to a node's status and answers. Orders do so by themselves."""
        if node not in self._watched:
            self._watched.add(node)
            self._wire.subscribe(acks_of(node), self.receive_ack)
            self._wire.subscribe(status_key(node), self.receive_status)

    def attend(self, node: str) -> None:
        """Be present at a node until `leave`, as long as this is open: once a second it is told that a person is there.

        That keeps a node whose operators fall silent from coming home, so ask for it where a person looks.
        """
        self.watch(node)
        self._attendance.attend(node)

    def leave(self, node: str) -> None:
        """Be present at a node no more."""
        self._attendance.leave(node)

    def attended(self) -> frozenset[str]:
        """Return the nodes that this is present at."""
        return self._attendance.nodes

    def renew(self) -> None:
        """Take newer documents of the identity's folder now; by itself it does so every second. Never raises."""
        self._believing.turn()

    def know_node(self, node: str, public_key: bytes) -> None:
        """Bind orders for `node` to this Ed25519 key (32 bytes)."""
        self._heard.node_keys[node] = public_key

    def knows(self, node: str) -> bool:
        """Say whether the node's key is known: from its token in the identity's folder, or from its status."""
        return node in self._heard.node_keys

    def send(self, node: str, command: DeviceCommand, life_s: float = ORDER_TTL_MS / 1000) -> Order:
        """Give an order; it is published until its final answer, again every second, for `life_s`.

        `command` says what is ordered (see `compose`); id and target are filled in here. When this returns,
        its pending row is durable, and nothing has left. Raises UnknownNode, NotRecorded, and ValueError for a
        life outside what a node takes.
        """
        check_life(life_s)
        key = self._heard.node_keys.get(node)
        if key is None:
            raise UnknownNode(f"the key of {node} is not known; give it, or wait for the node's status")
        complete = DeviceCommand()
        complete.CopyFrom(command)
        complete.command_id = str(uuid.UUID(bytes=self._random(16), version=4))
        complete.target_node_pubkey = key
        content = complete.SerializeToString(deterministic=True)
        begun = self._store.begin(
            node, complete.command_id, content, self._identity.principal_id, wall_ms(self._clock), int(life_s * 1000)
        )
        return self._add(node, key, complete.command_id, content, begun, life_s)

    def repeat(self, order: Order, life_s: float = ORDER_TTL_MS / 1000) -> Order:
        """Send the same order once more: same id, body and number, in envelopes of its own. Raises as `send` does."""
        check_life(life_s)
        begun = self._store.again(order.row, wall_ms(self._clock), int(life_s * 1000))
        return self._add(order.node, order.node_key, order.command_id, order.content, begun, life_s)

    def publish_raw(self, key_expr: str, payload: bytes) -> None:
        """Publish bytes as they are, for showing what a node does with garbage and replays. Raises LinkDown."""
        self._wire.put(key_expr, payload, urgent=True)

    def wait(
        self, order: Order, timeout_s: float | None = None, told: Callable[[Answer], None] = lambda _: None
    ) -> Answer:
        """Wait for the final answer; return the best that is known when time is up.

        `told` is called on this thread with every answer that is not the last word, as it comes.
        """
        left_s = max(0.0, (order.ends_mono_ns - self._clock.mono_ns()) / 1e9) + ANSWER_GRACE_S
        ends_s, known = time.monotonic() + (left_s if timeout_s is None else timeout_s), Answer()
        while not order.is_done:
            with self._ledger.changed:
                left_s = ends_s - time.monotonic()
                if not self._ledger.changed.wait_for(partial(order.differs, known), max(0.0, left_s)):
                    break
                known = order.answer
            if known.state == "pending":
                told(known)
        return order.answer

    def wait_pointing(self, order: Order, camera: int = 1, timeout_s: float = POINTING_S) -> Pointing:
        """Wait until the node says what its gimbal did for an accepted order; return what is known when time is up."""
        since_seq = order.answer.event_seq or 0

        def seen(status: NodeStatus) -> Pointing:
            return pointing(status, order.command_id, camera, since_seq)

        found = self.wait_status(order.node, lambda status: seen(status).is_done, timeout_s) or self.status(order.node)
        return Pointing() if found is None else seen(found.status)

    def commander(self, node: str, camera: int = 1) -> Commander | None:
        """Return who commanded a camera last, as far as the node's status has said since `watch`; None: unknown."""
        return self._heard.commander(node, camera)

    def permissions(self, node: str) -> tuple[Permission, Permission] | None:
        """Return what this operator may do to a node's cameras and flight, and why not; None before its status."""
        seen, held = self.status(node), self._believing.held
        if seen is None:
            return None
        token = held.token
        expired = not token.not_before_ms <= wall_ms(self._clock) <= token.not_after_ms
        revoked = held.revocations.covers(token)
        return permissions(seen.status, token.kind, token.roles, revoked=revoked, expired=expired)

    def history(self) -> tuple[AuditRow, ...]:
        """Return the issuer's own audit, oldest row first. Raises NotRecorded where it can't be read."""
        return self._store.rows()

    def unrecorded(self) -> tuple[str, ...]:
        """Return why last words are missing in the audit; empty while none is."""
        with self._ledger.changed:
            return tuple(self._unrecorded)

    def status(self, node: str) -> SeenStatus | None:
        """Return the newest status of a node, or None before the first."""
        return self._heard.newest(node)

    def wait_status(self, node: str, until: Callable[[NodeStatus], bool], timeout_s: float) -> SeenStatus | None:
        """Wait until a node's status satisfies `until`; None when time is up."""
        self.watch(node)

        def satisfied() -> bool:
            seen = self._heard.newest(node)
            return seen is not None and until(seen.status)

        with self._ledger.changed:
            return self._heard.newest(node) if self._ledger.changed.wait_for(satisfied, timeout_s) else None

    def linked(self) -> bool:
        """Say whether a router or peer is connected now."""
        return self._wire.linked()

    def tallies(self) -> dict[str, Tally]:
        """Return what the gates of acks and status have counted."""
        return {"acks": self._ack_gate.tally(), "status": self._heard.tally()}

    def disbelieved(self) -> dict[str, int]:
        """Return how many authentic acks did not fit an order of ours, by reason."""
        return self._ledger.refused()

    def complaints(self) -> dict[str, str]:
        """Return the nodes whose signed logs contradict what they signed before, and how."""
        return self._heard.complaints()

    def complain(self, node: str, wrong: str) -> None:
        """Note what was found out about a node's log."""
        self._heard.complain(node, wrong)

    def node_key(self, node: str) -> bytes | None:
        """Return the Ed25519 key of a node, None while it is not known."""
        return self._heard.node_keys.get(node)

    def ask(self, node: str, question: bytes, timeout_s: float) -> list[bytes]:
        """Ask for a consistency proof; return what was answered, by whomever."""
        return self._wire.ask(proof_key(node), question, timeout_s)

    def cosign(self, node: str, note: str) -> None:
        """Send a checkpoint with our cosignature under it, once. It may be lost: the node's status shows whether."""
        key_expr = cosign_key(node)
        content = CheckpointCosignature(checkpoint=note).SerializeToString(deterministic=True)
        with suppress(PackError, LinkDown):
            packed = self._packer.pack(MessageType.COSIGNATURE, key_expr, content, ttl_ms=ORDER_TTL_MS)
            self._wire.put(key_expr, packed.envelope, urgent=False)

    def receive_ack(self, key_expr: str, payload: bytes) -> None:
        """Judge a sample on an ack key. Never raises."""
        verdict = self._ack_gate.judge(key_expr, payload)
        if isinstance(verdict, Opened):
            self._ledger.believe(verdict.message, verdict.value)

    def receive_status(self, key_expr: str, payload: bytes) -> None:
        """Judge a sample on a status key; older ones than the newest are ignored. Never raises."""
        self._heard.receive(key_expr, payload)

    def turn(self) -> None:
        """Publish what is due now, and note what was not answered in its time."""
        now_mono_ns = self._clock.mono_ns()
        for order in self._ledger.overdue(now_mono_ns):
            self._record(order, "unanswered", detail=order.answer.detail)
        for order in self._ledger.due(now_mono_ns):
            if self._wire.linked():
                self._publish(order, now_mono_ns)
            else:
                self._ledger.postponed(order, now_mono_ns)

    def _record_last_word(self, order: Order, answer: Answer) -> None:
        self._record(order, "final", result=answer.result or answer.state, detail=answer.detail)

    def _record(self, order: Order, state: str, *, result: str = "", detail: str = "") -> None:
        """Write what came of an order. Where that fails the answer still counts: it is the row that is missing."""
        try:
            self._store.end(order.row, state, at_ms=wall_ms(self._clock), result=result, detail=detail)
        except NotRecorded as error:
            self._unrecorded.append(str(error))

    def _add(self, node: str, key: bytes, command_id: str, content: bytes, begun: Begun, life_s: float) -> Order:
        now_mono_ns = self._clock.mono_ns()
        order = Order(
            node=node,
            node_key=key,
            command_id=command_id,
            content=content,
            order_seq=begun.order_seq,
            row=begun.row,
            ends_mono_ns=now_mono_ns + int(life_s * 1e9),
            due_mono_ns=now_mono_ns,
        )
        self.watch(node)
        self._ledger.add(order)
        return order

    def _publish(self, order: Order, now_mono_ns: int) -> None:
        """Pack a fresh envelope that dies with the order, note it, publish it."""
        key_expr = order_key(order.node, order.command_id)
        ttl_ms = max(1, (order.ends_mono_ns - now_mono_ns) // 1_000_000)
        try:
            packed = self._packer.pack(
                MessageType.ORDER,
                key_expr,
                order.content,
                ttl_ms=ttl_ms,
                order_seq=order.order_seq,
                node_challenge=self._heard.challenge(order.node),
            )
        except PackError as error:
            self._ledger.failed(order, str(error))
            return
        self._ledger.published(order, packed, now_mono_ns)
        try:
            self._wire.put(key_expr, packed.envelope, urgent=True)
        except LinkDown:
            self._ledger.postponed(order, now_mono_ns)

    def _run(self) -> None:
        while not self._stopped:
            due = self._ledger.next_due()
            with self._ledger.changed:
                if not self._stopped and due == self._ledger.next_due():
                    wait_s = None if due is None else max(0.0, (due - self._clock.mono_ns()) / 1e9)
                    if wait_s != 0:
                        self._ledger.changed.wait(wait_s)
            self.turn()

    def _is_watched_ack(self, key_expr: str) -> bool:
        address = ack_address(key_expr)
        return address is not None and address.node in self._watched
