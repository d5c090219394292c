"""Documents that were taken in flight, in the identity's folder: 0600, replaced in one step, durable before they count.

Which document may be kept is not decided here.
"""

from __future__ import annotations

import re
from pathlib import Path

from autopilot.trust.identity import EPOCH_FILE, EPOCHS_FOLDER, REVOCATIONS_FILE, ROOT_BEFORE_FILE, ROOT_FILE
from autopilot.trust.keys import erase_file, sync_folder, write_file
from events.schema.waypoint_pb2 import EpochBundle, SignedDoc


def keep_revocations(folder: Path, data: bytes) -> None:
    """Replace the list. Raises OSError."""
    _keep(folder / REVOCATIONS_FILE, data)


def keep_root(folder: Path, data: bytes) -> None:
    """Replace the root, the one before it staying: the list that is held may be signed under it. Raises OSError."""
    _keep(folder / ROOT_BEFORE_FILE, (folder / ROOT_FILE).read_bytes())
    _keep(folder / ROOT_FILE, data)


def keep_epoch(folder: Path, epoch_id: int, data: bytes) -> None:
    """Add a bundle. Raises OSError."""
    (folder / EPOCHS_FOLDER).mkdir(mode=0o700, exist_ok=True)
    sync_folder(folder)
    _keep(folder / EPOCHS_FOLDER / str(epoch_id), data)


def erase_epochs(folder: Path, kept: frozenset[int]) -> None:
    """Overwrite and remove the bundles of epochs that are not in `kept`. Raises OSError.

    Where the one that the Directory issued is among them, the newest takes its place: there is always one.
    """
    bundles = {int(path.name): path for path in (folder / EPOCHS_FOLDER).glob("*") if re.fullmatch(r"\d+", path.name)}
    newest = bundles.get(max(kept, default=0))
    if _epoch_of(folder / EPOCH_FILE) not in kept and newest is not None:
        _replace_erased(folder / EPOCH_FILE, newest.read_bytes())
    for epoch_id in bundles.keys() - kept:
        erase_file(bundles[epoch_id])
    sync_folder(folder)


def _epoch_of(path: Path) -> int:
    return EpochBundle.FromString(SignedDoc.FromString(path.read_bytes()).body).epoch_id


def _replace_erased(path: Path, data: bytes) -> None:
    """Replace a file and overwrite what it held: the old one keeps a name of its own until then."""
    over = path.with_name(path.name + ".over")
    over.unlink(missing_ok=True)
    over.hardlink_to(path)
    write_file(path, data, secret=True)
    erase_file(over)


def _keep(path: Path, data: bytes) -> None:
    write_file(path, data, secret=True)
    sync_folder(path.parent)
