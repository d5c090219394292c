"""The doors for those who watch the node's log: queries for consistency proofs, and cosignatures of checkpoints.

A query comes in no envelope: it asks for hashes of salted records, which tell nothing, and its answer is believed for
what it proves. So anybody on the mesh may ask, at a bounded rate, and what one asker takes another lacks. A
cosignature passes the gate like an order; what it is worth is judged by the node.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable

from google.protobuf.message import DecodeError

from autopilot.ports.edges import Clock, Consistency, CosignatureJudge, InputClass, Offer, Proving
from autopilot.trust.believing import Believing
from autopilot.trust.documents import DocumentMalformed, parse
from autopilot.trust.envelope import MessageType
from autopilot.trust.gate import Gate
from autopilot.trust.identity import Identity
from autopilot.trust.verdict import Opened, Sealed, Unreadable
from autopilot.trust.window import TokenBucket
from autopilot.wire.keys import cosign_key
from events.schema.waypoint_pb2 import CheckpointCosignature, ConsistencyAnswer, ConsistencyRequest, PrincipalKind

# A witness asks once for each checkpoint, every 10 s; a few may catch up at once.
PROOFS_PER_S, PROOFS_BURST = 2.0, 10
COSIGNATURES_PER_S, COSIGNATURES_BURST = 2.0, 10
REQUEST_BYTES_MAX = 64
WITNESSES = frozenset({PrincipalKind.OPERATOR, PrincipalKind.SERVICE})


class ProofDoor:
    """Takes queries for consistency proofs."""

    def __init__(self, clock: Clock, proving: Proving) -> None:
        self._clock = clock
        self._proving = proving
        self._bucket = TokenBucket(PROOFS_PER_S, PROOFS_BURST)
        self._lock = threading.Lock()
        self._rejected: Counter[str] = Counter()

    def receive(self, payload: bytes, reply: Callable[[bytes], None]) -> None:
        """Take one query; it is answered later, or not at all. Never raises."""
        because = self._taken(payload, reply)
        if because:
            self._reject(because)

    def rejected(self) -> Counter[str]:
        """Return how many queries were not answered since start, by reason."""
        with self._lock:
            return Counter(self._rejected)

    def _taken(self, payload: bytes, reply: Callable[[bytes], None]) -> str:
        with self._lock:
            if not self._bucket.take(self._clock.mono_ns()):
                return "rate"
        if len(payload) > REQUEST_BYTES_MAX:
            return "size"
        try:
            asked = parse(ConsistencyRequest, payload)
        except DocumentMalformed:
            return "unreadable"
        if not 0 < asked.old_size < asked.new_size:
            return "unreadable"

        def answer(found: Consistency | None) -> None:
            if found is None:
                self._reject("no such log")
            else:
                reply(_answer(asked, found))

        return "" if self._proving.ask(asked.flight_number, asked.old_size, asked.new_size, answer) else "busy"

    def _reject(self, because: str) -> None:
        with self._lock:
            self._rejected[f"proof: {because}"] += 1


class CosignatureDoor:
    """Takes cosignatures."""

    def __init__(
        self,
        identity: Identity,
        clock: Clock,
        judge: CosignatureJudge,
        offer: Offer,
        believing: Believing | None = None,
    ) -> None:
        self._judge = judge
        self._offer = offer
        self._lock = threading.Lock()
        self._rejected: Counter[str] = Counter()
        self._gate: Gate[str] = Gate(
            identity,
            MessageType.COSIGNATURE,
            kinds=WITNESSES,
            is_ours=lambda key_expr: key_expr == cosign_key(identity.principal_id),
            reader=read_cosignature,
            clock=clock,
            samples_per_s=COSIGNATURES_PER_S,
            samples_burst=COSIGNATURES_BURST,
            believing=believing,
        )

    def receive(self, key_expr: str, payload: bytes) -> None:
        """Judge one sample and offer what came of it. Never raises."""
        verdict = self._gate.judge(key_expr, payload)
        if not isinstance(verdict, Opened):
            return
        judged = self._judge(verdict.message, verdict.value)
        if isinstance(judged, str):
            self._reject(judged)
        elif not self._offer(InputClass.OUTCOME, judged):
            self._reject("busy")

    def rejected(self) -> Counter[str]:
        """Return how many cosignatures were not taken since start, by reason."""
        tally = self._gate.tally()
        with self._lock:
            found = Counter(self._rejected)
        found.update({f"cosign: {reason}": count for reason, count in tally.rejected.items() if count})
        if tally.malformed:
            found["cosign: unreadable"] += tally.malformed
        return found

    def _reject(self, because: str) -> None:
        with self._lock:
            self._rejected[f"cosign: {because}"] += 1


def read_cosignature(_message: Sealed, content: bytes) -> str:
    """Decode a cosignature's note. Raises Unreadable."""
    try:
        return CheckpointCosignature.FromString(content).checkpoint
    except DecodeError as error:
        raise Unreadable("the content is no CheckpointCosignature, or a text in it is not UTF-8") from error


def _answer(asked: ConsistencyRequest, found: Consistency) -> bytes:
    return ConsistencyAnswer(
        flight_number=asked.flight_number,
        old_size=asked.old_size,
        new_size=asked.new_size,
        old_root=found.old_root,
        path=found.path,
    ).SerializeToString(deterministic=True)
