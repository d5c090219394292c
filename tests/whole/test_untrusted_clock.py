"""A node whose host clock is not to be believed, as a process: orders by its challenge, time by a Directory's beacon.

Everybody meets at a router with rules and no keys; the vehicle is a simulated one.
"""

from __future__ import annotations

import json
import subprocess
import sys
import uuid
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from autopilot.ground.issuer import Issuer
from autopilot.trust.clock import HostClock
from autopilot.trust.envelope import MessageType, Packer
from autopilot.trust.identity import load_identity
from autopilot.wire.keys import order_key
from events.schema.flight_pb2 import CLOCK_TRUSTED
from events.schema.trust_pb2 import TimeLearned
from events.schema.waypoint_pb2 import CameraRelease, DeviceCommand, NodeStatus
from tests.whole.daemons import WITHIN_S, ended, log, started, wait_for, write_config
from tests.whole.relays import free_datagram_port, plain, relaying, who_may_pass

pytestmark = pytest.mark.whole
AUTOPILOT = [sys.executable, "-m", "autopilot.cli.main"]
NODE = "wasp-01"


class Deployment:
    """A node that records, its vehicle, an operator, and a Directory that does not serve yet."""

    def __init__(self, folder: Path, endpoint: str, stack: ExitStack) -> None:
        self.folder, self.endpoint, self._stack = folder, endpoint, stack
        self.home = folder / "home"
        self.home.mkdir()

    def run(self, *words: str) -> str:
        """Run a command that must succeed; return what it printed."""
        command = [*AUTOPILOT, *words]
        run = subprocess.run(
            command, capture_output=True, text=True, timeout=2 * WITHIN_S, cwd=self.folder, check=False
        )
        assert run.returncode == 0, run.stdout + run.stderr
        return run.stdout

    def order(self) -> dict[str, object]:
        """Give an order as an operator does at a shell; return the answer."""
        words = ("--identity", "alice", "--connect", self.endpoint, "--to", NODE, "--life", "10", "--json")
        answer: dict[str, object] = json.loads(self.run("order", "release", *words))
        return answer

    def serve(self) -> None:
        """Let the Directory serve."""
        words = [*AUTOPILOT, "directory", "serve", "d", "--connect", self.endpoint]
        serving = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=self.folder)
        self._stack.callback(serving.communicate)
        self._stack.callback(serving.kill)

    def fly(self) -> int:
        """Let an aircraft stand ready; return its port."""
        port = free_datagram_port()
        words = ["--mavlink-port", str(port), "--eyes-port", "0", "--hold"]
        aircraft = subprocess.Popen(
            [sys.executable, "-m", "autopilot.sim.process", *words], stdout=subprocess.PIPE, text=True
        )
        self._stack.callback(aircraft.communicate)
        self._stack.callback(aircraft.kill)
        assert aircraft.stdout is not None
        assert aircraft.stdout.readline() == "ready\n"
        return port

    def believed_by(self) -> list[str]:
        """Return what made the node believe its time, by its log."""
        learned = [record.message for record in log(self.home) if isinstance(record.message, TimeLearned)]
        return [one.source for one in learned if one.to_quality == CLOCK_TRUSTED]


@pytest.fixture
def deployment(tmp_path: Path) -> Iterator[Deployment]:
    """Its node's host clock is configured as not to be trusted."""
    endpoint = plain()
    with ExitStack() as stack:
        made = Deployment(tmp_path, endpoint, stack)
        made.run("directory", "init", "d", "--deployment", "coast-watch")
        made.run("directory", "issue", "d", NODE, "--kind", "node", "--out", NODE)
        made.run("directory", "issue", "d", "alice", "--kind", "operator", "--role", "camera", "--out", "alice")
        stack.enter_context(relaying(tmp_path, who_may_pass() | {"outer": {"listen": [endpoint]}}))
        config = write_config(
            made.home,
            tmp_path / NODE,
            clock={"trusted": False},
            mesh={"connect": [endpoint], "reconnect_ms": 100},
            vehicle={"connect": f"127.0.0.1:{made.fly()}"},
            command={"enabled": True, "camera_roles": ["camera"]},
        )
        stack.callback(ended, started(config))
        yield made


def without_echo(folder: Path, target: bytes) -> tuple[str, bytes]:
    """Return key and envelope of an order that is right but for the challenge, which it does not echo."""
    alice = load_identity(folder / "alice")
    command_id = str(uuid.UUID(bytes=b"without an echo.", version=4))
    content = DeviceCommand(command_id=command_id, target_node_pubkey=target, camera_release=CameraRelease(camera=1))
    key = order_key(NODE, command_id)
    packed = Packer(alice, HostClock()).pack(
        MessageType.ORDER, key, content.SerializeToString(deterministic=True), ttl_ms=10_000, order_seq=1
    )
    return key, packed.envelope


def is_lost(status: NodeStatus) -> bool:
    """Say whether a node tells what an order has to echo."""
    return len(status.node_challenge) == 16


def dropped(status: NodeStatus) -> dict[str, int]:
    """Return the drops of a status by their counter."""
    return {drop.reason: drop.count for drop in status.dropped}


def test_orders_by_challenge_until_a_beacon_tells_the_time(deployment: Deployment) -> None:
    """Without the echo an order is dropped and counted; with it it is answered; a beacon ends the need for it."""
    with Issuer(load_identity(deployment.folder / "alice"), [deployment.endpoint]) as watcher:
        uncertain = watcher.wait_status(NODE, lambda status: status.vehicle_link and is_lost(status), WITHIN_S)
        assert uncertain is not None
        assert uncertain.undated
        key = watcher.node_key(NODE)
        assert key is not None
        watcher.publish_raw(*without_echo(deployment.folder, key))
        assert watcher.wait_status(NODE, lambda status: dropped(status) == {"challenge": 1}, WITHIN_S) is not None

        assert deployment.order()["result"] == "accepted"
        assert deployment.believed_by() == []

        deployment.serve()
        certain = watcher.wait_status(NODE, lambda status: not is_lost(status), WITHIN_S)
        assert certain is not None
        assert not certain.undated
        assert set(dropped(certain.status)) == {"challenge"}  # a shell's first try leaves before it heard the status
    wait_for(lambda: deployment.believed_by() == ["beacon"], "a record of the beacon")
    assert deployment.order()["result"] == "accepted"
