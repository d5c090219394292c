"""Two nodes, three operators, a relay and a Directory, each a process: one operator is shut out while a node is away.

The relay is a router with rules and no keys. Orders need no vehicle, so the answer that counts is that there is one:
a node that no longer believes an operator says nothing to him.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from events import Record
from tests.whole.daemons import WITHIN_S, ended, log, started, wait_for, write_config
from tests.whole.relays import plain, relaying, who_may_pass

pytestmark = pytest.mark.whole
AUTOPILOT = [sys.executable, "-m", "autopilot.cli.main"]
NODES = ("wasp-01", "hornet-02")
OPERATORS = ("alice", "bob", "carol")
NO_ANSWER = os.EX_UNAVAILABLE


@dataclass
class Deployment:
    """Everybody, in one folder."""

    folder: Path
    endpoint: str
    daemons: dict[str, subprocess.Popen[str]] = field(default_factory=dict)

    def run(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run a command to its end."""
        return subprocess.run(
            [*AUTOPILOT, *words], capture_output=True, text=True, timeout=2 * WITHIN_S, cwd=self.folder, check=False
        )

    def done(self, *words: str) -> None:
        """Run a command that must succeed."""
        run = self.run(*words)
        assert run.returncode == 0, run.stderr

    def answer(self, who: str, node: str, life_s: int = 5) -> str:
        """Give an order in a process of its own; return the answer's detail, "" for none."""
        words = ("--identity", who, "--connect", self.endpoint, "--to", node, "--life", str(life_s), "--json")
        run = self.run("order", "release", *words)
        assert run.returncode in (0, 1, NO_ANSWER), run.stderr
        return "" if run.returncode == NO_ANSWER else str(json.loads(run.stdout)["detail"])

    def taken(self, node: str) -> tuple[int, int]:
        """Return the newest revocation list and epoch in a node's log."""
        records = log(self.folder / f"{node}-home")
        return _newest(records, "revocations_taken", "list_version"), _newest(records, "epoch_taken", "epoch_id")


def _newest(records: list[Record], kind: str, name: str) -> int:
    found: list[Any] = [record.message for record in records if record.kind.name == kind]
    return max((int(getattr(message, name)) for message in found), default=0)


@pytest.fixture
def deployment(tmp_path: Path) -> Iterator[Deployment]:
    """The Directory serves, both nodes record, and everybody is linked through the relay."""
    endpoint = plain()
    made = Deployment(tmp_path, endpoint)
    made.done("directory", "init", "d", "--deployment", "coast-watch")
    for node in NODES:
        made.done("directory", "issue", "d", node, "--kind", "node", "--out", node)
    for who in OPERATORS:
        made.done("directory", "issue", "d", who, "--kind", "operator", "--role", "camera", "--out", who)
    with ExitStack() as stack:
        stack.enter_context(relaying(tmp_path, who_may_pass() | {"outer": {"listen": [endpoint]}}))
        serving = subprocess.Popen(
            [*AUTOPILOT, "directory", "serve", "d", "--connect", endpoint],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            cwd=tmp_path,
        )
        stack.callback(serving.communicate)
        stack.callback(serving.kill)
        assert serving.stderr is not None
        assert "serving" in serving.stderr.readline()
        for node in NODES:
            home = tmp_path / f"{node}-home"
            home.mkdir()
            mesh = {"connect": [endpoint], "reconnect_ms": 100}
            command = {"enabled": True, "camera_roles": ["camera"]}
            config = write_config(home, tmp_path / node, mesh=mesh, command=command)
            made.daemons[node] = started(config)
            stack.callback(ended, made.daemons[node])
        yield made


def test_one_is_shut_out_while_a_node_is_away(deployment: Deployment) -> None:
    """At once on the node that hears of it, and on the other before it takes any order of the new epoch."""
    for node in NODES:
        wait_for(lambda node=node: deployment.answer("alice", node) != "", f"an answer of {node}")  # type: ignore[misc]
        assert all(deployment.answer(who, node) for who in ("bob", "carol"))
    assert [deployment.taken(node) for node in NODES] == [(1, 1), (1, 1)]

    away = deployment.daemons["hornet-02"]
    away.send_signal(signal.SIGSTOP)
    try:
        deployment.done("directory", "revoke", "d", "bob")
        wait_for(lambda: deployment.taken("wasp-01") == (2, 2), "the new list and epoch at the node that is there")
        assert deployment.answer("bob", "wasp-01") == ""
        for who in ("alice", "carol"):
            deployment.done("enrol", "--renew", "--connect", deployment.endpoint, "--out", who)
            assert deployment.answer(who, "wasp-01") != ""
    finally:
        away.send_signal(signal.SIGCONT)

    wait_for(lambda: deployment.answer("carol", "hornet-02", 10) != "", "an answer under the new epoch")
    assert deployment.taken("hornet-02") == (2, 2)
    assert deployment.answer("bob", "hornet-02") == ""
    assert deployment.answer("alice", "hornet-02") != ""
