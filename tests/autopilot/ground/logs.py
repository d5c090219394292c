"""Logs of node wasp-01 as the ground sees them: histories that grow, fork and are cut, what they publish and prove."""

from __future__ import annotations

from dataclasses import dataclass, field
from hashlib import sha256

from autopilot.trust.keys import SignKey
from autopilot.trust.notes import Checkpoint, LogKey, sign_note
from events.schema.waypoint_pb2 import ConsistencyAnswer, ConsistencyRequest, NodeStatus
from events.tree import Tree
from tests.autopilot.trust.world import people

KEY = SignKey.from_seed(b"k" * 32)
NODE = "wasp-01"


@dataclass
class Log:
    """One history of a flight. The same `salt` is the same history; from `forked_at` on another one."""

    flight: int = 3
    flight_id: int = 1
    salt: str = ""
    forked_at: int = 1 << 40
    tree: Tree = field(default_factory=lambda: Tree([]))

    def grown(self, size: int) -> Tree:
        """Return the tree over at least `size` leaves."""
        if self.tree.size < size:
            self.tree = Tree([self._leaf(seq) for seq in range(size)])
        return self.tree

    def status(self, size: int, at_ms: int = 100_000) -> NodeStatus:
        """Return what the node publishes over `size` records of it."""
        log_key = LogKey(
            deployment_id="coast-watch",
            node=NODE,
            flight_number=self.flight,
            flight_id=bytes([self.flight_id]) * 16,
            public_key=KEY.public,
        )
        text = Checkpoint(log_key.origin, size, self.grown(size).root(size), at_ms).text()
        certificate = sign_note(log_key.text(), log_key.signer, people().wasp.sign_key)
        note = sign_note(text, log_key.origin, KEY)
        return NodeStatus(at_ms=at_ms, flight_id=log_key.flight_id, log_checkpoint=note, log_key=certificate)

    def answer(self, request: bytes) -> bytes:
        """Return the proof that was asked for, as a node that tells what it has answers."""
        asked = ConsistencyRequest.FromString(request)
        tree = self.grown(asked.new_size)
        return ConsistencyAnswer(
            flight_number=asked.flight_number,
            old_size=asked.old_size,
            new_size=asked.new_size,
            old_root=tree.root(asked.old_size),
            path=tree.consistency(asked.old_size, asked.new_size),
        ).SerializeToString(deterministic=True)

    def _leaf(self, seq: int) -> bytes:
        salt = self.salt if seq >= self.forked_at else ""
        return sha256(f"{self.flight}/{seq}/{salt}".encode()).digest()
