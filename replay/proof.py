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

FORMAT = "autopilot-proof/1"


class NotSealed(LookupError):
    """No signed checkpoint covers the record."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Papers:
    """What lies beside the log for strangers."""

    log_key: str  # certificate of the key that signs the checkpoints, a note
    token: bytes  # who the node is, by the Directory
    trust_root: bytes  # who the Directory is


def prove(reader: Reader, seq: int, papers: Papers) -> bytes:
    """Return the proof of record `seq` as canonical JSON: sorted keys, one space a level, a newline at the end.

    Raises LookupError where there is no such record, NotSealed where nothing signed covers it, StoreFailed.
    """
    records = list(_chain(reader, seq))
    size, note = next(reversed(reader.checkpoints()), (0, ""))
    if seq >= size:
        raise NotSealed(f"record {seq} is under no signed checkpoint: the newest covers {size} records")
    leaves = [stored.leaf for stored in reader.stored(0, size)]
    if len(leaves) < size:
        raise NotSealed(f"{size} records were signed, and the log holds {len(leaves)}: it was cut")
    tree = Tree(leaves)
    proof = {
        "format": FORMAT,
        "records": [_plain(stored, leaves, tree, reader.secret) for stored in records],
        "checkpoint": note,
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
