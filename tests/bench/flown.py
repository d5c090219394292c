"""A flight that the real charts decided: for measuring what decides again.

Frames at ten a second look at forty people who stand still, positions and gimbal reports come between, and
deadlines pass when the core asked for it. Made from numbers alone; nobody gives orders.
"""

from __future__ import annotations

from collections.abc import Iterator

from google.protobuf.message import Message

from autopilot.node.limits import configuration_message
from autopilot.ports.config import Config
from events.records import NO_CAUSE, Moment, Record, make_record
from events.schema.eyes_pb2 import FrameObserved
from events.schema.flight_pb2 import BaselineCarried, FlightOpened, NodeStarted, OriginSet, TimePassed
from events.schema.state_pb2 import CarriedState
from events.schema.vehicle_pb2 import VehicleLinkChanged, VehicleStateReported
from statecharts.engine import step
from statecharts.logic import LOGIC
from statecharts.state import State
from tests.bench.flight import FLIGHT_ID, STEP_NS, STEPS_A_SECOND, detection, message, moment, place

TICKS_A_SECOND = STEPS_A_SECOND - 10  # a tick is an observation; decisions come on top
PEOPLE = 40
APART = 997  # seqs of places that lie far enough from each other to be different people


def opening() -> Iterator[Message]:
    """Yield what every flight begins with."""
    config = Config.model_validate({"node": {"keys": "k", "flights": "f", "projections": "p"}})
    yield FlightOpened(
        flight_id=FLIGHT_ID,
        flight_number=1,
        node="bench-node",
        logic=LOGIC,
        configuration=configuration_message(config),
    )
    yield BaselineCarried(state=CarriedState())
    yield NodeStarted(boot_id="bench", start=1)
    yield OriginSet(place=place(0), source="configured")
    yield VehicleLinkChanged(vehicle=1, up=True)
    yield VehicleStateReported(vehicle=1, system_id=1, autopilot=3, vehicle_type=2, armed=True)


def frame(number: int) -> FrameObserved:
    """Return a frame that sees none to five of the people."""
    seen = [detection((number + nth) % PEOPLE * APART) for nth in range(number * 7 % 6)]
    return FrameObserved(
        vehicle=1, camera=1, frame_seq=number, captured_ns=number * STEP_NS, latency_us=31_000, detections=seen
    )


def observation(number: int) -> Message:
    """Return the observation of tick `number`: of 17 a second, ten are frames, two positions, five gimbal."""
    in_second = number % TICKS_A_SECOND
    return frame(number) if in_second < 10 else message(in_second + 10)


def flown(observations: int) -> list[Record]:
    """Return the whole log of a flight with this many ticks, decided by the charts as they are now."""
    state, log, due = State(), list[Record](), None

    def take(at: Moment, body: Message) -> int | None:
        decided = step(state, make_record(state.next_seq.value, NO_CAUSE, at, body))
        log.extend(decided.records)
        return decided.due

    for number, body in enumerate(opening()):
        due = take(moment(number), body)
    for number in range(observations):
        at = moment(number * STEPS_A_SECOND // TICKS_A_SECOND + 10)
        if due is not None and due <= at.flight_ns:
            due = take(at, TimePassed())
        due = take(at, observation(number))
    return log
