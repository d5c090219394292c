"""A verifying relay as a process, with a real daemon behind it: real orders pass both ways, forged ones stay outside.

Also here: that it is blind. Its memory, its open files and its folder are searched for a canary inside the orders that
pass through it and for the group's secret, by a search that finds both in the process that has them.
"""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import zenoh

from autopilot.ground import compose, directory
from autopilot.ground.directory_store import read_epoch_secret
from autopilot.ground.issuer import Issuer
from autopilot.trust import pae
from autopilot.trust.clock import HostClock, wall_ms
from autopilot.trust.documents import sign
from autopilot.trust.envelope import MessageType, Packer
from autopilot.trust.identity import REVOCATIONS_FILE, ROOT_FILE, load_identity
from autopilot.trust.keys import write_file
from autopilot.wire.keys import ack_key, acks_of, order_key, orders_of
from events.schema.waypoint_pb2 import AuthEnvelope, RevocationList
from tests.autopilot.trust.world import COMMAND_ID, seeded
from tests.whole.daemons import ended, started, wait_for, write_config
from tests.whole.relays import RelayProcess, listen, plain, put, relaying, session

pytestmark = pytest.mark.whole
NODE = "wasp"
CANARY = b"canary in a coal mine"


@dataclass
class World:
    """A Directory, a relay, a node's daemon behind it, and an operator before it."""

    folder: Path
    made: directory.Directory
    outer: str
    inner: str
    relay: RelayProcess
    daemon: subprocess.Popen[str]
    issuer: Issuer

    def identity(self, name: str) -> Any:
        """Return somebody's identity."""
        return load_identity(self.folder / name)

    def ordered(self) -> str:
        """Give an order that needs no vehicle; return its result."""
        return self.issuer.wait(self.issuer.send(NODE, compose.release())).result


def people(folder: Path) -> directory.Directory:
    """Make a Directory with a node and two operators, and the public folder of a relay."""
    now_ms = wall_ms(HostClock())
    made = directory.init(folder / "directory", deployment_id="t", now_ms=now_ms - 1000, random=seeded(1))
    for number, (name, kind) in enumerate(((NODE, "node"), ("alice", "operator"), ("bob", "operator"))):
        chance = seeded(number + 2)
        directory.issue(
            made, name, folder / name, kind=kind, roles=["camera"], callsign="", now_ms=now_ms, random=chance
        )
    (folder / "public").mkdir()
    for name in (ROOT_FILE, REVOCATIONS_FILE):
        write_file(folder / "public" / name, (made.folder / name).read_bytes())
    return made


def verifying(outer: str, inner: str, **verify: Any) -> dict[str, Any]:
    """Return the configuration of the relay."""
    return {
        "relay": {"mode": "verifying", "report_s": 0.2},
        "outer": {"listen": [outer]},
        "inner": {"listen": [inner]},
        "rates": {"orders_hz": 0},
        "who": {"ground": {"side": "ground", "nodes": [NODE]}, "node": {"side": "node", "nodes": [NODE]}},
        "verify": {"documents": "public", "nodes": [NODE], **verify},
    }


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    """The whole of it, until the node's status has reached the operator."""
    made = people(tmp_path)
    outer, inner = plain(), plain()
    with ExitStack() as stack:
        relay = stack.enter_context(relaying(tmp_path, verifying(outer, inner)))
        config = write_config(tmp_path, tmp_path / NODE, mesh={"connect": [inner], "reconnect_ms": 100})
        daemon = started(config)
        stack.callback(ended, daemon)
        issuer = stack.enter_context(Issuer(load_identity(tmp_path / "alice"), [outer], reconnect_ms=100))
        issuer.watch(NODE)
        wait_for(lambda: issuer.status(NODE) is not None, "a status through the relay")
        yield World(tmp_path, made, outer, inner, relay, daemon, issuer)


def revoke(world: World, principal: str, version: int) -> None:
    """Put a list that names `principal` into the relay's folder."""
    listed = RevocationList(
        v=1, deployment_id="t", version=version, issued_at_ms=wall_ms(HostClock()), next_update_ms=1 << 50,
        prev_digest=b"p" * 32, principals=[principal], min_policy_version=1, min_epoch_id=1,
    )  # fmt: skip
    signed = sign(pae.REVOCATION_LIST, listed, [world.made.purpose_keys["revoke"]])
    write_file(world.folder / "public" / REVOCATIONS_FILE, signed)


def packed(world: World, who: str, content: bytes = b"c") -> tuple[str, bytes]:
    """Return key and envelope of an order that nobody can decode and everybody can verify."""
    return packed_by(world.folder, who, content)


def packed_by(folder: Path, who: str, content: bytes = b"c") -> tuple[str, bytes]:
    """Return the same by an identity in a folder."""
    key, packer = order_key(NODE, COMMAND_ID), Packer(load_identity(folder / who), HostClock())
    return key, packer.pack(MessageType.ORDER, key, content, ttl_ms=10_000).envelope


def forged(envelope: bytes) -> bytes:
    """Return it with another signature."""
    message = AuthEnvelope.FromString(envelope)
    message.device_signature = bytes(64)
    return message.SerializeToString(deterministic=True)


def test_orders_and_answers_pass_and_forgeries_stay_outside(world: World) -> None:
    """The answer is the node's own; what was forged reaches neither side, and each is counted by its reason."""
    assert world.ordered() == "unsupported"  # this node takes no orders, and says so
    with session(world.inner) as inside, session(world.outer) as outside, session(world.outer) as elsewhere:
        orders, _orders = listen(inside, orders_of(NODE))
        acks, _acks = listen(elsewhere, acks_of(NODE))
        key, good = packed(world, "bob")

        def arrived() -> bool:
            put(outside, key, packed(world, "bob")[1])
            return bool(orders.keys)

        wait_for(arrived, "an order inside")
        put(outside, key, forged(good))
        put(outside, key, b"\xff" * 500)
        put(outside, key + "/more", good)
        put(inside, ack_key(NODE, COMMAND_ID), good)
        put(outside, key, good)
        orders.wait(lambda: good in orders.payloads)
        put(outside, key, good)
        assert world.ordered() == "unsupported"
        assert {AuthEnvelope.FromString(payload).device_signature for payload in orders.payloads} & {bytes(64)} == set()
        acks.wait(lambda: bool(acks.keys))
        assert good not in acks.payloads
        assert orders.payloads.count(good) == 1
    counts = world.relay.counts()
    assert counts["orders"]["passed"] + 3 == counts["orders"]["received"]
    assert {name: counts["orders"][name] for name in ("device_sig", "parse_env", "replay")} == {
        "device_sig": 1,
        "parse_env": 1,
        "replay": 1,
    }
    assert counts["acks"]["type"] == 1
    assert counts["inward"]["relayed"] == counts["orders"]["passed"] + counts["cosignatures"]["passed"]
    assert (counts["inward"]["queue_full"], counts["outward"]["queue_full"]) == (0, 0)


def test_who_is_revoked_in_flight_is_stopped_at_the_relay(world: World) -> None:
    """A list that is laid into its folder holds within a second; an older one that follows does not undo it."""
    with session(world.inner) as inside, session(world.outer) as outside:
        orders, _orders = listen(inside, orders_of(NODE))

        def arrived() -> bool:
            put(outside, *packed(world, "bob"))
            return bool(orders.keys)

        wait_for(arrived, "an order inside")
        revoke(world, "bob", 3)
        assert world.relay.process.stdout is not None
        wait_for(lambda: _revoked(world, outside), "a revocation that holds")
        revoke(world, "alice", 2)
        assert world.relay.process.stderr is not None
        assert "version 2 is older than 3" in world.relay.process.stderr.readline()
        assert world.ordered() == "unsupported"


def _revoked(world: World, outside: Any) -> bool:
    """Have bob order, and say whether the counts that the relay prints next have it as revoked."""
    put(outside, *packed(world, "bob"))
    assert world.relay.process.stdout is not None
    return '"revoked"' in world.relay.process.stdout.readline()


def test_questions_for_proofs_pass(world: World) -> None:
    """A node behind a relay can be watched; its answer is the node's."""
    world.issuer.wait_status(NODE, lambda status: bool(status.log_checkpoint), 10)
    answers: list[bytes] = []
    with session(world.outer) as outside:

        def answered() -> bool:
            replies = outside.get(f"waypoint/global/proof/{NODE}", payload=b"\x08\x01\x10\x01\x18\x02", timeout=3.0)
            answers.extend(reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None)
            return bool(answers)

        wait_for(answered, "an answer")
    assert answers[0].startswith(b"\x08\x01\x10\x01\x18\x02")


def memory_of(pid: int) -> Iterator[bytes]:
    """Yield the readable memory of a process, piece by piece, each overlapping the one before."""
    maps = Path(f"/proc/{pid}/maps").read_text(encoding="utf-8")
    with Path(f"/proc/{pid}/mem").open("rb", buffering=0) as memory:
        for found in re.finditer(r"^([0-9a-f]+)-([0-9a-f]+) r\S+ \S+ \S+ \d+ *(.*)$", maps, re.MULTILINE):
            begin, end = int(found[1], 16), int(found[2], 16)
            for at in range(begin, end, 1 << 22):
                try:
                    memory.seek(at)
                    yield memory.read(min(end - at, (1 << 22) + 64))
                except (OSError, ValueError, OverflowError):
                    break  # [vvar] and the like can't be read by anybody


def files_of(pid: int) -> Iterator[bytes]:
    """Yield the content of the regular files that a process has open."""
    for link in Path(f"/proc/{pid}/fd").iterdir():
        path = Path(os.readlink(link))
        if path.is_file():
            yield path.read_bytes()


def has(pid: int, wanted: bytes) -> bool:
    """Say whether a process holds these bytes in its memory or open files."""
    return any(wanted in part for part in (*memory_of(pid), *files_of(pid)))


HOLDER = """
import sys
from autopilot.trust.clock import HostClock
from autopilot.trust.gate import Gate
from autopilot.trust.envelope import MessageType
from autopilot.trust.identity import load_identity
from events.schema.waypoint_pb2 import PrincipalKind
identity = load_identity(sys.argv[1])
gate = Gate(identity, MessageType.ORDER, kinds=frozenset({PrincipalKind.OPERATOR}), is_ours=lambda _: True,
            reader=lambda _, content: content, clock=HostClock())
kept = gate.judge(sys.argv[2], bytes.fromhex(sys.stdin.readline()))
print(type(kept).__name__, flush=True)
sys.stdin.readline()
"""


def test_the_relay_is_blind(world: World) -> None:
    """Orders with a canary pass through it, and neither the canary nor the group's secret is anywhere in it.

    The same search finds the secret in the daemon, and both in a process that opens the very same envelope.
    """
    secret = read_epoch_secret(world.made.folder, 1)
    with session(world.inner) as inside, session(world.outer) as outside:
        orders, _orders = listen(inside, orders_of(NODE))

        def arrived() -> bool:
            put(outside, *packed(world, "alice", CANARY))
            return len(orders.keys) > 3

        wait_for(arrived, "orders with the canary")
        key, envelope = orders.keys[-1], orders.payloads[-1]
    relay, daemon = world.relay.process.pid, world.daemon.pid
    assert has(relay, envelope[-64:])  # it holds what it passed: the search sees its memory
    assert (has(relay, CANARY), has(relay, secret)) == (False, False)
    assert has(daemon, secret)
    command = [sys.executable, "-c", HOLDER, str(world.folder / NODE), key]
    holder = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert holder.stdin is not None
    assert holder.stdout is not None
    try:
        print(envelope.hex(), file=holder.stdin, flush=True)
        assert holder.stdout.readline() == "Opened\n"
        assert (has(holder.pid, CANARY), has(holder.pid, secret)) == (True, True)
    finally:
        holder.communicate()
    written = [path for path in (world.folder / "public").rglob("*") if path.is_file()]
    assert [path.name for path in written if secret in path.read_bytes() or CANARY in path.read_bytes()] == []
    assert sorted(path.name for path in written) == [REVOCATIONS_FILE, ROOT_FILE]


def test_a_bare_router_is_blind_too(tmp_path: Path) -> None:
    """It has no documents at all."""
    made, endpoint = people(tmp_path), plain()
    both = {"side": "node", "nodes": [NODE]}, {"side": "ground", "nodes": [NODE]}
    config = {"relay": {"mode": "router"}, "outer": {"listen": [endpoint]}, "who": {"a": both[0], "b": both[1]}}
    with relaying(tmp_path, config) as relay, session(endpoint) as inside, session(endpoint) as outside:
        orders, _orders = listen(inside, orders_of(NODE))
        packer, key = Packer(load_identity(tmp_path / "alice"), HostClock()), order_key(NODE, COMMAND_ID)

        def arrived() -> bool:
            put(outside, key, packer.pack(MessageType.ORDER, key, CANARY, ttl_ms=10_000).envelope)
            return len(orders.keys) > 3

        wait_for(arrived, "orders with the canary")
        assert has(relay.process.pid, NODE.encode())
        assert (has(relay.process.pid, CANARY), has(relay.process.pid, read_epoch_secret(made.folder, 1))) == (
            False,
            False,
        )


SELECTORS = (
    f"waypoint/global/proof/{NODE}?_time=[now(1s)..]",
    f"waypoint/global/proof/{NODE}?_time=[now(s)..]",
    f"waypoint/global/proof/{NODE}?_time=[..",
    f"waypoint/global/proof/{NODE}?" + "a=b;" * 5000,
    "@/**",
    "**",
)


def test_half_open_connections_and_odd_selectors_are_survived(world: World) -> None:
    """What connects and says nothing, half a handshake, or garbage is Zenoh's to shed; relay and node go on.

    While more of them are open than Zenoh lets wait, nobody new gets in; the relay sheds each after three seconds.
    A selector that Zenoh refuses or panics over does so in the asker's process, and harms nobody else.
    """
    hosts = [(end.removeprefix("tcp/").split(":")) for end in (world.outer, world.inner)]
    with ExitStack() as stack:
        for host, port in hosts:
            for number in range(300):
                one = stack.enter_context(socket.create_connection((host, int(port)), timeout=10))
                one.sendall((b"", b"\x00", b"\x10\x00\x01\x02", os.urandom(40), b"\xff\xff" * 30)[number % 5])
        assert world.ordered() == "unsupported"  # who is in stays in
        wait_for(lambda: _comes_in(world.outer), "a newcomer, when the half open are shed")
        for selector in SELECTORS:
            ask(world.outer, selector)
        assert world.ordered() == "unsupported"
    assert (world.relay.process.poll(), world.daemon.poll()) == (None, None)


def _comes_in(endpoint: str) -> bool:
    """Say whether a newcomer is let in now."""
    try:
        with session(endpoint):
            return True
    except zenoh.ZError:
        return False


ASKER = """
import sys
from tests.whole.relays import session
with session(sys.argv[1]) as outside:
    list(outside.get(sys.argv[2], timeout=0.2))
"""


def ask(endpoint: str, selector: str) -> None:
    """Ask in a process of its own: some of these make the asker's own Zenoh panic, and that aborts the process."""
    subprocess.run([sys.executable, "-c", ASKER, endpoint, selector], capture_output=True, timeout=60, check=False)
