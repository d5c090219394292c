"""The Directory as a folder: root and purpose keys, the group key, and the identities it issues.

It is used offline, by whoever may read the folder; nothing listens. Revoking and rotating are not
done here. Secrets are 0600, everything else is public.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from autopilot.trust import documents, identity, pae
from autopilot.trust.documents import DocumentError, Trust, is_name
from autopilot.trust.keys import BoxKey, Random, SecretFileError, SignKey, key_id, read_secret, wrap, write_file
from autopilot.trust.limits import KEY_BYTES, TOKEN_ID_BYTES
from events.schema.waypoint_pb2 import (
    EpochBundle,
    IdentityToken,
    PrincipalKind,
    PurposeKey,
    RevocationList,
    TrustRoot,
)

HOUR_MS = 3_600_000
DAY_MS = 24 * HOUR_MS
ROOT_LIFE_MS = 365 * DAY_MS  # the folder is made anew before that, or the root signs again
REVOCATIONS_DUE_MS = 3 * DAY_MS  # a camera may be ordered on a list up to this old
EPOCH_LIFE_MS = 31 * DAY_MS  # outlives a node's token: there is one epoch, and nothing rotates it
LIFE_HOURS = {"operator": 12, "node": 720, "service": 24}
KINDS = {"operator": PrincipalKind.OPERATOR, "node": PrincipalKind.NODE, "service": PrincipalKind.SERVICE}
PRINCIPALS_FILE, FACTS_FILE = "principals.json", "directory.json"


class DirectoryError(Exception):
    """The Directory can't do what it was asked; the text names the file or argument and the fix."""


@dataclass(frozen=True, slots=True)
class Directory:
    """A Directory's folder, opened: its keys and what it has fixed."""

    folder: Path
    trust: Trust
    root_key: SignKey
    purpose_keys: dict[str, SignKey]
    epoch_secret: bytes
    epoch: EpochBundle


def init(folder: Path | str, *, deployment_id: str, now_ms: int, random: Random) -> Directory:
    """Make a Directory: a root (1 of 1), four purpose keys, an empty revocation list, epoch 1.

    `random` gives all chance; `now_ms` is wall milliseconds since 1970. Raises DirectoryError.
    """
    folder = Path(folder)
    if not is_name(deployment_id):
        raise DirectoryError(f"deployment id {deployment_id!r}: use a-z, 0-9 and -, at most 64 characters")
    if (folder / _secret_name("root")).exists():
        raise DirectoryError(f"{folder}: holds a Directory already; choose another folder")
    folder.mkdir(parents=True, exist_ok=True)
    keys = {name: SignKey.from_seed(random(KEY_BYTES)) for name in ("root", *documents.PURPOSES)}
    for name, key in keys.items():
        write_file(folder / _secret_name(name), key.seed, secret=True)
    write_file(folder / _secret_name("epoch-1"), random(KEY_BYTES), secret=True)
    facts = {"epoch_not_before_ms": now_ms, "epoch_retire_at_ms": now_ms + EPOCH_LIFE_MS}
    _write_json(folder / FACTS_FILE, {"deployment_id": deployment_id, **facts})
    root = documents.sign(pae.TRUST_ROOT, _trust_root(deployment_id, keys, now_ms), [keys["root"]])
    write_file(folder / identity.ROOT_FILE, root)
    empty = documents.sign(pae.REVOCATION_LIST, _empty_list(deployment_id, now_ms), [keys["revoke"]])
    write_file(folder / identity.REVOCATIONS_FILE, empty)
    _write_json(folder / PRINCIPALS_FILE, [])
    return open_directory(folder)


def open_directory(folder: Path | str) -> Directory:
    """Open a Directory's folder. Raises DirectoryError naming the file and the fix."""
    folder = Path(folder)
    try:
        keys = {name: SignKey.from_seed(read_secret(folder / _secret_name(name))) for name in documents.PURPOSES}
        root_key = SignKey.from_seed(read_secret(folder / _secret_name("root")))
        secret = read_secret(folder / _secret_name("epoch-1"))
        trust = documents.verify_trust_root((folder / identity.ROOT_FILE).read_bytes())
        facts = json.loads((folder / FACTS_FILE).read_text("utf-8"))
    except (SecretFileError, DocumentError, OSError, ValueError) as error:
        raise DirectoryError(
            f"{folder}: is no whole Directory ({error}); make one with `autopilot directory init`"
        ) from error
    epoch = EpochBundle(
        v=1,
        deployment_id=trust.deployment_id,
        epoch_id=1,
        key_commitment=documents.epoch_commitment(1, secret),
        not_before_ms=facts["epoch_not_before_ms"],
        retire_at_ms=facts["epoch_retire_at_ms"],
        min_revocation_version=1,
    )
    return Directory(folder, trust, root_key, keys, secret, epoch)


def issue(
    directory: Directory,
    principal_id: str,
    out: Path | str,
    *,
    kind: str,
    roles: Sequence[str],
    callsign: str,
    now_ms: int,
    random: Random,
    hours: float | None = None,
) -> IdentityToken:
    """Make a device's keys and write its identity folder; return its token.

    `kind` is operator, node or service. The folder also gets the tokens of the nodes issued so
    far, so that an operator knows whom orders are bound to. Raises DirectoryError.
    """
    out = Path(out)
    if (out / identity.SIGN_FILE).exists():
        raise DirectoryError(f"{out}: holds an identity already; choose another folder or remove it")
    sign_key, box_key = SignKey.from_seed(random(KEY_BYTES)), BoxKey.from_secret(random(KEY_BYTES))
    life_ms = int((LIFE_HOURS[kind] if hours is None else hours) * HOUR_MS)
    token = IdentityToken(
        v=1,
        deployment_id=directory.trust.deployment_id,
        principal_id=principal_id,
        kind=KINDS[kind],
        device_sign_pk=sign_key.public,
        device_box_pk=box_key.public,
        roles=sorted(set(roles)),
        not_before_ms=now_ms,
        not_after_ms=now_ms + life_ms,
        policy_version=1,
        token_id=random(TOKEN_ID_BYTES),
        callsign=callsign or principal_id,
    )
    try:
        documents.check_token(token)
    except DocumentError as error:
        raise DirectoryError(f"{principal_id}: {error}") from error
    out.mkdir(parents=True, exist_ok=True)
    _write_identity(directory, out, token, sign_key, box_key, random)
    _remember(directory, token)
    return token


def _write_identity(
    directory: Directory, out: Path, token: IdentityToken, sign_key: SignKey, box_key: BoxKey, random: Random
) -> None:
    signed_token = documents.sign(pae.IDENTITY_TOKEN, token, [directory.purpose_keys["token"]])
    bundle = EpochBundle()
    bundle.CopyFrom(directory.epoch)
    bundle.recipient_device_key_id = key_id(sign_key.public)
    bundle.wrapped_key = wrap(directory.epoch_secret, box_key.public, random)
    write_file(out / identity.SIGN_FILE, sign_key.seed, secret=True)
    write_file(out / identity.BOX_FILE, box_key.secret, secret=True)
    write_file(out / identity.TOKEN_FILE, signed_token)
    write_file(out / identity.EPOCH_FILE, documents.sign(pae.EPOCH_BUNDLE, bundle, [directory.purpose_keys["epoch"]]))
    for name in (identity.ROOT_FILE, identity.REVOCATIONS_FILE):
        write_file(out / name, (directory.folder / name).read_bytes())
    _write_json(out / identity.SUMMARY_FILE, summary(token))
    nodes = directory.folder / identity.NODES_FOLDER
    nodes.mkdir(exist_ok=True)
    if token.kind == PrincipalKind.NODE:
        write_file(nodes / f"{token.principal_id}{identity.TOKEN_SUFFIX}", signed_token)
    shutil.copytree(nodes, out / identity.NODES_FOLDER, dirs_exist_ok=True)


def _remember(directory: Directory, token: IdentityToken) -> None:
    path = directory.folder / PRINCIPALS_FILE
    _write_json(path, [*json.loads(path.read_text("utf-8")), summary(token)])


def summary(token: IdentityToken) -> dict[str, object]:
    """What may be told of an identity to anybody."""
    return {
        "principal_id": token.principal_id,
        "callsign": token.callsign,
        "kind": PrincipalKind.Name(token.kind).lower(),
        "roles": list(token.roles),
        "device_public_key": token.device_sign_pk.hex(),
        "not_after_ms": token.not_after_ms,
        "token_id": token.token_id.hex(),
        "deployment_id": token.deployment_id,
    }


def _trust_root(deployment_id: str, keys: dict[str, SignKey], now_ms: int) -> TrustRoot:
    return TrustRoot(
        v=1,
        deployment_id=deployment_id,
        version=1,
        expires_ms=now_ms + ROOT_LIFE_MS,
        threshold=1,
        root_keys=[keys["root"].public],
        keys=[PurposeKey(purpose=purpose, public_key=keys[purpose].public) for purpose in documents.PURPOSES],
    )


def _empty_list(deployment_id: str, now_ms: int) -> RevocationList:
    return RevocationList(
        v=1,
        deployment_id=deployment_id,
        version=1,
        issued_at_ms=now_ms,
        next_update_ms=now_ms + REVOCATIONS_DUE_MS,
        prev_digest=bytes(KEY_BYTES),
    )


def _secret_name(name: str) -> str:
    return f"{name}.secret" if name.startswith("epoch-") else f"{name}.key"


def _write_json(path: Path, value: object) -> None:
    write_file(path, (json.dumps(value, indent=2, ensure_ascii=False) + "\n").encode())
