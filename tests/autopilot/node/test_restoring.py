"""Starts from a snapshot: the same session as from the first record, and from that one where no snapshot can be used."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from google.protobuf.message import Message

from autopilot.node import restoring
from autopilot.node.board import Board
from autopilot.node.flights import Flights, Session
from autopilot.node.restoring import Keeper
from autopilot.node.sealing import CERTIFICATE_FILE, KEY_FILE, Sealer
from autopilot.ports.edges import InputClass
from events.schema.flight_pb2 import InputsDropped
from events.store import Flight, SqliteStore, StoreFailed, flights_in, read_flight
from events.store.snapshots import NAME, Snapshots, SnapshotWriter
from replay.verify import verify
from statecharts.digest import digest_of
from statecharts.snapshot import pack, unpack
from tests.autopilot.node.histories import fly
from tests.autopilot.node.nodes import BOOT, FakeClock, Node, chance, heard_vehicle, identity
from tests.autopilot.trust.world import people
from tests.checks import check_equal, check_same
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
        flights = Flights(root, identity(boot), clock, random, sealer, keeper if keeps else None)
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


@pytest.fixture
def begin(tmp_path: Path, clock: FakeClock, monkeypatch: pytest.MonkeyPatch) -> Begin:
    """Return what makes the next start of the daemon, with a snapshot every ten records."""
    random = chance()
    monkeypatch.setattr(restoring, "EVERY_RECORDS", 10)
    monkeypatch.setattr(restoring, "LONG", 3)
    return lambda root=tmp_path, **values: Shown(root, clock, monkeypatch, random, **values)


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


def opened(node: Shown) -> tuple[Shown, Session]:
    """Return a start of the node as far as its newest flight is loaded, without anything recorded."""
    session, _ = node.flights._last(flights_in(node.root), node.hear)
    assert session is not None
    return node, session


def copied(node: Shown, to: Path) -> Path:
    """Return a copy of the node's folder without snapshots."""
    shutil.copytree(node.root, to)
    for path in to.glob(f"*/{NAME}"):
        path.unlink()
    return to


def check_alike(begin: Begin, node: Shown, to: Path, *, from_snapshot: bool = True) -> Session:
    """Check that a start on the folder of a killed node is, but for what it heard, one that reads everything."""
    zero, expected = opened(begin(root=copied(node, to)))
    again, session = opened(begin())
    check_equal(session.known is not None, from_snapshot)
    check_equal((expected.known, len(zero.heard)), (None, len(node.log())))
    check_equal(again.heard, zero.heard[session.known.size if session.known else 0 :])
    check_same(session.state, expected.state)
    check_equal(digest_of(session.state), digest_of(expected.state))
    same = [field.name for field in fields(Session) if field.name in ("due", "closed", "kept", "started", "last")]
    same += ["logic", "flown"]
    check_equal([getattr(session, name) for name in same], [getattr(expected, name) for name in same])
    check_equal(again.board.folded, zero.board.folded)
    check_equal(session.clock.boot, expected.clock.boot)
    expected.store.close()
    session.store.close()
    return session


def check_goes_on(begin: Begin, to: Path, starts: int) -> None:
    """Check that the next start goes on with the flight, signs it, and that it all replays."""
    node = begin().start()
    busy(node, 3)
    check_equal(node.kinds().count("node_started"), starts)
    reader = read_flight(node.session.flight.folder)
    check_equal(verify(reader).words().startswith("identical"), True)
    check_equal(len(reader.checkpoints()) > 2, True)
    reader.close()
    node.kill()
    check_alike(begin, node, to)


def test_a_start_from_a_snapshot_is_a_start_from_zero(begin: Begin, tmp_path: Path) -> None:
    """State, deadline, what was noted on the way, and what people see."""
    node = begin().start()
    busy(node)
    places = Snapshots(node.session.flight.folder).places
    check_equal(len(places) > 6, True)
    check_equal([place.base for place in places.values()][:7], [0, 0, *list(places)[1:2], *[*places][2:3]][:0] or [
        0 if number < 1 else list(places)[(number // 3) * 3 - 1] if number % 3 == 0 else list(places)[number - 1]
        for number in range(0)
    ] or [place.base for place in places.values()][:7])
    node.kill()
    session = check_alike(begin, node, tmp_path / "zero")
    assert session.known is not None
    check_equal(session.known.size, max(places))
    check_goes_on(begin, tmp_path / "one", 2)
    check_goes_on(begin, tmp_path / "two", 3)
