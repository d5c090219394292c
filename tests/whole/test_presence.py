"""A daemon, a relay with rules, a Directory, operators, each a process: who attends is heard, and goes by what is new.

An operator's presence is recorded thinned while he is there, and no longer; a viewer's is not. An issuer that is open
while an epoch begins gives its next order under it.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest

from autopilot.ground import compose
from autopilot.ground.issuer import Issuer
from autopilot.trust.identity import load_identity
from events import Record
from events.schema.waypoint_pb2 import AuthEnvelope, EnvelopeHeader
from tests.whole.daemons import WITHIN_S, ended, log, started, wait_for, write_config
from tests.whole.relays import plain, relaying

pytestmark = pytest.mark.whole
AUTOPILOT = [sys.executable, "-m", "autopilot.cli.main"]
NODE = "wasp-01"
PERIOD_S = 0.5
SILENCE_S = 4.0  # four presences would have come


@dataclass
class World:
    """Everybody, in one folder; the node's home is in it."""

    folder: Path
    endpoint: str

    def done(self, *words: str) -> None:
        """Run a command that must succeed."""
        done = subprocess.run(
            [*AUTOPILOT, *words], capture_output=True, text=True, timeout=2 * WITHIN_S, cwd=self.folder, check=False
        )
        assert done.returncode == 0, done.stderr

    @contextmanager
    def running(self, *words: str) -> Iterator[subprocess.Popen[str]]:
        """Have a command run until the end of the block, where it is killed; its first line has been read."""
        child = subprocess.Popen(
            [*AUTOPILOT, *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=self.folder,
        )
        try:
            assert child.stdout is not None
            assert child.stdout.readline()
            yield child
        finally:
            child.kill()
            child.communicate()

    def watching(self, who: str) -> tuple[str, ...]:
        """Return the words of an operator who attends the node."""
        return ("order", "watch", "--attend", "--identity", who, "--connect", self.endpoint, "--to", NODE)

    def records(self, kind: str) -> list[Record]:
        """Return the records of a kind in the node's log."""
        return [record for record in log(self.folder / "home") if record.kind.name == kind]

    def heard(self) -> set[str]:
        """Return who was heard."""
        return {record.message.principal_id for record in self.records("operator_heard")}  # type: ignore[attr-defined]

    def silent_s(self) -> float:
        """Return for how long nobody was heard, by this computer's clock."""
        now_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME)
        return (now_ns - self.records("operator_heard")[-1].at.mono_ns) / 1e9


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    """The node records, the Directory serves, and everybody is linked through a router that knows what may pass."""
    made = World(tmp_path, plain())
    made.done("directory", "init", "d", "--deployment", "coast-watch")
    made.done("directory", "issue", "d", NODE, "--kind", "node", "--out", NODE)
    for who, role in (("alice", "camera"), ("sue", "flight"), ("vic", "viewer")):
        made.done("directory", "issue", "d", who, "--kind", "operator", "--role", role, "--out", who)
    rules = {
        "relay": {"mode": "router"},
        "outer": {"listen": [made.endpoint]},
        "who": {side: {"side": side, "nodes": ["*"]} for side in ("node", "ground", "directory")},
    }
    with ExitStack() as stack:
        stack.enter_context(relaying(tmp_path, rules))
        stack.enter_context(made.running("directory", "serve", "d", "--connect", made.endpoint))
        home = tmp_path / "home"
        home.mkdir()
        mesh = {"connect": [made.endpoint], "reconnect_ms": 100, "presence_period_s": PERIOD_S}
        roles = {"enabled": True, "camera_roles": ["camera"], "flight_roles": ["flight"]}
        daemon = started(write_config(home, tmp_path / NODE, mesh=mesh, command=roles))
        stack.callback(ended, daemon)
        yield made


def test_who_attends_is_heard_until_he_goes(world: World) -> None:
    """An operator of either list, at most once a period; a viewer never; silence when they are gone."""
    with world.running(*world.watching("vic")), world.running(*world.watching("alice")):
        wait_for(lambda: len(world.records("operator_heard")) >= 4, "presence in the node's log")
    wait_for(lambda: world.silent_s() > SILENCE_S, "silence after they went")
    found = world.records("operator_heard")
    assert world.heard() == {"alice"}
    gaps_ns = [later.at.mono_ns - earlier.at.mono_ns for earlier, later in pairwise(found)]
    assert min(gaps_ns) >= PERIOD_S * 0.8 * 1e9  # it is recorded a little after it was heard
    refused = [
        one.reason
        for record in world.records("samples_rejected")
        for one in record.message.rejected  # type: ignore[attr-defined]
    ]
    assert set(refused) <= {"presence: role"}
    with world.running(*world.watching("sue")):
        wait_for(lambda: world.heard() == {"alice", "sue"}, "somebody of the other list")


def test_an_issuer_that_is_open_orders_under_the_epoch_that_begins(world: World) -> None:
    """Nobody starts it again; what it has taken lies in its folder, and the list that goes with it is held."""
    alice = world.folder / "alice"
    with Issuer(load_identity(alice), [world.endpoint], reconnect_ms=100) as issuer:

        def answered(epoch_id: int = 1) -> bool:
            order = issuer.send(NODE, compose.release(), 3)
            header = AuthEnvelope.FromString(order.envelopes[-1]).header if issuer.wait(order).result else b""
            return EnvelopeHeader.FromString(header).epoch_id == epoch_id

        wait_for(answered, "an answer")
        world.done("directory", "revoke", "d", "sue")
        wait_for(lambda: bool(world.records("epoch_taken")[1:]), "the new epoch at the node")
        wait_for(lambda: 2 in load_identity(alice).epochs, "the new epoch in the issuer's folder")
        assert answered(2)
        seen = issuer.wait_status(NODE, lambda status: status.epoch_id == 2, WITHIN_S)
        assert seen is not None
        assert seen.status.revocation_version == 2
        assert issuer._believing.held.revocations.version == 2
