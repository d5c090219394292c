"""The monitors over a flight that is replayed: which properties its recorded decisions broke (`statecharts.monitors`).

A log may be forged so that a monitor can make nothing of it; then it watches no more, and that is said.
"""

from __future__ import annotations

from collections.abc import Sequence

from events import Record
from replay.verdict import Broken
from statecharts.monitors import Watch


class Properties:
    """Watches the recorded steps of one flight and keeps the first breach of each property."""

    def __init__(self) -> None:
        self._watch: Watch | None = Watch()
        self.broken: dict[str, Broken] = {}

    def see(self, step: Sequence[Record]) -> None:
        """Take in a step as it was recorded."""
        if self._watch is None:
            return
        try:
            found = self._watch.see(step)
        except Exception as error:  # noqa: BLE001 - a forged decision may break any monitor
            self._watch = None
            self.broken["monitors"] = Broken("monitors", step[0].seq, f"they stopped: {type(error).__name__}")
            return
        for breach in found:
            self.broken.setdefault(breach.name, Broken(breach.name, breach.seq, breach.words))
