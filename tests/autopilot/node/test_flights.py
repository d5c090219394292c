"""Where flights begin, go on and end: over starts of the daemon, boots, landings, and writes that are cut short."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from autopilot.node import flights as flights_module
from autopilot.node.flights import Session
from autopilot.node.limits import digest
from autopilot.node.loop import Stop
from autopilot.ports.edges import InputClass
from events import Record
from events.chain import FIRST_LEAF_BEFORE
from events.schema.flight_pb2 import (
    CLOSE_DISARMED,
    CLOSE_INPUT_ENDED,
    CLOSE_LOGIC_CHANGED,
    CLOSE_REBOOTED,
    CLOSE_STOPPED,
    CloseReason,
    FlightOpened,
    NodeStarted,
)
from events.store import StoreFailed, flights_in, read_flight
from replay.verify import verify
from statecharts import LOGIC, State, carry_over, charts_digest, restore, steps_of
from tests.autopilot.node.nodes import FakeClock, Node, chance, config, heard_vehicle, log_of, of_kind, vehicle_state
from tests.checks import check_same
from tests.flights import answered, place, point_at_place, published

Begin = Callable[..., Node]


@pytest.fixture
def clock() -> FakeClock:
    return FakeClock()


@pytest.fixture
def begin(tmp_path: Path, clock: FakeClock, monkeypatch: pytest.MonkeyPatch) -> Begin:
    """Return what makes the next start of the daemon; all starts share folder, clock and source of chance."""
    random = chance()

    def start(**values: str) -> Node:
        return Node(tmp_path, clock, monkeypatch, random=random, **values)  # type: ignore[arg-type]

    return start


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


def fly(node: Node) -> None:
    """Arm, take an order and do it, land."""
    node.tell(*heard_vehicle())
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER, after_ms=50)
    node.tell(answered(node.performed[-1].seq), after_ms=50)
    node.tell(published(node.performed[-1].seq), after_ms=50)
    node.tell(vehicle_state(armed=False), after_ms=1000)
    node.turn(after_ms=200)


def test_the_first_flight_has_a_manifest_and_an_empty_baseline(begin: Begin, tmp_path: Path) -> None:
    """What is needed to replay it, and nothing of a flight before."""
    node = begin().start()
    manifest = next(of_kind(node.log(), "flight_opened"))
    assert (manifest.flight_number, manifest.flight_id, manifest.logic) == (1, b"\x01" * 16, LOGIC)
    assert manifest.charts_digest == charts_digest()
    assert manifest.configuration.digest == digest(config())
    assert (manifest.previous_flight_id, manifest.previous_leaf) == (b"", b"")
    assert node.session.flight.folder.name == "000001-01010101"
    assert next(of_kind(node.log(), "baseline_carried")).ByteSize() == 2
    assert list(of_kind(node.log(), "node_started")) == [NodeStarted(boot_id="boot-1", start=1, outage_ns=0)]
    assert node.disk.appends == 1  # whole or not at all: a log with half an opening could not go on
    check_history(tmp_path, (1, ""))


def test_flight_time_never_goes_back(begin: Begin, clock: FakeClock, tmp_path: Path) -> None:
    """Whatever the machine's clock does."""
    node = begin().start()
    node.tell(*heard_vehicle(), after_ms=9_000)
    clock.mono -= 5_000_000_000
    node.tell(vehicle_state(armed=False))
    node.turn(after_ms=200)
    node.turn(after_ms=200)
    check_history(tmp_path, (1, ""))
    assert len(node.log()) == 7


def test_a_start_in_the_same_boot_goes_on(begin: Begin, clock: FakeClock, tmp_path: Path) -> None:
    """Flight time counts on over the outage, and how long it was is recorded."""
    node = begin().start()
    node.tell(*heard_vehicle(), after_ms=100)
    node.turn(after_ms=200)
    last = node.log()[-1].at
    node.kill()
    clock.pass_ms(7_000)
    again = begin().start()
    clock.pass_ms(1)
    started = [record for record in again.log() if record.kind.name == "node_started"]
    gone_ns = clock.mono - 1_000_000 - last.mono_ns
    assert [record.message for record in started] == [
        NodeStarted(boot_id="boot-1", start=1, outage_ns=0),
        NodeStarted(boot_id="boot-1", start=2, outage_ns=gone_ns),
    ]
    assert started[1].at.flight_ns == last.flight_ns + gone_ns
    assert started[1].at.boot == last.boot == 1
    assert again.session.state.vehicles[1].armed
    assert again.heard[: len(node.heard)] == node.heard
    check_history(tmp_path, (2, ""))


def test_a_start_goes_on_by_evolving_only(begin: Begin) -> None:
    """The state after a restart is the state before, and the log's tail is what was durable."""
    node = begin().start()
    node.tell(*heard_vehicle())
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER, after_ms=50)
    node.tell(vehicle_state(armed=True))  # not committed yet: it dies with the process
    durable = State()
    for step in steps_of(node.log()):
        restore(durable, step)
    node.kill()
    again = begin()
    session = again.flights._last(flights_in(again.root), again.heard.extend)
    assert session is not None
    check_same(durable, session.state)


def test_an_order_without_an_outcome_is_answered_and_not_sent_again(begin: Begin) -> None:
    """Unknown after restart; its pointing is never performed again."""
    node = begin().start()
    node.tell(*heard_vehicle())
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER, after_ms=50)
    assert [record.kind.name for record in node.performed] == ["point_at_place"]
    node.kill()
    again = begin().start()
    assert [one.detail for one in of_kind(again.performed, "send_ack")] == ["unknown after restart"]
    assert len(again.performed) == 1
    assert again.kinds().count("point_at_place") == 1
    again.kill()
    third = begin().start()
    assert [one.kind.name for one in third.performed] == ["send_ack"]  # still owed: nothing says that it left


@pytest.mark.parametrize("later_ms", [0, -40_000])
def test_another_boot_is_another_flight(begin: Begin, clock: FakeClock, tmp_path: Path, later_ms: int) -> None:
    """The old one is closed where it stood, its time goes back for nothing, and what it knew is carried over."""
    node = begin().start()
    fly(node)
    node.kill()
    clock.mono += later_ms * 1_000_000  # monotonic time begins anew, here later, there earlier than it stood
    again = begin(boot_id="boot-2").start()
    check_history(tmp_path, (1, "CLOSE_REBOOTED"), (1, ""))
    check_hands_over(again.log(0), again.log(1))
    closed = again.log(0)[-1].at
    assert (closed.boot, closed.flight_ns) == (2, again.log(0)[-2].at.flight_ns)
    assert [record.at.boot for record in again.log(1)] == [2] * len(again.log(1))
    assert next(of_kind(again.log(1), "node_started")).boot_id == "boot-2"
    again.kill()
    assert begin(boot_id="boot-3").start().log(2)[0].at.boot == 3


def test_another_logic_on_the_ground_is_another_flight(
    begin: Begin, clock: FakeClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was told stays true: the new charts do not go on with the old ones' flight."""
    node = begin().start()
    fly(node)
    node.kill()
    clock.pass_ms(3_000)
    monkeypatch.setattr(flights_module, "LOGIC", LOGIC + 1)
    again = begin().start()
    check_history(tmp_path, (1, "CLOSE_LOGIC_CHANGED"), (1, ""))
    check_hands_over(again.log(0), again.log(1))
    assert next(of_kind(again.log(1), "flight_opened")).logic == LOGIC + 1
    assert again.log(0)[-1].at.flight_ns > again.log(0)[-2].at.flight_ns + 2_900_000_000
    assert [CLOSE_LOGIC_CHANGED, CLOSE_REBOOTED] == [4, 6]


def test_another_logic_in_the_air_goes_on(begin: Begin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A flight is not cut in the air."""
    node = begin().start()
    node.tell(*heard_vehicle())
    node.turn(after_ms=200)
    node.kill()
    monkeypatch.setattr(flights_module, "LOGIC", LOGIC + 1)
    begin().start()
    check_history(tmp_path, (2, ""))


def test_a_stop_on_the_ground_closes_and_one_in_the_air_does_not(begin: Begin, tmp_path: Path) -> None:
    """SIGTERM in the air may be a supervisor that restarts: the next start goes on."""
    node = begin().start()
    node.tell(*heard_vehicle())
    node.loop._finish(node.session, Stop(CLOSE_STOPPED))
    check_history(tmp_path, (1, ""))
    again = begin().start()
    again.tell(vehicle_state(armed=False))
    again.loop._finish(again.session, Stop(CLOSE_INPUT_ENDED))
    check_history(tmp_path, (2, "CLOSE_INPUT_ENDED"))
    third = begin().start()
    check_history(tmp_path, (2, "CLOSE_INPUT_ENDED"), (1, ""))
    check_hands_over(third.log(0), third.log(1))


def test_a_landing_closes_the_flight_after_a_while_and_the_next_begins(begin: Begin, tmp_path: Path) -> None:
    """close_after_s after disarm, not before; the manifest names the head of the flight before."""
    node = begin().start()
    fly(node)
    node.turn(after_ms=179_000)
    check_history(tmp_path, (1, ""))
    node.turn(after_ms=1_000)
    check_history(tmp_path, (1, "CLOSE_DISARMED"), (1, ""))
    check_hands_over(node.log(0), node.log(1))
    manifest = next(of_kind(node.log(1), "flight_opened"))
    reader = read_flight(flights_in(tmp_path)[0].folder)
    assert (manifest.previous_flight_id, manifest.previous_leaf) == (reader.flight_id, reader.head.leaf)
    reader.close()
    assert manifest.previous_leaf != FIRST_LEAF_BEFORE
    assert CLOSE_DISARMED == 2


def test_a_flight_that_begins_in_the_same_process_knows_its_vehicle(begin: Begin) -> None:
    """The link says only what changes, so the new flight is told what stands: else every order were refused."""
    node = begin().start()
    fly(node)
    node.turn(after_ms=181_000)
    node.turn(after_ms=200)
    assert node.kinds(1)[3:5] == ["vehicle_link_changed", "vehicle_state_reported"]
    node.tell(point_at_place("a2", order_seq=2), input_class=InputClass.ORDER)
    assert node.kinds(1).count("point_at_place") == 1


def test_a_vehicle_that_never_armed_closes_nothing(begin: Begin, tmp_path: Path) -> None:
    """Standing on the ground for a day is one flight."""
    node = begin().start()
    node.tell(*heard_vehicle(armed=False))
    node.turn(after_ms=86_400_000)
    node.turn(after_ms=200)
    check_history(tmp_path, (1, ""))


def test_arming_again_in_time_is_the_same_flight(begin: Begin, tmp_path: Path) -> None:
    """A short stop on the ground."""
    node = begin().start()
    fly(node)
    node.tell(vehicle_state(armed=True), after_ms=170_000)
    node.turn(after_ms=200)
    node.turn(after_ms=20_000)
    node.tell(vehicle_state(armed=False))
    node.turn(after_ms=200)
    node.turn(after_ms=179_000)
    check_history(tmp_path, (1, ""))
    node.turn(after_ms=1_500)
    check_history(tmp_path, (1, "CLOSE_DISARMED"), (1, ""))


def test_a_flight_is_not_closed_while_an_outcome_is_awaited(begin: Begin, tmp_path: Path) -> None:
    """Outcomes name the seq of their effect, which means nothing in the next flight."""
    node = begin().start()
    node.tell(*heard_vehicle())
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER)
    effect = node.performed[-1].seq
    node.tell(vehicle_state(armed=False), after_ms=200)
    node.turn(after_ms=200)
    node.turn(after_ms=181_000)
    check_history(tmp_path, (1, ""))
    (ack,) = [one.seq for one in node.performed if one.kind.name == "send_ack"]  # the order has timed out
    node.tell(published(ack))
    node.tell(answered(effect, mav_result=5))
    node.turn(after_ms=200)
    check_history(tmp_path, (1, ""))
    node.tell(answered(effect))
    node.turn(after_ms=200)
    check_history(tmp_path, (1, "CLOSE_DISARMED"), (1, ""))


def test_a_flight_is_not_closed_while_an_answer_is_on_its_way(begin: Begin, tmp_path: Path) -> None:
    """An ack's outcome names its seq too."""
    node = begin().start()
    node.tell(*heard_vehicle())
    node.tell(point_at_place("a1", roles=()), input_class=InputClass.ORDER)
    (ack,) = [one.seq for one in node.performed]
    node.tell(vehicle_state(armed=False))
    node.turn(after_ms=200)
    node.turn(after_ms=181_000)
    check_history(tmp_path, (1, ""))
    node.tell(published(ack))
    node.turn(after_ms=200)
    check_history(tmp_path, (1, "CLOSE_DISARMED"), (1, ""))


def test_an_answer_that_could_not_leave_does_not_keep_a_flight_open(begin: Begin, tmp_path: Path) -> None:
    """The operator is gone: the answer stays owed, and the next flight carries it."""
    node = begin().start()
    node.tell(*heard_vehicle())
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER)
    node.tell(answered(node.performed[-1].seq))
    node.tell(published(node.performed[-1].seq, failure="no link"))
    node.tell(vehicle_state(armed=False))
    node.turn(after_ms=200)
    node.turn(after_ms=181_000)
    check_history(tmp_path, (1, "CLOSE_DISARMED"), (1, ""))
    assert [one.command_id for one in next(of_kind(node.log(1), "baseline_carried")).state.unanswered] == ["a1"]


def test_what_was_underway_before_a_restart_does_not_keep_a_flight_open(begin: Begin, tmp_path: Path) -> None:
    """Nobody will ever tell the outcome of what another process sent; landed before the restart counts too."""
    node = begin().start()
    node.tell(*heard_vehicle())
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER)
    node.tell(vehicle_state(armed=False))
    node.turn(after_ms=200)
    node.kill()
    again = begin().start()
    again.tell(published(again.performed[-1].seq))
    again.turn(after_ms=200)
    again.turn(after_ms=181_000)
    check_history(tmp_path, (2, "CLOSE_DISARMED"), (1, ""))


# --- starts that are cut short ---------------------------------------------------------------------------------------


def cut_folder(_node: Node, monkeypatch: pytest.MonkeyPatch) -> None:
    """Die after the folder was made, before the log has its name."""

    def rename(_source: object, _target: object) -> None:
        raise OSError("cut for a test")

    monkeypatch.setattr(os, "rename", rename)


def cut_first_append(node: Node, _monkeypatch: pytest.MonkeyPatch) -> None:
    """Die with an empty log."""
    node.disk.fails_at = 0


def cut_second_append(node: Node, _monkeypatch: pytest.MonkeyPatch) -> None:
    """Die after the old flight was closed, with the new one's log empty."""
    node.disk.fails_at = 1


@pytest.mark.parametrize("cut", [cut_folder, cut_first_append])
def test_a_first_start_that_is_cut_short_is_passed_over(
    begin: Begin, tmp_path: Path, cut: Callable[[Node, pytest.MonkeyPatch], None]
) -> None:
    """Whatever it left, the next start records."""
    node = begin()
    with pytest.MonkeyPatch.context() as patch:
        cut(node, patch)
        with pytest.raises(StoreFailed):
            node.start()
    again = begin().start()
    assert again.kinds() == ["flight_opened", "baseline_carried", "node_started"]
    again.kill()
    assert begin().start().kinds().count("node_started") == 2


@pytest.mark.parametrize("cut", [cut_first_append, cut_second_append, cut_folder])
def test_a_change_of_flights_that_is_cut_short_is_done_again(
    begin: Begin, cut: Callable[[Node, pytest.MonkeyPatch], None]
) -> None:
    """The old flight is closed once, and what it knew arrives in the flight that comes of it."""
    node = begin().start()
    fly(node)
    node.kill()
    second = begin(boot_id="boot-2")
    with pytest.MonkeyPatch.context() as patch:
        cut(second, patch)
        with pytest.raises(StoreFailed):
            second.start()
    third = begin(boot_id="boot-2").start()
    old = third.log(0)
    assert [one.reason for one in of_kind(old, "flight_closed")] == [CLOSE_REBOOTED]
    check_hands_over(old, third.log())
    assert [order.command_id for order in third.session.state.orders.values()] == ["a1"]
    third.kill()
    check_history_of_newest(third.root)


def check_history_of_newest(root: Path) -> None:
    """Check that the newest log replays."""
    reader = read_flight(flights_in(root)[-1].folder)
    assert verify(reader).words().startswith("identical")
    reader.close()


def test_a_failing_end_leaves_the_flight_open(begin: Begin, tmp_path: Path) -> None:
    """The close itself can't be written: the next start goes on, as if it had never been tried."""
    node = begin().start()
    fly(node)
    node.disk.fails_at = node.disk.appends
    with pytest.raises(StoreFailed):
        node.turn(after_ms=181_000)
    node.kill()
    begin().start()
    check_history(tmp_path, (2, ""))


def test_a_manifest_names_the_origin_of_the_flight_before(begin: Begin) -> None:
    """Carried, and not set again: all places stay comparable."""
    node = begin().start()
    fly(node)
    node.turn(after_ms=181_000)
    assert next(of_kind(node.log(1), "baseline_carried")).state.origin == place(0, 0)
    assert node.session.state.origin.value is not None
    assert isinstance(node.log(1)[0].message, FlightOpened)


def test_a_session_that_was_just_opened_has_performed_its_effects_once(begin: Begin) -> None:
    """`fresh` is handed over and forgotten."""
    node = begin().start()
    session: Session = node.session
    assert session.fresh == []
