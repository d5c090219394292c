"""A boot that finds disarmed what was recorded armed: the flight is closed as abandoned, and the next begins."""

from __future__ import annotations

from pathlib import Path

import pytest

from autopilot.ports.edges import InputClass
from events.schema.flight_pb2 import CLOSE_ABANDONED
from events.schema.vehicle_pb2 import VehicleLinkChanged
from tests.autopilot.node.histories import Begin, check_hands_over, check_history
from tests.autopilot.node.nodes import FakeClock, Node, heard_vehicle, of_kind, vehicle_state
from tests.flights import answered, point_at_place, published


@pytest.fixture
def left(begin: Begin, clock: FakeClock) -> Node:
    """Return a node that was killed in the air, its computer off for a minute and up again."""
    node = begin().start()
    node.tell(*heard_vehicle())
    node.turn(after_ms=200)
    node.kill()
    clock.wall += 65_000_000_000
    clock.mono = 5_000_000_000
    return node


def check_abandoned(node: Node, root: Path, starts: int) -> None:
    """Check that the first flight was left and the second begins with what it hands over."""
    check_history(root, (starts, "CLOSE_ABANDONED"), (1, ""))
    check_hands_over(node.log(0), node.log(1))
    assert node.session.flight.number == 2
    assert not node.session.arming.abandoned
    assert CLOSE_ABANDONED == 3


def test_found_disarmed_after_a_boot_the_flight_is_abandoned(begin: Begin, left: Node, tmp_path: Path) -> None:
    """At the first word of the vehicle; the log of the old flight holds it, and the new one is told what stands."""
    again = begin(boot_id="boot-2").start()
    again.tell(VehicleLinkChanged(vehicle=1, up=True))
    check_history(tmp_path, (2, ""))
    again.tell(vehicle_state(armed=False))
    again.turn(after_ms=200)
    check_abandoned(again, tmp_path, starts=2)
    assert again.kinds(0)[-2:] == ["vehicle_state_reported", "flight_closed"]
    again.turn(after_ms=200)
    assert again.kinds(1)[3:5] == ["vehicle_link_changed", "vehicle_state_reported"]
    again.turn(after_ms=200_000)
    check_history(tmp_path, (2, "CLOSE_ABANDONED"), (1, ""))


def test_a_start_in_between_changes_nothing(begin: Begin, left: Node, tmp_path: Path) -> None:
    """Killed before the vehicle spoke, and after it did: what was found is in the log, or still to be found."""
    second = begin(boot_id="boot-2").start()
    second.kill()
    third = begin(boot_id="boot-2").start()
    third.inbox.offer(InputClass.OUTCOME, vehicle_state(armed=False))
    third.loop._observe(third.session, third.inbox.take(0, 9))
    third.clock.pass_ms(200)
    third.loop._observe(third.session, [])  # durable, and killed before the flight could be closed
    third.kill()
    check_history(tmp_path, (3, ""))
    fourth = begin(boot_id="boot-2").start()
    fourth.turn()
    check_abandoned(fourth, tmp_path, starts=4)


def test_found_armed_it_goes_on_and_a_landing_afterwards_is_one(begin: Begin, left: Node, tmp_path: Path) -> None:
    """A computer that started again in the air: the flight is not over, and ends as any other."""
    again = begin(boot_id="boot-2").start()
    again.tell(vehicle_state(armed=True))
    again.turn(after_ms=200)
    again.tell(vehicle_state(armed=False), after_ms=60_000)
    again.turn(after_ms=200)
    again.turn(after_ms=179_000)
    check_history(tmp_path, (2, ""))
    again.turn(after_ms=1_000)
    check_history(tmp_path, (2, "CLOSE_DISARMED"), (1, ""))


def test_a_landing_in_the_same_boot_is_no_abandonment(begin: Begin, tmp_path: Path) -> None:
    """Another start of the daemon alone: the computer ran on, nobody pulled a battery."""
    node = begin().start()
    node.tell(*heard_vehicle())
    node.turn(after_ms=200)
    node.kill()
    again = begin().start()
    again.tell(vehicle_state(armed=False))
    again.turn(after_ms=200)
    check_history(tmp_path, (2, ""))
    assert not again.session.arming.abandoned


def test_armed_again_it_is_not_closed(begin: Begin, left: Node, tmp_path: Path) -> None:
    """While an answer is awaited the vehicle takes off again: a flight is not cut in the air."""
    again = begin(boot_id="boot-2").start()
    again.tell(point_at_place("a1", roles=()), input_class=InputClass.ORDER)
    again.tell(vehicle_state(armed=False))
    again.turn(after_ms=200)
    check_history(tmp_path, (2, ""))
    assert again.session.arming.abandoned
    again.tell(vehicle_state(armed=True))
    again.turn(after_ms=200)
    again.tell(published(again.performed[-1].seq))
    again.turn(after_ms=200)
    again.tell(vehicle_state(armed=False))
    again.turn(after_ms=200)
    check_history(tmp_path, (2, ""))  # this landing is one of this boot
    again.turn(after_ms=181_000)
    check_history(tmp_path, (2, "CLOSE_DISARMED"), (1, ""))


def test_what_is_underway_is_awaited_first(begin: Begin, left: Node, tmp_path: Path) -> None:
    """An order that came in one breath with the finding is performed, and its outcome is the old flight's."""
    again = begin(boot_id="boot-2").start()
    again.tell(VehicleLinkChanged(vehicle=1, up=True))
    again.inbox.offer(InputClass.ORDER, point_at_place("a1"))
    again.tell(vehicle_state(armed=False))
    check_history(tmp_path, (2, ""))
    (effect,) = [one.seq for one in again.performed if one.kind.name == "point_at_place"]
    again.tell(answered(effect))
    again.tell(published(again.performed[-1].seq))
    again.turn(after_ms=200)
    check_abandoned(again, tmp_path, starts=2)
    assert [one.effect_seq for one in of_kind(again.log(0), "command_answered")] == [effect]
    assert list(of_kind(again.log(1), "command_answered")) == []
    carried = next(of_kind(again.log(1), "baseline_carried")).state
    assert [(one.command_id, one.chart_state) for one in carried.orders] == [("a1", "accepted")]
