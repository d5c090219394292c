"""Consistency proofs of the node's flights, worked out on a thread of their own, through a reader of their own.

The upper part of the newest asked flight's tree is kept and grows with the log, so that a proof among a million
records reads two blocks of 1,024. The first question after a start reads the whole log once; it does so a block at a
time and lets the other threads go first in between. What is asked is bounded by whoever takes the questions in.
"""

from __future__ import annotations

import queue
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from autopilot.ports.edges import Consistency
from events.canopy import Canopy
from events.store import Reader, StoreFailed, StoreMissing, flights_in, read_flight

WAITING_MAX = 8  # questions; an asker asks again
# Between two blocks, so that an order does not wait for a proof: hashing holds the interpreter.
BREATH_S = 0.001


class _Question(NamedTuple):
    flight_number: int
    old_size: int
    new_size: int
    reply: Callable[[Consistency | None], None]


class Prover:
    """Answers for the flights below a folder."""

    def __init__(self, root: Path, breathe: Callable[[], None] = lambda: time.sleep(BREATH_S)) -> None:
        self._root = root
        self._breathe = breathe
        self._waiting: queue.Queue[_Question | None] = queue.Queue(WAITING_MAX)
        self._thread = threading.Thread(target=self._run, name="prover", daemon=True)
        self._reader: Reader | None = None
        self._known: tuple[Path, Canopy] | None = None

    def start(self) -> None:
        """Begin to answer."""
        self._thread.start()

    def stop(self) -> None:
        """Answer nothing more."""
        if self._thread.is_alive():
            self._waiting.put(None)
            self._thread.join(timeout=5)

    def ask(
        self, flight_number: int, old_size: int, new_size: int, reply: Callable[[Consistency | None], None]
    ) -> bool:
        """Take a question; see `ports.edges.Proving`."""
        try:
            self._waiting.put_nowait(_Question(flight_number, old_size, new_size, reply))
        except queue.Full:
            return False
        return True

    def turn(self) -> bool:
        """Answer the next question; False when it was the last."""
        asked = self._waiting.get()
        if asked is None:
            return False
        try:
            asked.reply(self.proof(asked.flight_number, asked.old_size, asked.new_size))
        except Exception:  # noqa: BLE001 - the boundary of the thread: the next one asks in vain otherwise
            print(f"autopilot: a proof failed:\n{traceback.format_exc()}", file=sys.stderr, flush=True)
        return True

    def proof(self, flight_number: int, old_size: int, new_size: int) -> Consistency | None:
        """Return the proof that the log's first `new_size` records begin with its first `old_size`; None: can't."""
        folder = next((one.folder for one in flights_in(self._root) if one.number == flight_number), None)
        if folder is None:
            return None
        try:
            self._reader = read_flight(folder)
            canopy = self._canopy(folder, new_size)
            return Consistency(canopy.root(old_size), tuple(canopy.consistency(old_size, new_size)))
        except (IndexError, StoreFailed, StoreMissing):
            return None
        finally:
            if self._reader is not None:
                self._reader.close()
            self._reader = None

    def _canopy(self, folder: Path, size: int) -> Canopy:
        """Return the tree of this flight, grown to `size`. Raises IndexError where the log is shorter."""
        if self._known is None or self._known[0] != folder:
            self._known = (folder, Canopy(self._leaves))
        canopy = self._known[1]
        while canopy.lacks(size):
            canopy.take_block()
            self._breathe()
        canopy.reach(size)
        return canopy

    def _leaves(self, start: int, stop: int) -> Iterator[bytes]:
        assert self._reader is not None
        return (stored.leaf for stored in self._reader.stored(start, stop))

    def _run(self) -> None:
        while self.turn():
            pass
