"""Keeps projections.db up with the log, on a thread of its own and through a reader of its own."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from projections.store import Projector

from autopilot.node.board import Board
from events.store import StoreFailed, read_flight

# How often the rows follow the log: `autopilot status` is at most this old.
EVERY_S = 1.0


class Projecting:
    """Folds new records into projections.db. The database is disposable, so a failure only waits for better times."""

    def __init__(self, path: Path, board: Board) -> None:
        self._path = path
        self._board = board
        self._projector: Projector | None = None
        # One thread: SQLite connections stay on the thread that made them.
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="projections")

    async def run(self) -> None:
        """Catch up every second, until cancelled."""
        while True:
            await asyncio.get_running_loop().run_in_executor(self._thread, self._catch_up)
            await asyncio.sleep(EVERY_S)

    async def finish(self) -> None:
        """Catch up a last time and let go of the database."""
        await asyncio.get_running_loop().run_in_executor(self._thread, self._catch_up)
        self._thread.shutdown()

    def _catch_up(self) -> None:
        try:
            reader = read_flight(self._board.session.flight.folder)
        except (StoreFailed, FileNotFoundError):
            return
        try:
            if self._projector is None:
                self._projector = Projector(self._path)
            self._projector.catch_up(reader)
        finally:
            reader.close()
