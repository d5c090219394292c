"""Openings and ends that are cut short between any two writes: the next start makes good what was begun."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from events.schema.flight_pb2 import CLOSE_LOGIC_CHANGED
from events.store import StoreFailed
from tests.autopilot.node.histories import Begin, check_hands_over, check_history, check_history_of_newest, fly
from tests.autopilot.node.nodes import Node, of_kind, update


def cut_folder(_node: Node, monkeypatch: pytest.MonkeyPatch) -> None:
    """Die after the folder was made, before the log has its name."""

    def rename(_source: object, _target: object) -> None:
        raise OSError("cut for a test")

    monkeypatch.setattr(os, "rename", rename)


def cut_first_append(node: Node, _monkeypatch: pytest.MonkeyPatch) -> None:
    """Die with an empty log."""
    node.disk.fails_at = 0


def cut_second_append(node: Node, _monkeypatch: pytest.MonkeyPatch) -> None:
    """Die after the old flight was closed, with the new one's log empty."""
    node.disk.fails_at = 1


@pytest.mark.parametrize("cut", [cut_folder, cut_first_append])
def test_a_first_start_that_is_cut_short_is_passed_over(
    begin: Begin, tmp_path: Path, cut: Callable[[Node, pytest.MonkeyPatch], None]
) -> None:
    """Whatever it left, the next start records."""
    node = begin()
    with pytest.MonkeyPatch.context() as patch:
        cut(node, patch)
        with pytest.raises(StoreFailed):
            node.start()
    assert [path for path in tmp_path.iterdir() if path.is_dir()] == []  # tried every 30 s, it would fill a disk
    again = begin().start()
    assert again.kinds() == ["flight_opened", "baseline_carried", "node_started"]
    again.kill()
    assert begin().start().kinds().count("node_started") == 2


@pytest.mark.parametrize("cut", [cut_first_append, cut_second_append, cut_folder])
def test_a_change_of_flights_that_is_cut_short_is_done_again(
    begin: Begin, monkeypatch: pytest.MonkeyPatch, cut: Callable[[Node, pytest.MonkeyPatch], None]
) -> None:
    """The old flight is closed once, and what it knew arrives in the flight that comes of it."""
    node = begin().start()
    fly(node)
    node.kill()
    update(monkeypatch)
    second = begin()
    with pytest.MonkeyPatch.context() as patch:
        cut(second, patch)
        with pytest.raises(StoreFailed):
            second.start()
    third = begin().start()
    old = third.log(0)
    assert [one.reason for one in of_kind(old, "flight_closed")] == [CLOSE_LOGIC_CHANGED]
    check_hands_over(old, third.log())
    assert [order.command_id for order in third.session.state.orders.values()] == ["a1"]
    third.kill()
    check_history_of_newest(third.root)


def test_a_start_that_fails_lets_go_of_the_log(begin: Begin, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is tried again in the same process: nobody may have the old log open then."""
    node = begin().start()
    folder = node.session.flight.folder
    node.kill()
    update(monkeypatch)
    second = begin()
    second.disk.fails_at = 1
    with pytest.raises(StoreFailed) as failed:
        second.start()
    assert failed.tb is not None  # its frames still hold the store: only closing it lets go
    assert not (folder / "flight.db-wal").exists()


def test_a_failing_end_leaves_the_flight_open(begin: Begin, tmp_path: Path) -> None:
    """The close itself can't be written: the next start goes on, as if it had never been tried."""
    node = begin().start()
    fly(node)
    node.disk.fails_at = node.disk.appends
    with pytest.raises(StoreFailed):
        node.turn(after_ms=181_000)
    node.kill()
    begin().start()
    check_history(tmp_path, (2, ""))
