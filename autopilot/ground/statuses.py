"""What nodes say of themselves, as one issuer has heard it: verified, opened, the newest of each, and held to its word.

It listens to the status of the nodes that are watched. A status also tells a node's key, who commanded its cameras, the
challenge that it wants to see again, and checkpoints of its log, which a `Witness` holds against what was
signed before.
"""

from __future__ import annotations

import threading
from collections.abc import Collection
from dataclasses import dataclass

from autopilot.ground.following import Commander, attribute
from autopilot.ground.ledger import read_status
from autopilot.ground.witness import Witness
from autopilot.trust.believing import Believing
from autopilot.trust.clock import Clock
from autopilot.trust.envelope import MessageType
from autopilot.trust.gate import Gate
from autopilot.trust.limits import CHALLENGE_BYTES
from autopilot.trust.tally import Tally
from autopilot.trust.verdict import Opened
from autopilot.wire.keys import status_node
from events.schema.waypoint_pb2 import NodeStatus, PrincipalKind

NODES = frozenset({PrincipalKind.NODE})


@dataclass(frozen=True, slots=True)
class SeenStatus:
    """A node's newest status, verified and opened."""

    node: str
    status: NodeStatus
    received_mono_ns: int
    undated: bool = False  # the node's time was uncertain


class Statuses:
    """The newest status of each watched node. Any thread."""

    def __init__(
        self, believing: Believing, clock: Clock, watched: Collection[str], changed: threading.Condition
    ) -> None:
        """`changed` guards what is here and is notified of every status that is taken in."""
        identity = believing.held
        self.node_keys = dict(identity.known_nodes)
        self.witness = Witness(identity.folder, identity.deployment_id)
        self._clock = clock
        self._changed = changed
        self._newest: dict[str, SeenStatus] = {}
        self._commanders: dict[tuple[str, int], Commander] = {}
        self._complaints: dict[str, str] = {}
        self._gate: Gate[NodeStatus] = Gate(
            identity,
            MessageType.STATUS,
            kinds=NODES,
            is_ours=lambda key_expr: status_node(key_expr) in watched,
            reader=read_status,
            clock=clock,
            believing=believing,
            takes_undated=True,  # it holds the challenge without which such a node takes no order
        )

    def newest(self, node: str) -> SeenStatus | None:
        """Return the newest status of a node, None before the first."""
        return self._newest.get(node)

    def challenge(self, node: str) -> bytes:
        """Return the challenge that a node whose time is uncertain wants to see again; empty: it wants none."""
        seen = self._newest.get(node)
        challenge = b"" if seen is None else seen.status.node_challenge
        return challenge if len(challenge) == CHALLENGE_BYTES else b""

    def commander(self, node: str, camera: int) -> Commander | None:
        """Return who commanded a camera last, as far as it was said; None: unknown."""
        with self._changed:
            return self._commanders.get((node, camera))

    def complaints(self) -> dict[str, str]:
        """Return the nodes whose signed logs contradict what they signed before, and how."""
        with self._changed:
            return dict(self._complaints)

    def complain(self, node: str, wrong: str) -> None:
        """Note what was found out about a node's log."""
        with self._changed:
            self._complaints[node] = wrong

    def tally(self) -> Tally:
        """Return what the gate has counted."""
        return self._gate.tally()

    def receive(self, key_expr: str, payload: bytes) -> None:
        """Judge a sample on a status key; older ones than the newest are ignored. Never raises."""
        verdict = self._gate.judge(key_expr, payload)
        if not isinstance(verdict, Opened):
            return
        sender, node = verdict.message.sender, status_node(key_expr)
        if node is None or sender.principal_id != node:
            return
        wrong = self._bear_witness(node, sender.public_key, verdict.value)
        with self._changed:
            if wrong:
                self._complaints[node] = wrong
            before = self._newest.get(node)
            undated = not verdict.message.issued_at_ms  # then its at_ms may go back, and forth again
            if before is None or undated or before.undated or before.status.at_ms <= verdict.value.at_ms:
                self._newest[node] = SeenStatus(node, verdict.value, self._clock.mono_ns(), undated)
                self.node_keys[node] = sender.public_key
                attribute(self._commanders, node, verdict.value)
            self._changed.notify_all()

    def _bear_witness(self, node: str, public_key: bytes, status: NodeStatus) -> str:
        """Hold a status against what the node signed before; return what is wrong, "" where it fits."""
        try:
            return self.witness.see(node, public_key, status)
        except OSError as error:
            return f"what it signed can't be kept: {error}"
