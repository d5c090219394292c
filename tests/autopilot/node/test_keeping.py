"""Keeping snapshots: when they come, and what becomes of them where there is no room."""

from __future__ import annotations

from pathlib import Path

import pytest

from autopilot.node import restoring
from autopilot.node.sealing import KEY_FILE
from events.schema.flight_pb2 import InputsDropped
from events.store import SqliteStore
from events.store.snapshots import NAME, Snapshots, SnapshotWriter
from tests.autopilot.node.histories import fly
from tests.autopilot.node.nodes import FakeClock
from tests.autopilot.node.restored import Begin, Shown, busy, starts
from tests.checks import check_equal


@pytest.fixture
def begin(tmp_path: Path, clock: FakeClock, monkeypatch: pytest.MonkeyPatch) -> Begin:
    return starts(tmp_path, clock, monkeypatch)


def test_snapshots_come_only_now_and_then(begin: Begin, monkeypatch: pytest.MonkeyPatch) -> None:
    """And at the end of a flight, once."""
    monkeypatch.setattr(restoring, "EVERY_RECORDS", 10_000)
    node = begin().start()
    fly(node)
    folder = node.session.flight.folder
    check_equal(Snapshots(folder).base_of(), {})
    node.turn(after_ms=181_000)
    check_equal(Snapshots(folder).base_of(), {len(node.log(0)): 0})


class Full:
    """A file of snapshots for which there is no room."""

    def __init__(self, folder: Path, after: int) -> None:
        self._writer = SnapshotWriter(folder, after)
        self.discard = self._writer.discard

    def append(self, size: int, base: int, body: bytes) -> None:
        """Write half of it."""
        self._writer.append(size, base, body[: len(body) // 2])
        raise OSError("no room, for a test")


def check_kept_none(node: Shown, because: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Check that a node goes on without snapshots, and says it once."""
    check_equal(capsys.readouterr().err.count(because), 1)
    check_equal((node.session.flight.folder / NAME).exists(), False)
    assert node.session.sealing is not None
    check_equal((node.ended, node.session.sealing.newest.split("\n")[1]), (False, str(node.session.store.head.seq + 1)))


def test_without_room_there_are_none(
    begin: Begin, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The log needs it more."""
    monkeypatch.setattr(restoring, "SnapshotWriter", Full)
    node = begin().start()
    busy(node, 4)
    check_kept_none(node, "no room, for a test", capsys)


def test_with_the_reserve_they_go(
    begin: Begin, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """On a full disk everything disposable makes room."""
    node = begin().start()
    busy(node, 2)
    check_equal((node.session.flight.folder / NAME).exists(), True)
    monkeypatch.setattr(SqliteStore, "reserve_spent", property(lambda _: True))
    for number in range(20, 24):
        node.tell(*[InputsDropped(input_class="frame", count=number)] * 12, after_ms=6_000)
        node.turn(after_ms=5_000)
    check_kept_none(node, "the disk is full", capsys)


def test_a_status_that_lags_is_not_kept(begin: Begin, capsys: pytest.CaptureFixture[str]) -> None:
    """What people would be shown again must be of the same record."""
    node = begin().start()
    node.loop._on_records = node.heard.extend
    busy(node, 2)
    check_kept_none(node, "the status is that after record", capsys)


def test_a_folder_that_can_not_be_written(
    begin: Begin, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Said at the start, and no more."""

    def refuse(_folder: Path, _after: int) -> SnapshotWriter:
        raise PermissionError("not yours, for a test")

    monkeypatch.setattr(restoring, "SnapshotWriter", refuse)
    node = begin().start()
    busy(node, 2)
    check_kept_none(node, "not yours, for a test", capsys)


def test_without_a_keeper_nothing_is_kept(begin: Begin) -> None:
    """And a sealed flight is what it was."""
    node = begin(keeps=False).start()
    busy(node, 2)
    check_equal((node.session.flight.folder / NAME).exists(), False)
    check_equal((node.session.flight.folder / KEY_FILE).exists(), True)
