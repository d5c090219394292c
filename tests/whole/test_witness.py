"""A daemon, a router and a witness, with a real mesh between them: a log that grows is proven and cosigned, and one
that was rolled back is found out, at once by its size, and later, when it has grown again, by its proof.
"""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from autopilot.cli import export
from autopilot.cli import witness as witness_command
from autopilot.ground import compose, directory
from autopilot.ground.issuer import Issuer
from autopilot.ground.kept import EVIDENCE, FOLDER
from autopilot.ground.verifier import check
from autopilot.ground.watching import Watch
from autopilot.ground.witness import Standing
from autopilot.trust.clock import HostClock, wall_ms
from autopilot.trust.identity import load_identity
from events.store import flights_in
from tests.autopilot.cli.flown import run
from tests.autopilot.ground.test_round_trip import Router
from tests.autopilot.trust.world import seeded
from tests.whole.daemons import log, started, wait_for, write_config

pytestmark = pytest.mark.whole
NODE = "wasp"


@dataclass
class Ground:
    """A witness with a folder of its own."""

    issuer: Issuer
    watch: Watch
    folder: Path

    def standing(self) -> Standing | None:
        """Ask for what is missing; return what is known."""
        self.watch.turn()
        key = self.issuer.node_key(NODE)
        return None if key is None else self.issuer.witness.standing(NODE, key)

    def proven(self) -> int:
        """Return the records up to which all that was heard is proven; 0 while something waits."""
        found = self.standing()
        return found.proven_size if found is not None and found.proven_size == found.heard_size else 0

    def evidence(self) -> list[dict[str, Any]]:
        """Return what lies there as evidence."""
        paths = (self.folder / FOLDER / NODE).glob(f"{EVIDENCE}*")
        return [json.loads(path.read_text(encoding="utf-8")) for path in paths]


def published(ground: Ground) -> int:
    """Return how many records the newest checkpoint covers that was heard."""
    seen = ground.issuer.status(NODE)
    note = "" if seen is None else seen.status.log_checkpoint
    return int(note.split("\n")[1]) if note else 0


class World:
    """A node's folder, its daemon, a router, and people on the ground."""

    def __init__(self, root: Path) -> None:
        self.root, self.router = root, Router()
        made = directory.init(root / "directory", deployment_id="t", now_ms=wall_ms(HostClock()), random=seeded(1))
        for name, kind, role in ((NODE, "node", "camera"), ("alice", "operator", "viewer")):
            now_ms = wall_ms(HostClock())
            directory.issue(
                made, name, root / name, kind=kind, roles=[role], callsign="", now_ms=now_ms, random=seeded(len(name))
            )
        self.config = write_config(root, root / NODE, mesh={"connect": [self.router.endpoint], "reconnect_ms": 100})
        self.daemon: subprocess.Popen[str] | None = None
        self.grounds: list[Ground] = []

    def ground(self, folder: Path, *, cosigns: bool) -> Ground:
        """Return a witness who begins to listen."""
        identity = load_identity(folder)
        issuer = Issuer(identity, [self.router.endpoint], reconnect_ms=100)
        issuer.watch(NODE)
        issuer.start()
        self.grounds.append(Ground(issuer, Watch(issuer, identity, NODE, HostClock(), cosigns=cosigns), folder))
        return self.grounds[-1]

    def start(self) -> None:
        """Start the daemon, which signs its log at once."""
        self.daemon = started(self.config)

    def kill(self) -> None:
        """Kill it, as a power cut does."""
        if self.daemon is not None:
            self.daemon.kill()
            self.daemon.communicate()
            self.daemon = None

    def grow(self, ground: Ground, records: int) -> None:
        """Let the log grow to so many records at least, by orders that are refused, and have it signed."""
        while len(log(self.root)) < records:
            order = ground.issuer.send(NODE, compose.release())
            assert ground.issuer.wait(order).result == "unsupported"
        self.kill()
        self.start()
        wait_for(lambda: published(ground) >= records, "a checkpoint")

    def end(self) -> None:
        """End everything."""
        for ground in self.grounds:
            ground.issuer.stop()
        self.kill()
        if self.router.process is not None:
            self.router.end(signal.SIGKILL)


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    made = World(tmp_path)
    made.router.start()
    yield made
    made.end()


def test_a_node_that_is_rolled_back_is_found_out(world: World, capsys: pytest.CaptureFixture[str]) -> None:
    """By who listens when it happens, and by who comes later."""
    world.start()
    world.kill()
    shutil.copytree(world.root / "flights", world.root / "older")
    world.start()
    alice = world.ground(world.root / "alice", cosigns=True)
    wait_for(lambda: alice.proven() > 0, "a first checkpoint")
    world.grow(alice, 30)
    wait_for(lambda: alice.proven() >= 30, "a proof over the mesh")
    cosigned = check_cosigned(world, alice)
    shutil.copytree(world.root / "alice", world.root / "later")

    world.kill()
    shutil.rmtree(world.root / "flights")
    shutil.copytree(world.root / "older", world.root / "flights")
    world.start()
    wait_for(lambda: bool(alice.issuer.complaints()), "a complaint")
    assert "it was rolled back" in alice.issuer.complaints()[NODE]
    (shown,) = alice.evidence()
    assert int(shown["kept"]["checkpoint"].split("\n")[1]) >= cosigned > int(shown["said"]["checkpoint"].split("\n")[1])

    proven = alice.issuer.witness.standing(NODE, alice.issuer.node_key(NODE) or b"")
    assert proven is not None
    world.grow(alice, proven.heard_size + 10)
    later = world.ground(world.root / "later", cosigns=True)
    wait_for(lambda: later.proven() > 0 and bool(later.issuer.complaints()), "a proof of the fork")
    assert "that do not begin with" in later.issuer.complaints()[NODE]
    assert [len(one["proof"]["path"]) > 0 for one in later.evidence()] == [True]
    check_command(world, capsys)


def check_cosigned(world: World, alice: Ground) -> int:
    """Check that the node records a cosignature of what is proven and shows it, also in a proof; return its size."""

    def shown() -> int:
        alice.watch.turn()
        seen = alice.issuer.status(NODE)
        return 0 if seen is None or seen.status.cosigned_by != "alice" else seen.status.cosigned_size

    alice.watch._cosign_at_ns = 0  # not after a minute
    wait_for(lambda: shown() >= 30, "a cosignature in the status")
    size = shown()
    kinds = [record.kind.name for record in log(world.root)]
    assert "checkpoint_cosigned" in kinds
    out = world.root / "proof.json"
    folder = flights_in(world.root / "flights")[-1].folder
    assert run(export, ["export", "proof", str(folder), "--seq", "20", str(out)]) == 0
    proved = check(out.read_bytes())
    assert ([one.principal for one in proved.cosigners], proved.size) == (["alice"], size)
    return size


def check_command(world: World, capsys: pytest.CaptureFixture[str]) -> None:
    """Check that the command says it, too."""
    capsys.readouterr()
    words = ["witness", "--identity", str(world.root / "later"), "--connect", world.router.endpoint, "--node", NODE]
    assert run(witness_command, [*words, "--seconds", "4"]) == 1
    assert "CONTRADICTS what it signed before" in capsys.readouterr().out
