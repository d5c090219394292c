"""A flight of a million records that knows a hundred thousand objects, as a node leaves it when it is killed.

It goes through the node's own flights, seal and snapshots, with the real charts deciding; only the records are
committed many at a time. Frames of one to five sightings go over a field of objects ten metres apart, row after row,
each seen some ten times and none sure enough to ask a person about. It is made once and kept in build/, for that takes
a minute or two.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

from google.protobuf.message import Message

from autopilot.node.board import Board
from autopilot.node.flights import Flights, Identity, Session
from autopilot.node.limits import configuration_message
from autopilot.node.restoring import Keeper
from autopilot.node.sealing import Sealer
from autopilot.ports.config import Config
from events.records import Record
from events.schema.common_pb2 import Place
from events.schema.eyes_pb2 import Detection, FrameObserved
from events.schema.flight_pb2 import OriginSet
from events.schema.vehicle_pb2 import VehicleLinkChanged, VehicleStateReported
from events.store import flights_in
from tests.autopilot.trust.world import FakeClock, people, seeded
from tests.bench.flight import STEP_NS, message, place
from tests.flights import NODE_KEY
from tests.house import REPO

RECORDS = 1_000_000
OBJECTS = 100_000
KEPT = REPO / "build" / "bench-million"
TICKS_A_COMMIT = 170  # ten seconds of flight
COLUMNS = 400
APART_MM = 10_000
_DONE = "whole"


def thing(number: int) -> Detection:
    """Return object `number`, which stands where it stands."""
    east, north = number % COLUMNS * APART_MM, number // COLUMNS * APART_MM
    found = Detection(class_name="person", confidence_e4=3_000, x_min_e4=4_000, x_max_e4=4_400, y_max_e4=5_000)
    found.place.CopyFrom(place(number))
    found.place.MergeFrom(Place(east_mm=east, north_mm=north))
    return found


def frame(number: int, frames: int) -> FrameObserved:
    """Return the frame that looks at its part of the field."""
    first = number * OBJECTS // frames
    seen = [thing((first + nth) % OBJECTS) for nth in range(number % 5 + 1)]
    return FrameObserved(
        vehicle=1, camera=1, frame_seq=number, captured_ns=number * STEP_NS, latency_us=31_000, detections=seen
    )


def observations(records: int) -> Iterator[Message]:
    """Yield what leads to so many records: of 17 a second ten are frames, which are two records each."""
    yield OriginSet(place=place(0), source="configured")
    yield VehicleLinkChanged(vehicle=1, up=True)
    yield VehicleStateReported(vehicle=1, system_id=1, autopilot=3, vehicle_type=2, armed=True)
    frames = records * 10 // 27
    for number in range(records * 17 // 27):
        if number % 17 < 10:
            yield frame(number // 17 * 10 + number % 17, frames)
        else:
            yield message(number % 17 + 10)


class Bench:
    """A node without its world."""

    def __init__(self, root: Path, clock: FakeClock, software: str = "bench") -> None:
        self.heard = 0
        self.board = Board(lambda: 0)
        sealer = Sealer(people().wasp, clock, seeded(7))
        config = Config.model_validate({"node": {"keys": "k", "flights": "f", "projections": "p"}})
        identity = Identity(
            node="wasp-01",
            public_key=people().wasp.public_key or NODE_KEY,
            deployment_id="coast-watch",
            software=software,
            boot_id="bench",
            configuration=configuration_message(config),
        )
        keeper = Keeper(sealer, software, lambda: self.board.folded, self.board.recall)
        self.flights = Flights(root, identity, clock, seeded(8), sealer, keeper=keeper)

    def open(self) -> Session:
        """Start."""
        return self.flights.open(self.hear)

    def hear(self, records: tuple[Record, ...]) -> None:
        """Count them and show them."""
        self.heard += len(records)
        self.board.hear(records)


def fly(root: Path, records: int) -> None:
    """Record a flight of about so many records below `root`, and let it be found as after a kill."""
    clock = FakeClock()
    bench = Bench(root, clock)
    session, waiting = bench.open(), list[Record]()
    for tick, observation in enumerate(observations(records)):
        clock.now_ms += 1000 // 17
        waiting += session.observe(observation)
        if tick % TICKS_A_COMMIT == TICKS_A_COMMIT - 1:
            commit(bench, session, waiting)
    commit(bench, session, waiting)
    session.store.close()


def commit(bench: Bench, session: Session, waiting: list[Record]) -> None:
    """Do what the loop does when nothing waits any more."""
    session.store.append(waiting)
    bench.hear(tuple(waiting))
    waiting.clear()
    session.store.idle()
    assert session.sealing is not None
    session.sealing.turn(armed=True, flight_ns=session.clock.peek_ns())


def million() -> Path:
    """Return the folder of the node's flights, made where it is not there yet."""
    if not (KEPT / _DONE).exists():
        print("making a flight of a million records, once ...", file=sys.stderr, flush=True)
        shutil.rmtree(KEPT, ignore_errors=True)
        fly(KEPT, RECORDS)
        (KEPT / _DONE).touch()
    assert len(flights_in(KEPT)) == 1
    return KEPT
