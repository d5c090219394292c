"""Checks the proof of a decision, offline: written from docs/proof.md, so that it shares no mistake with who made it.

It imports the standard library and three files beside it: `papers`, for the papers that a proof comes with, which
adds one Ed25519 verification, `ordered`, for who gave an order, and `asked`, for what it asks; nothing else of this
repository. They can be copied away and read alone. It opens no network and needs no key. A proof holds as a whole or
not at all: every byte of the file is bound by a hash, a signature, or the one way in which it may be written. What a
record means is not its business.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from autopilot.ground.ordered import ORDER, Addressee, ProvedOrder, Revoked, check_order, read_revoked
from autopilot.ground.papers import BYTES_MAX as BYTES_MAX
from autopilot.ground.papers import Cosigner, Log, base64_of, head_of, log_of, parts_of, read_file, require
from autopilot.ground.papers import ProofRefused as ProofRefused

FORMAT = "autopilot-proof/1"
# Observations that answer an effect name its seq in this field of their body, by kind.
ANSWERS = {23: 1, 43: 1, 44: 1, 45: 1, 49: 5, 160: 9, 161: 1, 164: 1, 166: 1, 167: 1, 181: 1, 199: 1}

# flight_id, seq, cause, flight_ns, mono_ns, boot, wall_ns, clock_quality, kind, version, leaf before; then the body's
_LEAF = struct.Struct(">c16sQqQQIqBHB32s32s")
_COLUMNS = ("seq", "cause", "flight_ns", "mono_ns", "boot", "wall_ns", "clock_quality", "kind", "version")
_BINARY = {"leaf_before": 32, "salt": 16, "removed": 32}
# The parts of a record: with its body, or with the hash that stands for it where it was removed.
_RECORD_PARTS = (
    {*_COLUMNS, "leaf_before", "inclusion", "salt", "body"},
    {*_COLUMNS, "leaf_before", "inclusion", "removed"},
)


@dataclass(frozen=True, slots=True)
class ProvedRecord:
    """A record whose place in the log is proved."""

    seq: int
    cause: int
    wall_ns: int
    kind: int
    version: int
    body: bytes  # b"" where it was removed
    removed: bytes = b""  # the hash that stands for salt and body, where a redacted copy lacks them


@dataclass(frozen=True, slots=True, kw_only=True)
class Proved:
    """What a proof shows."""

    deployment: str
    node: str
    flight: int
    flight_id: bytes
    size: int
    signed_flight_ns: int
    trust_root: str  # SHA-256 of the trust root's document, hex
    cosigners: tuple[Cosigner, ...]
    records: tuple[ProvedRecord, ...]  # the one in question first, then what led to it
    orders: tuple[ProvedOrder, ...] = ()  # those of the records that are orders, and whose giver is proved too

    def words(self) -> str:
        """Return in one sentence what is proved and what is not."""
        first, *causes = self.records
        led = f" and what led to it, back to record {causes[-1].seq}," if causes else ""
        return (
            f"Proved: record {first.seq}{led} stood, byte for byte{self._removed()}, in the log of flight"
            f" {self.flight} of node {self.node}, deployment {self.deployment}, as it was signed over"
            f" {self.size} records by a key that the node certified for this flight{self._seen()}, where the trust root"
            f" {self.trust_root} is the one that you know;"
            f" not proved: that what was recorded is true, that the node's clocks were right, that its keys were in"
            f" nobody else's hands or not revoked, and what was recorded after those {self.size} records."
        )

    def order_words(self) -> tuple[str, ...]:
        """Return a sentence for each order among the records."""
        proved = {one.seq: one.words() for one in self.orders}
        orders = (one.seq for one in self.records if one.kind == ORDER)
        unproved = "Not proved: who gave the order of record {}, for the log holds no envelope of it"
        return tuple(proved.get(seq, unproved.format(seq)) for seq in orders)

    def _seen(self) -> str:
        """Return who had seen the log grow in order up to there, as a part of the sentence."""
        return f", cosigned by {', '.join(one.words() for one in self.cosigners)}" if self.cosigners else ""

    def _removed(self) -> str:
        """Return what can't be shown of these records any more."""
        gone = [str(one.seq) for one in self.records if one.removed]
        if not gone:
            return ""
        last = self.records[-1]
        further = ", and with it what it answered" if last.removed and last.kind in ANSWERS else ""
        return f" (of {' and '.join(gone)} header and hash: what was said was removed{further})"


def check(data: bytes, trust_root: bytes | None = None, revocations: bytes | None = None) -> Proved:
    """Check a proof, which must rest on `trust_root` where you have that file yourself. Raises ProofRefused.

    Where you have the Directory's newest revocation list too, it must not name who gave an order of the proof.
    """
    proof = read_file(data, FORMAT, ("checkpoint",), ("records", "witnesses"))
    records = proof["records"]
    require(isinstance(records, list) and bool(records), "the file shows no records")
    require(all(_is_record(one) for one in records), "a record of the file is not written as it is to be")
    log = log_of(proof, trust_root)
    head = head_of(proof["checkpoint"], proof["witnesses"], log)
    found = [_record(one, log.flight_id, head.size, head.root) for one in records]
    _chained(found)
    revoked = read_revoked(revocations, base64_of(proof["trust_root"])) if revocations is not None else None
    return Proved(
        deployment=log.deployment,
        node=log.node,
        flight=log.flight,
        flight_id=log.flight_id,
        size=head.size,
        signed_flight_ns=head.flight_ns,
        trust_root=log.trust_root,
        cosigners=head.cosigners,
        records=tuple(found),
        orders=tuple(_orders(found, log, revoked)),
    )


def _is_record(one: Any) -> bool:
    if not isinstance(one, dict) or set(one) not in _RECORD_PARTS:
        return False
    proof = one["inclusion"]
    texts = [one[name] for name in one if name not in (*_COLUMNS, "inclusion")]
    texts += proof if isinstance(proof, list) else [None]
    return all(type(one[name]) is int for name in _COLUMNS) and all(isinstance(text, str) for text in texts)


def _record(one: dict[str, Any], flight_id: bytes, size: int, root: bytes) -> ProvedRecord:
    """Check that a record lies in the tree of `size` records under `root`."""
    seq, what = one["seq"], f"record {one['seq']}"
    removed = base64_of(one["removed"], _BINARY["removed"]) if "removed" in one else b""
    body, hashed = (b"", removed) if removed else _said(one)
    before = base64_of(one["leaf_before"], _BINARY["leaf_before"])
    try:
        columns = (one[name] for name in _COLUMNS)
        packed = _LEAF.pack(b"\0", flight_id, *columns, before, hashed)
    except struct.error as error:
        raise ProofRefused(f"{what}: a number does not fit its column") from error
    require(0 <= seq < size, f"{what}: is not among the {size} records that were signed")
    found = _root_from(hashlib.sha256(packed).digest(), seq, size, [base64_of(each, 32) for each in one["inclusion"]])
    require(found == root, f"{what}: is not what the log holds there")
    return ProvedRecord(seq, one["cause"], one["wall_ns"], one["kind"], one["version"], body, removed)


def _said(one: dict[str, Any]) -> tuple[bytes, bytes]:
    """Return the body of a record and its salted hash."""
    body, salt = base64_of(one["body"]), base64_of(one["salt"], _BINARY["salt"])
    return body, hashlib.sha256(salt + body).digest()


def _root_from(leaf: bytes, index: int, size: int, proof: list[bytes]) -> bytes | None:
    """Return the root that an inclusion proof leads to (RFC 9162, section 2.1.3.2); None where it is no proof."""
    last = size - 1
    for sibling in proof:
        if last == 0:
            return None
        if index % 2 or index == last:
            leaf = hashlib.sha256(b"\1" + sibling + leaf).digest()
            while index and not index % 2:
                index, last = index // 2, last // 2
        else:
            leaf = hashlib.sha256(b"\1" + leaf + sibling).digest()
        index, last = index // 2, last // 2
    return leaf if last == 0 else None


def _chained(records: list[ProvedRecord]) -> None:
    """Check that each record is what led to the one before it, back to where the chain ends."""
    for effect, cause in zip(records, [*records[1:], None], strict=True):
        led_from = effect.cause if effect.cause >= 0 else _answered(effect)
        if cause is None:
            require(
                not 0 <= led_from < effect.seq, f"record {effect.seq}: record {led_from} led to it and is not shown"
            )
        else:
            require(led_from == cause.seq < effect.seq, f"record {cause.seq}: did not lead to record {effect.seq}")


def _orders(records: list[ProvedRecord], log: Log, revoked: Revoked | None) -> Iterator[ProvedOrder]:
    """Yield the orders among the records whose giver is proved; one whose envelope does not hold refuses the proof."""
    to = Addressee(log.deployment, log.node, log.node_key, log.token_key)
    for one in records:
        order = check_order(one.seq, one.body, to, revoked) if one.kind == ORDER else None
        if order is not None:
            yield order


def _answered(record: ProvedRecord) -> int:
    """Return the seq of the effect that an observation answers, -1 where it answers none."""
    number = ANSWERS.get(record.kind)
    if number is None:
        return -1
    found = [value for field, value in parts_of(record.body, f"record {record.seq}") if field == number]
    return found[0] if found and isinstance(found[0], int) else -1
