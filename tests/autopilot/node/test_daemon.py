"""The daemon's life around fake adapters: what it does when it is asked to stop early, and when an adapter breaks."""

from __future__ import annotations

import asyncio
import os
import shutil
from pathlib import Path

import pytest

from autopilot.node import daemon as daemon_module
from autopilot.node.trusting import settle
from autopilot.ports.config import Config
from autopilot.trust.book import TrustBook
from events.schema.flight_pb2 import CLOSE_INPUT_ENDED, CLOSE_STOPPED
from events.store import flights_in
from tests.autopilot.node.lives import REMEMBERED, FakeEdges, keyed, live, terminate
from tests.autopilot.node.nodes import log_of, of_kind


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Config:
    """Return a configuration with keys."""
    return keyed(tmp_path, monkeypatch)


def end_input(edges: FakeEdges) -> None:
    """Say that the input is over."""
    edges.eyes.ended.set()


def refuse(edges: FakeEdges) -> None:
    """Say that the input can never begin."""
    edges.eyes.refusal = "[eyes] model: it is none"
    edges.eyes.ended.set()


def refuse_address(_edges: FakeEdges) -> None:
    """Find an address that can't be used."""
    raise ValueError("[vehicle] connect: no such host")


def break_down(_edges: FakeEdges) -> None:
    """Break as adapters should not."""
    raise RuntimeError("broken for a test")


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


def test_a_node_whose_flights_are_gone_knows_that_it_has_forgotten(
    config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not so one that is new, and not so one that goes on."""
    REMEMBERED.clear()
    live(config, monkeypatch, terminate)
    live(config, monkeypatch, terminate)
    shutil.rmtree(config.node.flights)
    live(config, monkeypatch, terminate)
    live(config, monkeypatch, terminate)
    assert REMEMBERED == [True, True, False, True]


def test_a_start_records_what_it_goes_by(config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    """List, root, epoch and time; the next one finds that the log knows the documents."""
    live(config, monkeypatch, terminate)
    live(config, monkeypatch, terminate)
    first, second = (log_of(flight) for flight in flights_in(Path(config.node.flights)))
    taken = ("revocations_taken", "root_taken", "epoch_taken")
    assert [len(list(of_kind(first, kind))) for kind in taken] == [1, 1, 1]
    assert [len(list(of_kind(second, kind))) for kind in taken] == [0, 0, 0]
    assert [one.source for one in of_kind(first, "time_learned")][:1] == ["host"]


def test_the_adapters_know_the_folder_of_the_open_flight(config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before they start, and again with each flight that begins."""
    told: list[list[Path]] = []

    def look(edges: FakeEdges) -> None:
        told.append(list(edges.folders))
        terminate(edges)

    live(config, monkeypatch, look)
    live(config, monkeypatch, look)
    assert told == [[flight.folder] for flight in flights_in(Path(config.node.flights))]


def test_the_adapters_start_when_the_log_has_what_the_start_found(
    config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that no order is judged by less than the log knows a moment later."""
    settled: list[bool] = []
    durable: list[str] = []

    async def wait(book: TrustBook, over: asyncio.Event) -> None:
        await settle(book, over)
        settled.append(book.settled)

    def look(edges: FakeEdges) -> None:
        assert settled == [True]
        (flight,) = flights_in(Path(config.node.flights))
        durable.extend(record.kind.name for record in log_of(flight))
        terminate(edges)

    monkeypatch.setattr(daemon_module, "settle", wait)
    live(config, monkeypatch, look)
    assert {"revocations_taken", "root_taken", "epoch_taken"} <= set(durable)
