"""The loop: write, then act; what is committed when; timers as observations; a slow disk and a dead one."""

from __future__ import annotations

import gc
import os
from pathlib import Path

import pytest

from autopilot.node.daemon import _exit_code
from autopilot.node.loop import Stop
from autopilot.ports.edges import InputClass
from events.schema.flight_pb2 import CLOSE_DISK_FULL, CLOSE_STOPPED, InputsDropped, OriginSet
from events.schema.vehicle_pb2 import GimbalReported
from events.store import StoreFailed
from tests.autopilot.node.nodes import FakeClock, Node, config, heard_vehicle, of_kind, vehicle_state
from tests.flights import answered, frame, gimbal, place, point_at_place, published, received, sent


@pytest.fixture
def node(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Node:
    """Return a node that records and hears its vehicle."""
    node = Node(tmp_path, FakeClock(), monkeypatch).start()
    node.tell(*heard_vehicle())
    node.turn(after_ms=200)
    return node


def check_written_before_performed(node: Node) -> None:
    """Check that every effect was handed over once, and only after the append that holds it had returned."""
    durable = -1
    performed = []
    for line in node.disk.happened:
        what, _, numbers = line.partition(" ")
        if what == "append":
            durable = int(numbers.partition("-")[2])
        else:
            assert int(numbers) <= durable, node.disk.happened
            performed.append(int(numbers))
    effects = [record.seq for record in node.log() if record.kind.port]
    assert performed == effects


def appends(node: Node) -> int:
    """Return how often was written."""
    return node.disk.appends


def test_an_order_is_durable_and_then_performed(node: Node) -> None:
    """SYNC and effect: at once, before anything leaves."""
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER)
    assert node.kinds().count("point_at_place") == 1
    assert [record.kind.name for record in node.performed] == ["point_at_place"]
    check_written_before_performed(node)


def test_no_garbage_is_collected_between_an_order_and_its_effects(node: Node, monkeypatch: pytest.MonkeyPatch) -> None:
    """From then on it is, also where the turn ends with a defect."""
    seen: list[tuple[str, bool]] = []
    monkeypatch.setattr(node.loop, "_perform", lambda record: seen.append((record.kind.name, gc.isenabled())))
    monkeypatch.setattr(node.loop, "_on_records", lambda _: seen.append(("noted", gc.isenabled())))
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER)
    assert seen == [("point_at_place", False), ("send_ack", False), ("noted", True)]
    assert gc.isenabled()

    def fails(_: object) -> None:
        assert not gc.isenabled()
        raise StoreFailed("for a test")

    monkeypatch.setattr(node.session.store, "append", fails)
    with pytest.raises(StoreFailed):
        node.tell(point_at_place("a2", order_seq=2), input_class=InputClass.ORDER)
    assert gc.isenabled()


def test_how_far_an_order_got_waits_for_the_next_commit(node: Node) -> None:
    """What is not the last word makes no commit of its own, and nobody is told whether it left."""
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER)
    effect, before = node.performed[-1].seq, appends(node)
    node.tell(sent(effect))
    assert appends(node) == before
    node.tell(answered(effect))
    assert appends(node) == before + 1
    acks = [one for one in node.disk.happened if one.startswith("perform")]
    assert len(acks) == 4  # the effect, received, sent, the last word
    assert node.loop._awaited == {node.performed[-1].seq}


def test_what_must_not_be_lost_is_durable_at_once(node: Node) -> None:
    """SYNC, though nothing leaves."""
    before = appends(node)
    node.tell(OriginSet(place=place(0, 0), source="configured"))
    assert appends(node) == before + 1
    assert node.performed == []


def test_a_group_of_orders_is_one_commit(node: Node) -> None:
    """Orders that wait together are written together; each is still performed by itself."""
    before = appends(node)
    orders = [point_at_place(f"a{number}", who=f"who{number}") for number in range(5)]
    node.tell(*orders, input_class=InputClass.ORDER)
    assert appends(node) == before + 1
    assert len(node.performed) == 5
    check_written_before_performed(node)


def test_what_is_not_urgent_is_durable_within_the_group_time(node: Node) -> None:
    """Telemetry waits for others, at most commit_within_ms; the loop wakes up for it."""
    before = appends(node)
    node.tell(gimbal(0, 0), input_class=InputClass.TELEMETRY)
    node.tell(gimbal(100, 0), input_class=InputClass.TELEMETRY, after_ms=60)
    assert appends(node) == before
    node.turn(after_ms=30)
    assert node.inbox.wanted_s == pytest.approx(0.01)
    assert appends(node) == before
    node.turn(after_ms=10)
    assert appends(node) == before + 1
    assert [type(record.message) for record in node.log()[-2:]] == [GimbalReported] * 2


def test_what_waits_goes_with_an_order(node: Node) -> None:
    """An urgent record takes everything before it along: order is by seq."""
    before = appends(node)
    node.tell(gimbal(0, 0), input_class=InputClass.TELEMETRY)
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER, after_ms=1)
    assert appends(node) == before + 1
    kinds = node.kinds()
    assert kinds.index("gimbal_reported") < kinds.index("order_received")


def test_what_was_dropped_is_an_observation(node: Node) -> None:
    """Frames overflow by dropping the oldest; how many is in the log."""
    bound = config().limits.inbox_frames
    for number in range(bound + 7):
        assert node.inbox.offer(InputClass.FRAME, frame(number))
    node.turn()
    node.turn(after_ms=200)
    assert list(of_kind(node.log(), "inputs_dropped")) == [InputsDropped(input_class="frame", count=7)]
    assert [one.frame_seq for one in of_kind(node.log(), "frame_observed")] == list(range(7, bound + 7))
    node.turn(after_ms=200)
    assert node.kinds().count("inputs_dropped") == 1


def test_a_deadline_that_passes_is_one_observation(node: Node) -> None:
    """The loop sleeps exactly until the core's deadline and says so once."""
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER)
    node.tell(sent(node.performed[-1].seq), answered(node.performed[-1].seq))
    node.turn(after_ms=200)
    due = node.session.due
    assert due is not None
    left_ms = node.session.clock.seconds_until(due) * 1000
    node.turn(after_ms=left_ms - 500)
    assert node.inbox.wanted_s == pytest.approx(0.5)
    assert "time_passed" not in node.kinds()
    node.turn(after_ms=500)
    node.turn(after_ms=200)
    assert node.kinds().count("time_passed") == 1
    passed = next(record for record in node.log() if record.kind.name == "time_passed")
    assert passed.at.flight_ns >= due


def test_a_disk_that_fails_ends_the_loop_and_nothing_of_it_is_performed(node: Node) -> None:
    """No effect leaves before its record is durable; a process whose write failed once writes no more."""
    node.disk.fails_at = node.disk.appends
    node.inbox.offer(InputClass.ORDER, point_at_place("a1"))
    node.loop._flights = _Opened(node)  # type: ignore[assignment]
    node.loop.run()
    assert node.loop.failure is not None
    assert (node.ended, node.performed) == (True, [])
    assert "order_received" not in node.kinds()
    assert _exit_code(node.loop, None) == os.EX_IOERR


def run_to_failure(node: Node) -> StoreFailed:
    """Go round until the loop gives up."""
    with pytest.raises(StoreFailed) as failed:
        node.turn()
    return failed.value


def test_a_full_disk_on_the_ground_closes_the_flight_in_order(node: Node) -> None:
    """It is told, no order is taken any more, and the process ends with the flight closed."""
    node.tell(vehicle_state(armed=False))
    node.turn(after_ms=200)
    node.session.store._store._reserve.give_up()  # type: ignore[attr-defined]
    assert "the disk is full" in str(run_to_failure(node))
    assert node.kinds()[-2:] == ["disk_full", "flight_closed"]
    assert [one.reason for one in of_kind(node.log(), "flight_closed")] == [CLOSE_DISK_FULL]
    assert not node.inbox.offer(InputClass.ORDER, point_at_place("a1"))


def test_a_full_disk_in_the_air_does_not_end_the_flight(node: Node) -> None:
    """It is told once, orders are refused, what happens is recorded on; once disarmed the flight is closed."""
    node.session.store._store._reserve.give_up()  # type: ignore[attr-defined]
    node.turn()
    node.turn()
    assert not node.inbox.offer(InputClass.ORDER, point_at_place("a1"))
    node.tell(gimbal(0, 0), input_class=InputClass.TELEMETRY)
    node.turn(after_ms=200)
    assert node.kinds()[-3:] == ["disk_full", "inputs_dropped", "gimbal_reported"]
    assert node.inbox.offer(InputClass.OUTCOME, vehicle_state(armed=False))
    run_to_failure(node)
    assert node.kinds()[-2:] == ["vehicle_state_reported", "flight_closed"]
    assert node.kinds().count("disk_full") == 1


class _Opened:
    """Flights of a node that has one open already."""

    def __init__(self, node: Node) -> None:
        self._node = node

    def open(self, _on_records: object) -> object:
        """Return the open session."""
        return self._node.session


def test_a_defect_ends_the_loop_with_its_traceback(node: Node, capsys: pytest.CaptureFixture[str]) -> None:
    """Not a silent thread."""

    def broken(_record: object) -> None:
        raise RuntimeError("broken for a test")

    node.loop._perform = broken
    node.inbox.offer(InputClass.ORDER, point_at_place("a1"))
    node.loop._flights = _Opened(node)  # type: ignore[assignment]
    node.loop.run()
    assert (node.ended, node.loop.failure) == (True, None)
    assert _exit_code(node.loop, None) == os.EX_SOFTWARE
    assert "broken for a test" in capsys.readouterr().err


def check_stalled(node: Node) -> None:
    """Check that a slow commit closes the door for orders, and for orders only."""
    node.disk.takes_ms = 2_100
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER)
    node.disk.takes_ms = 5
    assert not node.inbox.offer(InputClass.ORDER, point_at_place("a2"))
    assert node.inbox.offer(InputClass.OUTCOME, sent(node.performed[-1].seq))


def test_a_stalled_disk_refuses_orders_until_a_commit_is_quick_again(node: Node) -> None:
    """The next commit tells whether the disk has recovered."""
    check_stalled(node)
    node.turn(after_ms=10)
    assert not node.inbox.offer(InputClass.ORDER, point_at_place("a2"))
    node.tell(gimbal(0, 0), input_class=InputClass.TELEMETRY, after_ms=200)
    assert node.inbox.offer(InputClass.ORDER, point_at_place("a2"))


def test_a_group_that_is_written_slowly_closes_the_door_too(node: Node) -> None:
    """Whichever commit it is that stalls, also one that the clock asked for."""
    node.tell(gimbal(0, 0), input_class=InputClass.TELEMETRY)
    node.disk.takes_ms = 2_100
    node.turn(after_ms=200)
    assert not node.inbox.offer(InputClass.ORDER, point_at_place("a2"))


def test_a_node_that_has_nothing_to_write_takes_orders_again(node: Node) -> None:
    """Without telemetry there is no next commit: a quiet second opens the door, or no order ever came again."""
    check_stalled(node)
    node.inbox.take(0, 8)
    node.inbox.take_dropped()
    node.turn(after_ms=1000)
    assert node.inbox.offer(InputClass.ORDER, point_at_place("a2"))


def test_an_order_that_was_refused_is_counted_and_its_record_asks_the_disk(node: Node) -> None:
    """Nothing else is to be written: the count itself is the next commit, and a quick one opens the door."""
    check_stalled(node)
    node.inbox.take(0, 8)
    node.turn(after_ms=10)
    assert not node.inbox.offer(InputClass.ORDER, point_at_place("a2"))
    node.turn(after_ms=200)
    assert node.inbox.offer(InputClass.ORDER, point_at_place("a2"))
    assert list(of_kind(node.log(), "inputs_dropped")) == [InputsDropped(input_class="order", count=1)]


def test_a_flood_of_refusals_is_a_record_a_second(node: Node) -> None:
    """Counts must not fill what is left of a disk; at the end whatever is still to be told is told."""
    node.inbox.close_to_orders()
    for _ in range(40):
        node.inbox.offer(InputClass.ORDER, point_at_place("a1"))
        node.turn(after_ms=50)
    told = [one.count for one in of_kind(node.log(), "inputs_dropped")]
    assert told == [1, 20]
    node.loop._finish(node.session, Stop(CLOSE_STOPPED))
    assert sum(one.count for one in of_kind(node.log(), "inputs_dropped")) == 40


def test_stop_records_what_waits_and_closes_on_the_ground(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the inbox holds is in the log before its end."""
    node = Node(tmp_path, FakeClock(), monkeypatch)
    node.loop.stop(Stop(CLOSE_STOPPED))
    for number in range(100):
        node.inbox.offer(InputClass.TELEMETRY, gimbal(number, 0))
    node.loop.run()
    assert node.kinds()[-1] == "flight_closed"
    assert node.kinds().count("gimbal_reported") == 100
    assert (node.ended, node.loop.failure, node.loop.defect) == (True, None, "")


def test_an_answer_is_sealed_only_when_it_is_durable(node: Node) -> None:
    """Refusals too: what people are told must still be true after a restart."""
    node.tell(received("u1"), input_class=InputClass.ORDER)
    assert [record.kind.name for record in node.performed] == ["send_ack"]
    check_written_before_performed(node)
    node.tell(published(node.performed[-1].seq))


def test_the_loop_says_when_it_last_went_round(node: Node) -> None:
    """The vehicle's heartbeat depends on it."""
    before = node.loop.turned_ns
    node.turn(after_ms=700)
    assert node.loop.turned_ns == before + 700_000_000
