"""Renewal: a device asks for a fresh token, and brings its identity folder up to date with what the Directory serves.

The request is signed by the device and names the token it holds, so that replaying one gives nothing: once it was
followed, it is answered with the token that followed.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from autopilot.ground.directory_folders import write_nodes
from autopilot.ground.directory_store import durable
from autopilot.trust import documents, identity, roots
from autopilot.trust.documents import DocumentError, Revocations, Trust
from autopilot.trust.identity import Identity, IdentityError, open_epoch
from autopilot.trust.keys import SealBroken
from autopilot.wire.directory_pb2 import Documents, RenewalRequest
from events.schema.waypoint_pb2 import IdentityToken, PrincipalKind, SignedDoc

RENEWAL: Final = b"autopilot/v1/RenewalRequest"
PENDING_FILE: Final = "renewal.pending"  # what was believed, until it lies in its files
FILES: Final = (identity.ROOT_FILE, identity.REVOCATIONS_FILE, identity.EPOCH_FILE, identity.TOKEN_FILE)


class Fresh(NamedTuple):
    """Encoded SignedDocs as somebody offered them; nothing of it is believed yet."""

    trust_root: bytes
    token: bytes
    revocations: bytes
    epoch: bytes
    nodes: Sequence[bytes] = ()


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
    5. Of the nodes' tokens, held and served, the newest of each that is signed and not revoked is kept.

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
    revocations = documents.verify_revocations(fresh.revocations, trust)
    nodes = _nodes(held, fresh.nodes, trust, revocations)  # 5
    everything = Documents(documents=[fresh.trust_root, fresh.revocations, fresh.epoch, fresh.token, *nodes.values()])
    durable(folder / PENDING_FILE, everything.SerializeToString(deterministic=True))
    return finish(folder)


def finish(folder: Path) -> list[str]:
    """Write what was believed, also when that was begun and cut short; return the names of the files that changed.

    Raises OSError.
    """
    try:
        pending = Documents.FromString((folder / PENDING_FILE).read_bytes()).documents
    except FileNotFoundError:
        return []
    changed = [name for name, data in zip(FILES, pending, strict=False) if _written(folder / name, data)]
    changed += _write_nodes(folder / identity.NODES_FOLDER, _by_name(pending[len(FILES) :]))
    (folder / PENDING_FILE).unlink()
    return changed


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


def _nodes(held: Identity, served: Sequence[bytes], trust: Trust, revocations: Revocations) -> dict[str, bytes]:
    kept = [path.read_bytes() for path in (held.folder / identity.NODES_FOLDER).glob(f"*{identity.TOKEN_SUFFIX}")]
    newest: dict[str, tuple[int, bytes]] = {}
    for data in (*kept, *served):
        try:
            token = documents.verify_token(data, trust)
        except DocumentError:
            continue  # signed by a key that was replaced, or anybody's
        if token.kind == PrincipalKind.NODE and not revocations.covers(token):
            found = (token.not_before_ms, data)
            newest[token.principal_id] = max(newest.get(token.principal_id, found), found)
    return {principal_id: data for principal_id, (_, data) in newest.items()}


def _write_nodes(folder: Path, nodes: dict[str, bytes]) -> list[str]:
    before = {
        path.name.removesuffix(identity.TOKEN_SUFFIX): path.read_bytes()
        for path in folder.glob(f"*{identity.TOKEN_SUFFIX}")
    }
    if before == nodes:
        return []
    write_nodes(folder, nodes)
    return [identity.NODES_FOLDER]


def _held_list(held: Identity) -> bytes:
    return (held.folder / identity.REVOCATIONS_FILE).read_bytes()


def _by_name(tokens: Sequence[bytes]) -> dict[str, bytes]:
    parsed = [documents.parse(IdentityToken, documents.parse(SignedDoc, data).body) for data in tokens]
    return {token.principal_id: data for token, data in zip(parsed, tokens, strict=True)}


def _written(path: Path, data: bytes) -> bool:
    if path.exists() and path.read_bytes() == data:
        return False
    durable(path, data)
    return True
