"""Real orders in a flood of forged ones: 20,000 a second on another link behind ingress limits, 5,000 a second on the
operators' own link behind a verifying relay, and 20,000 with no protection at all.

Relay, node and attacker are processes of their own. An order is lost when its datagram has not left the node for the
vehicle within a second; an issuer would publish it again, here it is counted. Before the flood the same orders are
given in quiet, so that latency, disk and memory have something to stand against.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from math import inf
from os import urandom
from pathlib import Path
from shutil import copyfile
from statistics import median
from time import perf_counter, time_ns
from typing import Any

import psutil

from autopilot.adapters.mesh.link import Link
from autopilot.ground import directory
from autopilot.trust.identity import REVOCATIONS_FILE, ROOT_FILE
from events.store import flights_in, read_flight
from tests.bench.frame import Bench, Row, at_least, at_most, fresh_folder
from tests.bench.latency import NODE, Contestant, Operator, Vehicle, free_endpoint, p99, send, wait_until_taken
from tests.house import REPO

SECONDS, QUIET_S = 60.0, 20.0
ORDER_EVERY_S = 0.1  # a person, and slower than the limit of 20 a second that stands before the relay
LOST_AFTER_S = 1.0
SESSIONS = 4  # of the attacker, where it has links of its own
P99_BUDGET_MS = 50.0
RSS_BUDGET_MIB, DISK_BUDGET = 8.0, 1.25
OFFERED_BUDGET = 0.9  # of the rate that is asked of the attacker; below it the row says nothing
WORDS = REPO / "build" / "bench-flood.txt"

_NODE = """
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
connect = [{connect}]
reconnect_ms = 100
[vehicle]
connect = {vehicle}
[flight]
origin = [52.1, 4.3, 0.0]
"""
_RELAY = """
schema_version = 1
[relay]
mode = "{mode}"
[outer]
listen = ["{outer}"]
[who.ground]
side = "ground"
nodes = ["{node}"]
[who.node]
side = "node"
nodes = ["{node}"]
"""
_VERIFY = """
[rates]
orders_hz = 0
[inner]
listen = ["{inner}"]
[verify]
documents = "public"
nodes = ["{node}"]
"""


@dataclass(frozen=True, slots=True)
class Case:
    """One way to stand in a flood."""

    name: str
    per_s: int
    guard: str  # bare, router or verifying
    shared: bool  # the attacker sits on the link of the operators


CASES = (
    Case("another link, ingress limits", 20_000, "router", shared=False),
    Case("same link, verifying relay", 5_000, "verifying", shared=True),
    Case("no protection", 20_000, "bare", shared=False),
)


@dataclass
class Spell:
    """What became of the orders of one spell, and what it cost."""

    took_s: list[float] = field(default_factory=list)
    given: int = 0
    seconds: float = 0.0
    disk_bytes: int = 0
    rss_bytes: dict[str, int] = field(default_factory=dict)
    forged: int = 0

    @property
    def lost(self) -> int:
        """Orders that did not reach the vehicle in time."""
        return self.given - len(self.took_s)

    def disk_per_s(self) -> float:
        """Bytes that were recorded in a second."""
        return self.disk_bytes / self.seconds

    def p99_ms(self) -> float:
        """The 99th percentile of those that arrived, in milliseconds."""
        return p99(self.took_s) * 1000 if len(self.took_s) > 1 else inf


@contextmanager
def process(*words: str, ready: str = "", cwd: Path = REPO) -> Iterator[subprocess.Popen[str]]:
    """Run a Python module until the end, and wait for the line by which it says that it is ready."""
    WORDS.parent.mkdir(exist_ok=True)
    with WORDS.open("a", encoding="utf-8") as said:
        child = subprocess.Popen(
            [sys.executable, "-m", *words], cwd=cwd, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        try:
            assert child.stdout is not None
            while ready not in (line := child.stdout.readline()):
                said.write(line)
                if not line:
                    raise RuntimeError(f"{words[0]} ended; what it said is in {WORDS}")
            yield child
        finally:
            child.terminate()
            said.write(child.communicate(timeout=30)[0])


def identities(folder: Path) -> Operator:
    """Make a Directory, the node's and an operator's keys, and the public folder of a relay; return the operator."""
    now_ms = time_ns() // 1_000_000
    house = directory.init(folder / "directory", deployment_id="bench", now_ms=now_ms, random=urandom)
    issue = partial(directory.issue, house, callsign="", now_ms=now_ms, random=urandom)
    token = issue(NODE, folder / "keys", kind="node", roles=())
    issue("bench-op", folder / "operator", kind="operator", roles=["camera"])
    (folder / "public").mkdir()
    for name in (ROOT_FILE, REVOCATIONS_FILE):
        copyfile(house.folder / name, folder / "public" / name)
    return Operator(folder / "operator", token.device_sign_pk)


def guard(stack: ExitStack, case: Case, folder: Path) -> tuple[str, str, subprocess.Popen[str]]:
    """Start what stands between; return the endpoints outside and inside, and its process."""
    outer = inner = free_endpoint()
    if case.guard == "bare":
        return outer, inner, stack.enter_context(
            process("autopilot.sim.router", "--listen", outer, ready="ready")
        )  # fmt: skip
    text = _RELAY.format(mode=case.guard, outer=outer, node=NODE)
    if case.guard == "verifying":
        inner = free_endpoint()
        text += _VERIFY.format(inner=inner, node=NODE)
    path = folder / "relay.toml"
    path.write_text(text, encoding="utf-8")
    words = ("autopilot.cli.main", "relay", "--config", str(path))
    return outer, inner, stack.enter_context(process(*words, ready="ready"))


def node(stack: ExitStack, folder: Path, connect: str, vehicle: Vehicle) -> subprocess.Popen[str]:
    """Start the daemon, with the limits that it ships with."""
    values = {name: str(folder / name) for name in ("keys", "flights", "projections")}
    values |= {"connect": connect, "vehicle": f"127.0.0.1:{vehicle.port}"}
    path = folder / "config.toml"
    path.write_text(_NODE.format(**{name: json.dumps(value) for name, value in values.items()}), encoding="utf-8")
    return stack.enter_context(process("autopilot.cli.main", "run", "--config", str(path), ready="recording in"))


def attacker(stack: ExitStack, case: Case, folder: Path, outer: str, seconds: float) -> tuple[Any, str]:
    """Start the attacker; return its process, and where operators connect."""
    listen = free_endpoint() if case.shared else ""
    count = 1 if case.shared else SESSIONS
    arguments = (str(folder / "operator"), NODE, outer, listen, str(count), str(case.per_s), str(seconds))
    return stack.enter_context(process("tests.bench.flooder", *arguments, ready="ready")), listen or outer


def spell(
    contestant: Contestant, operator: Operator, folder: Path, seconds: float, watched: dict[str, int]
) -> Spell:  # fmt: skip
    """Give orders for so long; return what became of them."""
    found, rest = Spell(seconds=seconds), threading.Event()
    disk, rss = _recorded(folder), _rss(watched)
    rest.wait(ORDER_EVERY_S)  # after whatever was given before: the limit is one order in 50 ms
    began = perf_counter()
    while perf_counter() - began < seconds:
        found.given += 1
        took = send(contestant, operator, LOST_AFTER_S)
        if took is not None:
            found.took_s.append(took)
            rest.wait(max(0.0, ORDER_EVERY_S - took))
    found.disk_bytes = _recorded(folder) - disk
    found.rss_bytes = {name: size - rss[name] for name, size in _rss(watched).items()}
    return found


def run(case: Case, folder: Path, seconds: float, quiet_s: float) -> tuple[Spell, Spell]:
    """Give orders in quiet, then in the flood."""
    operator = identities(folder)
    vehicle = Vehicle(answers=True)
    vehicle.start()
    with ExitStack() as stack:
        stack.callback(vehicle.stop)
        outer, inner, between = guard(stack, case, folder)
        daemon = node(stack, folder, inner, vehicle)
        flooder, at = attacker(stack, case, folder, outer, seconds)
        link = Link(connect=[at], reconnect_ms=100)
        link.start()
        stack.callback(link.stop)
        contestant = Contestant(link, vehicle, daemon)  # type: ignore[arg-type]
        wait_until_taken(contestant, operator)
        watched = {"node": daemon.pid, "relay": between.pid}
        quiet = spell(contestant, operator, folder, quiet_s, watched)
        print("go", file=flooder.stdin, flush=True)
        flooded = spell(contestant, operator, folder, seconds, watched)
        flooded.forged = int(flooder.stdout.readline())
    return quiet, flooded


def rows_of(case: Case, quiet: Spell, flooded: Spell) -> list[Row]:
    """Return the rows of one case. Without protection there is no budget to meet, only a figure to know."""
    guarded = case.guard != "bare"
    of = f"{flooded.given} orders, {flooded.forged / flooded.seconds:,.0f} forged/s"
    rss = max(flooded.rss_bytes.values()) / (1 << 20)
    disk = flooded.disk_per_s() / max(1.0, quiet.disk_per_s())
    name = f"flood, {case.name}"
    p50_ms = median(flooded.took_s) * 1000 if flooded.took_s else inf
    quiet_words = f"in quiet {median(quiet.took_s) * 1000:.2f} ms, p99 {quiet.p99_ms():.2f} ms"
    return [
        at_most(f"{name}: lost", 100 * flooded.lost / flooded.given, "%", 0.0 if guarded else 100.0, of),
        at_most(f"{name}: p50", p50_ms, "ms", P99_BUDGET_MS if guarded else inf, quiet_words),
        at_most(f"{name}: p99", flooded.p99_ms(), "ms", P99_BUDGET_MS if guarded else inf, quiet_words),
        at_most(f"{name}: memory", rss, "MiB", RSS_BUDGET_MIB, "node or relay, whichever grew more"),
        at_most(f"{name}: disk", disk, "x", DISK_BUDGET, "what is recorded in quiet"),
        at_least(
            f"{name}: offered", flooded.forged / flooded.seconds, "/s", OFFERED_BUDGET * case.per_s, "the attacker"
        ),
    ]


def _recorded(folder: Path) -> int:
    """Return the bytes of all bodies in the open flight; the file itself grows and is emptied in steps."""
    reader = read_flight(flights_in(folder / "flights")[-1].folder)
    try:
        return sum(len(stored.body) for stored in reader.stored())
    finally:
        reader.close()


def _rss(watched: dict[str, int]) -> dict[str, int]:
    return {name: psutil.Process(pid).memory_info().rss for name, pid in watched.items()}


def bench(case: Case) -> Callable[[], Sequence[Row]]:
    """Return the bench of one case."""

    def rows() -> list[Row]:
        with fresh_folder() as folder:
            return rows_of(case, *run(case, folder, SECONDS, QUIET_S))

    return rows


BENCHES = tuple(Bench(f"flood/{case.guard}", bench(case)) for case in CASES)
