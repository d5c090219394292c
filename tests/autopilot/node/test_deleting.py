"""Flights that are deleted: crash-safe at every step, told in the log, and never one that was not pushed."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from google.protobuf.message import Message

from autopilot.node import deleting
from autopilot.node.board import Board
from autopilot.node.deleting import Retention, bury, empty, forget, graves
from autopilot.node.receipts import NAME, read_receipt
from autopilot.ports.config import RetentionSection
from autopilot.ports.edges import InputClass
from events.schema.flight_pb2 import CLOSE_STOPPED, FlightDeleted
from events.store import flights_in
from tests.autopilot.node.kept import DAY_MS, keep, push, stock
from tests.autopilot.trust.world import NOW_MS, FakeClock
from tests.flights import detection, frame

SETTINGS = RetentionSection(keep_days=10, keep_newest=1, min_free_mib=0)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Return a folder with three closed flights of a month ago, of which the first was pushed, and an open one."""
    folder = tmp_path / "flights"
    for number in (1, 2, 3):
        keep(folder, number, began_ms=NOW_MS - (33 - number) * DAY_MS)
    keep(folder, 4, began_ms=NOW_MS - 1_000, is_closed=False)
    push(stock(folder)[1])
    return folder


class Log:
    """Takes what is said of deletions, or has no room for it."""

    def __init__(self) -> None:
        self.said: list[Message] = []
        self.refusals = 0

    def __call__(self, input_class: InputClass, observation: Message) -> bool:
        assert input_class is InputClass.OUTCOME
        self.refusals -= 1
        if self.refusals < 0:
            self.said.append(observation)
        return self.refusals < 0


def turn(root: Path, log: Log, settings: RetentionSection = SETTINGS, open_number: int = 4) -> str:
    """Apply the policy once, as the daemon does; return what it says of the disk."""
    short: list[str] = []
    retention = Retention(root, settings, FakeClock(), log, lambda: open_number, short.append)
    asyncio.run(retention.turn())
    return short[-1]


def numbers(root: Path) -> list[int]:
    """Return the flights that are there."""
    return [flight.number for flight in flights_in(root)]


def test_what_a_log_and_its_papers_say(root: Path) -> None:
    """When it was, why it ended, how large it is; a receipt counts only for this very head."""
    found = stock(root)
    one = found[1]
    assert (one.flight_id, one.head.seq, one.closed) == (b"\x01" * 16, 5, CLOSE_STOPPED)
    assert (one.began_ms, one.ended_ms) == (NOW_MS - 32 * DAY_MS, NOW_MS - 32 * DAY_MS + 1000)
    assert one.size_bytes > 4096
    assert [each.receipt is not None for each in found.values()] == [True, False, False, False]
    assert [each.closed for each in found.values()] == [CLOSE_STOPPED] * 3 + [None]
    receipt = asdict(push(found[1]))
    for key, value in (("last_seq", 4), ("last_leaf", "00" * 32), ("flight_id", "02" * 16)):
        (root / one.flight.folder.name / NAME).write_text(json.dumps(receipt | {key: value}))
        assert stock(root)[1].receipt is None


def test_a_flight_whose_end_led_to_something_is_closed(tmp_path: Path) -> None:
    """Questions that are withdrawn are said after the end, and are its consequence."""
    seen = [frame(number, detection(0, 0)) for number in range(3)]
    keep(tmp_path, 1, *seen, began_ms=NOW_MS)
    keep(tmp_path, 2, *seen, began_ms=NOW_MS, is_closed=False)
    one, two = stock(tmp_path).values()
    assert one.head.seq > two.head.seq + 1
    assert (one.closed, two.closed) == (CLOSE_STOPPED, None)


@pytest.mark.parametrize("changed", [{"to": 5}, {"last_seq": -1}, {"at_ms": "x"}, {"more": 1}, {"flight_id": "zz"}])
def test_a_receipt_that_is_none(root: Path, changed: dict[str, Any]) -> None:
    """Damage does not raise, and does not count."""
    folder = flights_in(root)[0].folder
    receipt = asdict(push(stock(root)[1]))
    assert read_receipt(folder) is not None
    (folder / NAME).write_text(json.dumps(receipt | changed))
    assert read_receipt(folder) is None
    (folder / NAME).write_bytes(b"\xff")
    assert read_receipt(folder) is None


def test_a_pushed_flight_goes_and_the_log_is_told(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Number, id, head and where it is; the others stay."""
    gone, log = stock(root)[1], Log()
    assert turn(root, log) == ""
    assert numbers(root) == [2, 3, 4]
    assert graves(root) == []
    assert log.said == [
        FlightDeleted(
            flight_number=1,
            flight_id=gone.flight_id,
            last_seq=gone.head.seq,
            last_leaf=gone.head.leaf,
            pushed_to="archive",
        )
    ]
    assert "was pushed and is deleted" in capsys.readouterr().err
    assert turn(root, log) == ""
    assert len(log.said) == 1


def test_the_open_flight_and_the_one_before_it_stay(root: Path) -> None:
    """Pushed or not, and whatever their logs say; so does what lies after the open one."""
    for one in stock(root).values():
        push(one)
    turn(root, Log(), open_number=3)
    assert numbers(root) == [2, 3, 4]
    turn(root, Log())
    assert numbers(root) == [3, 4]


def test_a_full_disk_deletes_nothing_that_was_not_pushed(root: Path) -> None:
    """The node says so instead, in its status."""
    settings = RetentionSection(keep_days=100, keep_newest=1, min_free_mib=1 << 30)
    words = turn(root, Log(), settings)
    assert numbers(root) == [2, 3, 4]  # the one that was pushed is younger than 100 days, and goes
    assert "1 flights (0 MiB) wait to be pushed" in words
    board = Board(lambda: NOW_MS)
    board.say_short(words)
    assert board.disk_short == words


def cut_after_burying(folder: Path) -> None:
    """Die with the flight out of sight and whole."""
    bury(flights_in(folder)[0])


def cut_while_emptying(folder: Path) -> None:
    """Die with a part of it gone."""
    grave = bury(flights_in(folder)[0])
    (grave / "flight.db").unlink()


def cut_after_emptying(folder: Path) -> None:
    """Die with the receipt alone left."""
    grave = bury(flights_in(folder)[0])
    (grave / "evidence").mkdir()
    (grave / "evidence" / "frame").write_bytes(b"x")
    assert empty(grave) is not None
    assert [path.name for path in grave.iterdir()] == [NAME]


@pytest.mark.parametrize("cut", [cut_after_burying, cut_while_emptying, cut_after_emptying])
def test_a_deletion_that_is_cut_short_is_finished_and_told(root: Path, cut: Callable[[Path], None]) -> None:
    """By the next start; no reader of flights sees a half one."""
    cut(root)
    assert numbers(root) == [2, 3, 4]
    log = Log()
    turn(root, log)
    assert [one.flight_number for one in log.said] == [1]  # type: ignore[attr-defined]
    assert graves(root) == []


def test_one_that_was_told_already_is_only_removed(root: Path) -> None:
    """Cut while forgetting: without its receipt there is nothing to tell."""
    grave = bury(flights_in(root)[0])
    empty(grave)
    (grave / NAME).unlink()
    log = Log()
    turn(root, log)
    assert (log.said, graves(root)) == ([], [])


def test_a_full_inbox_is_waited_for(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The receipt stays until the log has taken it."""
    log, waited = Log(), list[float]()
    log.refusals = 3

    async def sleep(seconds: float) -> None:
        waited.append(seconds)
        assert len(graves(root)) == 1

    monkeypatch.setattr("asyncio.sleep", sleep)
    turn(root, log)
    assert (len(log.said), len(waited), graves(root)) == (1, 3, [])


def test_it_is_applied_again_and_again_whatever_goes_wrong(
    root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """At the start and every hour; a folder that can't be removed is said, once an hour."""
    slept = list[float]()

    async def sleep(seconds: float) -> None:
        slept.append(seconds)
        if len(slept) == 2:
            raise asyncio.CancelledError

    def fail(_grave: Path) -> None:
        raise OSError("read-only, for a test")

    monkeypatch.setattr("asyncio.sleep", sleep)
    monkeypatch.setattr(deleting, "empty", fail)
    retention = Retention(root, SETTINGS, FakeClock(), Log(), lambda: 4, lambda _: None)
    with pytest.raises(asyncio.CancelledError):
        asyncio.run(retention.run())
    assert slept == [3600.0, 3600.0]
    assert capsys.readouterr().err.count("can't be deleted: read-only, for a test") == 2


def test_a_new_name_is_durable_before_anything_is_removed(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else a power cut could show a flight under its old name, and half of it gone."""
    synced: list[tuple[Path, bool]] = []
    monkeypatch.setattr(deleting, "sync_folder", lambda folder: synced.append((folder, bool(graves(root)))))
    grave = bury(flights_in(root)[0])
    assert synced == [(root, True)]
    assert (grave / "flight.db").exists()
    empty(grave)
    forget(grave)
    assert synced == [(root, True), (root, False)]


def test_forgetting_needs_an_empty_folder(root: Path) -> None:
    """What is not known is not removed unseen."""
    grave = bury(flights_in(root)[0])
    with pytest.raises(OSError, match="not empty"):
        forget(grave)
