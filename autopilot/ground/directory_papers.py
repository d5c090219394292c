"""What a Directory signs: tokens, the revocation list, epoch bundles, the root, the time, each with its own key.

Documents are made from the state and the keys; no file is written here, and nothing is decided about who gets what.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from autopilot.ground.directory_store import (
    DirectoryError,
    key_at,
    read_epoch_secret,
    read_key,
    read_state,
)
from autopilot.trust import documents, pae, roots
from autopilot.trust.documents import DocumentError, Revocations, Trust
from autopilot.trust.keys import SignKey, key_id, wrap
from autopilot.trust.limits import KEY_BYTES
from autopilot.wire.directory_pb2 import DirectoryState, EpochRecord
from events.schema.waypoint_pb2 import (
    EpochBundle,
    IdentityToken,
    PurposeKey,
    RevocationList,
    SignedDoc,
    TimeBeacon,
    TrustRoot,
)

HOUR_MS: Final = 3_600_000
DAY_MS: Final = 24 * HOUR_MS
ROOT_LIFE_MS: Final = 365 * DAY_MS  # rotating a purpose key signs it anew
REVOCATIONS_DUE_MS: Final = 3 * DAY_MS  # a camera may be ordered on a list up to this old
EPOCH_LIFE_MS: Final = 31 * DAY_MS  # a node whose Directory is never heard keeps working as long as its token
ROOT_KEY_FILE: Final = "root.key"


@dataclass(frozen=True, slots=True)
class Directory:
    """A Directory's folder, opened: its state, and the purpose keys that were asked for."""

    folder: Path
    state: DirectoryState
    trust: Trust
    purpose_keys: dict[str, SignKey]

    @property
    def root_key(self) -> SignKey:
        """The key of the root (1 of 1), where it lies in the folder. Raises DirectoryError."""
        return read_key(self.folder, ROOT_KEY_FILE)

    @property
    def revoked(self) -> Revocations:
        """The newest revocation list."""
        return documents.verify_revocations(self.state.revocations, self.trust)

    def epoch_at(self, now_ms: int) -> EpochRecord:
        """Return the newest epoch in use at `now_ms`. Raises DirectoryError where there is none."""
        usable = [epoch for epoch in self.state.epochs if epoch.not_before_ms <= now_ms < epoch.retire_at_ms]
        if not usable:
            raise DirectoryError(f"{self.folder}: no epoch is in use; run: autopilot directory rotate {self.folder}")
        return max(usable, key=lambda epoch: epoch.epoch_id)

    def live(self, now_ms: int) -> list[IdentityToken]:
        """Return the newest token of every device that may take part at `now_ms`."""
        revoked = self.revoked
        newest = {token.device_sign_pk: token for token in self.state.tokens if now_ms <= token.not_after_ms}
        return [token for token in newest.values() if not revoked.covers(token)]


def open_directory(folder: Path | str, needs: Sequence[str] = documents.PURPOSES) -> Directory:
    """Open a Directory's folder with the purpose keys that are needed. Raises DirectoryError."""
    folder = Path(folder)
    return opened(folder, read_state(folder), needs)


def opened(folder: Path, state: DirectoryState, needs: Sequence[str]) -> Directory:
    """Return the Directory of a state. Raises DirectoryError naming the file and the fix."""
    try:
        trust = documents.verify_trust_root(state.trust_root)
        documents.verify_revocations(state.revocations, trust)
    except DocumentError as error:
        raise DirectoryError(f"{folder}: is damaged ({error}); restore the folder from its copy") from error
    keys = {key.purpose: read_key(folder, key.name) for key in state.keys if key.purpose in needs}
    wrong = [purpose for purpose, key in keys.items() if key.public != trust.keys[purpose]]
    if wrong:
        raise DirectoryError(f"{folder}: the key for {wrong[0]} is not the root's; restore the folder from its copy")
    return Directory(folder, state, trust, keys)


def signed_token(directory: Directory, token: IdentityToken) -> bytes:
    """Sign a token, the same bytes every time. Raises DirectoryError when it is out of its bounds."""
    try:
        documents.check_token(token)
    except DocumentError as error:
        raise DirectoryError(f"{token.principal_id}: {error}") from error
    return documents.sign(pae.IDENTITY_TOKEN, token, [directory.purpose_keys["token"]])


def signed_bundle(directory: Directory, epoch: EpochRecord, token: IdentityToken) -> bytes:
    """Wrap an epoch's key for a device and sign it: the same bytes every time, so that nobody sees two versions.

    The wrapping's own key comes from the secret that it wraps, so whoever can work it out has no use for it.
    Raises DirectoryError.
    """
    secret = read_epoch_secret(directory.folder, epoch.epoch_id)
    ephemeral = hashlib.blake2b(token.device_box_pk, key=secret, digest_size=KEY_BYTES, person=b"wp.dir.wrap.v1")
    bundle = EpochBundle(
        v=1,
        deployment_id=directory.trust.deployment_id,
        epoch_id=epoch.epoch_id,
        key_commitment=documents.epoch_commitment(epoch.epoch_id, secret),
        not_before_ms=epoch.not_before_ms,
        retire_at_ms=epoch.retire_at_ms,
        min_revocation_version=epoch.min_revocation_version,
        recipient_device_key_id=key_id(token.device_sign_pk),
        wrapped_key=wrap(secret, token.device_box_pk, lambda _: ephemeral.digest()),
    )
    return documents.sign(pae.EPOCH_BUNDLE, bundle, [directory.purpose_keys["epoch"]])


def signed_beacon(directory: Directory, challenge: bytes, now_ms: int) -> bytes:
    """Sign the time for whoever gave `challenge` (16 bytes)."""
    beacon = TimeBeacon(v=1, deployment_id=directory.trust.deployment_id, challenge=challenge, time_ms=now_ms)
    return documents.sign(pae.TIME_BEACON, beacon, [directory.purpose_keys["time"]])


def list_body(state: DirectoryState) -> RevocationList:
    """Return the body of the newest revocation list."""
    return documents.parse(RevocationList, documents.parse(SignedDoc, state.revocations).body)


def first_list(deployment_id: str, key: SignKey, now_ms: int) -> bytes:
    """Sign the list of version 1, which revokes nobody."""
    body = RevocationList(v=1, deployment_id=deployment_id, version=1, prev_digest=bytes(KEY_BYTES))
    return _signed_list(body, key, now_ms)


def next_list(state: DirectoryState, body: RevocationList, key: SignKey, now_ms: int) -> bytes:
    """Sign `body` as the list after the newest one, in order and each entry once. Raises DirectoryError."""
    body.version = list_body(state).version + 1
    body.prev_digest = hashlib.blake2b(state.revocations, digest_size=KEY_BYTES).digest()
    body.principals[:] = sorted(set(body.principals))
    body.device_key_ids[:] = sorted(set(body.device_key_ids))
    body.token_ids[:] = sorted(set(body.token_ids))
    signed = _signed_list(body, key, now_ms)
    try:
        documents.verify_revocations(signed, roots_with(state, "revoke", key))
    except DocumentError as error:
        raise DirectoryError(f"the revocation list can't be made: {error}") from error
    return signed


def roots_with(state: DirectoryState, purpose: str, key: SignKey) -> Trust:
    """Return what the root says, with another key for one purpose: for what is signed beside a new root."""
    trust = documents.verify_trust_root(state.trust_root)
    return replace(trust, keys={**trust.keys, purpose: key.public})


def first_root(
    deployment_id: str, threshold: int, root_keys: Sequence[SignKey], keys: dict[str, SignKey], now_ms: int
) -> bytes:
    """Sign the TrustRoot of version 1 by all root keys."""
    root = TrustRoot(
        v=1,
        deployment_id=deployment_id,
        version=1,
        expires_ms=now_ms + ROOT_LIFE_MS,
        threshold=threshold,
        root_keys=[key.public for key in root_keys],
        keys=[PurposeKey(purpose=purpose, public_key=keys[purpose].public) for purpose in documents.PURPOSES],
    )
    return documents.sign(pae.TRUST_ROOT, root, root_keys)


def next_root(state: DirectoryState, changed: dict[str, SignKey], root_keys: Sequence[SignKey], now_ms: int) -> bytes:
    """Sign the TrustRoot after the one in force, with other keys for some purposes. Raises DirectoryError."""
    root = roots.root_of(state.trust_root)
    root.version += 1
    root.expires_ms = now_ms + ROOT_LIFE_MS
    for entry in root.keys:
        if entry.purpose in changed:
            entry.public_key = changed[entry.purpose].public
    signed = documents.sign(pae.TRUST_ROOT, root, root_keys)
    try:
        roots.verify_successor(signed, state.trust_root)
    except DocumentError as error:
        raise DirectoryError(
            f"the root's keys don't do ({error}); name {root.threshold} different ones with --root"
        ) from error
    return signed


def root_keys_at(folder: Path, paths: Sequence[Path | str]) -> list[SignKey]:
    """Read the root keys that are named, or the one in the folder. Raises DirectoryError."""
    return [key_at(Path(path)) for path in paths] or [read_key(folder, ROOT_KEY_FILE)]


def _signed_list(body: RevocationList, key: SignKey, now_ms: int) -> bytes:
    body.issued_at_ms, body.next_update_ms = now_ms, now_ms + REVOCATIONS_DUE_MS
    return documents.sign(pae.REVOCATION_LIST, body, [key])
