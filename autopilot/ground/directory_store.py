"""The Directory's folder: one file of state that is replaced in one step, and the secrets that it names.

Whatever changes reads the state under a lock, changes a copy, and commits by one rename; secrets that a new state
names are durable before it, those that no state names any more are overwritten after it. So a process that dies
leaves the old state or the new one, and a version that was ever visible is never given to something else. What the
state means is not known here.
"""

from __future__ import annotations

import fcntl
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from google.protobuf.message import DecodeError

from autopilot.trust import identity
from autopilot.trust.documents import PURPOSES
from autopilot.trust.keys import SecretFileError, SignKey, read_secret, write_file
from autopilot.wire.directory_pb2 import DirectoryState

STATE_FILE, LOCK_FILE = "directory.state", "directory.lock"
_MAKE = "make one with `autopilot directory init`"


class DirectoryError(Exception):
    """The Directory can't do what it was asked; the text names the file or argument and the fix."""


def durable(path: Path, data: bytes, *, secret: bool = False) -> None:
    """Replace `path` by `data` in one step that outlives a power cut. Raises OSError."""
    write_file(path, data, secret=secret)
    _sync_folder(path.parent)


def epoch_file(epoch_id: int) -> str:
    """Name of the file of an epoch's secret."""
    return f"epoch-{epoch_id}.secret"


def read_state(folder: Path) -> DirectoryState:
    """Read the state as it was committed last. Raises DirectoryError."""
    path = folder / STATE_FILE
    try:
        mode = path.stat().st_mode
        state = DirectoryState.FromString(path.read_bytes())
    except OSError as error:
        raise DirectoryError(f"{folder}: is no whole Directory ({path.name}: {error.strerror}); {_MAKE}") from error
    except DecodeError as error:
        raise DirectoryError(f"{path}: is damaged; restore the folder from its copy, or {_MAKE}") from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise DirectoryError(f"{path}: others may read it (mode {mode & 0o777:04o}); run: chmod 600 {path}")
    if state.v != 1:
        raise DirectoryError(f"{path}: is of format {state.v}, and this program knows 1")
    return state


def read_key(folder: Path, name: str) -> SignKey:
    """Read a signing key of the folder. Raises DirectoryError naming the file and the fix."""
    return key_at(folder / name)


def key_at(path: Path) -> SignKey:
    """Read a signing key. Raises DirectoryError naming the file and the fix."""
    try:
        return SignKey.from_seed(read_secret(path))
    except SecretFileError as error:
        raise DirectoryError(f"{error} (this command signs with that key)") from error


def read_epoch_secret(folder: Path, epoch_id: int) -> bytes:
    """Read the secret of an epoch. Raises DirectoryError naming the file and the fix."""
    try:
        return read_secret(folder / epoch_file(epoch_id))
    except SecretFileError as error:
        raise DirectoryError(f"{error}; `autopilot directory rotate {folder}` makes a new epoch") from error


@contextmanager
def changing(folder: Path) -> Iterator[DirectoryState]:
    """Give the state to change, alone; what was made of it is committed when the block ends without an error.

    Raises DirectoryError, OSError.
    """
    with _locked(folder):
        state = read_state(folder)
        before = state.SerializeToString(deterministic=True)
        yield state
        after = state.SerializeToString(deterministic=True)
        if after != before:
            durable(folder / STATE_FILE, after, secret=True)
        _settle(folder, state)


def create(folder: Path, state: DirectoryState) -> None:
    """Commit the first state of a folder. Raises OSError."""
    durable(folder / STATE_FILE, state.SerializeToString(deterministic=True), secret=True)
    _settle(folder, state)


def wipe(path: Path) -> None:
    """Overwrite a secret and remove it; what flash memory keeps of it is out of reach. Raises OSError."""
    descriptor = os.open(path, os.O_WRONLY)
    try:
        os.write(descriptor, bytes(os.fstat(descriptor).st_size))
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
    path.unlink()


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    if not (folder / STATE_FILE).exists():
        raise DirectoryError(f"{folder}: is no Directory; {_MAKE}")
    descriptor = os.open(folder / LOCK_FILE, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)  # held for milliseconds, by a command or the server
        yield
    finally:
        os.close(descriptor)


def _settle(folder: Path, state: DirectoryState) -> None:
    """Bring the rest of the folder into step: copies of the public documents, and secrets that nobody needs."""
    for name, data in ((identity.ROOT_FILE, state.trust_root), (identity.REVOCATIONS_FILE, state.revocations)):
        path = folder / name
        if not path.exists() or path.read_bytes() != data:
            durable(path, data)
    named = {key.name for key in state.keys} | {epoch_file(epoch.epoch_id) for epoch in state.epochs}
    patterns = ("epoch-*.secret*", *(f"{purpose}*.key*" for purpose in PURPOSES), f"{STATE_FILE}.part")
    for path in sorted(found for pattern in patterns for found in folder.glob(pattern)):
        if path.name not in named:
            wipe(path)
    _sync_folder(folder)


def _sync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
