"""A node whose store can't be opened: it stays, says so, refuses every order, and records as soon as it can."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from autopilot.adapters.mesh import MeshAdapter
from autopilot.node import flights as flights_module
from autopilot.node import not_recording as not_recording_module
from autopilot.node import notice
from autopilot.node.flights import Flights
from autopilot.node.lock import FolderLock, FolderTaken
from autopilot.node.not_recording import NotRecording
from autopilot.ports.config import Config, MeshSection
from autopilot.ports.edges import InputClass
from autopilot.trust.envelope import MessageType
from autopilot.trust.gate import Gate
from events.schema.flight_pb2 import CLOSE_STOPPED
from events.schema.waypoint_pb2 import AckResult, CommandAck, NodeStatus, PrincipalKind, ResultState
from events.store import SqliteStore, StoreFailed, create_flight, flights_in
from tests.autopilot.node.lives import keyed, live, terminate
from tests.autopilot.node.nodes import log_of, of_kind
from tests.autopilot.trust.world import ISSUERS, KEY, FakeClock, FakeWire, Forge, people

SOON: dict[str, dict[str, object]] = {"limits": {"store_retry_s": 1}}


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Config:
    """Return a configuration with keys that tries a store again soon."""
    return keyed(tmp_path, monkeypatch, **SOON)


def failing(monkeypatch: pytest.MonkeyPatch, times: int, then: Callable[[], object] = lambda: None) -> list[str]:
    """Let the store fail so often when a flight is opened; return what was tried, each try a word."""
    opened, tried = Flights.open, list[str]()

    def fail(self: Flights, on_records: Any) -> Any:
        if len(tried) < times:
            tried.append("failed")
            then()
            raise StoreFailed("no such disk, for a test")
        tried.append("opened")
        return opened(self, on_records)

    monkeypatch.setattr(Flights, "open", fail)
    return tried


def test_it_tries_again_and_then_records(
    config: Config, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the same process; the reason is said once, and the note for `status` goes when it records."""
    told: list[notice.Notice | None] = []
    path = Path(config.node.projections)
    tried = failing(monkeypatch, 3, lambda: told.append(notice.read(path)))
    monkeypatch.setattr("asyncio.sleep", no_sleep)
    assert live(config, monkeypatch, terminate) == os.EX_OK
    assert tried == ["failed", "failed", "failed", "opened"]
    assert capsys.readouterr().err.count("not recording: no such disk, for a test; tried again every 1 s") == 1
    assert [one.because for one in told if one is not None] == ["no such disk, for a test"] * 2
    assert notice.read(path) is None
    (flight,) = flights_in(Path(config.node.flights))
    assert [one.reason for one in of_kind(log_of(flight), "flight_closed")] == [CLOSE_STOPPED]


_SLEEP = asyncio.sleep


async def no_sleep(_seconds: float) -> None:
    """Sleep no longer than it takes others to do something."""
    await _SLEEP(0)


def test_asked_to_stop_it_ends_and_says_that_nothing_was_recorded(
    config: Config, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """74, for a supervisor: it never did what it is for."""
    failing(monkeypatch, 99, lambda: terminate(None))  # type: ignore[arg-type]
    assert live(config, monkeypatch, terminate) == os.EX_IOERR
    assert "nothing was recorded" in capsys.readouterr().err
    assert flights_in(Path(config.node.flights)) == []


def test_a_folder_that_can_not_be_made_is_a_store_that_fails(
    config: Config, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file stands where the folder should be; once it is gone the node records."""
    flights = Path(config.node.flights)
    flights.write_text("in the way")

    async def mend(_seconds: float) -> None:
        if flights.is_file():
            flights.unlink()
        await _SLEEP(0)

    monkeypatch.setattr("asyncio.sleep", mend)
    assert live(config, monkeypatch, terminate) == os.EX_OK
    assert "not recording: " in capsys.readouterr().err
    assert len(flights_in(flights)) == 1


def test_a_folder_that_another_daemon_has_is_not_a_store_that_fails(
    config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That one records; this one ends."""
    with FolderLock(Path(config.node.flights)):
        assert live(config, monkeypatch, terminate) == os.EX_UNAVAILABLE
    with FolderLock(Path(config.node.flights)), pytest.raises(FolderTaken), FolderLock(Path(config.node.flights)):
        pass


def test_tries_that_fail_leave_nothing_behind(config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder for each try would fill what is left of a disk."""
    tries = iter(range(9))

    def create(*given: Any) -> Any:
        flight, store = created(*given)
        if next(tries) < 3:
            monkeypatch.setattr(type(store), "append", broken)
        else:
            monkeypatch.setattr(type(store), "append", append)
        return flight, store

    def broken(_self: object, _records: object) -> None:
        raise StoreFailed("a disk that takes no commit")

    created = create_flight

    append = SqliteStore.append
    monkeypatch.setattr(flights_module, "create_flight", create)
    monkeypatch.setattr("asyncio.sleep", no_sleep)
    assert live(config, monkeypatch, terminate) == os.EX_OK
    folders = [path.name for path in Path(config.node.flights).iterdir() if path.is_dir()]
    assert len(folders) == 1
    assert folders[0].startswith("000001-")


# --- what it says on the mesh ----------------------------------------------------------------------------------------


def refusing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> tuple[NotRecording, FakeWire, MeshAdapter]:
    """Return a node that does not record, over a fake wire."""
    wire, clock = FakeWire(), FakeClock()
    config = Config.model_validate(
        {
            "node": {"keys": "k", "flights": "f", "projections": str(tmp_path / "p.db")},
            "mesh": {"connect": ["tcp/127.0.0.1:1"]},
        }
    )

    def adapter(settings: MeshSection, *given: Any, **named: Any) -> MeshAdapter:
        return MeshAdapter(settings, *given, wire=wire, **named)

    monkeypatch.setattr(not_recording_module, "MeshAdapter", adapter)
    node = NotRecording(config, people().wasp, clock)
    mesh = node._made()
    node._because = "the disk is gone"
    return node, wire, mesh


def opened(message_type: MessageType, wire: FakeWire, clock: FakeClock) -> list[bytes]:
    """Return the contents of what was put on the wire, as an operator's gate opens them."""
    gate = Gate(
        people().alice,
        message_type,
        kinds=frozenset({PrincipalKind.NODE}),
        is_ours=lambda _: True,
        reader=lambda _message, content: content,
        clock=clock,
    )
    verdicts = [gate.judge(key, envelope) for key, envelope, _ in wire.puts]
    return [verdict.value for verdict in verdicts]  # type: ignore[union-attr]


def test_an_authentic_order_is_refused_with_the_reason(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Not for good: nothing was written down. A forgery gets no answer, and nothing is performed."""
    _, wire, mesh = refusing(monkeypatch, tmp_path)
    mesh.receive(KEY, b"garbage")
    mesh._outbox.turn()
    assert wire.puts == []
    mesh.receive(KEY, Forge(people().alice).envelope())
    mesh._outbox.turn()
    ack = CommandAck.FromString(opened(MessageType.ACK, wire, FakeClock())[0])
    assert (ack.result, ack.detail) == (AckResult.ACK_REJECTED, "not recording: the disk is gone")
    assert ack.result_state == ResultState.PENDING
    assert PrincipalKind.OPERATOR in ISSUERS


def test_the_status_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Sealed as ever, with what the gate has dropped; no flight, no vehicle, no orders."""
    node, wire, mesh = refusing(monkeypatch, tmp_path)
    mesh.receive(KEY, b"garbage")
    mesh.publish_status(node.status(mesh))
    mesh._outbox.turn()
    status = NodeStatus.FromString(opened(MessageType.STATUS, wire, FakeClock())[0])
    assert (status.health, status.not_recording) == ("not recording", "the disk is gone")
    assert (status.flight_id, status.command_enabled, status.vehicle_link) == (b"", False, False)
    assert [(one.reason, one.count) for one in status.dropped] == [("size", 1)]


def test_it_comes_up_on_the_mesh_once_and_leaves_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """However often it is said; and without a mesh there is nothing to come up on."""
    node, wire, _ = refusing(monkeypatch, tmp_path)

    async def live_a_little() -> None:
        node.say("one")
        node.say("two")
        await asyncio.sleep(0)
        await node.stop()
        await node.stop()

    asyncio.run(live_a_little())
    assert list(wire.subscriptions) == ["waypoint/global/cmd/wasp-01/**"]
    assert [NodeStatus.FromString(one).not_recording for one in opened(MessageType.STATUS, wire, FakeClock())] == [
        "two"
    ]


def test_orders_alone_are_refused() -> None:
    """An outcome that nobody can record must not be offered for ever."""
    taken = [each for each in InputClass if not_recording_module.refuse_orders(each, NodeStatus())]
    assert taken == [InputClass.OUTCOME, InputClass.TELEMETRY, InputClass.FRAME]


@pytest.mark.parametrize("content", [b"", b"{}", b"[]", b'{"because": "x", "since_ms": null}', b"\xff"])
def test_a_note_that_can_not_be_read_is_none(tmp_path: Path, content: bytes) -> None:
    """It is a help, and no more."""
    (tmp_path / notice.NAME).write_bytes(content)
    assert notice.read(tmp_path / "p.db") is None
