"""A flight on the demo's stage whose node is killed again and again, while an operator keeps giving orders.

Every order differs from every other, so a man in the middle of the MAVLink link can count how often each arrived at
the aircraft. `fly` gives back what people and aircraft saw; `check` holds it against the log.
"""

from __future__ import annotations

import random
import select
import socket
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from pymavlink.dialects.v20 import common as dialect

from autopilot.cli.demonstration.cast import NODE
from autopilot.cli.demonstration.stage import Stage
from autopilot.ground import compose
from autopilot.ground.issuer import Issuer
from autopilot.ground.ledger import Answer, Order
from autopilot.ports.config import VehicleSection
from autopilot.sim.aircraft import HOME
from events import Record, read_record
from events.schema.orders_pb2 import OrderMalformed
from events.schema.waypoint_pb2 import DeviceCommand
from events.store import flights_in, read_flight
from replay.verify import verify
from statecharts import State, restore, steps_of
from statecharts.charts.command import FINAL

OPERATOR = "k-1"
ORDER_LIFE_S = 5.0
ORDERS_APART_S = (0.05, 0.5)
UP_WITHIN_S = 30.0
ALIVE_S = (0.0, 2.4)  # from the first word of a start to the kill
STARTING_S = (0.0, 1.2)  # from the start of the process to the kill, where it is killed before its first word
ATTEMPTS_MAX = VehicleSection().attempts
POINTING = {
    dialect.MAV_CMD_DO_SET_ROI_LOCATION,
    dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
    dialect.MAV_CMD_DO_SET_ROI_NONE,
}


class Middle(threading.Thread):
    """Passes datagrams between node and aircraft and counts the pointing commands by what they say."""

    def __init__(self, aircraft_port: int) -> None:
        super().__init__(name="middle", daemon=True)
        self.seen: Counter[tuple[int, float, float]] = Counter()
        self._aircraft = ("127.0.0.1", aircraft_port)
        self._node: tuple[str, int] | None = None
        self._inner = _bound()
        self._outer = _bound()
        self._over = threading.Event()
        self.port: int = self._inner.getsockname()[1]

    def stop(self) -> None:
        """End it."""
        self._over.set()
        self.join(5)
        self._inner.close()
        self._outer.close()

    def say(self, datagram: bytes) -> None:
        """Say something to the node in the aircraft's name."""
        assert self._node is not None
        self._inner.sendto(datagram, self._node)

    def run(self) -> None:
        """Pass on until stopped."""
        while not self._over.is_set():
            for ready in select.select([self._inner, self._outer], [], [], 0.2)[0]:
                try:
                    data, sender = ready.recvfrom(2048)
                    self._pass_on(ready, data, sender)
                except OSError:
                    continue  # a dead node's port: the next one has another

    def _pass_on(self, ready: socket.socket, data: bytes, sender: tuple[str, int]) -> None:
        if ready is self._outer:
            if self._node is not None:
                self._inner.sendto(data, self._node)
            return
        self._node = sender
        self._count(data)
        self._outer.sendto(data, self._aircraft)

    def _count(self, data: bytes) -> None:
        for message in dialect.MAVLink(None).parse_buffer(bytearray(data)) or []:
            if message.get_type() == "COMMAND_INT" and message.command in POINTING:
                self.seen[message.command, message.x, message.y] += 1
            if message.get_type() == "COMMAND_LONG" and message.command in POINTING:
                self.seen[message.command, round(message.param1, 3), round(message.param2, 3)] += 1


def _bound() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("127.0.0.1", 0))
    return made


class Operator(threading.Thread):
    """Gives an order every few hundred milliseconds, each to another place, node or no node."""

    def __init__(self, issuer: Issuer, chance: random.Random) -> None:
        super().__init__(name="operator", daemon=True)
        self.orders: list[Order] = []
        self._issuer, self._chance = issuer, chance
        self._over = threading.Event()

    def run(self) -> None:
        """Order until stopped."""
        while not self._over.wait(self._chance.uniform(*ORDERS_APART_S)):
            number = len(self.orders) + 1
            latitude = HOME[0] + number * 1e-6
            command = compose.point_at_place(latitude, HOME[1] + self._chance.uniform(-2e-4, 2e-4), HOME[2])
            self.orders.append(self._issuer.send(NODE, command, ORDER_LIFE_S))

    def stop(self) -> list[tuple[Order, Answer]]:
        """End it, wait for the last answers, and return every order with what was answered."""
        self._over.set()
        self.join(5)
        return [(order, self._issuer.wait(order)) for order in self.orders]


@dataclass
class Flown:
    """What was seen from outside."""

    folder: Path
    answers: list[tuple[Order, Answer]] = field(default_factory=list)
    at_aircraft: Counter[tuple[int, float, float]] = field(default_factory=Counter)
    kills: int = 0
    started_ms: int = 0  # wall clock of the newest start of the process
    lost: list[str] = field(default_factory=list)  # what the status had told and a log did not hold after a kill


def fly(folder: Path, *, seconds: float, seed: int, kills: int, starting: float = 0.0, land: bool = True) -> Flown:
    """Fly; kill the node `kills` times, a part of them (`starting`) before it has said its first word."""
    chance = random.Random(f"kill {seed}")
    flown = Flown(folder / "node" / "flights")
    stage = Stage(folder, seconds, seed)
    middle = Middle(stage.ports.mavlink)
    aircraft, between = f"127.0.0.1:{stage.ports.mavlink}", f"127.0.0.1:{middle.port}"
    stage.config.write_text(stage.config.read_text().replace(aircraft, between))
    middle.start()
    issuer = Issuer(stage.cast.first, [stage.endpoint], reconnect_ms=100)
    try:
        with stage, issuer:
            _wait_until_up(issuer, 0)
            operator = Operator(issuer, chance)
            operator.start()
            for _ in range(kills):
                _kill(stage, issuer, flown, chance, starting)
            _wait_until_up(issuer, flown.started_ms)
            if land and issuer.wait_status(NODE, lambda status: not status.armed, seconds + UP_WITHIN_S) is None:
                raise TimeoutError("the aircraft did not land")
            flown.answers = operator.stop()
            assert stage.node.stop() == 0
    finally:
        middle.stop()
    flown.at_aircraft = middle.seen
    return flown


def check(flown: Flown, *, starts: int | None = None, ends: int = 1) -> Counter[str]:
    """Hold what was seen against the log; return the orders by their final state. Raises AssertionError.

    `starts`: how many starts the flight must have recorded; None: at most one for each start of the process.
    """
    assert flown.lost == []
    (flight,) = flights_in(flown.folder)
    reader = read_flight(flight.folder)
    try:
        assert verify(reader).words().startswith("identical")
        records = [read_record(stored) for stored in reader.stored()]
    finally:
        reader.close()
    recorded = sum(record.kind.name == "node_started" for record in records)
    assert recorded <= flown.kills + 1
    assert starts in (None, recorded)
    assert sum(record.kind.name == "flight_closed" for record in records) == ends
    state = State()
    for step in steps_of(records):
        restore(state, step)
    _check_answers(flown, records, state)
    _check_performed_once(flown, records)
    _check_unknown_after_restart(records, state)
    return Counter(order.state for order in state.orders.values())


def _check_answers(flown: Flown, records: list[Record], state: State) -> None:
    """Check that what people were told is in the log, word for word, and that the log leaves nothing open."""
    told = {order.command_id: (answer.result, answer.detail) for order, answer in flown.answers if _final(answer)}
    kept = {order.command_id: {(order.state, order.detail)} for order in state.orders.values()}
    for record in records:  # before the first fix nothing has a place: such an order can't be read, and is told so
        if isinstance(record.message, OrderMalformed):
            kept.setdefault(record.message.command_id, set()).add(("rejected", record.message.because))
    assert {command_id: said for command_id, said in told.items() if said not in kept.get(command_id, set())} == {}
    assert [order for order in state.orders.values() if order.state not in FINAL] == []


def _final(answer: Answer) -> bool:
    return answer.state == "final"


def _check_performed_once(flown: Flown, records: list[Record]) -> None:
    """Check that each order has at most one effect, and that no more copies of it left than one effect may send."""
    effects = [record.message for record in records if record.kind.name == "point_at_place"]
    of_orders = [effect for effect in effects if effect.order]  # type: ignore[attr-defined]
    assert max(Counter(effect.order for effect in of_orders).values(), default=0) <= 1  # type: ignore[attr-defined]
    places = {(one.place.latitude_e7, one.place.longitude_e7) for one in of_orders}  # type: ignore[attr-defined]
    assert len(places) == len(of_orders)
    roi = dialect.MAV_CMD_DO_SET_ROI_LOCATION
    assert [place for place in places if flown.at_aircraft[roi, *place] > ATTEMPTS_MAX] == []
    asked = {(order_place(order)) for order, _ in flown.answers}
    strangers = [key for key in flown.at_aircraft if key[0] == roi and key[1:] in asked - places]
    assert strangers == []  # nothing left for the aircraft that the log does not hold


def _check_unknown_after_restart(records: list[Record], state: State) -> None:
    """Check that exactly the orders that a start found underway are answered so."""
    underway: set[str] = set()
    found: set[str] = set()
    for record in records:
        if record.kind.name == "node_started":
            found |= underway
        elif record.kind.name == "moved" and record.message.chart == "command":  # type: ignore[attr-defined]
            key, to_state = record.message.instance, record.message.to_state  # type: ignore[attr-defined]
            underway = underway - {key} if to_state in FINAL else underway | {key}
    unknown = {key for key, order in state.orders.items() if order.detail == "unknown after restart"}
    assert unknown == found
    assert {state.orders[key].state for key in unknown} <= {"timeout"}


def order_place(order: Order) -> tuple[int, int]:
    """Return where an order points, in 1e-7 degrees."""
    roi = DeviceCommand.FromString(order.content).camera_roi
    return roi.lat_e7, roi.lon_e7


def _kill(stage: Stage, issuer: Issuer, flown: Flown, chance: random.Random, starting: float) -> None:
    """Let the node live a while, kill it, look at what it left, and start it again."""
    if chance.random() < starting:
        _live_for(chance.uniform(*STARTING_S))
    else:
        _wait_until_up(issuer, flown.started_ms)
        _live_for(chance.uniform(*ALIVE_S))
    told = issuer.status(NODE)
    assert stage.node.running
    stage.node.kill()
    flown.kills += 1
    reader = read_flight(stage.flight)
    if told is not None and told.status.flight_id == reader.flight_id and told.status.head_seq > reader.head.seq:
        flown.lost.append(f"kill {flown.kills}: {told.status.head_seq} was told, the log ends at {reader.head.seq}")
    reader.close()
    flown.started_ms = time.time_ns() // 1_000_000
    stage.node.start()


def _wait_until_up(issuer: Issuer, since_ms: int) -> None:
    """Wait for a status of the newest start. Raises TimeoutError."""
    if issuer.wait_status(NODE, lambda status: status.at_ms > since_ms, UP_WITHIN_S) is None:
        raise TimeoutError("the node did not come up")


def _live_for(seconds: float) -> None:
    """Let a seeded moment come: there is nothing to wait for, that is the point."""
    threading.Event().wait(seconds)
