"""A lane: one thread that does one thing after the other, with bounded room for what waits."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Final

WAITING_MAX: Final = 16  # questions and documents; a Directory sends three when something changes


class Lane:
    """One thread that does one thing after the other, and has room for a few."""

    def __init__(self, name: str, waiting: int = WAITING_MAX) -> None:
        self._waiting: queue.Queue[Callable[[], None] | None] = queue.Queue(waiting)
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def put(self, act: Callable[[], None]) -> bool:
        """Have it done later; False when too much waits."""
        try:
            self._waiting.put_nowait(act)
        except queue.Full:
            return False
        return True

    def stop(self, timeout_s: float) -> None:
        """Forget what waits; return when what was begun is done, or after `timeout_s`."""
        while True:
            try:
                self._waiting.get_nowait()
            except queue.Empty:
                break
        self._waiting.put(None)
        if self._thread.is_alive():
            self._thread.join(timeout_s)

    def _work(self) -> None:
        while (act := self._waiting.get()) is not None:
            act()
            del act  # it may hold a question that nobody answers: letting go of it tells the asker so
