"""The papers of a proof, for the verifier: from the trust root to the log's key, and the checkpoints that it signed.

It is a part of the verifier and like it written from docs/proof.md: the standard library, one Ed25519 verification, and
nothing else of this repository. It opens no file and no network.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from nacl.exceptions import BadSignatureError
from nacl.signing import VerifyKey

BYTES_MAX = 1 << 20
NODE, WITNESSES = 2, (1, 3)  # kinds of principals in an identity token; witnesses are operators and services
PAPERS = frozenset({"log_key", "token", "trust_root"})

_CHECKPOINT = re.compile(
    r"(\S+)\n(0|[1-9]\d{0,18})\n(\S{44})\nflight_ns (0|[1-9]\d{0,18})\n"
    r"(?:state [0-9a-f]{8} [A-Za-z0-9+/]{43}=\n)?(?:(?!state )[ -~]+\n)*",
    re.ASCII,
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
class Cosigner:
    """A witness that had seen the log grow in order up to a checkpoint."""

    principal: str
    callsign: str
    time_s: int  # the witness's clock, seconds since 1970

    def words(self) -> str:
        """Return who it was, and when."""
        at = datetime.fromtimestamp(self.time_s, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
        return f"{self.principal} at {at}"


@dataclass(frozen=True, slots=True)
class Head:
    """A checkpoint whose signatures hold."""

    size: int
    root: bytes
    flight_ns: int
    cosigners: tuple[Cosigner, ...]

    def words(self) -> str:
        """Return who cosigned it, as a part of a sentence; empty where nobody did."""
        return f" (cosigned by {', '.join(one.words() for one in self.cosigners)})" if self.cosigners else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Log:
    """Whose log it is, which its papers say."""

    deployment: str
    node: str
    flight: int
    flight_id: bytes
    key: bytes
    node_key: bytes
    token_key: bytes
    trust_root: str  # SHA-256 of the trust root's document, hex


def log_of(proof: dict[str, Any], trust_root: bytes | None) -> Log:
    """Follow the papers from the trust root to the log's key."""
    root, token = base64_of(proof["trust_root"]), base64_of(proof["token"])
    require(trust_root is None or trust_root == root, "the proof rests on another trust root than the one given")
    deployment, token_key = trust_root_of(root)
    node, _, node_key = principal_of(token, deployment, token_key, kinds=(NODE,))
    certificate = notename_of(proof["log_key"], f"waypoint/{deployment}/{node}", node_key)
    signer, _, _, flight, flight_id, log_key = fields_of(_LOG_KEY, certificate, "log_key")
    require(signer == f"waypoint/{deployment}/{node}", "log_key: certified for another node")
    return Log(
        deployment=deployment,
        node=node,
        flight=int(flight),
        flight_id=bytes.fromhex(flight_id),
        key=base64_of(log_key, 32),
        node_key=node_key,
        token_key=token_key,
        trust_root=hashlib.sha256(root).hexdigest(),
    )


def head_of(note: str, witnesses: Any, log: Log) -> Head:
    """Return a checkpoint that the log's key signed, and each of its witnesses."""
    origin = f"waypoint/{log.deployment}/{log.node}/{log.flight}"
    tokens = texts_of(witnesses)
    _, *lines = note.rpartition("\n\n")[2].splitlines(keepends=True) or [""]
    text = notename_of(note[: len(note) - len("".join(lines))], origin, log.key)
    said, size, root, flight_ns = fields_of(_CHECKPOINT, text, "checkpoint")
    require(said == origin, "checkpoint: of another log than its key may sign")
    require(len(lines) == len(tokens), "checkpoint: not each of its witnesses has a token")
    cosigners = tuple(_cosigner(text, line, token, log) for line, token in zip(lines, tokens, strict=True))
    require(len({one.principal for one in cosigners}) == len(cosigners), "checkpoint: a witness signed it twice")
    return Head(int(size), base64_of(root, 32), int(flight_ns), cosigners)


def _cosigner(text: str, line: str, token: str, log: Log) -> Cosigner:
    """Check one cosignature (C2SP tlog-cosignature v1) by the key in the witness's token."""
    principal, callsign, key = principal_of(base64_of(token), log.deployment, log.token_key, kinds=WITNESSES)
    name, found = f"waypoint/{log.deployment}/{principal}", _SIGNATURE.fullmatch(line)
    require(found is not None and found[1] == name, f"{name}: the cosignature is not under this name")
    assert found is not None
    data = base64_of(found[2], 76)
    key_id = hashlib.sha256(name.encode() + b"\n\x04" + key).digest()[:4]
    require(data[:4] == key_id, f"{name}: the cosignature is by another key")
    time_s = int.from_bytes(data[4:12], "big")
    require(time_s < 1 << 35, f"{name}: the time of the cosignature is none")
    signed_by(key, f"cosignature/v1\ntime {time_s}\n{text}".encode(), data[12:], name)
    return Cosigner(principal, callsign, time_s)


def read_file(data: bytes, form: str, texts: Iterable[str], others: Iterable[str]) -> dict[str, Any]:
    """Read a file, which may be written in one way only: its papers, further texts, and other parts."""
    require(len(data) <= BYTES_MAX, f"the file has more than {BYTES_MAX} bytes")
    try:
        proof: dict[str, Any] = json.loads(data)
        written = json.dumps(proof, sort_keys=True, indent=1).encode() + b"\n"
    except (ValueError, RecursionError) as error:
        raise ProofRefused("the file is no proof: it is not JSON") from error
    require(isinstance(proof, dict) and proof.get("format") == form, f"the file is not of format {form}")
    require(written == data, "the file is not written as a proof is: it was changed")
    named = PAPERS | {"format", *texts}
    require(set(proof) == named | set(others), "the file has other parts than a proof")
    require(all(isinstance(proof[name], str) for name in named), "a part of the file is no text")
    return proof


def texts_of(part: Any) -> list[str]:
    """Return a part of a file that is a list of texts."""
    require(isinstance(part, list) and all(isinstance(one, str) for one in part), "a part of the file is no texts")
    texts: list[str] = part
    return texts


def require(holds: bool, because: str) -> None:
    """Refuse the proof where something does not hold. Raises ProofRefused."""
    if not holds:
        raise ProofRefused(because)


def base64_of(text: str, length: int | None = None) -> bytes:
    """Decode base64 that could be written in no other way."""
    try:
        data = base64.b64decode(text, validate=True)
    except ValueError as error:
        raise ProofRefused("a part of the file is not base64") from error
    require(base64.b64encode(data).decode() == text, "a part of the file is base64 written in another way")
    require(length is None or len(data) == length, f"a part of the file has {len(data)} bytes, not {length}")
    return data


def signed_by(public_key: bytes, message: bytes, signature: bytes, what: str) -> None:
    """Refuse what this key did not sign. Raises ProofRefused."""
    try:
        VerifyKey(public_key).verify(message, signature)
    except (BadSignatureError, ValueError, TypeError) as error:
        raise ProofRefused(f"{what}: the signature does not match") from error


def notename_of(note: str, name: str, public_key: bytes) -> str:
    """Return the text of a signed note (C2SP signed-note) with exactly one signature, by this key and name."""
    text, _, last = note.rpartition("\n\n")
    text += "\n"
    found = _SIGNATURE.fullmatch(last)
    require(found is not None and found[1] == name, f"{name}: the note is not signed under this name")
    assert found is not None
    signature = base64_of(found[2], 68)
    key_id = hashlib.sha256(name.encode() + b"\n\x01" + public_key).digest()[:4]
    require(signature[:4] == key_id, f"{name}: the note is signed by another key")
    signed_by(public_key, text.encode(), signature[4:], name)
    return text


def fields_of(pattern: re.Pattern[str], text: str, what: str) -> tuple[str, ...]:
    """Return what a note says, which is written in one way. Raises ProofRefused."""
    found = pattern.fullmatch(text)
    if found is None:
        raise ProofRefused(f"{what}: the note does not say what it is to say")
    return found.groups()


def parts_of(data: bytes, what: str) -> list[tuple[int, int | bytes]]:
    """Take a protobuf message apart: numbers and byte strings, in the order of their fields, shortest varints."""
    parts: list[tuple[int, int | bytes]] = []
    at = 0

    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            require(at < len(data) and shift < 64, f"{what}: ends within a number")
            byte, at = data[at], at + 1
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                require(byte > 0 or shift == 0, f"{what}: a number is longer than it needs to be")
                return value
            shift += 7

    while at < len(data):
        tag = varint()
        require(not parts or tag >> 3 >= parts[-1][0], f"{what}: its fields are out of order")
        if tag & 7 == 0:
            parts.append((tag >> 3, varint()))
        elif tag & 7 == 2:
            length = varint()
            require(at + length <= len(data), f"{what}: ends within a field")
            parts.append((tag >> 3, data[at : at + length]))
            at += length
        else:
            raise ProofRefused(f"{what}: has a field of a type that is not known")
    return parts


def field_of(parts: list[tuple[int, int | bytes]], number: int, what: str) -> bytes:
    """Return a field of bytes that must be there once. Raises ProofRefused."""
    found = [value for field, value in parts if field == number]
    if len(found) != 1 or not isinstance(found[0], bytes):
        raise ProofRefused(f"{what}: field {number} is not there once")
    return found[0]


def name_of(parts: list[tuple[int, int | bytes]], number: int, what: str) -> str:
    """Return a field that is the name of a principal or a deployment. Raises ProofRefused."""
    text = field_of(parts, number, what).decode("ascii", "replace")
    require(re.fullmatch(r"[a-z0-9-]{1,64}", text) is not None, f"{what}: field {number} is no name")
    return text


def fields_all(parts: list[tuple[int, int | bytes]], number: int) -> list[bytes]:
    """Return every field of bytes with this number."""
    return [value for field, value in parts if field == number and isinstance(value, bytes)]


def signed_body(document: bytes, context: bytes, keys: list[bytes], threshold: int, what: str) -> bytes:
    """Return the signed bytes of a document; each of its signatures must match, by `threshold` different keys."""
    parts = parts_of(document, what)
    body, signatures = field_of(parts, 1, what), fields_all(parts, 2)
    require(len(parts) == 1 + len(signatures), f"{what}: has parts that are not known")
    count = struct.Struct("<Q").pack
    framed = count(2) + count(len(context)) + context + count(len(body)) + body
    known = {hashlib.blake2b(key, digest_size=16, person=b"wp.keyid.v1").digest(): key for key in keys}
    for signature in signatures:
        inner = parts_of(signature, what)
        key = known.pop(field_of(inner, 1, what), None)
        require(len(inner) == 2 and key is not None, f"{what}: signed by a key that is not known, or twice")
        assert key is not None
        signed_by(key, framed, field_of(inner, 2, what), what)
    require(len(signatures) >= max(threshold, 1), f"{what}: signed by fewer keys than it needs")
    return body


def trust_root_of(document: bytes) -> tuple[str, bytes]:
    """Return the deployment and the key that signs tokens. A root is signed by the keys that it names itself."""
    return purpose_of(document, b"token")


def purpose_of(document: bytes, purpose: bytes) -> tuple[str, bytes]:
    """Return the deployment of a trust root and the key that it names for a purpose."""
    what = "trust_root"
    root = parts_of(field_of(parts_of(document, what), 1, what), what)
    threshold = next((value for field, value in root if field == 5 and isinstance(value, int)), 0)
    signed_body(document, b"waypoint/v1/TrustRoot", fields_all(root, 6), threshold, what)
    purposes = [parts_of(entry, what) for entry in fields_all(root, 7)]
    keys = [field_of(entry, 2, what) for entry in purposes if field_of(entry, 1, what) == purpose]
    kind = {b"token": "tokens", b"revoke": "revocation lists"}[purpose]
    require(len(keys) == 1, f"trust_root: names no key that signs {kind}")
    return name_of(root, 2, what), keys[0]


def principal_of(document: bytes, deployment: str, token_key: bytes, kinds: tuple[int, ...]) -> tuple[str, str, bytes]:
    """Return name, callsign and key of a principal of one of these kinds."""
    token = parts_of(signed_body(document, b"waypoint/v1/IdentityToken", [token_key], 1, "token"), "token")
    require(name_of(token, 2, "token") == deployment, "token: of another deployment")
    what = "a node's" if kinds == (NODE,) else "a witness's"
    require(any((4, kind) in token for kind in kinds), f"token: is not {what}")
    callsign = b"".join(fields_all(token, 12)).decode("utf-8", "replace")
    return name_of(token, 3, "token"), callsign, field_of(token, 5, "token")
