"""Large inputs beside the log: what a record names by its SHA-256 lies in the open flight's `evidence/`.

A flight replays without them; they are for people. The newest is written into the next flight's folder too, for what it
says is still in force there; by `hand_over` where a mission goes on in the air and another process kept its file.
"""

from __future__ import annotations

import os
import tempfile
from hashlib import sha256
from pathlib import Path

EVIDENCE = "evidence"


class Attachments:
    """Where large inputs go. `attend` is called on the node's thread, `keep` on any."""

    def __init__(self) -> None:
        self._folder: Path | None = None
        self._newest: tuple[str, bytes] | None = None

    @property
    def folder(self) -> Path | None:
        """The open flight's folder; None before one is open."""
        return self._folder

    def attend(self, folder: Path) -> None:
        """Go on in the folder of a flight that was opened. A disk that fails here fails the log too, which says so."""
        self._folder = folder
        if self._newest is not None:
            try:
                self.keep(*self._newest)
            except OSError:
                return

    def keep(self, name: str, data: bytes) -> None:
        """Write a file whole and durably, named by its SHA-256. Raises OSError, also where no flight is open."""
        folder = self._folder
        if folder is None:
            raise OSError("no flight is open")
        path = folder / EVIDENCE / name
        path.parent.mkdir(mode=0o700, exist_ok=True)
        if not path.exists():
            _write(path, data)
        self._newest = (name, data)


def hand_over(before: Path, after: Path, name: str) -> None:
    """Copy a file of one flight's folder into the next one's; one that can't be had whole is left out."""
    try:
        target = after / EVIDENCE / name
        data = (before / EVIDENCE / name).read_bytes()
        if sha256(data).hexdigest() != name:
            return
        target.parent.mkdir(mode=0o700, exist_ok=True)
        _write(target, data)
    except OSError:
        return


def _write(path: Path, data: bytes) -> None:
    descriptor, begun = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        Path(begun).replace(path)
    except OSError:
        Path(begun).unlink(missing_ok=True)
        raise
