"""A Directory that serves over a real router: a node enrols, renews, learns of a revocation, and asks the time."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from autopilot.adapters.mesh.link import Link
from autopilot.adapters.mesh.trust_client import TrustClient
from autopilot.trust import documents
from autopilot.trust.clock import HostClock, wall_ms
from autopilot.trust.fetching import Offered, What
from autopilot.trust.identity import load_identity, open_epoch
from autopilot.trust.limits import DOCUMENT_BYTES_MAX
from tests.autopilot.ground.test_round_trip import Router
from tests.whole.daemons import WITHIN_S, wait_for

pytestmark = pytest.mark.whole
AUTOPILOT = [sys.executable, "-m", "autopilot.cli.main"]


class Book:
    """Remembers what was offered."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._offers: list[tuple[What, bytes]] = []

    def offer(self, kind: What, data: bytes) -> Offered:
        """Remember."""
        with self._lock:
            self._offers.append((kind, data))
        return Offered.TAKEN

    def of(self, kind: What) -> list[bytes]:
        """Return what was offered of a kind."""
        with self._lock:
            return [data for each, data in self._offers if each == kind]


@dataclass
class Deployment:
    """A Directory in a process of its own, behind a router."""

    folder: Path
    endpoint: str
    process: subprocess.Popen[str]

    def run(self, *words: str, code: int = 0, stdin: str = "") -> Any:
        """Run a command to its end; return its facts, or its words where it fails."""
        done = subprocess.run(
            [*AUTOPILOT, *words, "--json"],
            input=stdin,
            capture_output=True,
            text=True,
            timeout=WITHIN_S,
            cwd=self.folder,
            check=False,
        )
        assert done.returncode == code, done
        return json.loads(done.stdout) if code == 0 else done.stderr

    def ended(self) -> dict[str, int]:
        """Stop serving; return what was counted."""
        self.process.terminate()
        out, _ = self.process.communicate(timeout=WITHIN_S)
        counts: dict[str, int] = json.loads(out)
        return counts


@pytest.fixture
def deployment(tmp_path: Path) -> Iterator[Deployment]:
    """Serve a new Directory."""
    router = Router()
    router.start()
    made = Deployment(tmp_path, router.endpoint, None)  # type: ignore[arg-type]
    made.run("directory", "init", "d", "--deployment", "coast-watch")
    made.process = subprocess.Popen(
        [*AUTOPILOT, "directory", "serve", "d", "--connect", router.endpoint, "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
    )
    assert made.process.stderr is not None
    assert made.process.stderr.readline() == "serving\n"
    yield made
    if made.process.poll() is None:
        made.process.kill()
        made.process.communicate()
    router.end(signal.SIGTERM)


def test_a_node_from_its_code_to_its_end(deployment: Deployment) -> None:
    """Enrolled, refused a second time, told of a revocation, renewed, given the time, and shut out."""
    code = deployment.run("directory", "enrol", "d", "wasp-01", "--kind", "node")["code"]
    enrol = ("enrol", "--connect", deployment.endpoint, "--out")
    assert deployment.run(*enrol, "wasp", stdin=code)["principal_id"] == "wasp-01"
    assert "refused" in deployment.run(*enrol, "thief", code=77, stdin=code)
    wasp = load_identity(deployment.folder / "wasp", wall_ms(HostClock()))
    deployment.run("directory", "issue", "d", "alice", "--kind", "operator", "--out", "alice")

    book = Book()
    link = Link(connect=[deployment.endpoint], answer_bytes_max=DOCUMENT_BYTES_MAX)
    client = TrustClient(link, HostClock(), book.offer, deployment_id="coast-watch", device_key_id=wasp.sign_key.key_id)
    client.start()
    link.start()
    try:
        wait_for(link.linked, "the link")
        deployment.run("directory", "revoke", "d", "alice")
        wait_for(lambda: bool(book.of("revocations") and book.of("epoch")), "the list and the new group key")
        assert documents.verify_revocations(book.of("revocations")[-1], wasp.trust).principals == {"alice"}
        bundle = documents.verify_epoch_bundle(book.of("epoch")[-1], wasp.trust)
        assert open_epoch(bundle, wasp.sign_key, wasp.box_key).epoch_id == 2

        before_ms = wall_ms(HostClock())
        client.request("time", b"c" * 16)
        client.request("epoch")
        wait_for(lambda: bool(book.of("time")) and len(book.of("epoch")) > 1, "the time, and the epoch asked for")
        beacon = documents.verify_time_beacon(book.of("time")[0], wasp.trust)
        assert (beacon.challenge, before_ms <= beacon.time_ms <= wall_ms(HostClock())) == (b"c" * 16, True)
    finally:
        client.stop()
        link.stop()

    deployment.run("directory", "rotate", "d", "--purpose", "token")
    renewed = deployment.run("enrol", "--renew", "--connect", deployment.endpoint, "--out", "wasp")
    assert renewed["changed"] == ["trust_root", "revocations", "epoch", "token", "nodes"]
    assert load_identity(deployment.folder / "wasp").trust.version == 2
    deployment.run("directory", "revoke", "d", "wasp-01")
    assert "renewals" in deployment.run("enrol", "--renew", "--connect", deployment.endpoint, "--out", "wasp", code=77)
    counts = deployment.ended()
    assert {name: counts[name] for name in ("enrolments: answered", "enrolments: used", "times: answered")} == {
        "enrolments: answered": 1,
        "enrolments: used": 1,
        "times: answered": 1,
    }


def test_nobody_there_is_said(deployment: Deployment) -> None:
    """No answer, and no link."""
    deployment.ended()
    code = "--code", deployment.run("directory", "enrol", "d", "wasp-01", "--kind", "node")["code"]
    asked = deployment.run("enrol", "--connect", deployment.endpoint, "--out", "wasp", *code, code=77)
    assert "nobody answered" in asked
    lost = deployment.run("enrol", "--connect", "tcp/127.0.0.1:9", "--wait", "0.5", "--out", "wasp", *code, code=77)
    assert "no link to tcp/127.0.0.1:9" in lost
