"""What changes after the start: who is out, which group key and which Directory keys are in force, whose token is new.

Each change is one commit of the Directory's state: a revocation and the epoch that shuts the revoked out come into
force together or not at all. Telling the devices is others' work.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from autopilot.ground import directory_papers as papers
from autopilot.ground.directory_papers import EPOCH_LIFE_MS, Directory
from autopilot.ground.directory_store import DirectoryError, changing, durable, epoch_file
from autopilot.trust import documents
from autopilot.trust.keys import Random, SignKey, key_id
from autopilot.trust.limits import KEY_BYTES, SKEW_MS, TOKEN_ID_BYTES
from autopilot.wire.directory_pb2 import DirectoryState, EpochRecord
from events.schema.waypoint_pb2 import IdentityToken, RevocationList


@dataclass(frozen=True, slots=True, kw_only=True)
class Removal:
    """Who is to be out; ids are 16 bytes. Nobody: the list is only signed anew, before it is overdue."""

    principals: Sequence[str] = ()
    device_key_ids: Sequence[bytes] = ()
    token_ids: Sequence[bytes] = ()
    min_policy_version: int = 0
    min_epoch_id: int = 0
    even_unknown: bool = False  # revoke what this Directory does not know, too
    keep_epoch: bool = False  # leave the group key to those who are out: not advised


class Changed(NamedTuple):
    """What is in force after a change."""

    root_version: int
    list_version: int
    epoch_id: int


def revoke(folder: Path, removal: Removal, now_ms: int, random: Random) -> Changed:
    """Sign the next revocation list, with these added; where any is new, begin a new epoch without them.

    An entry goes only when every token that it covers has expired before this list was signed: who
    holds the list knows that time, so the token is dead to him anyway. Raises DirectoryError, OSError.
    """
    with changing(folder) as state:
        directory = papers.opened(folder, state, ("revoke",))
        body = papers.list_body(state)
        before = _entries(body)
        _let_go(state.tokens, body, now_ms)
        _check_known(state, removal)
        body.principals.extend(removal.principals)
        body.device_key_ids.extend(removal.device_key_ids)
        body.token_ids.extend(removal.token_ids)
        _raise_floors(state, body, removal)
        removes = bool(_entries(body) - before)
        state.revocations = papers.next_list(state, body, directory.purpose_keys["revoke"], now_ms)
        _forget_tokens(state, papers.opened(folder, state, ()), now_ms)
        if removes and not removal.keep_epoch:
            _begin_epoch(folder, state, now_ms, now_ms, random)
    return in_force(folder)


def rotate_epoch(folder: Path, now_ms: int, random: Random, lead_ms: int = 0) -> Changed:
    """Make a new group key that is used from `lead_ms` on, so that it can be fetched before.

    The Directory overwrites older secrets as soon as they are out of use: it opens nothing, and
    whoever asks gets the key in use. Raises DirectoryError, OSError.
    """
    with changing(folder) as state:
        _begin_epoch(folder, state, now_ms, now_ms + lead_ms, random)
    return in_force(folder)


def rotate_purpose(
    folder: Path, purpose: str, now_ms: int, random: Random, root_paths: Sequence[Path | str] = ()
) -> Changed:
    """Replace the key of a purpose, by a new TrustRoot; sign anew what the old key signed.

    Tokens, bundles and beacons are signed when they are asked for; a list is signed now, one version
    up. The old key is overwritten. After a theft this is what makes its forgeries worthless: a list
    with a very high version, too, for versions are counted by key. Raises DirectoryError, OSError.
    """
    if purpose not in documents.PURPOSES:
        raise DirectoryError(f"purpose {purpose!r}: use one of {', '.join(documents.PURPOSES)}")
    with changing(folder) as state:
        root_keys = papers.root_keys_at(folder, root_paths)
        new = SignKey.from_seed(random(KEY_BYTES))
        state.trust_root = papers.next_root(state, {purpose: new}, root_keys, now_ms)
        version = documents.verify_trust_root(state.trust_root).version
        name = f"{purpose}-{version}.key"
        durable(folder / name, new.seed, secret=True)
        next(key for key in state.keys if key.purpose == purpose).name = name
        if purpose == "revoke":
            state.revocations = papers.next_list(state, papers.list_body(state), new, now_ms)
    return in_force(folder)


def renew(folder: Path, device_key_id: bytes, now_ms: int, random: Random) -> IdentityToken:
    """Give a live device a fresh token when half of the life of its newest one is over.

    Names, kind and roles stay. Returns the newest token, old or new. Raises DirectoryError, OSError.
    """
    with changing(folder) as state:
        directory = papers.opened(folder, state, ("token",))
        held = [token for token in directory.live(now_ms) if key_id(token.device_sign_pk) == device_key_id]
        if not held:
            raise DirectoryError(f"{device_key_id.hex()}: no live device has this key id; issue or enrol it again")
        token = IdentityToken()
        token.CopyFrom(held[0])
        policy_version = max(token.policy_version, directory.revoked.min_policy_version)
        life_ms = token.not_after_ms - token.not_before_ms
        if now_ms < token.not_before_ms + life_ms // 2 and policy_version == token.policy_version:
            return token
        token.not_before_ms, token.not_after_ms = now_ms, now_ms + life_ms
        token.policy_version = policy_version
        token.token_id = random(TOKEN_ID_BYTES)
        state.tokens.append(token)
    return token


def tidy(folder: Path, now_ms: int) -> None:
    """Overwrite the secrets of epochs that are over. Raises DirectoryError, OSError."""
    with changing(folder) as state:
        _drop_epochs(state, now_ms)


def in_force(folder: Path) -> Changed:
    """Return the versions in force; the epoch is the newest, in use or to come. Raises DirectoryError."""
    directory = papers.open_directory(folder, ())
    newest = max(epoch.epoch_id for epoch in directory.state.epochs)
    return Changed(directory.trust.version, directory.revoked.version, newest)


def _begin_epoch(folder: Path, state: DirectoryState, now_ms: int, not_before_ms: int, random: Random) -> None:
    epoch = EpochRecord(
        epoch_id=max(epoch.epoch_id for epoch in state.epochs) + 1,
        not_before_ms=not_before_ms,
        retire_at_ms=not_before_ms + EPOCH_LIFE_MS,
        min_revocation_version=papers.list_body(state).version,
    )
    durable(folder / epoch_file(epoch.epoch_id), random(KEY_BYTES), secret=True)
    state.epochs.append(epoch)
    _drop_epochs(state, now_ms)


def _drop_epochs(state: DirectoryState, now_ms: int) -> None:
    """Let go of the epochs before the newest that has begun; the newest stays in any case, for its number."""
    begun = [epoch.epoch_id for epoch in state.epochs if epoch.not_before_ms <= now_ms]
    kept = [epoch for epoch in state.epochs if not begun or epoch.epoch_id >= max(begun)]
    del state.epochs[:]
    state.epochs.extend(kept)


def _let_go(tokens: Iterable[IdentityToken], body: RevocationList, now_ms: int) -> None:
    """Take the entries out that cover tokens, all of which have expired; what covers none that is known stays."""
    tokens = list(tokens)

    def stays(entry: str | bytes, named_by: Callable[[IdentityToken], str | bytes]) -> bool:
        covered = [token for token in tokens if named_by(token) == entry]
        return not covered or any(token.not_after_ms + SKEW_MS >= now_ms for token in covered)

    body.principals[:] = [name for name in body.principals if stays(name, lambda token: token.principal_id)]
    body.device_key_ids[:] = [
        device for device in body.device_key_ids if stays(device, lambda token: key_id(token.device_sign_pk))
    ]
    body.token_ids[:] = [each for each in body.token_ids if stays(each, lambda token: token.token_id)]


def _forget_tokens(state: DirectoryState, directory: Directory, now_ms: int) -> None:
    """Forget expired tokens that no entry needs any more."""
    revoked = directory.revoked
    kept = [token for token in state.tokens if token.not_after_ms + SKEW_MS >= now_ms or revoked.covers(token)]
    del state.tokens[:]
    state.tokens.extend(kept)


def _check_known(state: DirectoryState, removal: Removal) -> None:
    names = {token.principal_id for token in state.tokens} | {each.token.principal_id for each in state.invitations}
    devices = {key_id(token.device_sign_pk) for token in state.tokens}
    tokens = {token.token_id for token in state.tokens}
    unknown = [name for name in removal.principals if name not in names]
    unknown += [device.hex() for device in removal.device_key_ids if device not in devices]
    unknown += [token.hex() for token in removal.token_ids if token not in tokens]
    if unknown and not removal.even_unknown:
        close = difflib.get_close_matches(unknown[0], names, n=1)
        hint = f"did you mean {close[0]}?" if close else "see `autopilot directory list`, or use --even-unknown"
        raise DirectoryError(f"{unknown[0]}: is not known here; {hint}")


def _raise_floors(state: DirectoryState, body: RevocationList, removal: Removal) -> None:
    newest = max(epoch.epoch_id for epoch in state.epochs)
    if removal.min_epoch_id > newest:
        raise DirectoryError(f"--min-epoch {removal.min_epoch_id}: the newest epoch is {newest}; rotate first")
    for name, asked in (("min_epoch_id", removal.min_epoch_id), ("min_policy_version", removal.min_policy_version)):
        if asked and asked < getattr(body, name):
            raise DirectoryError(f"{name}: is {getattr(body, name)} already, and only grows")
        if asked:
            setattr(body, name, asked)


def _entries(body: RevocationList) -> set[str | bytes]:
    return {*body.principals, *body.device_key_ids, *body.token_ids}
