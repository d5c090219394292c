"""The operators' link, heard: the door for presence, and what of it the node is told.

Any authentic word of an operator who may order something here counts, presence and orders alike; a viewer keeps no
aircraft in the air. The node is told when it first hears one, and then at most once in a period, however many there
are: the core needs to know that somebody is there. Presence has a gate of its own, so that a second's heartbeat of
fifty people takes no room of the orders' nonces.
"""

from __future__ import annotations

import threading
from collections import Counter

from google.protobuf.message import DecodeError

from autopilot.ports.edges import Clock, InputClass, Offer
from autopilot.trust.believing import Believing
from autopilot.trust.envelope import MessageType
from autopilot.trust.gate import Gate
from autopilot.trust.identity import Identity
from autopilot.trust.verdict import Opened, Sealed, Sender, Unreadable
from autopilot.wire.keys import presence_key
from events.schema.safety_pb2 import OperatorHeard
from events.schema.waypoint_pb2 import OperatorPresence, PrincipalKind

# Fifty operators send fifty a second; all of them verified take 4 ms of it.
PRESENCES_PER_S, PRESENCES_BURST = 100.0, 100
OPERATORS = frozenset({PrincipalKind.OPERATOR})


class Hearing:
    """Tells the node that an operator is heard, thinned."""

    def __init__(self, clock: Clock, roles: frozenset[str], period_s: float, offer: Offer) -> None:
        """`roles`: those that count, by their exact names; `period_s`: the node is told at most this often."""
        self._clock = clock
        self._roles = roles
        self._period_ns = int(period_s * 1e9)
        self._offer = offer
        self._told_ns: int | None = None
        self._lock = threading.Lock()

    def hear(self, sender: Sender) -> str:
        """Take in whose word was just authenticated; return "", or why it does not count. Any thread; never raises."""
        if self._roles.isdisjoint(sender.roles):
            return "role"
        with self._lock:
            now_ns = self._clock.mono_ns()
            if self._told_ns is not None and now_ns - self._told_ns < self._period_ns:
                return ""
            heard = OperatorHeard(principal_id=sender.principal_id, callsign=sender.callsign)
            if not self._offer(InputClass.OUTCOME, heard):
                return "busy"  # the next word tells it
            self._told_ns = now_ns
            return ""


class PresenceDoor:
    """Takes presence."""

    def __init__(self, identity: Identity, clock: Clock, hearing: Hearing, believing: Believing | None = None) -> None:
        self._node = identity.principal_id
        self._hearing = hearing
        self._lock = threading.Lock()
        self._rejected: Counter[str] = Counter()
        self._gate: Gate[OperatorPresence] = Gate(
            identity,
            MessageType.PRESENCE,
            kinds=OPERATORS,
            is_ours=self._is_ours,
            reader=self._read,
            clock=clock,
            samples_per_s=PRESENCES_PER_S,
            samples_burst=PRESENCES_BURST,
            believing=believing,
        )

    def receive(self, key_expr: str, payload: bytes) -> None:
        """Judge one sample. Never raises, never answers."""
        verdict = self._gate.judge(key_expr, payload)
        if isinstance(verdict, Opened):
            because = self._hearing.hear(verdict.message.sender)
            if because:
                with self._lock:
                    self._rejected[f"presence: {because}"] += 1

    def rejected(self) -> Counter[str]:
        """Return how many were not taken since start, by reason."""
        tally = self._gate.tally()
        with self._lock:
            found = Counter(self._rejected)
        found.update({f"presence: {reason}": count for reason, count in tally.rejected.items() if count})
        if tally.malformed:
            found["presence: unreadable"] += tally.malformed
        return found

    def _is_ours(self, key_expr: str) -> bool:
        principal = key_expr.rpartition("/")[2]
        return bool(principal) and key_expr == presence_key(self._node, principal)

    def _read(self, message: Sealed, content: bytes) -> OperatorPresence:
        """Decode a presence; it is its sender's own. Raises Unreadable."""
        if message.key_expr != presence_key(self._node, message.sender.principal_id):
            raise Unreadable("the key is another principal's")
        try:
            return OperatorPresence.FromString(content)
        except DecodeError as error:
            raise Unreadable("the content is no OperatorPresence") from error
