"""`autopilot replay`: verdicts, exit codes, and words on the right stream."""

from __future__ import annotations

import json
from io import StringIO
from pathlib import Path

import apsw
import pytest

from autopilot.cli import replay
from autopilot.cli.bar import Bar
from events.store import SqliteStore, create_flight
from tests.autopilot.cli.flown import run, story_on_disk
from tests.flights import FLIGHT_ID, SECRET, story
from tests.replay.changes import forged


def check_command(words: list[str], code: int, capsys: pytest.CaptureFixture[str], out: str = "", err: str = "") -> str:
    """Check exit code and parts of what is said; return what was printed on stdout."""
    assert run(replay, words) == code
    told = capsys.readouterr()
    assert out in told.out
    assert err in told.err
    return told.out


def tampered(folder: Path) -> Path:
    """Change one byte in the log without making the chain again; return the folder."""
    connection = apsw.Connection(str(folder / "flight.db"))
    connection.execute("UPDATE record SET body = zeroblob(9) WHERE seq = 40")
    connection.close()
    return folder


def test_verify_identical(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit 0, one line; by the folder or by the log in it."""
    folder = story_on_disk(tmp_path)
    line = "identical: 121 records, 78 decisions compared\n"
    assert check_command(["replay", "verify", str(folder)], 0, capsys) == line
    assert check_command(["replay", "verify", str(folder / "flight.db")], 0, capsys) == line


def test_verify_diverges(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit 65; the causes are words on stderr, the last line is data."""
    flight, store = create_flight(tmp_path, 1, FLIGHT_ID, SECRET)
    store.append(forged(story(), 22, because="forged"))
    store.close()
    words = ["replay", "verify", str(flight.folder)]
    out = check_command(words, 65, capsys, "diverges: record 22 (moved because), field", "order_received")
    assert out.count("\n") == 1
    plain = json.loads(check_command([*words, "--json"], 65, capsys))
    assert (plain["outcome"], plain["first"]["seq"], plain["first"]["field"]) == ("diverges", 22, "because")


def test_verify_a_broken_chain(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit 65, and which record."""
    folder = tampered(story_on_disk(tmp_path))
    check_command(["replay", "verify", str(folder)], 65, capsys, "broken chain: record 40: its leaf")


def test_no_flight_and_no_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """66 where there is nothing, 74 where it can't be read, and what to do."""
    check_command(["replay", "verify", str(tmp_path / "none")], 66, capsys, err="name the folder of a flight")
    (tmp_path / "empty").mkdir()
    check_command(["replay", "show", str(tmp_path / "empty")], 66, capsys, err="there is no log")
    (tmp_path / "empty" / "flight.db").write_bytes(b"this is no database" * 100)
    check_command(["replay", "why", str(tmp_path / "empty"), "1"], 74, capsys, err="not the log of a flight")


def test_show(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From and to count both; one kind alone; a kind that is none is a usage error."""
    folder = str(story_on_disk(tmp_path))
    assert check_command(["replay", "show", folder, "--from", "6", "--to", "8"], 0, capsys).count("\n") == 3
    out = check_command(["replay", "show", folder, "--kind", "order_malformed"], 0, capsys, "95 degrees")
    assert out.count("\n") == 1
    check_command(["replay", "show", folder, "--kind", "order"], 2, capsys, err="no event kind is named 'order'")


def test_why(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Causes and consequences; a record that is not there is a usage error."""
    folder = str(story_on_disk(tmp_path))
    out = check_command(["replay", "why", folder, "18"], 0, capsys)
    assert [line.split()[0] for line in out.splitlines()] == ["because", "18", "17", "8", "6", "record", "led"]
    plain = json.loads(check_command(["replay", "why", folder, "17", "--json"], 0, capsys))
    assert [one["seq"] for one in plain["causes"]] == [17, 8, 6]
    assert [one["seq"] for one in plain["led_to"]] == [18, 19, 96]
    check_command(["replay", "why", folder, "999"], 2, capsys, err="no record 999")


def test_a_seq_is_a_number(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Anything else is refused before the flight is looked at."""
    with pytest.raises(SystemExit, match="2"):
        run(replay, ["replay", "why", str(tmp_path), "-1x"])
    assert "SEQ" in capsys.readouterr().err


def test_replay_changes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The log has the same bytes afterwards."""
    folder = story_on_disk(tmp_path)
    before = (folder / "flight.db").read_bytes()
    check_command(["replay", "verify", str(folder)], 0, capsys)
    assert (folder / "flight.db").read_bytes() == before
    store = SqliteStore(folder / "flight.db")
    assert store.head.seq == 120
    store.close()


class Terminal(StringIO):
    """A stream that somebody looks at."""

    def isatty(self) -> bool:
        return True


def test_a_bar_for_those_who_look() -> None:
    """Not before a second, not more often than ten times a second, and gone at the end."""
    now_s = iter([0.0, 0.5, 1.5, 1.55, 1.7])
    out = Terminal()
    bar = Bar("replaying", out, lambda: next(now_s))
    for done in (10, 20, 30, 40):
        bar(done, 40)
    assert out.getvalue().count("replaying [") == 2
    assert out.getvalue().endswith("] 40 of 40")
    bar.end()
    assert out.getvalue().endswith("\r\x1b[K")
    silent = StringIO()
    bar = Bar("replaying", silent, lambda: 99.0)
    bar(1, 2)
    bar.end()
    assert silent.getvalue() == ""


def test_check_a_sound_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit 0; the last record and the head are named."""
    folder = story_on_disk(tmp_path)
    out = check_command(["replay", "check", str(folder)], 0, capsys, "sound: records 0 to 120 hold, last leaf ")
    assert "\nhead: record 120, leaf " in out
    plain = json.loads(check_command(["replay", "check", str(folder / "flight.db"), "--json"], 0, capsys))
    assert (plain["sound"], plain["records"], plain["head"]["seq"], plain["action"]) == (True, 121, 120, "go_on")


def test_check_a_wrong_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit 65: edited, without its head, and no database at all; what a start would do is said."""
    folder = story_on_disk(tmp_path)
    (folder / "head").unlink()
    check_command(["replay", "check", str(folder)], 65, capsys, "wrong: records 0 to 120 hold")
    tampered(folder)
    out = check_command(["replay", "check", str(folder)], 65, capsys, "record 40: its leaf is not the hash")
    assert "a start would: keep it as it was found" in out
    plain = json.loads(check_command(["replay", "check", str(folder), "--json"], 65, capsys))
    assert (plain["last_seq"], plain["facts"]["records"], plain["head"]) == (39, "broken", None)
    (folder / "flight.db").write_bytes(b"no database" * 1000)
    check_command(["replay", "check", str(folder)], 65, capsys, "no record can be read")


def test_check_what_can_not_be_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit 66 where there is none, 74 where the system does not let it be read."""
    check_command(["replay", "check", str(tmp_path)], 66, capsys, err="there is no log at")
    (tmp_path / "flight.db").mkdir()
    check_command(["replay", "check", str(tmp_path)], 74, capsys, "a start would: record nothing")
