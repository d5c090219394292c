"""Identity folders as the Directory writes them: for a new device, and again when what they hold has become old.

All but the two keys is public, so an exported folder may travel on any stick. Loading one is `trust.identity`'s.
"""

from __future__ import annotations

import json
from pathlib import Path

from autopilot.ground.directory_papers import Directory, signed_bundle, signed_token
from autopilot.ground.directory_store import DirectoryError, durable
from autopilot.trust import documents, identity, roots
from autopilot.trust.documents import DocumentError
from autopilot.trust.keys import BoxKey, SignKey, key_id
from autopilot.trust.limits import DOCUMENT_BYTES_MAX
from events.schema.waypoint_pb2 import IdentityToken, PrincipalKind, SignedDoc


def write_keys(out: Path, sign_key: SignKey, box_key: BoxKey) -> None:
    """Write a device's secrets. Raises OSError."""
    durable(out / identity.SIGN_FILE, sign_key.seed, secret=True)
    durable(out / identity.BOX_FILE, box_key.secret, secret=True)


def write_papers(directory: Directory, out: Path, token: IdentityToken, now_ms: int) -> None:
    """Write everything of an identity folder but the keys. Raises DirectoryError, OSError."""
    epoch = signed_bundle(directory, directory.epoch_at(now_ms), token)
    nodes = node_tokens(directory, now_ms)
    write_identity(
        out, directory.state.trust_root, signed_token(directory, token), directory.state.revocations, epoch, nodes
    )
    durable(out / identity.SUMMARY_FILE, _json(summary(token)))


def write_identity(
    out: Path, trust_root: bytes, token: bytes, revocations: bytes, epoch: bytes, nodes: dict[str, bytes]
) -> None:
    """Write the signed documents of an identity folder, the token last. Raises OSError."""
    write_nodes(out / identity.NODES_FOLDER, nodes)
    durable(out / identity.ROOT_FILE, trust_root)
    durable(out / identity.REVOCATIONS_FILE, revocations)
    durable(out / identity.EPOCH_FILE, epoch)
    durable(out / identity.TOKEN_FILE, token)


def write_nodes(folder: Path, nodes: dict[str, bytes]) -> None:
    """Make `folder` hold the signed tokens of these nodes and no others. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    for principal_id, signed in nodes.items():
        durable(folder / f"{principal_id}{identity.TOKEN_SUFFIX}", signed)
    for path in folder.glob(f"*{identity.TOKEN_SUFFIX}"):
        if path.name.removesuffix(identity.TOKEN_SUFFIX) not in nodes:
            path.unlink()  # revoked or expired


def node_tokens(directory: Directory, now_ms: int) -> dict[str, bytes]:
    """Return the signed tokens of the nodes that there are at `now_ms`, by name."""
    live = directory.live(now_ms)
    return {token.principal_id: signed_token(directory, token) for token in live if token.kind == PrincipalKind.NODE}


def export(directory: Directory, device: str, out: Path, now_ms: int) -> IdentityToken:
    """Write what a device needs to know, without keys; `device` is a principal or a key id. Raises DirectoryError."""
    live = directory.live(now_ms)
    found = [token for token in live if device in (token.principal_id, key_id(token.device_sign_pk).hex())]
    if len(found) != 1:
        ids = ", ".join(key_id(token.device_sign_pk).hex() for token in found)
        fix = f"it has several devices: name one of {ids}" if found else "see `autopilot directory list`"
        raise DirectoryError(f"{device}: is not the name or key id of one live device; {fix}")
    write_papers(directory, out, found[0], now_ms)
    return found[0]


def token_in(directory: Directory, folder: Path, now_ms: int) -> IdentityToken:
    """Return the newest token of the device whose identity folder this is. Raises DirectoryError."""
    trust_root, token_bytes = _read(folder / identity.ROOT_FILE), _read(folder / identity.TOKEN_FILE)
    try:
        if trust_root != directory.state.trust_root:
            roots.verify_successor(directory.state.trust_root, trust_root)
        token = documents.parse(IdentityToken, documents.parse(SignedDoc, token_bytes).body)
    except DocumentError as error:
        raise DirectoryError(f"{folder}: is no identity of this Directory: {error}") from error
    for live in directory.live(now_ms):
        if live.device_sign_pk == token.device_sign_pk:
            return live
    raise DirectoryError(f"{folder}: {token.principal_id} is revoked or has expired here; issue or enrol it again")


def summary(token: IdentityToken) -> dict[str, object]:
    """What may be told of an identity to anybody."""
    return {
        "principal_id": token.principal_id,
        "callsign": token.callsign,
        "kind": PrincipalKind.Name(token.kind).lower(),
        "roles": list(token.roles),
        "device_public_key": token.device_sign_pk.hex(),
        "device_key_id": key_id(token.device_sign_pk).hex(),
        "not_after_ms": token.not_after_ms,
        "token_id": token.token_id.hex(),
        "deployment_id": token.deployment_id,
    }


def _read(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(DOCUMENT_BYTES_MAX)
    except OSError as error:
        raise DirectoryError(f"{path}: {error.strerror}; name a folder that was issued or enrolled") from error


def _json(value: object) -> bytes:
    return (json.dumps(value, indent=2, ensure_ascii=False) + "\n").encode()
