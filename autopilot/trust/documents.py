"""Signed documents: what the root and the Directory say, parsed strictly and verified.

Five documents, each under its own purpose key and its own context string: TrustRoot,
IdentityToken, RevocationList, EpochBundle, TimeBeacon. The signed bytes are kept and never made again from
the parsed form (DSSE: do not re-parse after verification). No file is read here.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from google.protobuf.message import DecodeError, Message

from autopilot.trust import limits
from autopilot.trust.keys import SignatureInvalid, SignKey, digest, key_id, verify
from autopilot.trust.pae import (
    EPOCH_BUNDLE,
    EPOCH_COMMITMENT,
    IDENTITY_TOKEN,
    REVOCATION_LIST,
    TIME_BEACON,
    TRUST_ROOT,
    le64,
    pae,
)
from events.schema.waypoint_pb2 import (
    EpochBundle,
    IdentityToken,
    PrincipalKind,
    RevocationList,
    Sig,
    SignedDoc,
    TimeBeacon,
    TrustRoot,
)

M = TypeVar("M", bound=Message)

PURPOSES = ("epoch", "revoke", "time", "token")
KINDS = (PrincipalKind.OPERATOR, PrincipalKind.NODE, PrincipalKind.SERVICE)
_NAME = re.compile(r"[a-z0-9-]{1,64}")


class DocumentError(Exception):
    """A document is not what it must be; the text says what is wrong with it."""


class DocumentMalformed(DocumentError):
    """It can't be parsed, is not canonical, or a field is out of its bounds."""


class DocumentUnsigned(DocumentError):
    """A signature that it needs is missing or does not match."""


def is_name(text: str) -> bool:
    """Say whether `text` may name a principal or deployment: safe as one chunk of a Zenoh key."""
    return _NAME.fullmatch(text) is not None


def is_canonical(message: Message, data: bytes) -> bool:
    """Say whether `data` is the one encoding of `message` that a strict parser takes.

    Encoding it again must give the same bytes, which leaves no room for doubled or reordered
    fields and overlong numbers; and no field may carry its default explicitly. Unknown fields are
    taken out of `message` first, for protobuf keeps them and would write them back.
    """
    message.DiscardUnknownFields()
    return message.SerializeToString(deterministic=True) == data and _lacks_explicit_defaults(message)


def _lacks_explicit_defaults(message: Message) -> bool:
    for _, value in message.ListFields():
        if not value:
            return False
        parts = value if not isinstance(value, (int, str, bytes, Message)) else (value,)
        if not all(_lacks_explicit_defaults(part) for part in parts if isinstance(part, Message)):
            return False
    return True


def parse(message: type[M], data: bytes) -> M:
    """Parse `data` strictly. Raises DocumentMalformed."""
    name = message.DESCRIPTOR.name
    if len(data) > limits.DOCUMENT_BYTES_MAX:
        raise DocumentMalformed(f"{name}: larger than {limits.DOCUMENT_BYTES_MAX} bytes")
    parsed = message()
    try:
        parsed.ParseFromString(data)
    except DecodeError as error:
        raise DocumentMalformed(f"{name}: can't be parsed") from error
    if not is_canonical(parsed, data):
        raise DocumentMalformed(f"{name}: is not in canonical encoding")
    return parsed


def sign(context: bytes, body: Message, keys: Sequence[SignKey]) -> bytes:
    """Return the encoded SignedDoc of `body`, signed by each of `keys` for `context`."""
    encoded = body.SerializeToString(deterministic=True)
    framed = pae(context, encoded)
    sigs = [Sig(key_id=key.key_id, sig=key.sign(framed)) for key in keys]
    return SignedDoc(body=encoded, sigs=sigs).SerializeToString(deterministic=True)


def verified_body(context: bytes, data: bytes, keys: Sequence[bytes], threshold: int = 1) -> bytes:
    """Return the signed bytes of a SignedDoc that `threshold` different keys of `keys` signed.

    Every signature in it must be by a known key, each key once, and match. Raises
    DocumentMalformed or DocumentUnsigned.
    """
    document = parse(SignedDoc, data)
    known = {key_id(key): key for key in keys}
    framed = pae(context, document.body)
    signers: set[bytes] = set()
    for sig in document.sigs[: len(known) + 1]:
        public_key = known.get(sig.key_id)
        if public_key is None or sig.key_id in signers:
            raise DocumentUnsigned("a signature is by an unknown key, or the same key signed twice")
        try:
            verify(public_key, framed, sig.sig)
        except SignatureInvalid as error:
            raise DocumentUnsigned("a signature does not match the document") from error
        signers.add(sig.key_id)
    if threshold < 1 or len(signers) < threshold:
        raise DocumentUnsigned(f"signed by {len(signers)} keys of the {max(threshold, 1)} that are needed")
    return document.body


@dataclass(frozen=True, slots=True)
class Trust:
    """What a verified TrustRoot says: the deployment and the Directory's key for each purpose."""

    deployment_id: str
    version: int
    expires_ms: int
    keys: Mapping[str, bytes]
    root_keys: tuple[bytes, ...]
    threshold: int
    digest: bytes  # BLAKE2b-256 of the signed body


@dataclass(frozen=True, slots=True)
class Revocations:
    """A verified revocation list, ready for look-up."""

    version: int
    key_id: bytes  # of the key that signed it: versions are counted for each key apart
    digest: bytes  # BLAKE2b-256 of the signed body: two lists of one version are told apart by it
    issued_at_ms: int
    next_update_ms: int
    principals: frozenset[str]
    device_key_ids: frozenset[bytes]
    token_ids: frozenset[bytes]
    min_policy_version: int
    min_epoch_id: int

    def covers(self, token: IdentityToken) -> bool:
        """Say whether the token's principal, device or the token itself is out."""
        return (
            token.principal_id in self.principals
            or key_id(token.device_sign_pk) in self.device_key_ids
            or token.token_id in self.token_ids
        )


def verify_trust_root(data: bytes) -> Trust:
    """Verify a TrustRoot by the root keys that it names itself. Raises DocumentError.

    So it proves to be whole, not to be the right one: the folder that it lies in is what pins it.
    """
    claimed = parse(TrustRoot, parse(SignedDoc, data).body)
    root_keys = list(claimed.root_keys)
    if len(set(root_keys)) != len(root_keys) or not all(_is_key(key) for key in root_keys):
        raise DocumentMalformed("TrustRoot: root_keys: must be different 32-byte keys")
    signed = verified_body(TRUST_ROOT, data, root_keys, claimed.threshold)
    root = parse(TrustRoot, signed)
    keys = {entry.purpose: entry.public_key for entry in root.keys}
    _require(root.v == 1, "TrustRoot: v: only version 1 is known")
    _require(is_name(root.deployment_id), "TrustRoot: deployment_id: must be [a-z0-9-], 1 to 64 characters")
    _require(root.version > 0, "TrustRoot: version: must not be 0")
    _require(
        tuple(sorted(keys)) == PURPOSES and len(root.keys) == len(PURPOSES), "TrustRoot: keys: one for each purpose"
    )
    _require(all(_is_key(key) for key in keys.values()), "TrustRoot: keys: must be 32-byte keys")
    _require(not set(keys.values()) & set(root_keys), "TrustRoot: keys: a root key must serve no other purpose")
    _require(len(set(keys.values())) == len(PURPOSES), "TrustRoot: keys: purposes must not share a key")
    return Trust(
        root.deployment_id, root.version, root.expires_ms, keys, tuple(root_keys), root.threshold, digest(signed)
    )


def verify_token(data: bytes, trust: Trust) -> IdentityToken:
    """Verify an IdentityToken and its bounds; its validity in time is the caller's. Raises DocumentError."""
    if len(data) > limits.TOKEN_BYTES_MAX:
        raise DocumentMalformed(f"IdentityToken: larger than {limits.TOKEN_BYTES_MAX} bytes")
    token = parse(IdentityToken, verified_body(IDENTITY_TOKEN, data, [trust.keys["token"]]))
    check_token(token)
    _require(token.deployment_id == trust.deployment_id, "IdentityToken: deployment_id: is another deployment's")
    return token


def check_token(token: IdentityToken) -> None:
    """Check every field of a token for its bounds. Raises DocumentMalformed naming the field."""
    roles = list(token.roles)
    _require(token.v == 1, "IdentityToken: v: only version 1 is known")
    _require(is_name(token.principal_id), "IdentityToken: principal_id: must be [a-z0-9-], 1 to 64 characters")
    _require(token.kind in KINDS, "IdentityToken: kind: unknown")
    _require(_is_key(token.device_sign_pk), "IdentityToken: device_sign_pk: must be 32 bytes, not all zero")
    _require(_is_key(token.device_box_pk), "IdentityToken: device_box_pk: must be 32 bytes, not all zero")
    _require(roles == sorted(set(roles)) and len(roles) <= limits.ROLES_MAX, "IdentityToken: roles: at most 8, sorted")
    _require(all(0 < len(role) <= limits.ROLE_CHARACTERS_MAX for role in roles), "IdentityToken: roles: 1 to 32 long")
    _require(token.not_before_ms < token.not_after_ms, "IdentityToken: not_after_ms: must follow not_before_ms")
    _require(len(token.token_id) == limits.TOKEN_ID_BYTES, "IdentityToken: token_id: must be 16 bytes")
    _require(len(token.callsign) <= limits.CALLSIGN_CHARACTERS_MAX, "IdentityToken: callsign: at most 64 characters")
    _require(token.callsign.isprintable(), "IdentityToken: callsign: must be printable")


def verify_revocations(data: bytes, trust: Trust) -> Revocations:
    """Verify a RevocationList. Raises DocumentError."""
    signed = verified_body(REVOCATION_LIST, data, [trust.keys["revoke"]])
    body = parse(RevocationList, signed)
    entries = [list(body.principals), _hexed(body.device_key_ids), _hexed(body.token_ids)]
    _require(body.v == 1, "RevocationList: v: only version 1 is known")
    _require(body.deployment_id == trust.deployment_id, "RevocationList: deployment_id: is another deployment's")
    _require(body.version > 0, "RevocationList: version: must not be 0")
    _require(len(body.prev_digest) == limits.KEY_BYTES, "RevocationList: prev_digest: must be 32 bytes")
    _require(sum(len(kind) for kind in entries) <= limits.REVOKED_MAX, "RevocationList: more than 4096 entries")
    ordered = all(kind == sorted(set(kind)) for kind in entries)
    _require(ordered, "RevocationList: entries: must be sorted and unique")
    return Revocations(
        version=body.version,
        key_id=key_id(trust.keys["revoke"]),
        digest=digest(signed),
        issued_at_ms=body.issued_at_ms,
        next_update_ms=body.next_update_ms,
        principals=frozenset(body.principals),
        device_key_ids=frozenset(body.device_key_ids),
        token_ids=frozenset(body.token_ids),
        min_policy_version=body.min_policy_version,
        min_epoch_id=body.min_epoch_id,
    )


def verify_epoch_bundle(data: bytes, trust: Trust) -> EpochBundle:
    """Verify an EpochBundle; opening its key is its device's. Raises DocumentError."""
    bundle = parse(EpochBundle, verified_body(EPOCH_BUNDLE, data, [trust.keys["epoch"]]))
    _require(bundle.v == 1, "EpochBundle: v: only version 1 is known")
    _require(bundle.deployment_id == trust.deployment_id, "EpochBundle: deployment_id: is another deployment's")
    _require(bundle.epoch_id > 0, "EpochBundle: epoch_id: must not be 0")
    _require(bundle.not_before_ms < bundle.retire_at_ms, "EpochBundle: retire_at_ms: must follow not_before_ms")
    return bundle


def verify_time_beacon(data: bytes, trust: Trust) -> TimeBeacon:
    """Verify a TimeBeacon; whether it answers a challenge is its asker's. Raises DocumentError."""
    beacon = parse(TimeBeacon, verified_body(TIME_BEACON, data, [trust.keys["time"]]))
    _require(beacon.v == 1, "TimeBeacon: v: only version 1 is known")
    _require(beacon.deployment_id == trust.deployment_id, "TimeBeacon: deployment_id: is another deployment's")
    _require(len(beacon.challenge) == limits.CHALLENGE_BYTES, "TimeBeacon: challenge: must be 16 bytes")
    _require(beacon.time_ms > 0, "TimeBeacon: time_ms: must not be 0")
    return beacon


def epoch_commitment(epoch_id: int, secret: bytes) -> bytes:
    """Return what a bundle says of its key, so that one epoch id names exactly one key."""
    return hashlib.blake2b(EPOCH_COMMITMENT + le64(epoch_id) + secret, digest_size=limits.KEY_BYTES).digest()


def _hexed(ids: Iterable[bytes]) -> list[str]:
    return [each.hex() for each in ids]


def _is_key(key: bytes) -> bool:
    return len(key) == limits.KEY_BYTES and any(key)


def _require(holds: bool, because: str) -> None:
    if not holds:
        raise DocumentMalformed(because)
