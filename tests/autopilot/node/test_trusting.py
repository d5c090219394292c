"""The node and its trust: what a start remembers, what is lost, and what orders, answers and status tell of it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import pytest
from google.protobuf.message import Message

from autopilot.adapters.mesh.adapter import MeshAdapter
from autopilot.geo import Origin
from autopilot.node.clock import read_clocks
from autopilot.node.edges import remembered, resume
from autopilot.node.trusting import RECORDED_FILE, Believed, believed, put_into_force, remembers_all, settle
from autopilot.ports.config import MeshSection
from autopilot.ports.edges import InputClass
from autopilot.trust.book import TrustBook
from autopilot.trust.fetching import Offered
from autopilot.trust.identity import load_identity
from autopilot.trust.judging import Floors, Known
from events.schema.flight_pb2 import CLOCK_BOUNDED, CLOCK_TRUSTED, CLOCK_UNSET, LogDamaged
from events.schema.orders_pb2 import OrderReceived
from events.schema.waypoint_pb2 import CameraRelease, DeviceCommand, NodeStatus
from tests.autopilot.node.nodes import FakeClock, Node, config, of_kind
from tests.autopilot.node.test_edges import Mesh, edges
from tests.autopilot.trust.papers import HOUR_MS, Device, HostClocks, a_bundle, a_list, device
from tests.autopilot.trust.test_gate import set_to
from tests.autopilot.trust.world import COMMAND_ID, KEY, NOW_MS, FakeWire, Forge, people, seeded

RELEASE = DeviceCommand(
    command_id=COMMAND_ID, target_node_pubkey=people().wasp.public_key, camera_release=CameraRelease(camera=1)
).SerializeToString(deterministic=True)


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], Node]:
    """Return what starts the daemon's loop again and again on one folder."""
    clock = FakeClock()
    return lambda: Node(tmp_path / "flights", clock, monkeypatch).start()


def book_of(node: Node, keys: Path) -> TrustBook:
    """Return a book that records in this node's log."""
    made = device(keys)
    return TrustBook(
        load_identity(keys), made.clock, record=lambda learned: node.inbox.offer(InputClass.OUTCOME, learned)
    )


def turn(node: Node, book: TrustBook) -> None:
    """Let the loop go round, and the book hear of it."""
    before = len(node.heard)
    node.turn()
    put_into_force(book, tuple(node.heard[before:]))


def test_what_was_taken_is_in_force_when_the_log_has_it_and_remembered(
    start: Callable[[], Node], tmp_path: Path
) -> None:
    node = start()
    book = book_of(node, tmp_path / "keys")
    book.resume(believed(node.session).floors, 0)
    turn(node, book)
    assert book.offer("revocations", a_list(13, "bob")) is Offered.TAKEN
    assert book.offer("epoch", a_bundle(2)) is Offered.TAKEN
    assert book.held.revocations.version == 1
    turn(node, book)
    assert (book.settled, book.held.revocations.version) == (True, 13)
    assert [one.list_version for one in of_kind(node.log(), "revocations_taken")] == [1, 13]
    node.kill()
    again = start()
    memory = believed(again.session)
    assert memory.floors.lists == {book.held.revocations.key_id: Known(13, book.held.revocations.digest)}
    assert (memory.floors.epoch_id, memory.floors.root.version) == (2, 1)
    book_of(again, tmp_path / "keys").resume(memory.floors, memory.time_floor_ms)
    assert again.inbox.empty  # disk and log agree: there is nothing to say


def test_no_order_is_taken_before_the_log_knows_what_the_start_found(start: Callable[[], Node], tmp_path: Path) -> None:
    node = start()
    book = book_of(node, tmp_path / "keys")
    book.resume(Floors({}), 0)

    async def run(*, commits: bool) -> bool:
        over = asyncio.Event()
        task = asyncio.create_task(settle(book, over))
        await asyncio.sleep(0)
        if commits:
            turn(node, book)
        else:
            assert not task.done()
            over.set()
        await asyncio.wait_for(task, 5)
        return book.settled

    assert not asyncio.run(run(commits=False))
    assert asyncio.run(run(commits=True))


@pytest.mark.parametrize(
    ("begins", "lost", "marked", "whole"),
    [
        (True, False, False, True),  # a new node
        (True, False, True, False),  # its flights are gone
        (False, False, True, True),  # it goes on
        (False, False, False, True),  # from before there was a mark
        (False, True, True, False),  # its log is damaged
    ],
)
def test_what_is_remembered_whole(tmp_path: Path, begins: bool, lost: bool, marked: bool, whole: bool) -> None:
    if marked:
        (tmp_path / RECORDED_FILE).touch()
    memory = Believed(Floors({}), 0, log_lost=lost, log_begins=begins)
    assert remembers_all(memory, tmp_path) is whole
    assert (tmp_path / RECORDED_FILE).exists()


def test_the_gate_is_told_whether_its_memory_is_whole(start: Callable[[], Node]) -> None:
    node, mesh = start(), Mesh()
    for whole in (False, True):
        resume(config(), remembered(node.session), edges(mesh), node.inbox, Origin(), whole=whole)
        assert mesh.whole is whole


def test_a_session_says_what_its_start_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """While its opening is told: a first flight, and a damaged log."""
    node = Node(tmp_path / "flights", FakeClock(), monkeypatch)
    session = node.flights.open(node.heard.extend)
    assert (believed(session).log_begins, believed(session).log_lost) == (True, False)
    session.fresh.extend(session.observe(LogDamaged(folder="f")))
    assert believed(session).log_lost
    session.fresh.clear()
    assert (believed(session).log_begins, believed(session).log_lost) == (False, False)


def test_records_say_how_far_their_clock_is_to_be_believed(tmp_path: Path) -> None:
    assert read_clocks(FakeClock()).quality == CLOCK_TRUSTED
    lost = device(tmp_path / "keys", HostClocks(wall_ms=0))
    assert read_clocks(lost.clock) == (lost.host.mono_ns(), NOW_MS * 1_000_000, CLOCK_UNSET)
    lost.clock.hear_gps(NOW_MS + 5_000)
    assert read_clocks(lost.clock) == (lost.host.mono_ns(), (NOW_MS + 5_000) * 1_000_000, CLOCK_BOUNDED)


def test_orders_and_status_tell_of_overdue_lists_and_uncertain_time(tmp_path: Path) -> None:
    lost: Device = device(tmp_path / "keys", HostClocks(wall_ms=0))
    lost.book.offer("revocations", a_list(2, next_update_ms=NOW_MS - HOUR_MS))
    taken: list[Message] = []

    def take(input_class: InputClass, observation: Message) -> bool:
        assert input_class is InputClass.ORDER
        taken.append(observation)
        return True

    adapter = MeshAdapter(
        MeshSection(),
        people().wasp,
        lost.clock,
        lambda *_: None,
        take,
        wire=FakeWire(),
        random=seeded(5),
        book=lost.book,
    )
    status = NodeStatus(at_ms=1)
    adapter.publish_status(status)
    assert (status.time_quality, status.revocation_stale, status.revocation_version) == (CLOCK_UNSET, True, 2)
    assert (status.node_challenge, status.epoch_id) == (lost.book.challenge(), 1)
    echo = set_to("node_challenge", status.node_challenge)
    forged = Forge(people().alice, content=RELEASE, spoil_header=echo)
    adapter.restore_window([], whole=False)
    adapter.receive(KEY, forged.envelope())
    (order,) = taken
    assert isinstance(order, OrderReceived)
    assert (order.revocation_overdue_ms, order.time_uncertain, order.before_memory) == (HOUR_MS, True, True)
    lost.book.offer("revocations", b"")
    assert adapter.take_rejections() == {"trust: revocations: unsigned": 1}


def test_a_node_that_knows_the_time_says_nothing_of_a_challenge(tmp_path: Path) -> None:
    sure = device(tmp_path / "keys")
    adapter = MeshAdapter(
        MeshSection(), people().wasp, sure.clock, lambda *_: None, lambda *_: True, wire=FakeWire(), book=sure.book
    )
    status = NodeStatus(at_ms=1)
    adapter.publish_status(status)
    assert status.time_quality == CLOCK_TRUSTED
    assert not status.HasField("revocation_stale")
    assert not status.HasField("node_challenge")
