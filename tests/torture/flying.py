"""A node's flights as the node records and seals them, without its threads: by seed, on a clock that is moved by hand.

The real `Flights`, `Sealer` and verdicts write the folders. Nothing here checks anything.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from google.protobuf.message import Message

from autopilot.node.board import Board
from autopilot.node.flights import Flights, Identity, Session
from autopilot.node.limits import configuration_message
from autopilot.node.sealing import Sealer
from autopilot.node.verdicts import Verdicts
from events import Record
from events.schema.flight_pb2 import CLOSE_DISARMED, InputsDropped, TimePassed
from events.schema.waypoint_pb2 import NodeStatus
from events.store import read_flight
from replay.verify import verify
from tests.autopilot.node.nodes import FakeClock, config, heard_vehicle, vehicle_state
from tests.autopilot.trust.world import people
from tests.flights import answered, detection, frame, gimbal, point_at_place, position, published

Committed = Callable[[], None]


def nothing(*_: object) -> None:
    """Do nothing."""


@dataclass
class Drone:
    """Node wasp-01 with one flight after the other."""

    root: Path
    seed: int
    committed: Committed = nothing  # told after each commit: of records, or of a checkpoint
    clock: FakeClock = field(default_factory=FakeClock)
    records: list[Record] = field(default_factory=list)  # of the open flight, from its second commit on
    said: list[NodeStatus] = field(default_factory=list)  # everything that was published of its seals

    def __post_init__(self) -> None:
        wasp, self.chance = people().wasp, Random(self.seed)
        identity = Identity(
            node=wasp.principal_id,
            public_key=wasp.public_key,
            deployment_id=wasp.deployment_id,
            software="0.1.0",
            boot_id="boot-1",
            configuration=configuration_message(config()),
        )
        sealer = Sealer(wasp, self.clock, self.chance.randbytes)
        self._flights = Flights(self.root, identity, self.clock, self.chance.randbytes, sealer)
        self._verdicts = Verdicts(self.root, wasp, "0.1.0", Board(self.clock.mono_ns))
        self.session: Session = self._flights.open(nothing)
        self._seal()

    def tell(self, *observations: Message, after_ms: int = 40) -> None:
        """Let time pass, record observations in one commit, and sign where it is time."""
        self.clock.pass_ms(after_ms)
        session, due = self.session, self.session.due
        late = [TimePassed()] if due is not None and session.clock.seconds_until(due) <= 0 else []
        made = [record for one in (*late, *observations) for record in session.observe(one)]
        session.store.append(made)
        self.records += made
        self.committed()
        self._seal()

    def fly(self, steps: int) -> None:
        """Arm, let things happen for so many steps, land."""
        self.tell(*heard_vehicle())
        for number in range(steps):
            self.tell(self._something(number), after_ms=self.chance.choice((40, 200, 900, 2_500)))
        self.tell(vehicle_state(armed=False), after_ms=800)

    def end(self) -> None:
        """Close the flight, begin the next one, and give the closed one its verdict."""
        over = self.session
        self._flights.close(over, CLOSE_DISARMED, nothing)
        self._publish(over)
        self.session = self._flights.follow(over, nothing)
        self.records = []
        reader = read_flight(over.flight.folder)
        self._verdicts._sign(over.flight, verify(reader).plain())
        reader.close()
        self._seal()

    def _seal(self) -> None:
        session = self.session
        assert session.sealing is not None
        armed = any(vehicle.armed for vehicle in session.state.vehicles.values())
        before = session.sealing.newest
        session.sealing.turn(armed=armed, flight_ns=session.clock.peek_ns())
        if session.sealing.newest != before:
            self.committed()
            self._publish(session)

    def _publish(self, session: Session) -> None:
        assert session.sealing is not None
        at_ms = self.clock.wall_ns() // 1_000_000
        said = NodeStatus(at_ms=at_ms, log_checkpoint=session.sealing.newest, log_key=session.sealing.certificate)
        self.said.append(said)

    def _something(self, number: int) -> Message:
        east, north, who = self.chance.randrange(90_000), self.chance.randrange(90_000), self.chance.choice("ab")
        effect = next((one.seq for one in reversed(self.records) if one.kind.port == "vehicle"), 0)
        return self.chance.choice(
            (
                frame(number + 1, detection(40_000 + north % 900, 10_000), detection(east, north, "car", 6_500)),
                position(east, north),
                gimbal(-north % 9_000, east % 9_000, effect, north % 200),
                InputsDropped(input_class="frame", count=1 + north % 9),
                answered(effect),
                published(effect),
                point_at_place(
                    f"o{number}", east, north, order_seq=number + 1, who=who, target_public_key=people().wasp.public_key
                ),
            )
        )
