"""One daemon a folder: two writers of one log would be two histories."""

from __future__ import annotations

import fcntl
from pathlib import Path
from typing import IO


class FolderTaken(RuntimeError):
    """Another daemon records in this folder."""


class FolderLock:
    """Holds `<folder>/.lock` while the daemon runs; the kernel lets go of it when the process dies."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / ".lock"
        self._file: IO[str] | None = None

    def __enter__(self) -> FolderLock:
        """Take the lock. Raises FolderTaken, and OSError where the folder can't be made."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self._path.open("w")
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._file.close()
            raise FolderTaken(f"another autopilot records in {self._path.parent}; stop it first") from None
        return self

    def __exit__(self, *_error: object) -> None:
        if self._file is not None:
            self._file.close()
