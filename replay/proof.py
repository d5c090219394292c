"""One decision with what led to it, in a form that a stranger can check: records, and where they lie under a signature.

The records are those of the cause chain, from the decision back to the first observation. Each comes with what its
leaf is the hash of and with its inclusion proof (RFC 9162) in the newest signed checkpoint. Who signed, and who vouches
for that key, is laid beside it as it was found. Nothing is judged here: `autopilot verify` does that, by a program of
its own. docs/proof.md is the specification. A redacted copy proves what the flight proves, but for the bodies that were
removed.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from events import NO_CAUSE
from events.chain import FIRST_LEAF_BEFORE, salt_shown
from events.records import Stored
from events.store import Reader
from events.tree import Tree
from replay.causes import led_from
from replay.cosigners import Signed, Witnesses, newest_over

FORMAT = "autopilot-proof/1"
CONSISTENCY_FORMAT = "autopilot-consistency/1"


class NotSealed(LookupError):
    """No signed checkpoint covers the record."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Papers:
    """What lies beside the log for strangers."""

    log_key: str  # certificate of the key that signs the checkpoints, a note
    token: bytes  # who the node is, by the Directory
    trust_root: bytes  # who the Directory is


@dataclass(frozen=True, slots=True)
class _Log:
    """What proofs are made of, read once."""

    leaves: list[bytes]
    checkpoints: tuple[Signed, ...]

    def tree(self, size: int) -> Tree:
        """Return the tree over the first records. Raises NotSealed where they are not there."""
        if len(self.leaves) < size:
            raise NotSealed(f"{size} records were signed, and the log holds {len(self.leaves)}: it was cut")
        return Tree(self.leaves[:size])


def prove(reader: Reader, seq: int, papers: Papers, *, cosigned: bool = True) -> bytes:
    """Return the proof of record `seq` as canonical JSON: sorted keys, one space a level, a newline at the end.

    It rests on the newest `cosigned` checkpoint over the record, where there is one, else on the newest signed one.
    Raises LookupError where there is no such record, NotSealed where nothing signed covers it, StoreFailed.
    """
    records = list(_chain(reader, seq))
    log = _read(reader)
    signed = newest_over(log.checkpoints, seq, cosigned=cosigned)
    if signed is None:
        newest = max((one.size for one in log.checkpoints), default=0)
        raise NotSealed(f"record {seq} is under no signed checkpoint: the newest covers {newest} records")
    tree = log.tree(signed.size)
    proof = {
        "format": FORMAT,
        "records": [_plain(stored, log.leaves, tree, reader.secret) for stored in records],
        "checkpoint": signed.note,
        "witnesses": [_base64(token) for token in signed.tokens],
    }
    return _written(proof, papers)


def prove_consistency(reader: Reader, old_size: int, new_size: int | None, papers: Papers) -> bytes:
    """Return the proof that the flight's log only grew between two checkpoints, as canonical JSON.

    Without `new_size` up to the newest. Raises NotSealed where no checkpoint has such a size, StoreFailed.
    """
    log = _read(reader)
    signed = {one.size: one for one in log.checkpoints}
    new_size = max(signed, default=0) if new_size is None else new_size
    for size in (old_size, new_size):
        if size not in signed:
            near = ", ".join(str(one) for one in sorted(signed, key=lambda known: abs(known - size))[:3])
            raise NotSealed(f"no checkpoint over {size} records was signed; near it: {near or 'none'}")
    if not old_size < new_size:
        raise NotSealed(f"a log of {new_size} records does not go on from one of {old_size}")
    old, new = signed[old_size], signed[new_size]
    proof = {
        "format": CONSISTENCY_FORMAT,
        "old_checkpoint": old.note,
        "new_checkpoint": new.note,
        "old_witnesses": [_base64(token) for token in old.tokens],
        "new_witnesses": [_base64(token) for token in new.tokens],
        "path": [_base64(sibling) for sibling in log.tree(new_size).consistency(old_size)],
    }
    return _written(proof, papers)


def _read(reader: Reader) -> _Log:
    witnesses, leaves = Witnesses(), list[bytes]()
    for stored in reader.stored():
        leaves.append(stored.leaf)
        witnesses.take(stored)
    return _Log(leaves, tuple(witnesses.of(size, note) for size, note in reader.checkpoints()))


def _written(proof: dict[str, Any], papers: Papers) -> bytes:
    proof |= {
        "log_key": papers.log_key,
        "token": _base64(papers.token),
        "trust_root": _base64(papers.trust_root),
    }
    return json.dumps(proof, sort_keys=True, indent=1).encode() + b"\n"


def _chain(reader: Reader, seq: int) -> Iterator[Stored]:
    """Yield a record and what led to it, back to the first observation."""
    while seq != NO_CAUSE:
        stored = next(iter(reader.stored(seq, seq + 1)), None)
        if stored is None:
            raise LookupError(f"the flight has no record {seq}")
        yield stored
        before = led_from(stored)
        seq = before if before < seq else NO_CAUSE


def _plain(stored: Stored, leaves: list[bytes], tree: Tree, secret: bytes) -> dict[str, Any]:
    before = leaves[stored.seq - 1] if stored.seq else FIRST_LEAF_BEFORE
    return {
        "seq": stored.seq,
        "cause": stored.cause,
        **stored.at._asdict(),
        "kind": stored.kind_number,
        "version": stored.version,
        "leaf_before": _base64(before),
        **_said(stored, secret),
        "inclusion": [_base64(sibling) for sibling in tree.inclusion(stored.seq)],
    }


def _said(stored: Stored, secret: bytes) -> dict[str, str]:
    """Return what the leaf's last hash is made of; of a body that was removed there is only that hash."""
    if stored.removed:
        return {"removed": _base64(stored.removed)}
    return {"salt": _base64(salt_shown(stored, secret)), "body": _base64(stored.body)}


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()
