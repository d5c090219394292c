"""Checks the proof that a log only grew, offline: a part of the verifier, written from docs/proof.md as it is.

Two signed checkpoints and a path between them (RFC 9162, section 2.1.4); no record is shown, and none is needed.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from autopilot.ground.papers import Head, Log, base64_of, head_of, log_of, read_file, require, texts_of

FORMAT = "autopilot-consistency/1"


@dataclass(frozen=True, slots=True, kw_only=True)
class Consistent:
    """What a consistency proof shows."""

    log: Log
    old: Head
    new: Head

    def words(self) -> str:
        """Return in one sentence what is proved and what is not."""
        log, old, new = self.log, self.old, self.new
        return (
            f"Proved: the log of flight {log.flight} of node {log.node}, deployment {log.deployment}, as it was signed"
            f" over {new.size} records{new.words()}, begins with the {old.size} records that were signed before"
            f"{old.words()}, where the trust root {log.trust_root} is the one that you know; not proved: what the"
            f" records say, that keys were in nobody else's hands or not revoked, and that clocks were right."
        )


def check_consistent(data: bytes, trust_root: bytes | None = None) -> Consistent:
    """Check a consistency proof, which must rest on `trust_root` where you have that. Raises ProofRefused."""
    proof = read_file(data, FORMAT, ("old_checkpoint", "new_checkpoint"), ("old_witnesses", "new_witnesses", "path"))
    log = log_of(proof, trust_root)
    old = head_of(proof["old_checkpoint"], proof["old_witnesses"], log)
    new = head_of(proof["new_checkpoint"], proof["new_witnesses"], log)
    require(0 < old.size < new.size, "the checkpoints are not in their order")
    path = [base64_of(sibling, 32) for sibling in texts_of(proof["path"])]
    require(_grows(old, new, path), f"the log of {new.size} records does not begin with that of {old.size}")
    return Consistent(log=log, old=old, new=new)


def is_consistency(data: bytes) -> bool:
    """Say whether a file says of itself that it is a consistency proof."""
    return f'"format": "{FORMAT}"'.encode() in data


def _grows(old: Head, new: Head, path: list[bytes]) -> bool:
    """Follow a consistency path (RFC 9162, section 2.1.4.2) to both roots."""
    place, last = old.size - 1, new.size - 1
    while place % 2:
        place, last = place // 2, last // 2
    if place:
        first, *path = path or [b""]
    else:
        first = old.root
    one = other = first
    for sibling in path:
        if last == 0:
            return False
        if place % 2 or place == last:
            one, other = (
                hashlib.sha256(b"\1" + sibling + one).digest(),
                hashlib.sha256(b"\1" + sibling + other).digest(),
            )
            while place and not place % 2:
                place, last = place // 2, last // 2
        else:
            other = hashlib.sha256(b"\1" + other + sibling).digest()
        place, last = place // 2, last // 2
    return last == 0 and one == old.root and other == new.root
