"""Presence: an operator tells the nodes that are attended, once a second, that a person is there.

A node whose operators fall silent comes home by itself, so presence is said only while it is asked for, from a thread
of its own: an order that waits for a dead link must not hold it up, and one that can't leave is dropped, for the next
says the same. Nothing is answered, and nothing is repeated. Where several nodes are attended their turns are spread
over the second, because a relay's limit is a distance between samples of a session.
"""

from __future__ import annotations

import threading
from contextlib import suppress
from typing import Final

from autopilot.adapters.mesh.link import LinkDown, Wire
from autopilot.ground.statuses import Statuses
from autopilot.trust.believing import Believing
from autopilot.trust.envelope import MessageType, Packer, PackError
from autopilot.trust.limits import PRESENCE_TTL_MS
from autopilot.wire.keys import presence_key
from events.schema.waypoint_pb2 import OperatorPresence

PRESENCE_S: Final = 1.0  # a node that records every 2 s has two chances for each


class Attendance:
    """The nodes that one issuer attends, and its presence there. Any thread."""

    def __init__(self, believing: Believing, packer: Packer, wire: Wire, statuses: Statuses) -> None:
        self._believing, self._packer, self._wire, self._statuses = believing, packer, wire, statuses
        self._nodes: frozenset[str] = frozenset()
        self._turns = 0
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._wanted = threading.Event()
        self._thread = threading.Thread(target=self._run, name="presence", daemon=True)

    @property
    def nodes(self) -> frozenset[str]:
        """The nodes that are attended now."""
        return self._nodes

    def attend(self, node: str) -> None:
        """Be present at a node from now on."""
        with self._lock:
            self._nodes |= {node}
        self._wanted.set()

    def leave(self, node: str) -> None:
        """Be present there no more."""
        with self._lock:
            self._nodes -= {node}

    def start(self) -> None:
        """Begin; returns at once."""
        self._thread.start()

    def stop(self) -> None:
        """End."""
        self._over.set()
        self._wanted.set()
        if self._thread.is_alive():
            self._thread.join(timeout=5)

    def turn(self) -> None:
        """Say it to the next of the nodes that are attended, as far as there is a link. Never raises."""
        nodes = sorted(self._nodes)
        if nodes and self._wire.linked():
            self._turns += 1
            with suppress(PackError, LinkDown):
                self._say(nodes[self._turns % len(nodes)])

    def _say(self, node: str) -> None:
        seen = self._statuses.newest(node)
        presence = OperatorPresence() if seen is None else OperatorPresence(heard_head_seq=seen.status.head_seq)
        key_expr = presence_key(node, self._believing.held.principal_id)
        packed = self._packer.pack(
            MessageType.PRESENCE,
            key_expr,
            presence.SerializeToString(deterministic=True),
            ttl_ms=PRESENCE_TTL_MS,
            node_challenge=self._statuses.challenge(node),
        )
        self._wire.put(key_expr, packed.envelope, urgent=False)

    def _run(self) -> None:
        while not self._over.is_set():
            self._wanted.wait()
            self.turn()
            self._over.wait(PRESENCE_S / max(1, len(self._nodes)))
