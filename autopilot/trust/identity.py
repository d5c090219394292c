"""A device's identity as a folder holds it: its keys, its token, and whom it trusts.

The folder is written by `autopilot directory issue`, and newer documents are added to it in flight (`book`). Loading
verifies everything once; after that the identity is a value.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from autopilot.trust import documents
from autopilot.trust.documents import DocumentError, DocumentUnsigned, Revocations, Trust
from autopilot.trust.keys import BoxKey, SealBroken, SecretFileError, SignKey, digest, key_id, read_secret
from autopilot.trust.limits import DOCUMENT_BYTES_MAX, KEY_BYTES, OVERLAP_MS
from events.schema.waypoint_pb2 import EpochBundle, IdentityToken, PrincipalKind

SIGN_FILE, BOX_FILE = "device.sign", "device.box"
TOKEN_FILE, ROOT_FILE, REVOCATIONS_FILE, EPOCH_FILE = "token", "trust_root", "revocations", "epoch"
SUMMARY_FILE, NODES_FOLDER, TOKEN_SUFFIX = "identity.json", "nodes", ".token"
# Taken in flight: the root before the present one, which may still be needed for a list, and group keys by their epoch.
ROOT_BEFORE_FILE, EPOCHS_FOLDER = "trust_root.before", "epochs"
D = TypeVar("D")
_AGAIN = "issue the identity again with `autopilot directory issue`"


class IdentityError(Exception):
    """An identity folder can't be used; the text names the file and the fix."""


@dataclass(frozen=True, slots=True)
class Epoch:
    """A group key and when it is in use (wall milliseconds since 1970)."""

    epoch_id: int
    secret: bytes = field(repr=False)
    not_before_ms: int
    retire_at_ms: int
    min_revocation_version: int = 0  # whoever uses it must know at least this list


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """Who this device is, and whom it believes."""

    folder: Path
    sign_key: SignKey
    box_key: BoxKey
    token: IdentityToken
    token_bytes: bytes
    token_digest: bytes
    trust: Trust
    revocations: Revocations
    epochs: Mapping[int, Epoch]
    known_nodes: Mapping[str, bytes]

    @property
    def principal_id(self) -> str:
        """The Directory's name for this principal."""
        return self.token.principal_id

    @property
    def callsign(self) -> str:
        """The name that people use."""
        return self.token.callsign

    @property
    def deployment_id(self) -> str:
        """The deployment that it belongs to."""
        return self.trust.deployment_id

    @property
    def public_key(self) -> bytes:
        """Ed25519 public key of the device, 32 bytes; orders for a node are bound to it."""
        return self.sign_key.public

    def current_epoch(self, now_ms: int, *, certain: bool = True) -> Epoch | None:
        """Return the newest epoch in use at `now_ms`, or None: then nothing may be sent.

        Where the time is not certain there is always one: the oldest, if none is in use by the best guess.
        """
        alive = [epoch for epoch in self.epochs.values() if epoch.epoch_id >= self.revocations.min_epoch_id]
        usable = [epoch for epoch in alive if epoch.not_before_ms <= now_ms < epoch.retire_at_ms]
        if alive and not usable and not certain:
            usable = [min(alive, key=lambda epoch: epoch.epoch_id)]
        return max(usable, key=lambda epoch: epoch.epoch_id, default=None)

    def is_over(self, epoch: Epoch, now_ms: int) -> bool:
        """Say whether an epoch's key opens nothing any more.

        It opens until two minutes after it is retired, or after a newer one came into use, and never below the
        list's least epoch.
        """
        newer = [other.not_before_ms for other in self.epochs.values() if other.epoch_id > epoch.epoch_id]
        ends_ms = min(epoch.retire_at_ms, *newer) if newer else epoch.retire_at_ms
        return now_ms > ends_ms + OVERLAP_MS or epoch.epoch_id < self.revocations.min_epoch_id


def load_identity(folder: Path | str, now_ms: int | None = None) -> Identity:
    """Read and verify an identity folder.

    With `now_ms` (wall milliseconds since 1970) documents that have run out are refused too.
    Raises IdentityError naming the file and the fix.
    """
    folder = Path(folder)
    sign_key = SignKey.from_seed(_secret(folder / SIGN_FILE))
    box_key = BoxKey.from_secret(_secret(folder / BOX_FILE))
    trust = _root(folder / ROOT_FILE)
    before = folder / ROOT_BEFORE_FILE
    trusts = (trust, _root(before)) if before.exists() else (trust,)
    token_bytes = _document(folder / TOKEN_FILE)
    token = _own_token(folder / TOKEN_FILE, token_bytes, trusts, sign_key, box_key)
    revocations = _revocations(folder / REVOCATIONS_FILE, trusts)
    bundles = [folder / EPOCH_FILE, *sorted((folder / EPOCHS_FOLDER).glob("*[0-9]"))]
    epochs = [_epoch(path, trusts, sign_key, box_key) for path in bundles]
    if now_ms is not None:
        _check_times(folder, trust, token, now_ms)
    return Identity(
        folder=folder,
        sign_key=sign_key,
        box_key=box_key,
        token=token,
        token_bytes=token_bytes,
        token_digest=digest(token_bytes),
        trust=trust,
        revocations=revocations,
        epochs={epoch.epoch_id: epoch for epoch in epochs},
        known_nodes=_known_nodes(folder / NODES_FOLDER, trust, revocations),
    )


def _secret(path: Path) -> bytes:
    try:
        return read_secret(path, KEY_BYTES)
    except SecretFileError as error:
        raise IdentityError(str(error)) from error


def _document(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(DOCUMENT_BYTES_MAX + 1)
    except OSError as error:
        raise IdentityError(f"{path}: {error.strerror}; {_AGAIN}") from error


def _root(path: Path) -> Trust:
    try:
        return documents.verify_trust_root(_document(path))
    except DocumentError as error:
        raise IdentityError(f"{path}: {error}; {_AGAIN}") from error


def _by_either(verify: Callable[[bytes, Trust], D], data: bytes, trusts: tuple[Trust, ...]) -> D:
    """Verify a document by the present root, or by the one before it: not everything is signed anew in one moment."""
    for older in trusts[1:]:
        try:
            return verify(data, trusts[0])
        except DocumentUnsigned:
            return verify(data, older)
    return verify(data, trusts[0])


def _own_token(path: Path, data: bytes, trusts: tuple[Trust, ...], sign_key: SignKey, box_key: BoxKey) -> IdentityToken:
    try:
        token = _by_either(documents.verify_token, data, trusts)
    except DocumentError as error:
        raise IdentityError(f"{path}: {error}; {_AGAIN}") from error
    if token.device_sign_pk != sign_key.public or token.device_box_pk != box_key.public:
        raise IdentityError(f"{path}: was issued for other keys than those beside it; {_AGAIN}")
    return token


def _revocations(path: Path, trusts: tuple[Trust, ...]) -> Revocations:
    try:
        return _by_either(documents.verify_revocations, _document(path), trusts)
    except DocumentError as error:
        raise IdentityError(f"{path}: {error}; copy the Directory's newest list there") from error


def _epoch(path: Path, trusts: tuple[Trust, ...], sign_key: SignKey, box_key: BoxKey) -> Epoch:
    try:
        bundle = _by_either(documents.verify_epoch_bundle, _document(path), trusts)
        return open_epoch(bundle, sign_key, box_key)
    except (DocumentError, SealBroken) as error:
        raise IdentityError(f"{path}: {error}; {_AGAIN}") from error


def open_epoch(bundle: EpochBundle, sign_key: SignKey, box_key: BoxKey) -> Epoch:
    """Open a verified bundle's group key and check its commitment. Raises SealBroken."""
    if bundle.recipient_device_key_id != key_id(sign_key.public):
        raise SealBroken("the group key was wrapped for another device")
    secret = box_key.open(bundle.wrapped_key)
    if documents.epoch_commitment(bundle.epoch_id, secret) != bundle.key_commitment:
        raise SealBroken("the group key is not the one that the Directory committed to")
    return Epoch(bundle.epoch_id, secret, bundle.not_before_ms, bundle.retire_at_ms, bundle.min_revocation_version)


def _known_nodes(folder: Path, trust: Trust, revocations: Revocations) -> dict[str, bytes]:
    """Read the tokens of nodes that were issued before this identity: principal to public key."""
    nodes: dict[str, bytes] = {}
    for path in sorted(folder.glob(f"*{TOKEN_SUFFIX}")):
        try:
            token = documents.verify_token(_document(path), trust)
        except DocumentError as error:
            raise IdentityError(f"{path}: {error}; remove the file, or copy the node's token there again") from error
        if token.kind == PrincipalKind.NODE and not revocations.covers(token):
            nodes[token.principal_id] = token.device_sign_pk
    return nodes


def _check_times(folder: Path, trust: Trust, token: IdentityToken, now_ms: int) -> None:
    if now_ms > token.not_after_ms:
        raise IdentityError(f"{folder / TOKEN_FILE}: has expired; {_AGAIN}")
    if trust.expires_ms <= now_ms:
        raise IdentityError(f"{folder / ROOT_FILE}: has expired; make a new Directory with `autopilot directory init`")
