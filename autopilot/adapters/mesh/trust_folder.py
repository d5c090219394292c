"""Fetches documents from a folder that somebody fills by hand or by a sync: the way of an air gap.

The files are those of `autopilot directory export`. Nothing is believed here; the book of trust judges. A folder can't
tell the time.
"""

from __future__ import annotations

import threading
from collections import Counter
from pathlib import Path
from typing import Final

from autopilot.trust import identity
from autopilot.trust.fetching import Offer, What
from autopilot.trust.limits import DOCUMENT_BYTES_MAX

LOOK_EVERY_S: Final = 5.0  # a stick is plugged in by hand
Mark = tuple[int, int, int]  # of a file: inode, size, time of change
# The root comes first: what follows may be signed by keys that only the new one names.
FILES: Final[dict[What, str]] = {
    "trust_root": identity.ROOT_FILE,
    "revocations": identity.REVOCATIONS_FILE,
    "epoch": identity.EPOCH_FILE,
}


class TrustFolder:
    """A `Fetch` from a folder, which it also watches."""

    def __init__(self, folder: Path, offer: Offer, look_every_s: float = LOOK_EVERY_S) -> None:
        """Fetch from `folder`, which need not exist yet."""
        self._folder, self._offer = folder, offer
        self._look_every_s = look_every_s
        self._seen: dict[What, Mark | None] = {}
        self._counts: Counter[str] = Counter()
        self._asked = threading.Event()
        self._stopped = False
        self._watcher = threading.Thread(target=self._watch, name="trust-folder", daemon=True)

    def start(self) -> None:
        """Begin to watch; returns at once."""
        self._watcher.start()

    def stop(self) -> None:
        """Stop watching."""
        self._stopped = True
        self._asked.set()
        self._watcher.join(timeout=self._look_every_s)

    def request(self, what: What, challenge: bytes | None = None) -> None:
        """Look now. Any thread; never blocks, never raises."""
        del what, challenge
        self._asked.set()

    def counts(self) -> Counter[str]:
        """Return what became of the files since start, by kind."""
        return self._counts.copy()

    def look(self) -> None:
        """Offer all that lies there, when any of it changed: a new root may be what another file waited for."""
        marks = {what: _mark(self._folder / name) for what, name in FILES.items()}
        if marks != self._seen:
            self._seen = marks
            for what, name in FILES.items():
                self._take(what, self._folder / name)

    def _take(self, what: What, path: Path) -> None:
        try:
            with path.open("rb") as file:
                data = file.read(DOCUMENT_BYTES_MAX + 1)
        except OSError:
            return
        word = "size" if len(data) > DOCUMENT_BYTES_MAX else self._offer(what, data).value
        self._counts[f"{what}: {word}"] += 1

    def _watch(self) -> None:
        while not self._stopped:
            self.look()
            self._asked.wait(self._look_every_s)
            self._asked.clear()


def _mark(path: Path) -> Mark | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns
