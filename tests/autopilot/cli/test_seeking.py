"""`autopilot replay show --at`: a state in words and as JSON, read from a snapshot that the node's key vouches for."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from autopilot.cli import replay
from autopilot.node import restoring
from autopilot.node.sealing import CERTIFICATE_FILE, KEY_FILE
from autopilot.trust.keys import SignKey, read_secret
from autopilot.trust.notes import read_checkpoint, read_log_key, sign_note
from events.store import SqliteStore, flights_in
from events.store.snapshots import NAME, Snapshots
from tests.autopilot.cli.flown import run, story_on_disk
from tests.autopilot.trust.world import people
from tests.bench import million
from tests.checks import check_equal

LATE = 990


def shown(folder: Path, seq: int, capsys: pytest.CaptureFixture[str], code: int = 0) -> tuple[dict[str, Any], str]:
    """Run the command; return what it printed as JSON, and what it said."""
    check_equal(run(replay, ["replay", "show", str(folder), "--at", str(seq), "--json"]), code)
    told = capsys.readouterr()
    return json.loads(told.out or "{}"), told.err


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a flight's folder as a node leaves it that was killed, with a few snapshots."""
    monkeypatch.setattr(restoring, "EVERY_RECORDS", 200)
    million.fly(tmp_path, 1_000)
    return flights_in(tmp_path)[0].folder


def test_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A flight without snapshots says that it takes longer; a record that is not there is a usage error."""
    folder = story_on_disk(tmp_path)
    check_equal(run(replay, ["replay", "show", str(folder), "--at", "64"]), 0)
    told = capsys.readouterr()
    check_equal(told.out.startswith("after record 64 (order_received), digest "), True)
    check_equal("\norders: order alpha/j1, state received, verb judge\n" in told.out, True)
    check_equal("no snapshot to start from: the log was read from its beginning" in told.err, True)
    _, err = shown(folder, 121, capsys, 2)
    check_equal("no record 121: its last one is 120" in err, True)


def test_from_a_snapshot_as_from_zero(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The same, but for where it was read from."""
    sizes = sorted(Snapshots(folder).places)
    found, err = shown(folder, LATE, capsys)
    check_equal((len(sizes) > 1, found["read_from"], err), (True, max(size for size in sizes if size <= LATE + 1), ""))
    (folder / NAME).unlink()
    whole, _ = shown(folder, LATE, capsys)
    check_equal((whole["read_from"], whole["seq"]), (0, LATE))
    check_equal(whole | {"read_from": found["read_from"]}, found)


@pytest.mark.parametrize(
    "statement",
    [
        "DELETE FROM checkpoint",
        "UPDATE checkpoint SET note = replace(note, 'state ', 'stage ')",
        "UPDATE checkpoint SET size = size + 5000",
        "DELETE FROM checkpoint WHERE size < 800; UPDATE checkpoint SET size = size - 540",
        "UPDATE record SET body = x'ff' WHERE seq = 0",
    ],
)
def test_what_nobody_signed_is_not_used(folder: Path, statement: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Not even where everything else fits; the log is read from zero, or can't be."""
    store = SqliteStore(folder / "flight.db")
    store._connection.execute(statement)
    store.close()
    readable = "record SET" not in statement
    found, err = shown(folder, LATE, capsys, 0 if readable else 65)
    check_equal(found.get("read_from", 0), 0)
    check_equal(all("nothing vouches" in one for one in found.get("refused", ["nothing vouches"])), True)
    check_equal(("no snapshot to start from" in err) or not readable, True)


def test_a_checkpoint_that_names_no_state_vouches_for_none(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As an older version signed it, by the very same key."""
    key = SignKey.from_seed(read_secret(folder / KEY_FILE))
    store = SqliteStore(folder / "flight.db")
    for size, note in store.checkpoints():
        said = replace(read_checkpoint(note.rpartition("\n\n")[0] + "\n"), state=None)
        store.add_checkpoint(size, sign_note(said.text(), said.origin, key))
    store.close()
    found, _ = shown(folder, LATE, capsys)
    check_equal((found["read_from"], "nothing vouches" in found["refused"][0]), (0, True))


def test_another_certificate_is_not_believed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of another flight, changed, or gone."""
    path, wasp = folder / CERTIFICATE_FILE, people().wasp
    text = path.read_text("utf-8").rpartition("\n\n")[0] + "\n"
    other = replace(read_log_key(text), flight_id=bytes(16))
    path.write_text(sign_note(other.text(), other.signer, wasp.sign_key), "utf-8")
    check_equal(shown(folder, LATE, capsys)[0]["read_from"], 0)
    path.write_text(sign_note(text, other.signer, wasp.sign_key), "utf-8")
    check_equal(shown(folder, LATE, capsys)[0]["read_from"] > 0, True)
    path.write_text(path.read_text("utf-8").replace("flight ", "flight 0"), "utf-8")
    check_equal(shown(folder, LATE, capsys)[0]["read_from"], 0)
    path.unlink()
    check_equal(shown(folder, LATE, capsys)[0]["read_from"], 0)
