"""Documents of the Directory at their bounds: each field signed by the right key, and still not taken."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from autopilot.trust import documents, pae
from autopilot.trust.documents import DocumentMalformed, DocumentUnsigned
from autopilot.trust.keys import SignKey
from events.schema.waypoint_pb2 import PurposeKey, Sig, SignedDoc
from tests.vectors import cast

TRUST = cast.identity("alice").trust
BODIES: dict[str, Callable[[], Any]] = {
    "TrustRoot": cast.root,
    "IdentityToken": lambda: cast.token("alice"),
    "RevocationList": lambda: cast.revocations(12, principals=["mallory"]),
    "EpochBundle": lambda: cast.bundle("alice"),
    "TimeBeacon": cast.beacon,
}
VERIFY: dict[str, Callable[[bytes], object]] = {
    "TrustRoot": documents.verify_trust_root,
    "IdentityToken": lambda data: documents.verify_token(data, TRUST),
    "RevocationList": lambda data: documents.verify_revocations(data, TRUST),
    "EpochBundle": lambda data: documents.verify_epoch_bundle(data, TRUST),
    "TimeBeacon": lambda data: documents.verify_time_beacon(data, TRUST),
}
Change = Callable[[Any], object]


def check_taken(kind: str, change: Change) -> None:
    """A document with this change, signed by its purpose's key, is one."""
    body = BODIES[kind]()
    change(body)
    VERIFY[kind](cast.signed(kind, body))


def check_refused(kind: str, words: str, change: Change) -> None:
    """It is none, and the error names what is wrong."""
    body = BODIES[kind]()
    change(body)
    with pytest.raises(DocumentMalformed, match=f"^{kind}: {words}"):
        VERIFY[kind](cast.signed(kind, body))


def put(name: str, value: object) -> Change:
    return lambda body: setattr(body, name, value)


def lengthen(name: str, *values: object) -> Change:
    return lambda body: getattr(body, name).extend(values)


def swap(name: str, *values: object) -> Change:
    def change(body: Any) -> None:
        body.ClearField(name)
        getattr(body, name).extend(values)

    return change


def purposes(*names: str) -> Change:
    keys = [PurposeKey(purpose=name, public_key=cast.secret(f"key {at}")) for at, name in enumerate(names)]
    return swap("keys", *keys)


def key_of(at: int, key: bytes) -> Change:
    return lambda body: setattr(body.keys[at], "public_key", key)


REFUSED: list[tuple[str, str, Change]] = [
    ("TrustRoot", "v:", put("v", 2)),
    ("TrustRoot", "deployment_id:", put("deployment_id", "Coast Watch")),
    ("TrustRoot", "version:", lambda body: body.ClearField("version")),
    ("TrustRoot", "keys: one", purposes("epoch", "revoke", "time", "other")),
    ("TrustRoot", "keys: one", purposes("epoch", "revoke", "time")),
    ("TrustRoot", "keys: one", purposes("epoch", "revoke", "time", "token", "token")),
    ("TrustRoot", "keys: must be", key_of(0, bytes(32))),
    ("TrustRoot", "keys: must be", key_of(3, b"\x01" * 31)),
    ("TrustRoot", "keys: a root", key_of(2, cast.sign_key("root").public)),
    ("TrustRoot", "keys: purposes", key_of(2, cast.sign_key("dir.token").public)),
    ("TrustRoot", "root_keys:", lengthen("root_keys", bytes(32))),
    ("TrustRoot", "root_keys:", lengthen("root_keys", b"\x01" * 31)),
    ("TrustRoot", "root_keys:", lengthen("root_keys", cast.sign_key("root").public)),
    ("IdentityToken", "callsign: at most", put("callsign", "x" * 65)),
    ("IdentityToken", "callsign: must", put("callsign", "a\x7f")),
    ("IdentityToken", "roles: at most", swap("roles", *"abcdefghi")),
    ("IdentityToken", "roles: 1 to", swap("roles", "")),
    ("IdentityToken", "roles: 1 to", swap("roles", "a", "b" * 33)),
    ("IdentityToken", "not_after_ms:", put("not_after_ms", cast.NOW_MS - cast.HOUR_MS)),
    ("IdentityToken", "deployment_id:", put("deployment_id", "elsewhere")),
    ("IdentityToken", "token_id:", put("token_id", b"\x01" * 17)),
    ("RevocationList", "v:", put("v", 2)),
    ("RevocationList", "deployment_id:", put("deployment_id", "elsewhere")),
    ("RevocationList", "version:", lambda body: body.ClearField("version")),
    ("RevocationList", "prev_digest:", put("prev_digest", b"\x01" * 31)),
    ("RevocationList", "entries:", swap("principals", "b", "a")),
    ("RevocationList", "entries:", lengthen("token_ids", b"b" * 16, b"a" * 16)),
    ("RevocationList", "more than", swap("principals", *(f"{at:04}" for at in range(4097)))),
    ("EpochBundle", "v:", put("v", 2)),
    ("EpochBundle", "deployment_id:", put("deployment_id", "elsewhere")),
    ("EpochBundle", "epoch_id:", lambda body: body.ClearField("epoch_id")),
    ("EpochBundle", "retire_at_ms:", put("retire_at_ms", cast.NOW_MS - cast.HOUR_MS)),
    ("TimeBeacon", "v:", put("v", 2)),
    ("TimeBeacon", "deployment_id:", put("deployment_id", "elsewhere")),
    ("TimeBeacon", "challenge:", put("challenge", b"\x01" * 15)),
    ("TimeBeacon", "challenge:", put("challenge", b"\x01" * 17)),
    ("TimeBeacon", "time_ms:", lambda body: body.ClearField("time_ms")),
]
TAKEN: list[tuple[str, Change]] = [
    *((kind, lambda body: None) for kind in BODIES),
    ("IdentityToken", put("callsign", "x" * 64)),
    ("IdentityToken", swap("roles", *"abcdefgh")),
    ("IdentityToken", swap("roles", "a", "b" * 32)),
    ("IdentityToken", put("not_after_ms", cast.NOW_MS - cast.HOUR_MS + 1)),
    ("RevocationList", put("version", 1)),
    ("RevocationList", swap("principals", *(f"{at:04}" for at in range(4096)))),
    ("EpochBundle", put("retire_at_ms", cast.NOW_MS - cast.HOUR_MS + 1)),
    ("TimeBeacon", put("time_ms", 1)),
]


@pytest.mark.parametrize(("kind", "words", "change"), REFUSED)
def test_a_document_out_of_bounds_is_refused(kind: str, words: str, change: Change) -> None:
    check_refused(kind, words, change)


@pytest.mark.parametrize(("kind", "change"), TAKEN)
def test_a_document_at_its_bounds_is_taken(kind: str, change: Change) -> None:
    check_taken(kind, change)


def of_size(size: int) -> bytes:
    """Return a SignedDoc of so many bytes, signed by nobody."""
    body = b"b" * size
    while len(data := SignedDoc(body=body).SerializeToString(deterministic=True)) > size:
        body = body[:-1]
    assert len(data) == size
    return data


@pytest.mark.parametrize(("kind", "largest"), [("IdentityToken", 1024), ("RevocationList", 262_144)])
def test_a_document_that_is_too_large_is_not_read(kind: str, largest: int) -> None:
    with pytest.raises(DocumentUnsigned):
        VERIFY[kind](of_size(largest))
    with pytest.raises(DocumentMalformed, match=f"larger than {largest}"):
        VERIFY[kind](of_size(largest + 1))


def test_a_default_inside_is_refused_as_one_outside() -> None:
    """Also where encoding it again would give the same bytes."""
    sig = Sig(key_id=b"", sig=b"\x01")
    for document in (SignedDoc(body=b"b", sigs=[sig]), SignedDoc(body=b"", sigs=[Sig(sig=b"\x01")])):
        with pytest.raises(DocumentMalformed, match="canonical"):
            documents.parse(SignedDoc, document.SerializeToString(deterministic=True))
    good = SignedDoc(body=b"b", sigs=[Sig(key_id=b"\x01", sig=b"\x01")])
    assert documents.parse(SignedDoc, good.SerializeToString(deterministic=True)) == good


def test_a_threshold_counts_different_keys() -> None:
    """Two of two are enough, one of two is not, and the error says how many are needed."""
    second = SignKey.from_seed(cast.secret("root.2"))
    body = cast.root()
    body.root_keys.append(second.public)
    body.threshold = 2
    keys = [cast.sign_key("root"), second]
    assert documents.verify_trust_root(documents.sign(pae.TRUST_ROOT, body, keys)).version == 1
    for signers in (keys[:1], [keys[0], keys[0]], [keys[0], cast.sign_key("alice")]):
        with pytest.raises(DocumentUnsigned):
            documents.verify_trust_root(documents.sign(pae.TRUST_ROOT, body, signers))
    with pytest.raises(DocumentUnsigned, match="by 1 keys of the 2 that"):
        documents.verify_trust_root(documents.sign(pae.TRUST_ROOT, body, keys[:1]))
