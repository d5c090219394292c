"""Space that is set aside so that the end of a flight can be written on a full disk.

It lies as `reserve` beside `flight.db` while the log is open for writing, and is given up once. A file system that
can't set space aside goes without: then a full disk ends the log as any other write error does.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

NAME = "reserve"
# A flight's last records, checkpoint and verdict are some KiB; a landing's worth of records at 400 bytes each is 1 MiB.
RESERVE_BYTES = 4 << 20


class Reserve:
    """The reserved space of one flight."""

    def __init__(self, folder: Path) -> None:
        """Set the space aside where that is possible."""
        self._path = folder / NAME
        self.spent = False  # given up because the disk was full
        try:
            descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                os.posix_fallocate(descriptor, 0, RESERVE_BYTES)
            finally:
                os.close(descriptor)
        except OSError:
            self.release()

    def give_up(self) -> bool:
        """Give the space to the log; say whether there was any. It is only there once."""
        self.spent, had = True, self._path.exists()
        self.release()
        return had

    def release(self) -> None:
        """Let go of the space without need."""
        with suppress(OSError):
            self._path.unlink()
