"""A node that keeps snapshots, for the tests of these: with a board, and a keeper, and a while of flight."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from autopilot.node import restoring
from autopilot.node.board import Board
from autopilot.node.flights import Flights
from autopilot.node.restoring import Keeper
from autopilot.node.sealing import Sealer
from autopilot.ports.edges import InputClass
from tests.autopilot.node.nodes import BOOT, FakeClock, Node, chance, heard_vehicle, identity
from tests.autopilot.trust.world import people
from tests.flights import answered, detection, frame, point_at_place, position

SOFTWARE = "0.1.0"


class Shown(Node):
    """A node with a board and a keeper."""

    def __init__(self, root: Path, clock: FakeClock, patch: pytest.MonkeyPatch, random: Any, **values: Any) -> None:
        software = values.pop("software", SOFTWARE)
        keeps = values.pop("keeps", True)
        super().__init__(root, clock, patch, random=random, **values)
        self.board = Board(lambda: 0)
        sealer = Sealer(people().wasp, clock, random)
        keeper = Keeper(sealer, software, lambda: self.board.folded, self.board.recall)
        boot = values.get("boot_id", BOOT)
        flights = Flights(root, identity(boot), clock, random, sealer, keeper=keeper if keeps else None)
        self.loop._flights = self.flights = flights
        self.loop._on_records = self.hear

    def hear(self, records: tuple[Any, ...]) -> None:
        """Keep and show records."""
        self.heard.extend(records)
        self.board.hear(records)

    def start(self) -> Shown:
        """Open a flight, as the loop's thread does first."""
        self.loop._open(self.flights.open(self.hear))
        return self


Begin = Callable[..., Shown]


def starts(root: Path, clock: FakeClock, patch: pytest.MonkeyPatch) -> Begin:
    """Return what makes the next start of the daemon, with a snapshot every ten records."""
    random = chance()
    patch.setattr(restoring, "EVERY_RECORDS", 10)
    patch.setattr(restoring, "LONG", 3)
    home = root / "home"
    return lambda root=home, **values: Shown(root, clock, patch, random, **values)


def busy(node: Shown, turns: int = 12) -> None:
    """Fly for a while: orders, findings, a checkpoint every ten seconds."""
    node.tell(*heard_vehicle())
    node.turn(after_ms=200)
    for number in range(turns):
        order = point_at_place(f"a{number}", order_seq=number + 1)
        node.tell(order, input_class=InputClass.ORDER, after_ms=3_000)
        node.tell(answered(node.performed[-1].seq), position(number, number), after_ms=3_000)
        node.tell(frame(number, detection(number * 20_000, 0), detection(0, 9_000 * number, "car")), after_ms=3_500)
        node.turn(after_ms=600)
