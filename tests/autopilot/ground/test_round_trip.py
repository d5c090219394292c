"""Real Zenoh: a router in its own process, a node's adapter and an issuer, and a router that dies and returns."""

from __future__ import annotations

import argparse
import json
import shutil
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from google.protobuf.message import Message

from autopilot.adapters.mesh import MeshAdapter
from autopilot.cli import directory as directory_command
from autopilot.cli import order as order_command
from autopilot.ground import compose, directory
from autopilot.ground.issuer import Issuer
from autopilot.ports.config import MeshSection
from autopilot.ports.edges import InputClass
from autopilot.trust.clock import HostClock, wall_ms
from autopilot.trust.identity import Identity, load_identity
from events.schema.common_pb2 import Place
from events.schema.orders_pb2 import AckPublished, AckResult, OrderMalformed, OrderReceived, SendAck
from events.schema.waypoint_pb2 import CameraStatus, NodeStatus
from tests.autopilot.trust.world import seeded

TIMEOUT_S = 30
pytestmark = pytest.mark.whole


class Router:
    """The router's process on one free port, which may be killed and started again."""

    def __init__(self) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
        self.process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        """Start and wait until it listens."""
        command = [sys.executable, "-m", "autopilot.sim.router", "--listen", self.endpoint]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"

    def end(self, how: signal.Signals) -> int:
        """End it with a signal; return its exit code."""
        assert self.process is not None
        self.process.send_signal(how)
        code = self.process.wait(TIMEOUT_S)
        assert self.process.stdout is not None
        self.process.stdout.close()
        self.process = None
        return code


@dataclass
class Node:
    """A node that accepts every new order and repeats its answer to what it has seen."""

    endpoint: str
    identity: Identity
    orders: list[OrderReceived | OrderMalformed] = field(default_factory=list)
    outcomes: list[AckPublished] = field(default_factory=list)
    changed: threading.Condition = field(default_factory=threading.Condition)

    def __post_init__(self) -> None:
        config = MeshSection(connect=(self.endpoint,), reconnect_ms=100)
        self.adapter = MeshAdapter(config, self.identity, HostClock(), lambda *_: Place(mgrs="31U"), self.offer)

    def offer(self, input_class: InputClass, observation: Message) -> bool:
        """Take everything, answer orders."""
        with self.changed:
            if isinstance(observation, AckPublished):
                self.outcomes.append(observation)
            elif input_class is InputClass.ORDER and isinstance(observation, (OrderReceived, OrderMalformed)):
                seen = any(order.command_id == observation.command_id for order in self.orders)
                self.orders.append(observation)
                self._answer(observation, duplicate=seen)
            self.changed.notify_all()
        return True

    def _answer(self, order: OrderReceived | OrderMalformed, *, duplicate: bool) -> None:
        ack = SendAck(command_id=order.command_id, final=True, in_reply_to=order.in_reply_to, duplicate=duplicate)
        ack.result = AckResult.ACK_ACCEPTED if isinstance(order, OrderReceived) else AckResult.ACK_REJECTED
        self.adapter.perform(len(self.orders), ack, HostClock().mono_ns())


@dataclass(frozen=True)
class Field:
    """Everything of a test on the mesh."""

    router: Router
    node: Node
    alice: Issuer
    folder: Path


@pytest.fixture
def mesh(tmp_path: Path) -> Iterator[Field]:
    router, now_ms = Router(), wall_ms(HostClock())
    made = directory.init(tmp_path / "directory", deployment_id="test", now_ms=now_ms, random=seeded(1))
    for name, kind, role in (("wasp", "node", "camera"), ("alice", "operator", "operator")):
        directory.issue(
            made, name, tmp_path / name, kind=kind, roles=[role], callsign=name, now_ms=now_ms, random=seeded(len(name))
        )
    node = Node(router.endpoint, load_identity(tmp_path / "wasp"))
    alice = Issuer(load_identity(tmp_path / "alice"), [router.endpoint], reconnect_ms=100)
    node.adapter.start()
    alice.start()
    yield Field(router, node, alice, tmp_path)
    alice.stop()
    node.adapter.stop()
    if router.process is not None:
        router.end(signal.SIGKILL)


def test_orders_and_answers_cross_a_router_that_dies_and_returns(mesh: Field) -> None:
    """Given before the router is there, answered after; killed, given again, answered; garbage counted."""
    early = mesh.alice.send("wasp", compose.release(), 30)
    mesh.router.start()
    assert mesh.alice.wait(early, TIMEOUT_S).result == "accepted"
    mesh.router.end(signal.SIGKILL)
    late = mesh.alice.send("wasp", compose.point_at_place(52, 4, 10), 30)
    assert late.answer.state == "waiting"
    mesh.router.start()
    assert mesh.alice.wait(late, TIMEOUT_S).result == "accepted"
    taken = [order for order in mesh.node.orders if order.command_id == late.command_id]
    assert len({order.body_digest for order in taken if isinstance(order, OrderReceived)}) == 1
    assert isinstance(taken[0], OrderReceived)
    assert taken[0].point_at_place.place.mgrs == "31U"

    repeat = mesh.alice.repeat(late)
    assert mesh.alice.wait(repeat, TIMEOUT_S).duplicate
    mesh.alice.publish_raw(f"waypoint/global/cmd/wasp/{late.command_id}", repeat.envelopes[0])
    mesh.alice.publish_raw("waypoint/global/cmd/wasp/x", b"garbage")
    mesh.alice.publish_raw("waypoint/global/cmd/wasp/x", b"\xff" * 100_000)
    last = mesh.alice.send("wasp", compose.release())
    assert mesh.alice.wait(last, TIMEOUT_S).result == "accepted"
    assert mesh.node.adapter.take_rejections() == {"replay": 1, "size": 2}
    assert mesh.node.adapter.tally().balances()
    assert all(not outcome.failure for outcome in mesh.node.outcomes)
    assert mesh.router.end(signal.SIGTERM) == 0


def check_command(capsys: pytest.CaptureFixture[str], arguments: list[str], code: int) -> str:
    """Run one command line; return what it wrote to stdout."""
    parser = argparse.ArgumentParser()
    commands = parser.add_subparsers()
    directory_command.add(commands)
    order_command.add(commands)
    args = parser.parse_args(arguments)
    assert args.run(args) == code
    return capsys.readouterr().out


def test_an_order_from_a_shell(mesh: Field, capsys: pytest.CaptureFixture[str]) -> None:
    mesh.router.start()
    common = ["--identity", str(mesh.folder / "alice"), "--connect", mesh.router.endpoint, "--to", "wasp", "--json"]
    said = json.loads(check_command(capsys, ["order", "look", "-30", "90", "--north", *common], 0))
    assert (said["result"], said["state"], said["node"]) == ("accepted", "final", "wasp")
    rows = check_command(capsys, ["order", "history", "--identity", str(mesh.folder / "alice"), "--json"], 0)
    assert [json.loads(row)["state"] for row in rows.splitlines()] == ["pending", "final"]
    said = json.loads(check_command(capsys, ["order", "confirm", "nonsense", *common], 1))
    assert said["result"] == "rejected"
    camera = CameraStatus(camera=1, state="operator", callsign="alice", aim="arrived", error_cdeg=40)
    stop = threading.Event()

    def tell() -> None:
        while not stop.wait(0.05):
            mesh.node.adapter.publish_status(NodeStatus(at_ms=wall_ms(HostClock()), cameras=[camera]))

    teller = threading.Thread(target=tell)
    teller.start()
    shutil.rmtree(mesh.folder / "alice" / "nodes")
    words = check_command(capsys, ["order", "watch", "--seconds", "1", *common[:-1]], 0)
    said = json.loads(check_command(capsys, ["order", "release", *common], 0))
    stop.set()
    teller.join()
    assert "camera 1 operator by alice, arrived 0.4 deg off" in words
    assert said["result"] == "accepted"
    lines = check_command(capsys, ["order", "history", "--identity", str(mesh.folder / "alice")], 0).splitlines()
    assert [line.split()[3] for line in lines] == ["camera_pitch_yaw"] * 2 + ["poi_confirm"] * 2 + [
        "camera_release"
    ] * 2


def test_until_the_gimbal_is_there(mesh: Field, capsys: pytest.CaptureFixture[str]) -> None:
    """What the status says of the very order is waited for; what the operator may do is said beforehand."""
    mesh.router.start()
    common = ["--identity", str(mesh.folder / "alice"), "--connect", mesh.router.endpoint, "--to", "wasp"]
    stop = threading.Event()

    def tell() -> None:
        while not stop.wait(0.05):
            asked = mesh.node.orders[-1].command_id if mesh.node.orders else ""
            camera = CameraStatus(camera=1, command_id=asked, aim="arrived", error_cdeg=40, arrived_after_ms=2100)
            said = NodeStatus(at_ms=wall_ms(HostClock()), head_seq=99, cameras=[camera], command_enabled=True)
            said.camera_roles.append("operator")
            mesh.node.adapter.publish_status(said)

    teller = threading.Thread(target=tell)
    teller.start()
    words = check_command(capsys, ["order", "look", "-30", "90", "--until", "arrived", *common], 0)
    may = check_command(capsys, ["order", "may", *common], 0)
    stop.set()
    teller.join()
    assert words == "accepted; arrived, 0.4 deg off, after 2.1 s\n"
    assert may == "camera: yes\nflight: no, the node allows it to nobody\n"


def test_an_order_that_nobody_answers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = str(tmp_path / "directory")
    assert "coast" in check_command(capsys, ["directory", "init", made, "--deployment", "coast"], 0)
    check_command(capsys, ["directory", "init", made], 73)
    for name, kind in (("wasp", "node"), ("alice", "operator")):
        out = str(tmp_path / name)
        said = check_command(
            capsys, ["directory", "issue", made, name, "--kind", kind, "--role", "r", "--out", out, "--json"], 0
        )
        assert json.loads(said)["device_public_key"] == load_identity(out).public_key.hex()
    check_command(capsys, ["directory", "issue", made, "bob", "--kind", "node", "--out", str(tmp_path / "wasp")], 65)
    check_command(
        capsys, ["directory", "issue", str(tmp_path), "bob", "--kind", "node", "--out", str(tmp_path / "bob")], 65
    )
    nowhere = ["--connect", "tcp/127.0.0.1:1", "--to", "wasp", "--life", "0.2"]
    said = check_command(capsys, ["order", "release", "--identity", str(tmp_path / "alice"), *nowhere], 69)
    assert said == "no answer\n"
    check_command(capsys, ["order", "release", "--identity", str(tmp_path / "nobody"), *nowhere], 78)
