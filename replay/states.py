"""The digests of the state that checkpoints were signed with, held against the state that a replay comes to.

A decision that differs is found by its bytes. This finds what no decision has shown yet: a row of the state that came
out otherwise. Who signed is judged elsewhere; a digest of another layout can't be compared, and is passed over.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence

from replay.verdict import Divergence
from statecharts import State
from statecharts.codec import LAYOUT
from statecharts.digest import StateDigest

WHAT = "state digest"


def stated(note: str) -> tuple[bytes, bytes] | None:
    """Return layout and digest of the state that the note of a checkpoint names; None where it names none."""
    lines = note.split("\n")
    words = lines[4].split(" ") if len(lines) > 4 else []
    if len(words) != 3 or words[0] != "state":
        return None
    try:
        return bytes.fromhex(words[1]), base64.b64decode(words[2], validate=True)
    except ValueError:
        return None


class SignedStates:
    """Follows a state from its beginning, and compares it wherever a checkpoint says what it was."""

    def __init__(self, checkpoints: Sequence[tuple[int, str]], state: State) -> None:
        found = ((size, stated(note)) for size, note in checkpoints)
        self._signed = {size: said[1] for size, said in found if said is not None and said[0] == LAYOUT}
        self._digest = StateDigest(state) if self._signed else None
        self._equal_to = 0  # after so many records the state was the one that was signed
        self._told = False

    def after(self, seq: int) -> Divergence | None:
        """Compare the state after record `seq`; return the first difference, and nothing more behind it."""
        signed = self._signed.get(seq + 1)
        if signed is None or self._digest is None or self._told:
            return None
        self._digest.advance()
        if self._digest.value == signed:
            self._equal_to = seq + 1
            return None
        self._told = True
        between = f"between records {self._equal_to} and {seq}"
        return Divergence(seq, "state", WHAT, between, signed.hex(), self._digest.value.hex(), ())
