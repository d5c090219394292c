"""`autopilot export`: the same bytes every time, whole files, and clear refusals."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from autopilot.cli import export
from events.store import create_flight
from projections.bundle import build, build_push
from projections.canonical import json_text
from tests.autopilot.cli.flown import run, story_on_disk
from tests.flights import FLIGHT_ID, SECRET, story


def check_export(words: list[str], code: int, capsys: pytest.CaptureFixture[str], err: str = "") -> str:
    """Check exit code and a part of what is said on stderr; return stdout."""
    assert run(export, ["export", *words]) == code
    told = capsys.readouterr()
    assert err in told.err
    return told.out


def test_a_bundle_is_the_fold_of_the_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """To a file and to standard output, the same bytes."""
    folder, out = str(story_on_disk(tmp_path)), tmp_path / "bundle.json"
    said = check_export(["bundle", folder, str(out)], 0, capsys, "2 map objects, 3 observations, 1 ignored items")
    assert said == ""
    assert out.read_text(encoding="utf-8") == json_text(build(story().records)) + "\n"
    assert check_export(["bundle", folder, "-"], 0, capsys) == out.read_text(encoding="utf-8")
    assert [file.name for file in tmp_path.iterdir() if file.name.startswith(".")] == []


def test_what_was_written_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Path, size and digest."""
    folder, out = str(story_on_disk(tmp_path)), tmp_path / "bundle.json"
    told = json.loads(check_export(["bundle", folder, str(out), "--json"], 0, capsys))
    assert told["sha256"] == hashlib.sha256(out.read_bytes()).hexdigest()
    assert (told["bundle"], told["bytes"], told["audit"]) == (str(out), out.stat().st_size, 17)
    check_export(["bundle", folder, "-", "--json"], 2, capsys, "name a file")


def test_what_is_to_be_pushed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As the node's child prints it: up to a record, that one too."""
    folder, out = str(story_on_disk(tmp_path)), tmp_path / "push.json"
    words = "3 observations, 1 ignored items of mission none"
    assert check_export(["observations", folder, str(out)], 0, capsys, words) == ""
    records = story().records
    assert out.read_text(encoding="utf-8") == json_text(build_push(records)) + "\n"
    first = next(record.seq for record in records if record.kind.name == "sightings_classified")
    for until, count in ((first - 1, 0), (first, len(build_push(records[: first + 1])["observations"]))):
        told = json.loads(check_export(["observations", folder, "-", "--until", str(until)], 0, capsys))
        assert len(told["observations"]) == count
    assert count > 0


def test_refusals(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No flight, no manifest, nowhere to write: each with its code and its reason."""
    check_export(["bundle", str(tmp_path / "none"), "-"], 66, capsys, "there is no flight")
    flight, store = create_flight(tmp_path, 1, FLIGHT_ID, SECRET)
    store.close()
    check_export(["bundle", str(flight.folder), "-"], 65, capsys, "no manifest")
    check_export(["observations", str(flight.folder), "-"], 65, capsys, "no manifest")
    folder = str(story_on_disk(tmp_path / "other"))
    check_export(["bundle", folder, str(tmp_path / "no" / "where.json")], 73, capsys, "can't be written")
    (tmp_path / "taken").mkdir()
    check_export(["bundle", folder, str(tmp_path / "taken")], 73, capsys, "can't be written")
    assert [file.name for file in tmp_path.iterdir() if file.name.startswith(".")] == []
