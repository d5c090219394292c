"""Keeps projections.db up with the log, on a thread of its own and through a reader of its own."""

from __future__ import annotations

import asyncio
import sqlite3
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from autopilot.node.board import Board
from events.store import read_flight
from projections.store import Projector

# How often the rows follow the log: `autopilot status` is at most this old.
EVERY_S = 1.0


class Projecting:
    """Folds new records into projections.db. The database is disposable, so a failure only waits for better times."""

    def __init__(self, path: Path, board: Board) -> None:
        self._path = path
        self._board = board
        self._projector: Projector | None = None
        self._trouble = ""
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
            self._fold()
            self._trouble = ""
        except (
            OSError,
            sqlite3.Error,
            LookupError,
            ValueError,
        ) as error:  # the store, its rows, or a record of the log
            self._projector = None  # its memory may be ahead of its tables
            if str(error) != self._trouble:
                self._trouble = str(error)
                print(f"autopilot: the projections are behind: {self._path}: {error}", file=sys.stderr, flush=True)

    def _fold(self) -> None:
        """Fold what is new. Raises OSError (StoreFailed too) and sqlite3.Error."""
        reader = read_flight(self._board.session.flight.folder)
        try:
            if self._projector is None:
                self._projector = Projector(self._path)
            self._projector.catch_up(reader)
        finally:
            reader.close()
