"""The daemon's life around fake adapters: what it does when it is asked to stop early, and when an adapter breaks."""

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
from events.schema.flight_pb2 import CLOSE_INPUT_ENDED, CLOSE_STOPPED
from events.store import flights_in
from tests.autopilot.node.nodes import log_of, of_kind
from tests.autopilot.trust.world import NOW_MS, seeded

Act = Callable[["FakeEdges"], None]


class FakeEyes:
    """Eyes that see nothing and end when they are told."""

    def __init__(self) -> None:
        self.ended = asyncio.Event()
        self.refusal: str | None = None
        self.rejected: dict[str, int] = {}


class FakeEdges:
    """Adapters that do what a test says when they start and stop."""

    def __init__(self, on_start: Act, on_stop: Act) -> None:
        self.mesh = self.vehicle = None
        self.eyes = FakeEyes()
        self._on_start, self._on_stop = on_start, on_stop

    async def start(self) -> None:
        self._on_start(self)

    async def stop(self) -> None:
        self._on_stop(self)


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Config:
    """Return a configuration with keys; the wall clock stands where they are valid."""
    random = seeded(1)
    ours = directory.init(tmp_path / "directory", deployment_id="test", now_ms=NOW_MS, random=random)
    directory.issue(ours, "n", tmp_path / "keys", kind="node", roles=(), callsign="", now_ms=NOW_MS, random=random)
    monkeypatch.setattr("autopilot.trust.clock.HostClock.wall_ns", lambda _self: NOW_MS * 1_000_000)
    node = {"keys": str(tmp_path / "keys"), "flights": str(tmp_path / "flights"), "projections": str(tmp_path / "p.db")}
    return Config.model_validate({"node": node})


def nothing(_edges: FakeEdges) -> None:
    """Do nothing."""


def end_input(edges: FakeEdges) -> None:
    """Say that the input is over."""
    edges.eyes.ended.set()


def refuse(edges: FakeEdges) -> None:
    """Say that the input can never begin."""
    edges.eyes.refusal = "[eyes] model: it is none"
    edges.eyes.ended.set()


def terminate(_edges: FakeEdges) -> None:
    """Be asked to stop before the daemon waits for it."""
    os.kill(os.getpid(), signal.SIGTERM)


def refuse_address(_edges: FakeEdges) -> None:
    """Find an address that can't be used."""
    raise ValueError("[vehicle] connect: no such host")


def break_down(_edges: FakeEdges) -> None:
    """Break as adapters should not."""
    raise RuntimeError("broken for a test")


def live(config: Config, monkeypatch: pytest.MonkeyPatch, on_start: Act, on_stop: Act = nothing) -> int:
    """Run a daemon to its end and return its exit code."""
    monkeypatch.setattr(daemon_module, "make_edges", lambda *_, **__: FakeEdges(on_start, on_stop))
    monkeypatch.setattr(daemon_module, "resume", lambda *_: None)

    async def run() -> int:
        async with asyncio.timeout(20):
            return await Daemon(config).run()

    return asyncio.run(run())


def check_closed(config: Config, *reasons: int) -> None:
    """Check how the only flight ended."""
    (flight,) = flights_in(Path(config.node.flights))
    assert [one.reason for one in of_kind(log_of(flight), "flight_closed")] == list(reasons)


def test_it_ends_with_its_input(config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where it is told to."""
    stopping = config.model_copy(update={"eyes": config.eyes.model_copy(update={"at_end": "stop"})})
    assert live(stopping, monkeypatch, end_input) == os.EX_OK
    check_closed(config, CLOSE_INPUT_ENDED)


@pytest.mark.parametrize("at_end", ["stop", "go_on"])
def test_eyes_that_can_never_see_are_a_configuration_error(
    config: Config, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], at_end: str
) -> None:
    """It does not fly blind because of a typo; nothing had begun, so nothing has ended."""
    changed = config.model_copy(update={"eyes": config.eyes.model_copy(update={"at_end": at_end})})
    assert live(changed, monkeypatch, refuse) == os.EX_CONFIG
    assert "[eyes] model: it is none" in capsys.readouterr().err
    check_closed(config, CLOSE_STOPPED)


def test_a_signal_that_comes_early_is_heard(config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before the adapters are up: the flight still gets its end."""
    assert live(config, monkeypatch, terminate) == os.EX_OK
    check_closed(config, CLOSE_STOPPED)


def test_an_address_that_cannot_be_used_is_a_configuration_error(
    config: Config, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Named; the flight is closed."""
    assert live(config, monkeypatch, refuse_address) == os.EX_CONFIG
    assert "[vehicle] connect: no such host" in capsys.readouterr().err
    check_closed(config, CLOSE_STOPPED)


def test_an_adapter_that_breaks_while_stopping_does_not_keep_the_log_open(
    config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The defect is seen, and the flight has its end."""
    with pytest.raises(RuntimeError, match="broken for a test"):
        live(config, monkeypatch, terminate, break_down)
    check_closed(config, CLOSE_STOPPED)
