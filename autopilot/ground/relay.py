"""The verifying relay: two sessions, and between them only what a relay can verify without a secret.

Orders, cosignatures and presence go inward, acks and status outward, byte for byte as they came. Each kind of key has
a gate of its own (`autopilot.trust.keyless`). A Directory's documents come in as they are asked for
(`relay_documents`). What passed waits in a bounded queue for a thread that puts it on the other side, for a put may
block and a callback must not. Nothing is answered, kept on disk or raised here; everything is counted.
"""

from __future__ import annotations

import queue
import threading
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

from autopilot.adapters.mesh.link import LinkDown, Reply, Wire
from autopilot.ground.relay_config import VerifySection
from autopilot.ground.relay_documents import Documents
from autopilot.ground.relay_papers import Papers
from autopilot.trust.clock import Clock
from autopilot.trust.documents import Trust
from autopilot.trust.envelope import MessageType
from autopilot.trust.keyless import KeylessGate, Rates
from autopilot.trust.window import TokenBucket
from autopilot.wire.keys import NODE_CHANNELS, PRESENCE, PROOFS, Channel, Delivery, Direction, proof_key
from events.schema.waypoint_pb2 import EnvelopeHeader, IdentityToken, PrincipalKind

ISSUERS: Final = frozenset({PrincipalKind.OPERATOR, PrincipalKind.SERVICE})
OPERATORS: Final = frozenset({PrincipalKind.OPERATOR})  # only a person keeps an operators' link up
NODES: Final = frozenset({PrincipalKind.NODE})
PROOF_BYTES_MAX: Final = 64  # a question names two sizes and a flight
PROOF_PATIENCE_S: Final = 2.0
PROOFS_PER_S, PROOFS_BURST, PROOFS_WAITING = 2.0, 10, 16  # what a node itself answers

Counts = dict[str, int]


def node_in(channel: Channel, key_expr: str) -> str | None:
    """Return the node that a key of this channel names; None when it is no such key."""
    return chunk_in(channel, "<node>", key_expr)


def chunk_in(channel: Channel, name: str, key_expr: str) -> str | None:
    """Return what a key of this channel has for `name`, such as "<principal>"; None when it is no such key."""
    wanted, found = channel.pattern.split("/"), key_expr.split("/")
    if len(wanted) != len(found) or not all(found):
        return None
    if any(part != chunk for part, chunk in zip(wanted, found, strict=True) if not part.startswith("<")):
        return None
    return found[wanted.index(name)]


@dataclass(frozen=True, slots=True)
class Sample:
    """What passed a gate, as it was received."""

    key_expr: str
    payload: bytes
    urgent: bool


class Pump:
    """Puts on one side what passed from the other, from a thread of its own."""

    def __init__(self, wire: Wire, waiting: int) -> None:
        self._wire = wire
        self._queue: queue.Queue[Sample | None] = queue.Queue(waiting)
        self._thread = threading.Thread(target=self._run, name="relay-pump", daemon=True)
        self._lock = threading.Lock()
        self._counts: Counter[str] = Counter()

    def start(self) -> None:
        """Begin to put."""
        self._thread.start()

    def stop(self) -> None:
        """Put what waits, as far as it can be within two seconds, and end."""
        try:
            self._queue.put(None, timeout=1)
        except queue.Full:
            return
        self._thread.join(timeout=1)

    def offer(self, sample: Sample) -> None:
        """Take a sample, or count that it found the queue full. Never waits."""
        try:
            self._queue.put_nowait(sample)
        except queue.Full:
            self._count("queue_full")

    def counts(self) -> Counts:
        """Return what became of what passed: relayed, queue_full, link_down."""
        with self._lock:
            return {name: self._counts[name] for name in ("relayed", "queue_full", "link_down")}

    def _run(self) -> None:
        while (sample := self._queue.get()) is not None:
            try:
                self._wire.put(sample.key_expr, sample.payload, urgent=sample.urgent)
            except LinkDown:
                self._count("link_down")
            else:
                self._count("relayed")

    def _count(self, what: str) -> None:
        with self._lock:
            self._counts[what] += 1


class Proofs:
    """Passes questions for proofs inward and the first answer back; they are in no envelope, so only bounded."""

    def __init__(self, inner: Wire, clock: Clock) -> None:
        self._inner, self._clock = inner, clock
        self._bucket = TokenBucket(PROOFS_PER_S, PROOFS_BURST)
        self._queue: queue.Queue[tuple[str, bytes, Reply] | None] = queue.Queue(PROOFS_WAITING)
        self._thread = threading.Thread(target=self._run, name="relay-proofs", daemon=True)
        self._lock = threading.Lock()
        self._counts: Counter[str] = Counter()

    def start(self) -> None:
        """Begin to ask."""
        self._thread.start()

    def stop(self) -> None:
        """End when the question in hand is answered; do not wait for the others."""
        try:
            self._queue.put_nowait(None)
        except queue.Full:
            return
        self._thread.join(timeout=PROOF_PATIENCE_S + 1)

    def receive(self, key_expr: str, question: bytes, reply: Reply) -> None:
        """Take one question, or count why not. Never raises, never waits."""
        self._count(self._taken(key_expr, question, reply))

    def counts(self) -> Counts:
        """Return how many questions were taken, answered, and not taken by reason."""
        with self._lock:
            return {name: self._counts[name] for name in ("asked", "answered", "rate", "size", "queue_full")}

    def _taken(self, key_expr: str, question: bytes, reply: Reply) -> str:
        with self._lock:
            if not self._bucket.take(self._clock.mono_ns()):
                return "rate"
        if len(question) > PROOF_BYTES_MAX:
            return "size"
        try:
            self._queue.put_nowait((key_expr, question, reply))
        except queue.Full:
            return "queue_full"
        return "asked"

    def _run(self) -> None:
        while (asked := self._queue.get()) is not None:
            self._pass(*asked)
            del asked  # letting go of a question tells an asker that nobody answers

    def _pass(self, key_expr: str, question: bytes, reply: Reply) -> None:
        answers = self._inner.ask(key_expr, question, PROOF_PATIENCE_S)
        if answers:
            reply(answers[0])
            self._count("answered")

    def _count(self, what: str) -> None:
        with self._lock:
            self._counts[what] += 1


class RelayGate(KeylessGate):
    """A gate whose trust root may be replaced by one that follows it."""

    def believe(self, trust: Trust) -> None:
        """Go by another root from now on; every token has to prove itself again."""
        with self._lock:
            self._trust = trust
            self._tokens.clear()


class Relay:
    """Stands between the ground and the nodes; holds public documents, counters, and what waits to be put."""

    def __init__(self, config: VerifySection, papers: Papers, clock: Clock, outer: Wire, inner: Wire) -> None:
        """Make the relay; `start` listens on both sides."""
        self._config, self._papers, self._clock = config, papers, clock
        self._outer, self._inner = outer, inner
        self._pumps = {Direction.IN: Pump(inner, config.queue), Direction.OUT: Pump(outer, config.queue)}
        self._channels = [channel for channel in NODE_CHANNELS if channel.envelope_type is not None]
        self._gates = {channel.name: self._gate(channel) for channel in self._channels}
        self._proofs = Proofs(inner, clock)
        self._documents = Documents(papers, clock, outer, inner, give=self._give, believe=self._believe)

    def start(self) -> None:
        """Listen; returns at once."""
        for channel in self._channels:
            side = self._outer if channel.direction is Direction.IN else self._inner
            for node in self._config.nodes:
                key_expr = channel.pattern.replace("<node>", node).replace("<cmd_id>", "*").replace("<principal>", "*")
                side.subscribe(key_expr, partial(self.receive, channel))
        for node in self._config.nodes:
            self._outer.answer(proof_key(node), partial(self._proofs.receive, proof_key(node)))
        for pump in self._pumps.values():
            pump.start()
        self._proofs.start()
        self._documents.start()
        self._inner.start()
        self._outer.start()

    def stop(self) -> None:
        """Take no more, put what waits, and close."""
        self._outer.stop()
        self._proofs.stop()
        self._documents.stop()
        for pump in self._pumps.values():
            pump.stop()
        self._inner.stop()

    def look(self) -> str:
        """Do what is due: take a newer list from its file, ask for one. Returns what is wrong with the file."""
        self._documents.turn()
        return self._papers.look()

    def receive(self, channel: Channel, key_expr: str, payload: bytes) -> None:
        """Judge one sample; what passes waits to be put on the other side, unchanged. Never raises."""
        if not self._gates[channel.name].judge(key_expr, payload):
            urgent = channel.delivery is Delivery.BLOCK
            self._pumps[channel.direction].offer(Sample(key_expr, payload, urgent))

    def counts(self) -> dict[str, Counts]:
        """Return every counter: of each kind of key (those that are 0 left out but received and passed), each way."""
        found: dict[str, Counts] = {}
        for name, gate in self._gates.items():
            passage = gate.passage()
            dropped = {reason: count for reason, count in passage.dropped.items() if count}
            found[name] = {"received": passage.received, "passed": passage.passed, **dropped}
        found["inward"] = self._pumps[Direction.IN].counts()
        found["outward"] = self._pumps[Direction.OUT].counts()
        found[PROOFS.name] = self._proofs.counts()
        return found | self._documents.counts()

    def _give(self, key_expr: str, document: bytes) -> None:
        self._pumps[Direction.IN].offer(Sample(key_expr, document, urgent=False))

    def _believe(self) -> None:
        for gate in self._gates.values():
            gate.believe(self._papers.trust)

    def _gate(self, channel: Channel) -> RelayGate:
        config, inward = self._config, channel.direction is Direction.IN
        return RelayGate(
            self._papers.trust,
            self._papers.revocations,
            MessageType(channel.envelope_type or 0),
            kinds=NODES if not inward else OPERATORS if channel is PRESENCE else ISSUERS,
            is_ours=lambda key_expr: node_in(channel, key_expr) in config.nodes,
            admits=partial(_admitted, config.classification_max, config.owners if inward else None, channel),
            clock=self._clock,
            rates=Rates(
                samples_per_s=config.samples_per_s,
                samples_burst=config.samples_burst,
                device_per_s=config.device_per_s,
                device_burst=config.device_burst,
            ),
        )


def _admitted(
    classification_max: int,
    owners: Sequence[str] | None,
    channel: Channel,
    header: EnvelopeHeader,
    token: IdentityToken,
) -> str:
    """Say why a relay drops what its sender may send: the seed's gate on the signed cleartext. Empty: it passes."""
    if header.classification > classification_max:
        return "classification"
    if owners is not None and token.principal_id not in owners:
        return "owner"
    if channel is PRESENCE and chunk_in(channel, "<principal>", header.key_expr) != token.principal_id:
        return "owner"
    if channel.direction is Direction.OUT and node_in(channel, header.key_expr) != token.principal_id:
        return "owner"
    return ""
