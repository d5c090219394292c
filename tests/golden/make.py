"""Records the golden flights anew: `python -m tests.golden.make`.

Only for a change of the charts that is meant; the new files are then part of that change. Each flight is a log as the
daemon writes it, made from the same observations every time.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from events import Record
from events.store import SqliteStore
from tests.flights import FLIGHT_ID, SECRET, Flight, story
from tests.replay.changes import at, forged

HERE = Path(__file__).parent


def write(name: str, records: Sequence[Record]) -> None:
    """Write a flight's log, sealed from its first record on."""
    path = HERE / f"{name}.db"
    path.unlink(missing_ok=True)
    store = SqliteStore.create(path, FLIGHT_ID, SECRET)
    store.append(records)
    store.close()


def forged_answer(flight: Flight) -> list[Record]:
    """Return the flight with one answer that its charts did not give, the chain made to fit."""
    return forged(flight, at(flight, "send_ack"), detail="something else")


def main() -> None:
    """Write them all."""
    flight = story()
    write("story", flight.records)
    write("forged", forged_answer(flight))


if __name__ == "__main__":
    main()
