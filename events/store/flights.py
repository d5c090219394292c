"""The folder of a flight: `<number>-<8 hex of flight_id>/flight.db`, numbered from 1 on each node.

A flight ships and is deleted as one folder. Which flight is open is decided by the node, not here.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass
from pathlib import Path

from events.store.protocol import StoreFailed, StoreMissing
from events.store.sqlite import SqliteReader, SqliteStore, sync_folder

DATABASE = "flight.db"
_NAME = re.compile(r"(\d{6})-[0-9a-f]{8}")


@dataclass(frozen=True, slots=True, order=True)
class Flight:
    """A flight's folder."""

    number: int
    folder: Path

    @property
    def database(self) -> Path:
        """The log."""
        return self.folder / DATABASE


def flights_in(root: Path) -> list[Flight]:
    """Return the flights below `root`, oldest first. A folder without a log (a start cut short) is none."""
    if not root.is_dir():
        return []
    found = ((_NAME.fullmatch(folder.name), folder) for folder in root.iterdir())
    flights = (Flight(int(match[1]), folder) for match, folder in found if match)
    return sorted(flight for flight in flights if flight.database.exists())


def create_flight(root: Path, number: int, flight_id: bytes, secret: bytes) -> tuple[Flight, SqliteStore]:
    """Make the folder and the empty log of a new flight. Raises StoreFailed."""
    flight = Flight(number, root / f"{number:06d}-{flight_id.hex()[:8]}")
    try:
        root.mkdir(parents=True, exist_ok=True)
        flight.folder.mkdir(mode=0o700)
        sync_folder(root)
    except OSError as error:
        raise StoreFailed(f"the flight's folder can't be made: {error}") from error
    try:
        return flight, SqliteStore.create(flight.database, flight_id, secret)
    except StoreFailed:
        remove_begun(flight)
        raise


def remove_begun(flight: Flight) -> None:
    """Remove what is left of a flight whose opening could not be recorded: tried again and again it would fill a disk.

    Best effort: a start passes over whatever stays.
    """
    shutil.rmtree(flight.folder, ignore_errors=True)


def open_flight(flight: Flight) -> SqliteStore:
    """Open a flight for writing. Raises StoreMissing and StoreFailed."""
    return SqliteStore(flight.database)


def read_flight(folder: Path) -> SqliteReader:
    """Open a flight's folder for reading. Raises StoreMissing and StoreFailed."""
    if not folder.is_dir():
        raise StoreMissing(f"there is no flight at {folder}")
    return SqliteReader(folder / DATABASE)
