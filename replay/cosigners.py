"""Which checkpoints of a flight were cosigned, and the tokens of those who did: for proofs. Nothing is judged here.

The lines lie under the checkpoints beside the log, the tokens in the records that took them in.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from google.protobuf.message import DecodeError

from events.kinds import kind_of
from events.records import Stored
from events.schema.flight_pb2 import CheckpointCosigned

_KIND = kind_of(CheckpointCosigned).number


class Signed(NamedTuple):
    """A signed checkpoint with those of its cosignatures whose witnesses are known."""

    size: int
    note: str
    tokens: tuple[bytes, ...]  # of the witnesses, in the order of their lines


class Witnesses:
    """The tokens of witnesses, by what they cosigned."""

    def __init__(self) -> None:
        self._tokens: dict[tuple[int, str], bytes] = {}

    def take(self, stored: Stored) -> None:
        """Take a record in; only those of cosignatures count, and one that can't be read is none."""
        if stored.kind_number != _KIND:
            return
        try:
            said = CheckpointCosigned.FromString(stored.body)
        except DecodeError:
            return
        self._tokens[said.size, said.witness.principal_id] = said.token

    def of(self, size: int, note: str) -> Signed:
        """Return a checkpoint without the lines of those whose token is not known."""
        text, gap, signed = note.rpartition("\n\n")
        own, *lines = signed.splitlines(keepends=True)
        known = [(line, token) for line in lines if (token := self._tokens.get((size, _principal(line)))) is not None]
        kept = "".join(line for line, _ in known)
        return Signed(size, f"{text}{gap}{own}{kept}", tuple(token for _, token in known))


def newest_over(checkpoints: Iterable[Signed], seq: int, *, cosigned: bool) -> Signed | None:
    """Return the newest checkpoint over a record, before all others a `cosigned` one; None: none covers it."""
    covering = [one for one in checkpoints if one.size > seq]
    return max(covering, key=lambda one: (cosigned and bool(one.tokens), one.size), default=None)


def _principal(line: str) -> str:
    name = line.split(" ")[1] if line.count(" ") == 2 else ""
    return name.rpartition("/")[2]
