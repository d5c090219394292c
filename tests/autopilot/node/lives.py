"""A daemon's life around fake adapters, for the tests of its start and end; nothing here checks anything."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from autopilot.ground import directory
from autopilot.node import daemon as daemon_module
from autopilot.node.daemon import Daemon
from autopilot.ports.config import Config
from tests.autopilot.trust.world import NOW_MS, seeded

Act = Callable[["FakeEdges"], None]


class FakeEyes:
    """Eyes that see nothing and end when they are told."""

    def __init__(self) -> None:
        self.ended = asyncio.Event()
        self.refusal: str | None = None
        self.rejected: dict[str, int] = {}


REMEMBERED: list[bool] = []  # of each life: whether it remembers all that went before


class FakeEdges:
    """Adapters that do what a test says when they start and stop."""

    def __init__(self, on_start: Act, on_stop: Act) -> None:
        self.mesh = self.vehicle = self.selftest = None
        self.eyes = FakeEyes()
        self._on_start, self._on_stop = on_start, on_stop
        self.folders: list[Path] = []  # where raw data belonged into, one after the other

    def record_in(self, flight: Path) -> None:
        self.folders.append(flight)

    async def start(self) -> None:
        self._on_start(self)

    async def stop(self) -> None:
        self._on_stop(self)


def keyed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, **sections: dict[str, object]) -> Config:
    """Return a configuration with keys; the wall clock stands where they are valid."""
    random = seeded(1)
    ours = directory.init(tmp_path / "directory", deployment_id="test", now_ms=NOW_MS, random=random)
    directory.issue(ours, "n", tmp_path / "keys", kind="node", roles=(), callsign="", now_ms=NOW_MS, random=random)
    monkeypatch.setattr("autopilot.trust.clock.HostClock.wall_ns", lambda _self: NOW_MS * 1_000_000)
    node = {"keys": str(tmp_path / "keys"), "flights": str(tmp_path / "flights"), "projections": str(tmp_path / "p.db")}
    return Config.model_validate({"node": node} | sections)


def nothing(_edges: FakeEdges) -> None:
    """Do nothing."""


def terminate(_edges: FakeEdges) -> None:
    """Be asked to stop before the daemon waits for it."""
    os.kill(os.getpid(), signal.SIGTERM)


def live(config: Config, monkeypatch: pytest.MonkeyPatch, on_start: Act, on_stop: Act = nothing) -> int:
    """Run a daemon to its end and return its exit code."""
    monkeypatch.setattr(daemon_module, "make_edges", lambda *_, **__: FakeEdges(on_start, on_stop))
    monkeypatch.setattr(daemon_module, "resume", lambda *_, whole: REMEMBERED.append(whole))

    async def run() -> int:
        async with asyncio.timeout(20):
            return await Daemon(config).run()

    return asyncio.run(run())
