"""Orders as fast as they can be given: how many a second are durable and answered by the daemon.

Eight operators give 480 each, which is what a node remembers of one device at a time, with 64 of them unanswered. An
order counts when its ack has come; acks leave after the commit, and the log is counted afterwards.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from time import perf_counter, time_ns

from autopilot.adapters.mesh.link import Link
from autopilot.ground import directory
from autopilot.ground.compose import release
from autopilot.trust.clock import HostClock
from autopilot.trust.envelope import MessageType, Packer
from autopilot.trust.identity import load_identity
from autopilot.wire.keys import acks_of, order_key
from events.kinds import kind_named
from events.store import flights_in, read_flight
from tests.bench.frame import Bench, Row, at_least, fresh_folder
from tests.bench.latency import NODE, free_endpoint
from tests.house import REPO

OPERATORS, ORDERS, UNANSWERED = 8, 480, 64
BUDGET_PER_S = 400.0  # what the window of nonces lets in for good: 4,096 in 10 s
GIVE_UP_S = 120.0
WORDS = REPO / "build" / "bench-load.txt"

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
samples_per_s = 100000
samples_burst = 100000
"""


class Answers:
    """Which orders were answered."""

    def __init__(self) -> None:
        self._keys: set[str] = set()
        self._changed = threading.Condition()

    def take(self, key_expr: str, _payload: bytes) -> None:
        """Note an ack (called on Zenoh's thread)."""
        with self._changed:
            self._keys.add(key_expr)
            self._changed.notify_all()

    def forget(self) -> None:
        """Begin to count again."""
        with self._changed:
            self._keys.clear()

    def wait_for(self, count: int, timeout_s: float = GIVE_UP_S) -> bool:
        """Wait until so many were answered."""
        with self._changed:
            return self._changed.wait_for(lambda: len(self._keys) >= count, timeout_s)


@contextmanager
def daemon(folder: Path, listen: str) -> Iterator[None]:
    """Run the daemon."""
    values = {name: str(folder / name) for name in ("keys", "flights", "projections")} | {"listen": listen}
    path = folder / "config.toml"
    path.write_text(_CONFIG.format(**{name: json.dumps(value) for name, value in values.items()}), encoding="utf-8")
    WORDS.parent.mkdir(exist_ok=True)
    with WORDS.open("wb") as words:
        command = [sys.executable, "-m", "autopilot.cli.main", "run", "--config", str(path)]
        process = subprocess.Popen(command, cwd=REPO, stdout=words, stderr=words)
    try:
        yield
    finally:
        process.terminate()
        process.wait(timeout=30)


def operators(folder: Path) -> tuple[list[Packer], bytes]:
    """Make a Directory, the node's keys and those of the operators; return their packers and the node's key."""
    now_ms = time_ns() // 1_000_000
    house = directory.init(folder / "directory", deployment_id="bench", now_ms=now_ms, random=os.urandom)
    issue = partial(directory.issue, house, callsign="", now_ms=now_ms, random=os.urandom)
    token = issue(NODE, folder / "keys", kind="node", roles=())
    names = [f"op-{number}" for number in range(OPERATORS)]
    for name in names:
        issue(name, folder / name, kind="operator", roles=["camera"])
    return [Packer(load_identity(folder / name), HostClock()) for name in names], token.device_sign_pk


def order(packer: Packer, node_key: bytes, number: int) -> tuple[str, bytes]:
    """Return key and envelope of an order to release the camera."""
    command = release()
    command.command_id = str(uuid.UUID(bytes=os.urandom(16), version=4))
    command.target_node_pubkey = node_key
    key = order_key(NODE, command.command_id)
    content = command.SerializeToString(deterministic=True)
    return key, packer.pack(MessageType.ORDER, key, content, ttl_ms=30_000, order_seq=number).envelope


def durable(folder: Path) -> int:
    """Return how many orders the log holds."""
    reader = read_flight(flights_in(folder / "flights")[-1].folder)
    try:
        wanted = kind_named("order_received").number
        return sum(stored.kind_number == wanted for stored in reader.stored())
    finally:
        reader.close()


def load(folder: Path, each: int = ORDERS) -> tuple[float, int]:
    """Give all orders; return how many a second were answered, and how many are in the log."""
    packers, node_key = operators(folder)
    listen, answers = free_endpoint(), Answers()
    with daemon(folder, listen):
        link = Link(mode="peer", connect=[listen], reconnect_ms=50)
        link.subscribe(acks_of(NODE), answers.take)
        link.start()
        try:
            _first(link, answers, packers[0], node_key)
            given, began = 0, perf_counter()
            for number in range(each):
                for packer in packers:
                    given += 1
                    link.put(*order(packer, node_key, number + 1000), urgent=True)
                    answers.wait_for(given - UNANSWERED)
            if not answers.wait_for(given):
                raise TimeoutError(f"orders were lost; what the daemon said is in {WORDS}")
            took_s = perf_counter() - began
        finally:
            link.stop()
    return given / took_s, durable(folder)


def _first(link: Link, answers: Answers, packer: Packer, node_key: bytes) -> None:
    """Give orders until one is answered; none of these counts."""
    for number in range(1, 120):
        if link.linked():
            link.put(*order(packer, node_key, number), urgent=True)
        if answers.wait_for(1, 0.5):
            answers.forget()
            return
    raise TimeoutError(f"no order got through; what the daemon said is in {WORDS}")


def rows() -> list[Row]:
    """Return the row."""
    with fresh_folder() as folder:
        per_s, recorded = load(folder)
    return [at_least("orders, durable and answered", per_s, "/s", BUDGET_PER_S, f"{recorded} orders in the log")]


BENCHES = (Bench("load/orders", rows),)
