"""A progress bar on stderr, for work that takes long enough to wonder about. Silent where nobody looks."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TextIO

PATIENCE_S = 1.0  # a bar that only flashes disturbs
EVERY_S = 0.1
WIDTH = 30


class Bar:
    """Call it with what is done and what there is to do."""

    def __init__(self, label: str, out: TextIO | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self._label = label
        self._out = sys.stderr if out is None else out
        self._clock = clock
        self._started = self._drawn = clock()
        self._visible = False

    def __call__(self, done: int, of: int) -> None:
        """Draw, when it is time to."""
        now = self._clock()
        if not self._out.isatty() or now - self._started < PATIENCE_S or now - self._drawn < EVERY_S:
            return
        self._drawn, self._visible = now, True
        filled = WIDTH * done // max(of, 1)
        self._out.write(f"\r{self._label} [{'#' * filled}{'.' * (WIDTH - filled)}] {done:,} of {of:,}")
        self._out.flush()

    def end(self) -> None:
        """Take the bar away."""
        if self._visible:
            self._out.write("\r\x1b[K")
            self._out.flush()
