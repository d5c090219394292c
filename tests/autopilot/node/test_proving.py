"""Consistency proofs of the node's flights: what is answered, what is not, and that nobody is kept waiting."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from autopilot.node.proving import WAITING_MAX, Prover
from autopilot.ports.edges import Consistency
from events.store import SqliteStore, create_flight, read_flight
from events.tree import Tree, check_consistency
from tests.flights import FLIGHT_ID, SECRET, story

STORY = story()


def flight(
    root: Path, number: int = 1, most: int | None = None, secret: bytes = SECRET
) -> tuple[SqliteStore, list[bytes]]:
    """Write the story as a flight; return its store and its leaves."""
    made, store = create_flight(root, number, FLIGHT_ID, secret)
    store.append(STORY.records[:most])
    reader = read_flight(made.folder)
    leaves = [stored.leaf for stored in reader.stored()]
    reader.close()
    return store, leaves


def check_proves(found: Consistency | None, leaves: list[bytes], old: int, new: int) -> None:
    """Check that a proof leads from the old root to the new one."""
    assert found is not None
    assert found.old_root == Tree(leaves[:old]).root()
    check_consistency(old, found.old_root, new, Tree(leaves[:new]).root(), found.path)


def test_a_log_that_grows_is_proved(tmp_path: Path) -> None:
    """Of the open flight as it goes on, and of one before it."""
    store, leaves = flight(tmp_path, most=60)
    prover = Prover(tmp_path)
    check_proves(prover.proof(1, 7, 60), leaves, 7, 60)
    store.append(STORY.records[60:])
    rest = [stored.leaf for stored in store.stored(60)]
    check_proves(prover.proof(1, 60, len(STORY.records)), leaves + rest, 60, len(STORY.records))
    flight(tmp_path, 2, most=9)
    check_proves(prover.proof(2, 8, 9), leaves, 8, 9)
    check_proves(prover.proof(1, 3, 9), leaves, 3, 9)


def test_what_is_not_there_is_not_proved(tmp_path: Path) -> None:
    """Another flight, more records than there are, a log that can't be read."""
    _, leaves = flight(tmp_path)
    prover = Prover(tmp_path)
    assert prover.proof(2, 1, 5) is None
    assert prover.proof(1, 5, len(leaves) + 1) is None
    assert prover.proof(1, 5, 1 << 40) is None
    assert prover.proof(1, 0, 5) is None
    check_proves(prover.proof(1, 5, len(leaves)), leaves, 5, len(leaves))
    (folder,) = tmp_path.iterdir()
    (folder / "flight.db").write_bytes(b"nothing" * 1000)
    assert Prover(tmp_path).proof(1, 5, 9) is None


def test_questions_are_bounded_and_answered_in_turn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Eight may wait; one that can't be told does not end the thread."""
    _, leaves = flight(tmp_path)
    prover, told, done = Prover(tmp_path), list[Consistency | None](), threading.Event()

    def broken(_: Consistency | None) -> None:
        raise RuntimeError("odd")

    def last(found: Consistency | None) -> None:
        told.append(found)
        done.set()

    assert prover.ask(1, 5, 9, broken)
    for number in range(1, WAITING_MAX - 1):
        assert prover.ask(1, number, 9, told.append)
    assert prover.ask(9, 1, 2, last)
    assert not prover.ask(1, 1, 2, told.append)
    prover.start()
    assert done.wait(30)
    prover.stop()
    assert told[-1] is None
    for number, found in enumerate(told[:-1], start=1):
        check_proves(found, leaves, number, 9)
    assert (len(told), "odd" in capsys.readouterr().err) == (WAITING_MAX - 1, True)


def test_a_long_log_is_read_in_blocks_with_pauses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Once; the next question reads what is new."""
    monkeypatch.setattr("events.canopy.BLOCK", 16)
    monkeypatch.setattr("events.canopy.BLOCK_HEIGHT", 4)
    store, leaves = flight(tmp_path, most=70)
    breaths: list[int] = []
    prover = Prover(tmp_path, breathe=lambda: breaths.append(1))
    check_proves(prover.proof(1, 40, 70), leaves, 40, 70)
    assert len(breaths) == 4
    check_proves(prover.proof(1, 11, 69), leaves, 11, 69)
    assert len(breaths) == 4
    store.append(STORY.records[70:])
    whole = [stored.leaf for stored in store.stored()]
    check_proves(prover.proof(1, 70, len(whole)), whole, 70, len(whole))
    assert len(breaths) == len(whole) // 16
    _, others = flight(tmp_path, 2, secret=bytes(32))
    check_proves(prover.proof(2, 41, 80), others, 41, 80)
