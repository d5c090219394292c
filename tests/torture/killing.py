"""A flight on the demo's stage whose node is killed again and again, while an operator keeps giving orders.

Every order differs from every other, so a man in the middle of the MAVLink link can count how often each arrived at
the aircraft. `fly` gives back what people and aircraft saw; `holding.check` holds it against the log.
"""

from __future__ import annotations

import random
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from autopilot.cli.demonstration.cast import NODE
from autopilot.cli.demonstration.stage import Stage
from autopilot.ground import compose
from autopilot.ground.issuer import Issuer
from autopilot.ground.ledger import Answer, Order
from autopilot.sim.aircraft import HOME
from events.store import read_flight
from tests.torture.middle import Middle

ORDER_LIFE_S = 5.0
ORDERS_APART_S = (0.05, 0.5)
UP_WITHIN_S = 30.0
ACCEPTED_WITHIN_S = 60.0
ALIVE_S = (0.0, 2.4)  # from the first word of a start to the kill
AS_IT_ACTS = 0.5  # part of the kills that wait for a command to leave
STARTING_S = (0.0, 1.2)  # from the start of the process to the kill, where it is killed before its first word


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

    def wait_accepted(self, count: int) -> None:
        """Wait until so many of the orders were accepted. Raises TimeoutError."""
        give_up_at_s = time.monotonic() + ACCEPTED_WITHIN_S
        while sum(order.answer.result == "accepted" for order in list(self.orders)) < count:
            if time.monotonic() > give_up_at_s:
                raise TimeoutError(f"waited {ACCEPTED_WITHIN_S:.0f} s for {count} orders to be accepted")
            self._over.wait(0.1)

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


def fly(
    folder: Path,
    *,
    seconds: float,
    seed: int,
    kills: int,
    starting: float = 0.0,
    land: bool = True,
    accepted: int = 0,
) -> Flown:
    """Fly; kill the node `kills` times, a part of them (`starting`) before it has said its first word.

    It ends when so many orders were `accepted`, also where a slow machine is mostly starting. Raises TimeoutError.
    """
    chance = random.Random(f"kill {seed}")
    flown = Flown(folder / "node" / "flights")
    stage = Stage(folder, seconds, seed)
    middle = Middle(stage.ports.mavlink, random.Random(f"late {seed}"))
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
                _kill(stage, middle, issuer, flown, chance, starting)
            _wait_until_up(issuer, flown.started_ms)
            operator.wait_accepted(accepted)
            if land and issuer.wait_status(NODE, lambda status: not status.armed, seconds + UP_WITHIN_S) is None:
                raise TimeoutError("the aircraft did not land")
            flown.answers = operator.stop()
            assert stage.node.stop() == 0
    finally:
        middle.stop()
    flown.at_aircraft = middle.seen
    return flown


def _kill(stage: Stage, middle: Middle, issuer: Issuer, flown: Flown, chance: random.Random, starting: float) -> None:
    """Let the node live a while, kill it, look at what it left, and start it again.

    Half of those that are up die in the moment in which a command leaves them: what left must be in the log.
    """
    if chance.random() < starting:
        _live_for(chance.uniform(*STARTING_S))
    else:
        _wait_until_up(issuer, flown.started_ms)
        _live_for(chance.uniform(*ALIVE_S))
        middle.pointed.clear()
        if chance.random() < AS_IT_ACTS:
            middle.pointed.wait(ALIVE_S[1])
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
