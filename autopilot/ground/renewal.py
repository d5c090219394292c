"""Renewal: a device asks for a fresh token, and brings its identity folder up to date with what the Directory serves.

The request is signed by the device and names the token it holds, so that replaying one gives nothing: once it was
followed, it is answered with the token that followed.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from autopilot.ground.directory_store import durable
from autopilot.trust import documents, identity, roots
from autopilot.trust.documents import DocumentError, Trust
from autopilot.trust.identity import Identity, IdentityError, open_epoch
from autopilot.trust.keys import SealBroken
from autopilot.wire.directory_pb2 import RenewalRequest
from events.schema.waypoint_pb2 import IdentityToken, SignedDoc

RENEWAL: Final = b"autopilot/v1/RenewalRequest"


@dataclass(frozen=True, slots=True, kw_only=True)
class Fresh:
    """Encoded SignedDocs as somebody offered them; nothing of it is believed yet."""

    trust_root: bytes
    token: bytes
    revocations: bytes
    epoch: bytes


def renewal_request(held: Identity) -> bytes:
    """Return a device's request for a fresh token."""
    body = RenewalRequest(
        v=1, deployment_id=held.deployment_id, device_key_id=held.sign_key.key_id, token_id=held.token.token_id
    )
    return documents.sign(RENEWAL, body, [held.sign_key])


def read_renewal(data: bytes) -> RenewalRequest:
    """Parse a request; `check_renewal` verifies it. Raises DocumentError."""
    return documents.parse(RenewalRequest, documents.parse(SignedDoc, data).body)


def check_renewal(data: bytes, token: IdentityToken) -> None:
    """Verify a request by the key of the device that `token` names. Raises DocumentError."""
    body = documents.parse(RenewalRequest, documents.verified_body(RENEWAL, data, [token.device_sign_pk]))
    if body.v != 1 or body.deployment_id != token.deployment_id:
        raise documents.DocumentMalformed("RenewalRequest: is of another version or deployment")


def refresh(held: Identity, fresh: Fresh) -> list[str]:
    """Bring an identity folder up to date; return the names of the files that changed.

    1. The root is the one that is pinned, or follows it by its own signatures.
    2. The token is for the device's keys.
    3. The list is signed; under the same key it is not older than the one held.
    4. The group key opens, is not older than the one held, and is what the Directory committed to.

    Raises IdentityError naming the file; then nothing is changed. Raises OSError.
    """
    folder = held.folder
    pinned = (folder / identity.ROOT_FILE).read_bytes()
    trust = held.trust
    try:
        if fresh.trust_root != pinned:
            trust = roots.verify_successor(fresh.trust_root, pinned)  # 1
        _check_token(held, fresh.token, trust)  # 2
        _check_list(held, fresh.revocations, trust)  # 3
        epoch = open_epoch(documents.verify_epoch_bundle(fresh.epoch, trust), held.sign_key, held.box_key)  # 4
        if epoch.epoch_id < max(held.epochs):
            raise documents.DocumentMalformed("EpochBundle: is older than the one held")
    except (DocumentError, SealBroken) as error:
        raise IdentityError(f"{folder}: what was served is not believed ({error}); nothing was changed") from error
    return [name for name, data in _files(fresh) if _written(folder / name, data)]


def _check_token(held: Identity, data: bytes, trust: Trust) -> None:
    token = documents.verify_token(data, trust)
    if (token.device_sign_pk, token.device_box_pk) != (held.sign_key.public, held.box_key.public):
        raise documents.DocumentMalformed("IdentityToken: is for other keys")


def _check_list(held: Identity, data: bytes, trust: Trust) -> None:
    found = documents.verify_revocations(data, trust)
    rotated = trust.keys["revoke"] != held.trust.keys["revoke"]
    if not rotated and found.version < held.revocations.version:
        raise documents.DocumentMalformed("RevocationList: is older than the one held")
    if not rotated and found.version == held.revocations.version and data != _held_list(held):
        raise documents.DocumentMalformed("RevocationList: is another one of the version held")


def _held_list(held: Identity) -> bytes:
    return (held.folder / identity.REVOCATIONS_FILE).read_bytes()


def _files(fresh: Fresh) -> list[tuple[str, bytes]]:
    return [
        (identity.ROOT_FILE, fresh.trust_root),
        (identity.REVOCATIONS_FILE, fresh.revocations),
        (identity.EPOCH_FILE, fresh.epoch),
        (identity.TOKEN_FILE, fresh.token),
    ]


def _written(path: Path, data: bytes) -> bool:
    if path.read_bytes() == data:
        return False
    durable(path, data)
    return True
