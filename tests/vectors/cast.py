"""Who speaks in the published vectors: a Directory, two operators, two nodes, and the papers they hold.

Every secret is BLAKE2b-256 of its name, so that anybody can make them again. Nothing is asserted here.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import cache

from autopilot.trust import documents, pae
from autopilot.trust.documents import PURPOSES
from autopilot.trust.identity import Epoch, Identity
from autopilot.trust.keys import BoxKey, SignKey, digest, key_id, wrap
from events.schema.waypoint_pb2 import (
    EpochBundle,
    IdentityToken,
    PrincipalKind,
    PurposeKey,
    RevocationList,
    TimeBeacon,
    TrustRoot,
)
from tests.autopilot.trust.world import people

SEED = 1
NOW_MS = 1_790_000_000_000
DEPLOYMENT = "coast-watch"
COMMAND_ID = "0b7c5e2a-6f0e-4d3a-9a51-3f1f5a0c9d11"
HOUR_MS = 3_600_000
PEOPLE = {
    "alice": (PrincipalKind.OPERATOR, ["operator"]),
    "bob": (PrincipalKind.OPERATOR, ["operator"]),
    "wasp-01": (PrincipalKind.NODE, []),
    "hornet-02": (PrincipalKind.NODE, []),
}


def secret(name: str, size: int = 32) -> bytes:
    """Return the secret of this name."""
    return hashlib.blake2b(f"autopilot vectors {SEED}: {name}".encode(), digest_size=size).digest()


def sign_key(name: str) -> SignKey:
    """Return the signing key of a device, or `root`, `dir.token`, `dir.revoke`, `dir.epoch`, `dir.time`."""
    return SignKey.from_seed(secret(f"{name}.sign"))


def box_key(name: str) -> BoxKey:
    """Return the key that a device receives with."""
    return BoxKey.from_secret(secret(f"{name}.box"))


def root() -> TrustRoot:
    """Return what the root says."""
    keys = [PurposeKey(purpose=purpose, public_key=sign_key(f"dir.{purpose}").public) for purpose in PURPOSES]
    return TrustRoot(
        v=1,
        deployment_id=DEPLOYMENT,
        version=1,
        expires_ms=NOW_MS + 8760 * HOUR_MS,
        threshold=1,
        root_keys=[sign_key("root").public],
        keys=keys,
    )


def token(name: str) -> IdentityToken:
    """Return what the Directory says of a principal."""
    kind, roles = PEOPLE[name]
    return IdentityToken(
        v=1,
        deployment_id=DEPLOYMENT,
        principal_id=name,
        kind=kind,
        device_sign_pk=sign_key(name).public,
        device_box_pk=box_key(name).public,
        roles=roles,
        not_before_ms=NOW_MS - HOUR_MS,
        not_after_ms=NOW_MS + 11 * HOUR_MS,
        policy_version=1,
        token_id=secret(f"{name}.token", 16),
        callsign=name.upper(),
        max_classification=1,
    )


def revocations(version: int, before: bytes = bytes(32), **changes: object) -> RevocationList:
    """Return a list of this version, which follows the document `before`."""
    body = RevocationList(
        v=1,
        deployment_id=DEPLOYMENT,
        version=version,
        issued_at_ms=NOW_MS - HOUR_MS + version,
        next_update_ms=NOW_MS + 71 * HOUR_MS,
        prev_digest=before,
    )
    body.MergeFrom(RevocationList(**changes))  # type: ignore[arg-type]
    return body


@cache
def lists() -> dict[str, bytes]:
    """Return the signed lists: v12, v13 after it, and those of the negatives."""
    before = digest(b"the list before")
    v12 = signed("RevocationList", revocations(12, before, principals=["mallory"]))
    after = digest(v12)
    bodies = {
        "v13": revocations(13, after, principals=["bob", "mallory"]),
        "v13_other": revocations(13, after, principals=["carol", "mallory"]),
        "v13_alice": revocations(13, after, principals=["alice"]),
        "v13_device": revocations(13, after, device_key_ids=[sign_key("alice").key_id]),
        "v13_token": revocations(13, after, token_ids=[token("alice").token_id]),
        "v13_policy": revocations(13, after, min_policy_version=2),
        "v13_epoch": revocations(13, after, min_epoch_id=2),
    }
    return {"v12": v12} | {name: signed("RevocationList", body) for name, body in bodies.items()}


def bundle(name: str) -> EpochBundle:
    """Return the group key of epoch 1, wrapped for a device."""
    ephemeral = secret(f"{name}.ephemeral")
    return EpochBundle(
        v=1,
        deployment_id=DEPLOYMENT,
        epoch_id=1,
        key_commitment=documents.epoch_commitment(1, secret("epoch.1")),
        not_before_ms=NOW_MS - HOUR_MS,
        retire_at_ms=NOW_MS + 23 * HOUR_MS,
        min_revocation_version=12,
        recipient_device_key_id=key_id(sign_key(name).public),
        wrapped_key=wrap(secret("epoch.1"), box_key(name).public, lambda _: ephemeral),
    )


def beacon() -> TimeBeacon:
    """Return the time, for the node that asked."""
    return TimeBeacon(v=1, deployment_id=DEPLOYMENT, challenge=secret("wasp-01.challenge", 16), time_ms=NOW_MS)


SIGNERS = {
    "TrustRoot": (pae.TRUST_ROOT, "root"),
    "IdentityToken": (pae.IDENTITY_TOKEN, "dir.token"),
    "RevocationList": (pae.REVOCATION_LIST, "dir.revoke"),
    "EpochBundle": (pae.EPOCH_BUNDLE, "dir.epoch"),
    "TimeBeacon": (pae.TIME_BEACON, "dir.time"),
}


def signed(kind: str, body: TrustRoot | IdentityToken | RevocationList | EpochBundle | TimeBeacon) -> bytes:
    """Return a document signed by the key of its purpose."""
    context, signer = SIGNERS[kind]
    return documents.sign(context, body, [sign_key(signer)])


@cache
def identity(name: str) -> Identity:
    """Return a device's identity, as its papers make it."""
    trust = documents.verify_trust_root(signed("TrustRoot", root()))
    paper = signed("IdentityToken", token(name))
    return replace(
        people().alice,
        sign_key=sign_key(name),
        box_key=box_key(name),
        token=token(name),
        token_bytes=paper,
        token_digest=digest(paper),
        trust=trust,
        revocations=documents.verify_revocations(lists()["v12"], trust),
        epochs={1: Epoch(1, secret("epoch.1"), NOW_MS - HOUR_MS, NOW_MS + 23 * HOUR_MS)},
        known_nodes={node: sign_key(node).public for node in ("wasp-01", "hornet-02")},
    )
