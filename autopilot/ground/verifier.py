"""Checks the proof of a decision, offline: written from docs/proof.md, so that it shares no mistake with who made it.

It imports the standard library and one Ed25519 verification, and nothing of this repository; it can be copied away
and read alone. It opens no network and needs no key. A proof holds as a whole or not at all: every byte of the file is
bound by a hash, a signature, or the one way in which it may be written. What a record means is not its business.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
import struct
from dataclasses import dataclass
from typing import Any

from nacl.exceptions import BadSignatureError
from nacl.signing import VerifyKey

FORMAT = "autopilot-proof/1"
BYTES_MAX = 1 << 20
NODE = 2  # kind of principal in an identity token
# Observations that answer an effect name its seq in this field of their body, by kind.
ANSWERS = {23: 1, 43: 1, 44: 1, 45: 1, 49: 5}

# flight_id, seq, cause, flight_ns, mono_ns, boot, wall_ns, clock_quality, kind, version, leaf before; then the body's
_LEAF = struct.Struct(">c16sQqQQIqBHB32s32s")
_COLUMNS = ("seq", "cause", "flight_ns", "mono_ns", "boot", "wall_ns", "clock_quality", "kind", "version")
_BINARY = {"leaf_before": 32, "salt": 16}
_CHECKPOINT = re.compile(
    r"(\S+)\n(0|[1-9]\d{0,18})\n(\S{44})\nflight_ns (0|[1-9]\d{0,18})\n(?:state [0-9a-f]{8} (\S{44})\n)?", re.ASCII
)
_LOG_KEY = re.compile(
    r"waypoint/log-key/v1\n(waypoint/([a-z0-9-]{1,64})/([a-z0-9-]{1,64}))/([1-9]\d{0,9})\n"
    r"flight ([0-9a-f]{32})\nkey (\S{44})\n",
    re.ASCII,
)
_SIGNATURE = re.compile(r"— (\S+) (\S+)\n")


class ProofRefused(ValueError):
    """The file proves nothing; the text says what does not hold."""


@dataclass(frozen=True, slots=True)
class ProvedRecord:
    """A record whose place in the log is proved."""

    seq: int
    cause: int
    wall_ns: int
    kind: int
    version: int
    body: bytes


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
    records: tuple[ProvedRecord, ...]  # the one in question first, then what led to it

    def words(self) -> str:
        """Return in one sentence what is proved and what is not."""
        first, *causes = self.records
        led = f" and what led to it, back to record {causes[-1].seq}," if causes else ""
        return (
            f"Proved: record {first.seq}{led} stood, byte for byte, in the log of flight {self.flight} of node"
            f" {self.node}, deployment {self.deployment}, as it was signed over {self.size} records by a key that the"
            f" node certified for this flight, where the trust root {self.trust_root} is the one that you know;"
            f" not proved: that what was recorded is true, that the node's clocks were right, that its keys were in"
            f" nobody else's hands or not revoked, and what was recorded after those {self.size} records."
        )


def check(data: bytes, trust_root: bytes | None = None) -> Proved:
    """Check a proof, which must rest on `trust_root` where you have that file yourself. Raises ProofRefused."""
    _require(len(data) <= BYTES_MAX, f"the file has more than {BYTES_MAX} bytes")
    proof = _read(data)
    root, token = _base64(proof["trust_root"]), _base64(proof["token"])
    _require(trust_root is None or trust_root == root, "the proof rests on another trust root than the one given")
    deployment, token_key = _trust_root(root)
    node, node_key = _token(token, deployment, token_key)
    certified = _fields_of(_LOG_KEY, _note(proof["log_key"], f"waypoint/{deployment}/{node}", node_key), "log_key")
    signer, _, _, flight, flight_id, log_key = certified
    _require(signer == f"waypoint/{deployment}/{node}", "log_key: certified for another node")
    origin = f"{signer}/{flight}"
    text = _note(proof["checkpoint"], origin, _base64(log_key, 32))
    log, size, tree_root, signed_ns, state = _fields_of(_CHECKPOINT, text, "checkpoint")
    _require(log == origin, "checkpoint: of another log than its key may sign")
    if state:
        _base64(state, 32)
    root_hash = _base64(tree_root, 32)
    found = [_record(one, bytes.fromhex(flight_id), int(size), root_hash) for one in proof["records"]]
    _chained(found)
    return Proved(
        deployment=deployment,
        node=node,
        flight=int(flight),
        flight_id=bytes.fromhex(flight_id),
        size=int(size),
        signed_flight_ns=int(signed_ns),
        trust_root=hashlib.sha256(root).hexdigest(),
        records=tuple(found),
    )


def _require(holds: bool, because: str) -> None:
    if not holds:
        raise ProofRefused(because)


def _read(data: bytes) -> dict[str, Any]:
    """Read the file, which may be written in one way only."""
    try:
        proof: dict[str, Any] = json.loads(data)
        written = json.dumps(proof, sort_keys=True, indent=1).encode() + b"\n"
    except (ValueError, RecursionError) as error:
        raise ProofRefused("the file is no proof: it is not JSON") from error
    _require(isinstance(proof, dict) and proof.get("format") == FORMAT, f"the file is not of format {FORMAT}")
    _require(written == data, "the file is not written as a proof is: it was changed")
    texts = {"checkpoint", "format", "log_key", "token", "trust_root"}
    _require(set(proof) == texts | {"records"}, "the file has other parts than a proof")
    _require(all(isinstance(proof[name], str) for name in texts), "a part of the file is no text")
    records = proof["records"]
    _require(isinstance(records, list) and bool(records), "the file shows no records")
    _require(all(_is_record(one) for one in records), "a record of the file is not written as it is to be")
    return proof


def _is_record(one: Any) -> bool:
    if not isinstance(one, dict) or set(one) != {*_COLUMNS, *_BINARY, "body", "inclusion"}:
        return False
    proof = one["inclusion"]
    texts = [one["body"], *(one[name] for name in _BINARY), *(proof if isinstance(proof, list) else [None])]
    return all(type(one[name]) is int for name in _COLUMNS) and all(isinstance(text, str) for text in texts)


def _base64(text: str, length: int | None = None) -> bytes:
    """Decode base64 that could be written in no other way."""
    try:
        data = base64.b64decode(text, validate=True)
    except ValueError as error:
        raise ProofRefused("a part of the file is not base64") from error
    _require(base64.b64encode(data).decode() == text, "a part of the file is base64 written in another way")
    _require(length is None or len(data) == length, f"a part of the file has {len(data)} bytes, not {length}")
    return data


def _signed_by(public_key: bytes, message: bytes, signature: bytes, what: str) -> None:
    try:
        VerifyKey(public_key).verify(message, signature)
    except (BadSignatureError, ValueError, TypeError) as error:
        raise ProofRefused(f"{what}: the signature does not match") from error


def _note(note: str, name: str, public_key: bytes) -> str:
    """Return the text of a signed note (C2SP signed-note) with exactly one signature, by this key and name."""
    text, _, last = note.rpartition("\n\n")
    text += "\n"
    found = _SIGNATURE.fullmatch(last)
    _require(found is not None and found[1] == name, f"{name}: the note is not signed under this name")
    assert found is not None
    signature = _base64(found[2], 68)
    key_id = hashlib.sha256(name.encode() + b"\n\x01" + public_key).digest()[:4]
    _require(signature[:4] == key_id, f"{name}: the note is signed by another key")
    _signed_by(public_key, text.encode(), signature[4:], name)
    return text


def _fields_of(pattern: re.Pattern[str], text: str, what: str) -> tuple[str, ...]:
    found = pattern.fullmatch(text)
    if found is None:
        raise ProofRefused(f"{what}: the note does not say what it is to say")
    return found.groups()


def _parts(data: bytes, what: str) -> list[tuple[int, int | bytes]]:
    """Take a protobuf message apart: numbers and byte strings, in the order of their fields, shortest varints."""
    parts: list[tuple[int, int | bytes]] = []
    at = 0

    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            _require(at < len(data) and shift < 64, f"{what}: ends within a number")
            byte, at = data[at], at + 1
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                _require(byte > 0 or shift == 0, f"{what}: a number is longer than it needs to be")
                return value
            shift += 7

    while at < len(data):
        tag = varint()
        _require(not parts or tag >> 3 >= parts[-1][0], f"{what}: its fields are out of order")
        if tag & 7 == 0:
            parts.append((tag >> 3, varint()))
        elif tag & 7 == 2:
            length = varint()
            _require(at + length <= len(data), f"{what}: ends within a field")
            parts.append((tag >> 3, data[at : at + length]))
            at += length
        else:
            raise ProofRefused(f"{what}: has a field of a type that is not known")
    return parts


def _one(parts: list[tuple[int, int | bytes]], number: int, what: str) -> bytes:
    found = [value for field, value in parts if field == number]
    if len(found) != 1 or not isinstance(found[0], bytes):
        raise ProofRefused(f"{what}: field {number} is not there once")
    return found[0]


def _text(parts: list[tuple[int, int | bytes]], number: int, what: str) -> str:
    text = _one(parts, number, what).decode("ascii", "replace")
    _require(re.fullmatch(r"[a-z0-9-]{1,64}", text) is not None, f"{what}: field {number} is no name")
    return text


def _all(parts: list[tuple[int, int | bytes]], number: int) -> list[bytes]:
    return [value for field, value in parts if field == number and isinstance(value, bytes)]


def _signed_body(document: bytes, context: bytes, keys: list[bytes], threshold: int, what: str) -> bytes:
    """Return the signed bytes of a document; each of its signatures must match, by `threshold` different keys."""
    parts = _parts(document, what)
    body, signatures = _one(parts, 1, what), _all(parts, 2)
    _require(len(parts) == 1 + len(signatures), f"{what}: has parts that are not known")
    count = struct.Struct("<Q").pack
    framed = count(2) + count(len(context)) + context + count(len(body)) + body
    known = {hashlib.blake2b(key, digest_size=16, person=b"wp.keyid.v1").digest(): key for key in keys}
    for signature in signatures:
        inner = _parts(signature, what)
        key = known.pop(_one(inner, 1, what), None)
        _require(len(inner) == 2 and key is not None, f"{what}: signed by a key that is not known, or twice")
        assert key is not None
        _signed_by(key, framed, _one(inner, 2, what), what)
    _require(len(signatures) >= max(threshold, 1), f"{what}: signed by fewer keys than it needs")
    return body


def _trust_root(document: bytes) -> tuple[str, bytes]:
    """Return the deployment and the key that signs tokens. A root is signed by the keys that it names itself."""
    what = "trust_root"
    root = _parts(_one(_parts(document, what), 1, what), what)
    threshold = next((value for field, value in root if field == 5 and isinstance(value, int)), 0)
    _signed_body(document, b"waypoint/v1/TrustRoot", _all(root, 6), threshold, what)
    purposes = [_parts(entry, what) for entry in _all(root, 7)]
    keys = [_one(entry, 2, what) for entry in purposes if _one(entry, 1, what) == b"token"]
    _require(len(keys) == 1, "trust_root: names no key that signs tokens")
    return _text(root, 2, what), keys[0]


def _token(document: bytes, deployment: str, token_key: bytes) -> tuple[str, bytes]:
    """Return name and key of the node."""
    token = _parts(_signed_body(document, b"waypoint/v1/IdentityToken", [token_key], 1, "token"), "token")
    _require(_text(token, 2, "token") == deployment, "token: of another deployment")
    _require((4, NODE) in token, "token: is not a node's")
    return _text(token, 3, "token"), _one(token, 5, "token")


def _record(one: dict[str, Any], flight_id: bytes, size: int, root: bytes) -> ProvedRecord:
    """Check that a record lies in the tree of `size` records under `root`."""
    seq, what = one["seq"], f"record {one['seq']}"
    body, salt = _base64(one["body"]), _base64(one["salt"], _BINARY["salt"])
    before = _base64(one["leaf_before"], _BINARY["leaf_before"])
    try:
        columns = (one[name] for name in _COLUMNS)
        packed = _LEAF.pack(b"\0", flight_id, *columns, before, hashlib.sha256(salt + body).digest())
    except struct.error as error:
        raise ProofRefused(f"{what}: a number does not fit its column") from error
    _require(0 <= seq < size, f"{what}: is not among the {size} records that were signed")
    found = _root_from(hashlib.sha256(packed).digest(), seq, size, [_base64(each, 32) for each in one["inclusion"]])
    _require(found == root, f"{what}: is not what the log holds there")
    return ProvedRecord(seq, one["cause"], one["wall_ns"], one["kind"], one["version"], body)


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
            _require(
                not 0 <= led_from < effect.seq, f"record {effect.seq}: record {led_from} led to it and is not shown"
            )
        else:
            _require(led_from == cause.seq < effect.seq, f"record {cause.seq}: did not lead to record {effect.seq}")


def _answered(record: ProvedRecord) -> int:
    """Return the seq of the effect that an observation answers, -1 where it answers none."""
    number = ANSWERS.get(record.kind)
    if number is None:
        return -1
    found = [value for field, value in _parts(record.body, f"record {record.seq}") if field == number]
    return found[0] if found and isinstance(found[0], int) else -1
