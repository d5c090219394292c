"""`replay verify` on a flight that diverges: who is to blame, for people and for programs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from autopilot.cli import blaming, replay
from events.store import create_flight
from replay.blame.findings import Blame, Cause, Finding, Weight
from tests.autopilot.cli.flown import run, story_on_disk
from tests.flights import FLIGHT_ID, SECRET, Flight, closed, gimbal, limits, point_at_place, story
from tests.replay.changes import forged
from tests.torture.recorder import under

SCREEN_LINES = 40


def under_another_limit(root: Path, reports: int) -> Path:
    """Write a flight that was decided under another limit than its manifest's; return its folder."""
    told = Flight(limits=limits(arrival_tolerance_cdeg=50))
    told.tell(point_at_place("a"), 100)
    effect = told.effect()
    for error_cdeg in range(80 + reports, 80, -1):
        told.tell(gimbal(-100, 100, effect, error_cdeg), 100)
    told.tell(gimbal(-100, 100, effect, 30), 100)
    told.tell(closed(), 100)
    flight, store = create_flight(root, 1, FLIGHT_ID, SECRET)
    store.append(under(told.records, limits()))
    store.close()
    return flight.folder


def test_a_person_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """On stderr: the winner with its evidence, the others in short, on a screen; the data line stays what it was."""
    assert run(replay, ["replay", "verify", str(under_another_limit(tmp_path, 1))]) == 65
    told = capsys.readouterr()
    assert told.out.startswith("diverges: record ")
    assert "to blame: configuration, which explains it\n  arrival_tolerance_cdeg " in told.err
    assert [f"  {cause.value} " in told.err for cause in Cause if cause is not Cause.CONFIGURATION] == [True] * 5
    assert told.err.count("\n") <= SCREEN_LINES
    assert "looking into" not in told.err


def test_a_program_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As JSON, every hypothesis with what it came to; nothing where nothing diverges."""
    assert run(replay, ["replay", "verify", str(under_another_limit(tmp_path, 2)), "--json"]) == 65
    plain = json.loads(capsys.readouterr().out)
    assert plain["blame"]["cause"] == "configuration"
    first = plain["blame"]["findings"][0]
    assert (first["weight"], first["result"], first["stopped"]) == ("whole", "explains it", False)
    assert len(plain["blame"]["findings"]) == len(Cause)
    (tmp_path / "same").mkdir()
    assert run(replay, ["replay", "verify", str(story_on_disk(tmp_path / "same")), "--json"]) == 0
    assert "blame" not in json.loads(capsys.readouterr().out)


def test_a_long_chain_of_causes_is_cut(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The decision and its root stay."""
    flight, store = create_flight(tmp_path, 1, FLIGHT_ID, SECRET)
    store.append(forged(story(), 22, because="forged"))
    store.close()
    monkeypatch.setattr(replay, "CAUSES_SHOWN", 3)
    assert run(replay, ["replay", "verify", str(flight.folder)]) == 65
    told = capsys.readouterr().err
    assert "...  1 more, which `replay why` shows\n      6  order_received" in told
    assert "     22  moved" in told


def test_what_stopped_looking_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    """With how much was tried."""
    blaming.tell_blame(
        Blame(
            (Finding(Cause.CODE, Weight.LEFT, "left"), Finding(Cause.MISSING, Weight.NOTHING, "none", 7, stopped=True))
        )
    )
    told = capsys.readouterr().err
    assert told.startswith("to blame: code, which may explain it\n  left\n")
    assert "missing input does not explain it: none (stopped looking after 7 runs)" in told


def test_those_who_look_see_what_is_looked_into(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A word, and nothing of it is left."""
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    run(replay, ["replay", "verify", str(under_another_limit(tmp_path, 1))])
    told = capsys.readouterr().err
    assert "looking into: configuration" in told
    assert told.index("looking into: code") < told.index("\r\x1b[Kthe first decision")
