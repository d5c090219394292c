"""A sealed flight in a folder, as a node leaves it, for the tests of proofs. Nothing here tests anything."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from autopilot.node.sealing import Sealer, Sealing
from events import Record
from events.store import Flight, SqliteStore, create_flight
from statecharts import State, evolve
from tests.autopilot.trust.world import FakeClock, people, seeded
from tests.flights import FLIGHT_ID, SECRET, story


@dataclass
class Sealed:
    """A flight with its seal still open."""

    flight: Flight
    store: SqliteStore
    sealing: Sealing
    clock: FakeClock
    state: State  # after every record

    def append(self, record: Record) -> None:
        """Let state and log go on by a record."""
        evolve(self.state, record)
        self.store.append([record])


def sealer(clock: FakeClock, seed: int = 7) -> Sealer:
    """Return the sealer of node wasp-01."""
    return Sealer(people().wasp, clock, seeded(seed))


def sealed_story(root: Path, *, close: bool = True) -> Sealed:
    """Write the whole story, signed once; closed, its key is erased."""
    clock = FakeClock()
    flight, store = create_flight(root, 1, FLIGHT_ID, SECRET)
    told = story()
    sealing = sealer(clock).open(flight, store, told.state)
    store.append(told.records)
    if close:
        sealing.close(5_000)
        store.close()
    return Sealed(flight, store, sealing, clock, told.state)
