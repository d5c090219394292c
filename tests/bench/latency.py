"""Order latency: from the put of an order to the vehicle's socket, the daemon against its floor in turns.

Both run in processes of their own and get the same kind of order over a Zenoh session of their own; both
end with a datagram on loopback. The vehicle here only beats its heart and accepts: what is measured is the
node, unloaded, one order at a time.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import threading
import uuid
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median, quantiles
from time import perf_counter, time_ns

from pymavlink.dialects.v20 import common as dialect

from autopilot.adapters.mesh.link import Link
from autopilot.ground import directory
from autopilot.ground.compose import point_at_place
from autopilot.trust.clock import HostClock
from autopilot.trust.envelope import MessageType, Packer
from autopilot.trust.identity import load_identity
from autopilot.wire.keys import order_key
from tests.bench.frame import ROUNDS, Bench, Row, at_most, fresh_folder
from tests.house import REPO

NODE = "bench-node"
ORDERS = 100  # a run; the 99th of them is its p99
WARM_UP = 20
ORDER_LIFE_MS = 5_000
ANSWER_S = 5.0  # an order that takes longer is lost, and the run with it
START_S = 30.0
REST_S = 0.02  # between orders, so that one is over before the next
HEARTBEAT_S = 0.5
P50_BUDGET, P99_BUDGET = 1.6, 2.0
COMMAND_INT = 75
WORDS = REPO / "build" / "bench-latency.txt"  # what daemon and floor print

_CONFIG = """
schema_version = 1
[node]
keys = {keys}
flights = {flights}
projections = {projections}
[command]
enabled = true
camera_roles = ["camera"]
roi_turns_vehicle = "warn" # the vehicle here tells of no gimbal
[mesh]
mode = "peer"
listen = [{listen}]
samples_per_s = 1000
[vehicle]
connect = {vehicle}
[flight]
origin = [52.1, 4.3, 0.0]
"""


class Vehicle(threading.Thread):
    """The end of the way: beats its heart, accepts commands, and stamps when one arrives."""

    def __init__(self, *, answers: bool) -> None:
        super().__init__(daemon=True)
        self._answers = answers
        self._mav = dialect.MAVLink(None, 1, 1)
        self._stopped = threading.Event()
        self._arrived = threading.Event()
        self._at_s = 0.0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(HEARTBEAT_S)
        self.port: int = self._socket.getsockname()[1]

    def expect(self) -> None:
        """Forget what arrived before."""
        self._arrived.clear()

    def arrived_at(self, timeout_s: float) -> float | None:
        """Wait for an order's datagram and return when it came (perf_counter), or None."""
        return self._at_s if self._arrived.wait(timeout_s) else None

    def stop(self) -> None:
        """End the thread."""
        self._stopped.set()
        self.join(timeout=5)
        self._socket.close()

    def run(self) -> None:
        """Receive until stopped."""
        peer, beat_at_s = None, 0.0
        while not self._stopped.is_set():
            try:
                datagram, peer = self._socket.recvfrom(2048)
                self._take(datagram, perf_counter(), peer)
            except TimeoutError:
                pass
            if peer is not None and self._answers and perf_counter() >= beat_at_s:
                beat_at_s = perf_counter() + HEARTBEAT_S
                self._socket.sendto(self._mav.heartbeat_encode(2, 3, 128, 0, 4).pack(self._mav), peer)

    def _take(self, datagram: bytes, at_s: float, peer: tuple[str, int]) -> None:
        if not self._answers or int.from_bytes(datagram[7:10], "little") == COMMAND_INT:
            self._at_s = at_s
            self._arrived.set()
            if self._answers:
                command = dialect.MAV_CMD_DO_SET_ROI_LOCATION
                self._socket.sendto(self._mav.command_ack_encode(command, 0).pack(self._mav), peer)


@dataclass(frozen=True, slots=True)
class Contestant:
    """One way that an order can take: the link that it leaves on and the socket where it ends."""

    link: Link
    vehicle: Vehicle
    process: subprocess.Popen[bytes]


class Operator:
    """Packs orders that the node takes, each with a number of its own."""

    def __init__(self, keys: Path, node_key: bytes) -> None:
        self._packer = Packer(load_identity(keys), HostClock())
        self._node_key = node_key
        self._number = time_ns() // 1_000_000

    def order(self) -> tuple[str, bytes]:
        """Return the key and the envelope of a fresh order."""
        self._number += 1
        command = point_at_place(52.1 + self._number % 100 / 1e5, 4.301, 10.0)
        command.command_id = str(uuid.UUID(bytes=os.urandom(16), version=4))
        command.target_node_pubkey = self._node_key
        key = order_key(NODE, command.command_id)
        content = command.SerializeToString(deterministic=True)
        packed = self._packer.pack(MessageType.ORDER, key, content, ttl_ms=ORDER_LIFE_MS, order_seq=self._number)
        return key, packed.envelope


def send(contestant: Contestant, operator: Operator, timeout_s: float) -> float | None:
    """Give one order and return the seconds until its datagram came, or None."""
    key, envelope = operator.order()
    contestant.vehicle.expect()
    began = perf_counter()
    contestant.link.put(key, envelope, urgent=True)
    arrived = contestant.vehicle.arrived_at(timeout_s)
    return None if arrived is None else arrived - began


def latency(contestant: Contestant, operator: Operator) -> float:
    """Return the seconds that an order took; raises TimeoutError where it was lost."""
    threading.Event().wait(REST_S)
    took = send(contestant, operator, ANSWER_S)
    if took is None:
        raise TimeoutError(f"an order was lost; what the daemon said is in {WORDS}")
    return took


def wait_until_taken(contestant: Contestant, operator: Operator) -> None:
    """Give orders until one gets through; raises TimeoutError."""
    give_up_at_s = perf_counter() + START_S
    while contestant.process.poll() is None and perf_counter() < give_up_at_s:
        if contestant.link.linked() and send(contestant, operator, 1.0) is not None:
            return
        threading.Event().wait(0.1)
    raise TimeoutError(f"no order got through; what the daemon said is in {WORDS}")


def free_endpoint() -> str:
    """Return a Zenoh endpoint on a TCP port of loopback that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def config_text(folder: Path, listen: str, vehicle_port: int) -> str:
    """Return the daemon's configuration, everything below `folder`."""
    values = {name: str(folder / name) for name in ("keys", "flights", "projections")}
    values |= {"listen": listen, "vehicle": f"127.0.0.1:{vehicle_port}"}
    return _CONFIG.format(**{name: json.dumps(value) for name, value in values.items()})


@contextmanager
def running(arguments: Sequence[str], listen: str, vehicle: Vehicle) -> Iterator[Contestant]:
    """Run a process that listens at `listen` and ends at `vehicle`; stop it afterwards."""
    with WORDS.open("ab") as words:
        process = subprocess.Popen(arguments, cwd=REPO, stdin=subprocess.PIPE, stdout=words, stderr=words)
    link = Link(mode="peer", connect=[listen])
    vehicle.start()
    link.start()
    try:
        yield Contestant(link, vehicle, process)
    finally:
        link.stop()
        process.terminate()
        process.communicate(timeout=20)
        vehicle.stop()


@contextmanager
def contest(folder: Path) -> Iterator[tuple[Contestant, Contestant, Operator]]:
    """Make identities, start daemon and floor, and wait until both take orders."""
    now_ms = time_ns() // 1_000_000
    house = directory.init(folder / "directory", deployment_id="bench", now_ms=now_ms, random=os.urandom)
    issue = partial(directory.issue, house, callsign="", now_ms=now_ms, random=os.urandom)
    token = issue(NODE, folder / "keys", kind="node", roles=())
    issue("bench-op", folder / "operator", kind="operator", roles=["camera"])
    operator = Operator(folder / "operator", token.device_sign_pk)
    ends, listens = [Vehicle(answers=True), Vehicle(answers=False)], [free_endpoint(), free_endpoint()]
    config = folder / "config.toml"
    config.write_text(config_text(folder, listens[0], ends[0].port), encoding="utf-8")
    daemon = [str(Path(sys.executable).with_name("autopilot")), "run", "--config", str(config)]
    floor = [sys.executable, "-m", "tests.bench.floor", str(folder / "keys"), listens[1], str(ends[1].port)]
    with ExitStack() as stack:
        node = stack.enter_context(running(daemon, listens[0], ends[0]))
        least = stack.enter_context(running([*floor, str(folder / "floor.db")], listens[1], ends[1]))
        for contestant in (node, least):
            wait_until_taken(contestant, operator)
        yield node, least, operator


def p99(latencies: Sequence[float]) -> float:
    """Return the 99th percentile."""
    return quantiles(latencies, n=100, method="inclusive")[98]


def one_run(node: Contestant, least: Contestant, operator: Operator, orders: int) -> tuple[list[float], list[float]]:
    """Give both the same number of orders, in the order N F F N N F F N, so that both follow both equally often.

    Whoever follows the daemon finds disk and processor awake, for an answered order leaves work behind it.
    """
    took: dict[str, list[float]] = {"node": [], "floor": []}
    for turn in range(orders):
        pair = [("node", node), ("floor", least)]
        for name, contestant in reversed(pair) if turn % 2 else pair:
            took[name].append(latency(contestant, operator))
    return took["node"], took["floor"]


def rows() -> list[Row]:
    """Return the rows of order latency."""
    WORDS.unlink(missing_ok=True)
    with fresh_folder() as folder, contest(folder) as (node, least, operator):
        one_run(node, least, operator, WARM_UP)
        runs = [one_run(node, least, operator, ORDERS) for _ in range(ROUNDS)]
    made = []
    for name, measure, budget in (("p50", median, P50_BUDGET), ("p99", p99, P99_BUDGET)):
        ratio = median(measure(mine) / measure(other) for mine, other in runs)
        floor_us = median(measure(other) for _, other in runs) * 1e6
        made.append(at_most(f"order latency, {name}", ratio, "x", budget, f"the floor, {floor_us:.0f} us"))
    return made


BENCHES = (Bench("latency/order", rows),)
