"""Watching one node's log: it asks for the proofs that are missing, and cosigns what is proven.

It talks through an issuer, which hears the node; what is believed is decided in `witness`. A proof that does not come
is asked for again, and what waits for it stays unproven and is cosigned by nobody.
"""

from __future__ import annotations

from autopilot.ground.issuer import Issuer
from autopilot.ground.witness import Outcome, contradiction
from autopilot.trust.clock import Clock
from autopilot.trust.cosignatures import cosign, cosigned, cosigner_name
from autopilot.trust.identity import Identity

ANSWER_WITHIN_S = 10.0  # the first proof after a start of the node reads its whole log: 5.4 s for a million records
ASK_AGAIN_NS = 2_000_000_000
# A cosignature is a record of near 900 bytes on the node, which makes the log grow, which is signed: not too often.
COSIGN_EVERY_NS = 60_000_000_000


class Watch:
    """Watches one node."""

    def __init__(self, issuer: Issuer, identity: Identity, node: str, clock: Clock, *, cosigns: bool) -> None:
        self._issuer = issuer
        self._identity = identity
        self._node = node
        self._clock = clock
        self._cosigns = cosigns
        self._ask_at_ns = 0
        self._cosign_at_ns = 0
        self._cosigned: tuple[bytes, int] | None = None  # flight and size
        self.unanswered = 0  # questions since the last proof that brought none

    def turn(self) -> None:
        """Ask and cosign what is due now; waits for an answer at most ANSWER_WITHIN_S. Raises NoteInvalid, OSError."""
        key = self._issuer.node_key(self._node)
        if key is None:
            return
        while self._clock.mono_ns() >= self._ask_at_ns and self._ask(key):
            pass
        if self._cosigns and self._clock.mono_ns() >= self._cosign_at_ns:
            self._cosign(key)

    def _ask(self, key: bytes) -> bool:
        """Ask for the next proof; say whether it was brought."""
        asked = self._issuer.witness.question(self._node, key)
        if asked is None:
            return False
        answers = self._issuer.ask(self._node, asked.request(), ANSWER_WITHIN_S)
        outcomes = [self._issuer.witness.answered(self._node, key, asked, answer) for answer in answers]
        if Outcome.CONTRADICTS in outcomes:
            self._issuer.complain(self._node, contradiction(asked))
        if Outcome.PROVEN in outcomes:
            self.unanswered = 0
            return True
        self.unanswered += Outcome.CONTRADICTS not in outcomes
        self._ask_at_ns = self._clock.mono_ns() + ASK_AGAIN_NS
        return False

    def _cosign(self, key: bytes) -> None:
        """Cosign what is proven of the open flight, again where the node does not show that it was taken."""
        chain, seen = self._issuer.witness.newest(self._node, key), self._issuer.status(self._node)
        if chain is None or seen is None or seen.status.flight_id != chain.proven.log_key.flight_id:
            return
        newest = (seen.status.flight_id, chain.proven.checkpoint.size)
        if newest == self._cosigned and seen.status.cosigned_size >= chain.proven.checkpoint.size:
            return
        text = chain.proven.note.rpartition("\n\n")[0] + "\n"
        name = cosigner_name(self._identity.deployment_id, self._identity.principal_id)
        line = cosign(text, name, self._identity.sign_key, self._clock.wall_ns() // 1_000_000_000)
        self._issuer.cosign(self._node, cosigned(chain.proven.note, [line]))
        self._cosigned = newest
        self._cosign_at_ns = self._clock.mono_ns() + COSIGN_EVERY_NS
