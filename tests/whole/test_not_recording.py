"""A daemon whose store really fails: it stays on the mesh, refuses orders with the reason, and records when it can."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from autopilot.cli.demonstration.cast import NODE, make_cast
from autopilot.cli.demonstration.stage import Stage
from autopilot.ground import compose
from autopilot.ground.issuer import Issuer
from events.store import flights_in
from tests.whole import daemons

pytestmark = pytest.mark.whole

SOON = {"store_retry_s": 1}


def status_of(config: Path) -> dict[str, object]:
    """Return what `autopilot status --json` says."""
    command = [sys.executable, "-m", "autopilot.cli.main", "status", "--config", str(config), "--json"]
    told = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    read: dict[str, object] = json.loads(told.stdout)
    return read


def test_a_log_in_whose_place_a_folder_lies(tmp_path: Path) -> None:
    """Operators see it and are refused; once the folder is gone the flight that was recorded before goes on."""
    stage = Stage(tmp_path, 60, 3)
    node = tmp_path / "node"
    text = stage.config.read_text()
    stage.config.write_text(text + "\n[limits]\nstore_retry_s = 1\n")
    with stage, Issuer(stage.cast.first, [stage.endpoint], reconnect_ms=100) as operator:
        assert operator.wait_status(NODE, lambda status: status.head_seq > 10, 30) is not None
        stage.node.kill()
        (flight,) = flights_in(node / "flights")
        aside = flight.folder.with_name("aside")
        flight.folder.rename(aside)
        flight.database.mkdir(parents=True)
        stage.node.start()
        seen = operator.wait_status(NODE, lambda status: bool(status.not_recording), 30)
        assert seen is not None
        assert seen.status.health == "not recording"
        assert flight.folder.name in seen.status.not_recording
        order = operator.send(NODE, compose.point_at_angles(-30, 10), 5)
        assert operator.wait(order, 8).detail.startswith("not recording: ")
        assert status_of(stage.config)["not_recording"] is not None
        flight.database.rmdir()
        flight.folder.rmdir()
        aside.rename(flight.folder)
        assert operator.wait_status(NODE, lambda status: not status.not_recording, 30) is not None
        assert status_of(stage.config)["not_recording"] is None
        assert flights_in(node / "flights") == [flight]


def test_a_disk_that_takes_not_one_byte(tmp_path: Path) -> None:
    """No flight can be begun: it says so, leaves nothing behind, and ends with 74 when it is asked to."""
    make_cast(tmp_path)
    config = daemons.write_config(tmp_path, tmp_path / "node" / "keys", limits=SOON)
    none = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))  # noqa: E731 - runs in the child
    child = daemons.said(config, "not recording: ", preexec_fn=none)
    daemons.wait_for(lambda: (tmp_path / "flights").exists(), "the folder of the flights")
    assert child.poll() is None
    code, words = daemons.ended(child)
    assert (code, "nothing was recorded" in words) == (os.EX_IOERR, True)
    assert [path.name for path in (tmp_path / "flights").iterdir()] == [".lock"]
    assert daemons.ended(daemons.started(config))[0] == 0
