"""What the tests of flights share: a flight flown, and a node's flights held against what they should be."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from autopilot.ports.edges import InputClass
from events import Record
from events.schema.flight_pb2 import (
    CloseReason,
)
from events.store import flights_in, read_flight
from replay.verify import verify
from statecharts import State, carry_over, restore, steps_of
from tests.autopilot.node.nodes import Node, heard_vehicle, log_of, of_kind, vehicle_state
from tests.flights import answered, point_at_place, published

Begin = Callable[..., Node]


def check_history(root: Path, *expected: tuple[int, str]) -> None:
    """Check the flights below a folder: how many starts each saw and why it ended ("" while it is open).

    Each must replay, begin as a flight does, and go forward in time.
    """
    found = []
    for number, flight in enumerate(flights_in(root), start=1):
        records = log_of(flight)
        assert flight.number == next(of_kind(records, "flight_opened")).flight_number == number
        reader = read_flight(flight.folder)
        assert verify(reader).words().startswith("identical")
        reader.close()
        assert [record.kind.name for record in records[:3]] == ["flight_opened", "baseline_carried", "node_started"]
        times = [record.at.flight_ns for record in records]
        assert times == sorted(times)
        assert times[0] == 0
        closed = [CloseReason.Name(one.reason) for one in of_kind(records, "flight_closed")]
        found.append((sum(1 for _ in of_kind(records, "node_started")), "".join(closed)))
    assert found == list(expected)


def check_hands_over(before: list[Record], after: list[Record]) -> None:
    """Check that a flight carries exactly what the one before handed over, and names its end."""
    baseline = next(of_kind(after, "baseline_carried")).state
    state = State()
    for step in steps_of(before):
        restore(state, step)
    assert baseline == carry_over(state, before[-1].at.flight_ns)
    assert next(of_kind(after, "flight_opened")).previous_seq == before[-1].seq


def check_history_of_newest(root: Path) -> None:
    """Check that the newest log replays."""
    reader = read_flight(flights_in(root)[-1].folder)
    assert verify(reader).words().startswith("identical")
    reader.close()


def fly(node: Node) -> None:
    """Arm, take an order and do it, land."""
    node.tell(*heard_vehicle())
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER, after_ms=50)
    node.tell(answered(node.performed[-1].seq), after_ms=50)
    node.tell(published(node.performed[-1].seq), after_ms=50)
    node.tell(vehicle_state(armed=False), after_ms=1000)
    node.turn(after_ms=200)
