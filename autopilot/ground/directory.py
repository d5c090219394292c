"""The Directory: who is who in a deployment. It is made here, and issues identities as folders of files.

Changes to what was issued are `directory_changes`', onboarding by a code is `enrolment`'s, and answering over the mesh
is `directory_service`'s. The secrets never leave the folder, except that a device's keys may be made here (`issue`).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from autopilot.ground import directory_papers as papers
from autopilot.ground.directory_folders import summary as summary
from autopilot.ground.directory_folders import write_keys, write_papers
from autopilot.ground.directory_papers import DAY_MS as DAY_MS
from autopilot.ground.directory_papers import EPOCH_LIFE_MS, ROOT_KEY_FILE
from autopilot.ground.directory_papers import HOUR_MS as HOUR_MS
from autopilot.ground.directory_papers import Directory as Directory
from autopilot.ground.directory_papers import open_directory as open_directory
from autopilot.ground.directory_store import STATE_FILE, changing, create, durable, epoch_file
from autopilot.ground.directory_store import DirectoryError as DirectoryError
from autopilot.trust import documents, identity
from autopilot.trust.documents import is_name
from autopilot.trust.keys import BoxKey, Random, SignKey
from autopilot.trust.limits import KEY_BYTES, TOKEN_ID_BYTES
from autopilot.wire.directory_pb2 import DirectoryState, EpochRecord, KeyFile
from events.schema.waypoint_pb2 import IdentityToken, PrincipalKind

LIFE_HOURS = {"operator": 12, "node": 720, "service": 24}
KINDS = {"operator": PrincipalKind.OPERATOR, "node": PrincipalKind.NODE, "service": PrincipalKind.SERVICE}
ROOTS_MAX = 16


def init(
    folder: Path | str, *, deployment_id: str, now_ms: int, random: Random, roots: int = 1, threshold: int = 1
) -> Directory:
    """Make a Directory: a root (`threshold` of `roots` keys), four purpose keys, an empty list, epoch 1.

    `random` gives all chance; `now_ms` is wall milliseconds since 1970. Raises DirectoryError, OSError.
    """
    folder = Path(folder)
    if not is_name(deployment_id):
        raise DirectoryError(f"deployment id {deployment_id!r}: use a-z, 0-9 and -, at most 64 characters")
    if not 1 <= threshold <= roots <= ROOTS_MAX:
        raise DirectoryError(f"a root of {threshold} of {roots} keys: use 1 to {ROOTS_MAX}, no more needed than made")
    if (folder / STATE_FILE).exists():
        raise DirectoryError(f"{folder}: holds a Directory already; choose another folder")
    folder.mkdir(parents=True, exist_ok=True)
    root_keys = [SignKey.from_seed(random(KEY_BYTES)) for _ in range(roots)]
    keys = {purpose: SignKey.from_seed(random(KEY_BYTES)) for purpose in documents.PURPOSES}
    for name, key in [*zip(root_files(roots), root_keys, strict=True), *((f"{name}.key", keys[name]) for name in keys)]:
        durable(folder / name, key.seed, secret=True)
    durable(folder / epoch_file(1), random(KEY_BYTES), secret=True)
    state = DirectoryState(
        v=1,
        trust_root=papers.first_root(deployment_id, threshold, root_keys, keys, now_ms),
        revocations=papers.first_list(deployment_id, keys["revoke"], now_ms),
        keys=[KeyFile(purpose=purpose, name=f"{purpose}.key") for purpose in documents.PURPOSES],
        epochs=[
            EpochRecord(epoch_id=1, not_before_ms=now_ms, retire_at_ms=now_ms + EPOCH_LIFE_MS, min_revocation_version=1)
        ],
    )
    create(folder, state)
    return open_directory(folder)


def root_files(roots: int) -> list[str]:
    """Names of the files of the root's keys, as `init` writes them."""
    return [ROOT_KEY_FILE] if roots == 1 else [f"root-{number}.key" for number in range(1, roots + 1)]


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

    `kind` is operator, node or service. The folder also gets the tokens of the nodes that there
    are, so that an operator knows whom orders are bound to. Raises DirectoryError, OSError.
    """
    out = Path(out)
    if (out / identity.SIGN_FILE).exists():
        raise DirectoryError(f"{out}: holds an identity already; choose another folder or remove it")
    sign_key, box_key = SignKey.from_seed(random(KEY_BYTES)), BoxKey.from_secret(random(KEY_BYTES))
    token = described(principal_id, kind, roles, callsign)
    life_ms = int((LIFE_HOURS[kind] if hours is None else hours) * HOUR_MS)
    with changing(directory.folder) as state:
        now = papers.opened(directory.folder, state, ("token",))
        grant(now, token, sign_key.public, box_key.public, life_ms, now_ms, random)
        papers.signed_token(now, token)  # before it is kept: refused when out of bounds
        state.tokens.append(token)
    out.mkdir(parents=True, exist_ok=True)
    write_keys(out, sign_key, box_key)
    write_papers(open_directory(directory.folder, ("epoch", "token")), out, token, now_ms)
    return token


def described(principal_id: str, kind: str, roles: Sequence[str], callsign: str) -> IdentityToken:
    """Return the part of a token that people choose."""
    return IdentityToken(
        v=1, principal_id=principal_id, kind=KINDS[kind], roles=sorted(set(roles)), callsign=callsign or principal_id
    )


def grant(
    directory: Directory,
    token: IdentityToken,
    sign_pk: bytes,
    box_pk: bytes,
    life_ms: int,
    now_ms: int,
    random: Random,
) -> None:
    """Give a described token to a device from `now_ms` on. Raises DirectoryError for one that is revoked."""
    token.deployment_id = directory.trust.deployment_id
    token.device_sign_pk, token.device_box_pk = sign_pk, box_pk
    token.not_before_ms, token.not_after_ms = now_ms, now_ms + life_ms
    token.policy_version = max(1, directory.revoked.min_policy_version)
    token.token_id = random(TOKEN_ID_BYTES)
    if directory.revoked.covers(token):
        raise DirectoryError(f"{token.principal_id}: is revoked; choose another name")
