"""Where flights begin and go on: over starts of the daemon, boots, and versions of the software."""

from __future__ import annotations

from pathlib import Path

import pytest

from autopilot.node.flights import Session
from autopilot.node.limits import digest
from autopilot.ports.edges import InputClass
from events.schema.flight_pb2 import (
    CLOSE_LOGIC_CHANGED,
    NodeStarted,
)
from events.store import flights_in
from statecharts import State, charts_digest, restore, steps_of
from statecharts.logic import LOGIC
from tests.autopilot.node.histories import Begin, check_hands_over, check_history, fly
from tests.autopilot.node.nodes import FakeClock, config, heard_vehicle, of_kind, update, vehicle_state
from tests.checks import check_equal, check_same
from tests.flights import point_at_place


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
    assert list(of_kind(node.log(), "node_started")) == [
        NodeStarted(boot_id="boot-1", start=1, outage_ns=0, logic=LOGIC, software="0.1.0")
    ]
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
        NodeStarted(boot_id="boot-1", start=1, outage_ns=0, logic=LOGIC, software="0.1.0"),
        NodeStarted(boot_id="boot-1", start=2, outage_ns=gone_ns, logic=LOGIC, software="0.1.0"),
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
    session, found = again.flights._last(flights_in(again.root), again.heard.extend)
    assert session is not None
    assert found == []
    check_same(durable, session.state)


def test_an_order_without_an_outcome_is_answered_and_not_sent_again(begin: Begin) -> None:
    """Unknown after restart; its pointing is never performed again."""
    node = begin().start()
    node.tell(*heard_vehicle())
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER, after_ms=50)
    assert [record.kind.name for record in node.performed] == ["point_at_place"]
    node.kill()
    again = begin().start()
    (told,) = of_kind(again.performed, "send_ack")
    assert told.detail.startswith("unknown after restart")
    assert len(again.performed) == 1
    assert again.kinds().count("point_at_place") == 1
    again.kill()
    third = begin().start()
    assert [one.kind.name for one in third.performed] == ["send_ack"]  # still owed: nothing says that it left


def reboot(clock: FakeClock, *, off_s: int, up_s: int = 20) -> None:
    """Let the computer be off, and then up for some seconds before the daemon starts."""
    clock.mono = up_s * 1_000_000_000
    clock.wall += (off_s + up_s) * 1_000_000_000


def test_another_boot_goes_on_with_the_flight(begin: Begin, clock: FakeClock, tmp_path: Path) -> None:
    """Its time is joined over the outage, which the wall clock bounds; nothing that people wait for is over early."""
    node = begin().start()
    fly(node)
    node.kill()
    last = node.log()[-1].at
    reboot(clock, off_s=300)
    again = begin(boot_id="boot-2").start()
    check_history(tmp_path, (2, ""))
    started = [record for record in again.log() if record.kind.name == "node_started"][-1]
    gone_ns = clock.wall - last.wall_ns
    assert started.message == NodeStarted(boot_id="boot-2", start=2, outage_ns=gone_ns, logic=LOGIC, software="0.1.0")
    assert (started.at.boot, started.at.flight_ns) == (2, last.flight_ns + gone_ns)
    again.kill()
    reboot(clock, off_s=10)
    third = begin(boot_id="boot-3").start()
    assert third.log()[-1].at.boot == 3
    check_history(tmp_path, (3, ""))


def test_an_outage_that_nobody_can_measure_frees_the_camera(begin: Begin, clock: FakeClock, tmp_path: Path) -> None:
    """The start says so; no time passes, so what must not be forgotten is kept, and what people hold is let go."""
    node = begin().start()
    fly(node)
    assert node.session.state.cameras["1/1"].state == "operator"
    nonces = list(node.session.state.nonces.items())
    node.kill()
    clock.wall -= 3_600_000_000_000
    clock.mono = 0
    again = begin(boot_id="boot-2").start()
    started = [record for record in again.log() if record.kind.name == "node_started"][-1]
    assert started.message == NodeStarted(
        boot_id="boot-2",
        start=2,
        outage_ns=0,
        outage_unbounded="the wall clock went back",
        logic=LOGIC,
        software="0.1.0",
    )
    assert started.at.flight_ns == node.log()[started.seq - 1].at.flight_ns
    assert again.session.state.cameras["1/1"].state == "automatic"
    assert list(again.session.state.nonces.items()) == nonces
    assert [order.command_id for order in again.session.state.orders.values()] == ["a1"]
    check_history(tmp_path, (2, ""))


def test_the_longest_outage_that_is_believed_is_configured(begin: Begin, clock: FakeClock) -> None:
    """Where the wall clock says more, it is doubted."""
    node = begin().start()
    node.kill()
    reboot(clock, off_s=7_300)
    again = begin(boot_id="boot-2", outage_longest_h=2.0).start()
    assert again.session.started.outage_unbounded == "the wall clock says 7320 s, more than is believed"


def test_another_logic_on_the_ground_is_another_flight(
    begin: Begin, clock: FakeClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was told stays true: the new charts do not go on with the old ones' flight."""
    node = begin().start()
    fly(node)
    node.kill()
    clock.pass_ms(3_000)
    update(monkeypatch)
    again = begin().start()
    check_history(tmp_path, (1, "CLOSE_LOGIC_CHANGED"), (1, ""))
    check_hands_over(again.log(0), again.log(1))
    assert next(of_kind(again.log(1), "flight_opened")).logic == LOGIC + 1
    assert again.log(0)[-1].at.flight_ns > again.log(0)[-2].at.flight_ns + 2_900_000_000
    assert CLOSE_LOGIC_CHANGED == 4


def test_another_logic_in_the_air_goes_on(begin: Begin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A flight is not cut in the air."""
    node = begin().start()
    node.tell(*heard_vehicle())
    node.turn(after_ms=200)
    node.kill()
    update(monkeypatch)
    again = begin().start()
    check_history(tmp_path, (2, ""))
    check_equal([one.logic for one in of_kind(again.log(), "node_started")], [LOGIC, LOGIC + 1])
    again.tell(vehicle_state(armed=False))
    again.turn(after_ms=200)
    again.kill()
    begin().start()
    check_history(tmp_path, (3, ""))  # on the ground the newest start's logic counts, not the manifest's


def test_a_session_that_was_just_opened_has_performed_its_effects_once(begin: Begin) -> None:
    """`fresh` is handed over and forgotten."""
    node = begin().start()
    session: Session = node.session
    assert session.fresh == []
