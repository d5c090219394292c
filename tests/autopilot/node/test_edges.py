"""What joins the loop to its surroundings: one daemon a folder, what adapters learn of the log, status, projections."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import cast

import pytest
from google.protobuf.message import Message

from autopilot.adapters.eyes import Eyes
from autopilot.adapters.mesh import MeshAdapter
from autopilot.adapters.vehicle import VehicleLink
from autopilot.geo import Origin
from autopilot.node.board import Board
from autopilot.node.daemon import _perform
from autopilot.node.edges import Edges, home_of, remembered, resume, set_origin
from autopilot.node.lock import FolderLock, FolderTaken
from autopilot.node.projecting import Projecting
from autopilot.node.upkeep import Rejections, report_rejections
from autopilot.ports.config import Config
from autopilot.ports.edges import InputClass, VehicleFacts
from projections.store import Projector, read_status
from tests.autopilot.node.nodes import FakeClock, Node, config, heard_vehicle, of_kind, vehicle_state
from tests.autopilot.node.test_fitness import VEHICLE
from tests.flights import answered, point_at_place, sent

_HOLD = "import sys; from pathlib import Path; from autopilot.node.lock import FolderLock\n"
_HOLD += "with FolderLock(Path(sys.argv[1])): print('held', flush=True); sys.stdin.read()"


class Mesh:
    """A mesh adapter as far as the node's joints touch it."""

    def __init__(self) -> None:
        self.window: list[tuple[bytes, bytes, int]] = []
        self.whole = True
        self.performed: list[int] = []
        self.rejections = {"token_sig": 3, "size": 1}

    def restore_window(self, nonces: Iterable[tuple[bytes, bytes, int]], *, whole: bool = True) -> None:
        self.window, self.whole = list(nonces), whole

    def perform(self, seq: int, effect: Message, recorded_mono_ns: int) -> None:
        self.performed.append(seq)

    def take_rejections(self) -> dict[str, int]:
        taken, self.rejections = self.rejections, {}
        return taken


class Counting:
    """An adapter as far as its counts of rejections go."""

    def __init__(self, **rejected: int) -> None:
        self.rejected = Counter(rejected)


class Standing:
    """An adapter as far as its vehicle's home goes."""

    home: tuple[float, float, float] | None = None

    def facts(self) -> VehicleFacts:
        return replace(VEHICLE, home=self.home)


class Failing:
    """A vehicle's adapter with a defect."""

    def __init__(self) -> None:
        self.performed: list[int] = []

    def perform(self, seq: int, *_: object) -> None:
        self.performed.append(seq)
        raise ZeroDivisionError


def edges(mesh: Mesh, vehicle: Counting | None = None) -> Edges:
    """Return edges with a mesh, and perhaps a vehicle."""
    return Edges(cast(MeshAdapter, mesh), cast(VehicleLink, vehicle), cast(Eyes, Counting(too_many=2)))


@pytest.fixture
def node(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Node:
    return Node(tmp_path / "flights", FakeClock(), monkeypatch).start()


def test_one_daemon_a_folder(tmp_path: Path) -> None:
    """A second one is refused, and the kernel forgets a dead one."""
    holder = subprocess.Popen(
        [sys.executable, "-c", _HOLD, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    with pytest.raises(FolderTaken, match="stop it first"), FolderLock(tmp_path):
        pass
    holder.kill()
    holder.communicate()
    with FolderLock(tmp_path):
        pass


def test_a_start_gives_the_adapters_what_the_log_remembers(node: Node, monkeypatch: pytest.MonkeyPatch) -> None:
    """The origin, and every nonce with what is left of its life: a replay is one also after a restart."""
    node.tell(*heard_vehicle())
    first, second = point_at_place("a1"), point_at_place("a2", order_seq=2)
    node.tell(first, input_class=InputClass.ORDER, after_ms=50)
    node.tell(answered(node.performed[-1].seq))
    node.tell(second, input_class=InputClass.ORDER, after_ms=4_950)
    node.kill()
    node.clock.pass_ms(10_000)
    again = Node(node.root, node.clock, monkeypatch).start()
    mesh, origin = Mesh(), Origin()
    resume(config(), remembered(again.session), edges(mesh), again.inbox, origin)
    assert origin.frame is not None
    kept = {nonce: left_ms for _, nonce, left_ms in mesh.window}
    assert kept == {first.nonce: 45_000 - 14_950 + 1, second.nonce: 45_000 - 10_000 + 1}
    assert again.inbox.take(0, 9) == []  # the origin is known already and is not set again


def test_a_configured_origin_is_recorded_once(node: Node) -> None:
    """From [flight] origin; else from where a fixed camera stands."""
    origin = Origin()
    resume(config(flight={"origin": [47.1, 8.2, 400.0]}), remembered(node.session), edges(Mesh()), node.inbox, origin)
    set_origin(origin, node.inbox, (1.0, 2.0, 3.0), "first fix")
    node.turn()
    node.turn(after_ms=200)
    (set_once,) = of_kind(node.log(), "origin_set")
    assert (set_once.place.latitude_e7, set_once.source) == (471_000_000, "configured")


def test_a_fixed_camera_stands_at_the_origin(node: Node) -> None:
    """Where nobody says otherwise."""
    pose = {"latitude_deg": 47.5, "longitude_deg": 8.0, "altitude_m": 410.0, "height_m": 6.0, "pitch_deg": -20.0}
    settings: Config = config(eyes={"pose": pose})
    resume(settings, remembered(node.session), edges(Mesh()), node.inbox, Origin())
    node.turn()
    node.turn(after_ms=200)
    assert [one.place.latitude_e7 for one in of_kind(node.log(), "origin_set")] == [475_000_000]


def test_home_is_where_the_vehicle_says() -> None:
    """Not where the frame has its origin, which is of another flight, or configured; there where nothing flies."""
    origin, vehicle = Origin(), Standing()
    link = cast(VehicleLink, vehicle)
    assert (home_of(link, origin), home_of(None, origin)) == (None, None)
    origin.set(47.1, 8.2, 400.0)
    assert (home_of(link, origin), home_of(None, origin)) == (None, (47.1, 8.2, 400.0))
    vehicle.home = (47.3, 8.4, 512.0)
    assert home_of(link, origin) == (47.3, 8.4, 512.0)


def test_effects_go_to_their_port(node: Node) -> None:
    """And those of a port that is not there to nobody."""
    node.tell(*heard_vehicle())
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER)
    node.tell(sent(node.performed[-1].seq), answered(node.performed[-1].seq))
    mesh = Mesh()
    for record in node.performed:
        edges(mesh).perform(record)
    assert mesh.performed == [record.seq for record in node.performed if record.kind.name == "send_ack"]
    assert len(node.performed) > len(mesh.performed) > 0


def test_what_is_for_the_vehicle_is_performed_where_it_is_brought(
    node: Node, capsys: pytest.CaptureFixture[str]
) -> None:
    """Anything else on the loop, in its next turn; and a defect of the vehicle's adapter is said, and stays there."""
    node.tell(*heard_vehicle())
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER)
    node.tell(answered(node.performed[-1].seq))
    by_port = {record.kind.port: record for record in node.performed}
    mesh, vehicle = Mesh(), Failing()
    both = edges(mesh, cast(Counting, vehicle))

    async def story() -> None:
        for port in ("mesh", "vehicle"):
            _perform(asyncio.get_running_loop(), both, by_port[port])
        assert (vehicle.performed, mesh.performed) == ([by_port["vehicle"].seq], [])
        await asyncio.sleep(0)
        assert mesh.performed == [by_port["mesh"].seq]

    asyncio.run(story())
    assert "an effect failed:\nTraceback" in capsys.readouterr().err


def test_what_was_rejected_is_recorded_as_counts(node: Node) -> None:
    """By gate, vehicle and eyes: once, sorted, and nothing when nothing was."""
    vehicle = Counting(garbage=4)
    rejections = Rejections(edges(Mesh(), vehicle))
    report_rejections(rejections, node.inbox)
    report_rejections(rejections, node.inbox)
    vehicle.rejected["garbage"] += 5
    report_rejections(rejections, node.inbox)
    node.turn()
    node.turn(after_ms=200)
    told = [[(one.reason, one.count) for one in each.rejected] for each in of_kind(node.log(), "samples_rejected")]
    first = [("eyes: too_many", 2), ("size", 1), ("token_sig", 3), ("vehicle: garbage", 4)]
    assert told == [first, [("vehicle: garbage", 5)]]


def test_what_was_rejected_while_the_inbox_was_full_is_told_later(node: Node) -> None:
    """No count is lost: it comes with the next."""
    rejections = Rejections(edges(Mesh(), vehicle := Counting(garbage=4)))
    while node.inbox.offer(InputClass.OUTCOME, vehicle_state(armed=True)):
        continue
    report_rejections(rejections, node.inbox)
    report_rejections(rejections, node.inbox)
    vehicle.rejected["garbage"] += 5
    while not node.inbox.empty:
        node.turn()
    report_rejections(rejections, node.inbox)
    report_rejections(rejections, node.inbox)
    node.turn()
    node.turn(after_ms=200)
    told = [[(one.reason, one.count) for one in each.rejected] for each in of_kind(node.log(), "samples_rejected")]
    assert told == [[("eyes: too_many", 2), ("size", 1), ("token_sig", 3), ("vehicle: garbage", 9)]]


def test_the_board_says_what_the_log_says(node: Node) -> None:
    """Who holds the camera, and for how much longer."""
    board = Board(lambda: 1_790_000_000_123)
    with pytest.raises(LookupError):
        _ = board.session
    node.tell(*heard_vehicle())
    node.tell(point_at_place("a1"), input_class=InputClass.ORDER)
    board.follow(node.session)
    board.hear(tuple(node.heard))
    node.clock.pass_ms(1_500)
    said = board.node_status()
    assert (said.at_ms, said.armed, said.vehicle_link, said.health) == (1_790_000_000_123, True, True, "normal")
    (camera,) = said.cameras
    assert (camera.callsign, camera.state, camera.held_for_ms) == ("ALPHA", "operator", 58_500)
    assert said.head_seq == node.session.store.head.seq


@pytest.mark.parametrize("rounds", range(5))
def test_whoever_waits_for_a_change_can_be_stopped_at_any_moment(rounds: int) -> None:
    """Also in the moment in which something changes: a daemon that ends must not wait for ever."""
    board = Board(lambda: 0)

    async def watch() -> None:
        while True:
            await board.changed(60)

    async def run() -> bool:
        task = asyncio.create_task(watch())
        for _ in range(3):
            await asyncio.sleep(0)
        board._changed.set()
        for _ in range(rounds):
            await asyncio.sleep(0)
        task.cancel()
        await asyncio.wait([task], timeout=5)
        return task.cancelled()

    assert asyncio.run(run())


@pytest.mark.parametrize("block", ["folder", "garbage"])
def test_projections_wait_for_better_times(node: Node, tmp_path: Path, block: str) -> None:
    """They are disposable: where they can't be written the node goes on, and they come back by themselves."""
    path = tmp_path / "projections.db"
    if block == "folder":
        path.mkdir()
    else:
        path.write_bytes(b"no database" * 100)
    board = Board(lambda: 0)
    board.follow(node.session)
    projecting = Projecting(path, board)

    async def run() -> bool:
        task = asyncio.create_task(projecting.run())
        await asyncio.sleep(0)  # the task has handed its first round to the thread; the next to go there waits for it
        await asyncio.get_running_loop().run_in_executor(projecting._thread, int)
        await asyncio.sleep(0)
        dead = task.done()
        if block == "folder":
            path.rmdir()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        await projecting.finish()
        return dead

    assert not asyncio.run(run())
    assert path.is_file()
    assert path.read_bytes().startswith(b"SQLite format 3")


def test_a_fold_that_fails_begins_anew(
    node: Node, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is said, the daemon's end is not disturbed, and the next round reads from the beginning."""
    board = Board(lambda: 0)
    board.follow(node.session)
    projecting = Projecting(tmp_path / "projections.db", board)

    def broken(_self: Projector, _reader: object) -> int:
        raise KeyError("odd")

    with monkeypatch.context() as patch:
        patch.setattr(Projector, "catch_up", broken)
        projecting._catch_up()
    assert "the projections are behind" in capsys.readouterr().err
    projecting._catch_up()
    assert read_status(tmp_path / "projections.db")["head_seq"] == node.session.store.head.seq
