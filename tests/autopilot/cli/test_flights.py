"""`autopilot flights`: the list, receipts that are only given for what is whole, and pruning."""

from __future__ import annotations

import json
from pathlib import Path

import apsw
import pytest

from autopilot.cli import flights
from autopilot.node.deleting import graves
from autopilot.node.lock import FolderLock
from autopilot.node.receipts import read_receipt
from autopilot.trust.notes import sign_note
from autopilot.trust.replayed import SignedVerdict
from events.store import flights_in
from tests.autopilot.cli.flown import run
from tests.autopilot.node.kept import DAY_MS, keep, push, stock
from tests.autopilot.trust.world import NOW_MS

ROWS = 3


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a configuration whose node has two closed flights and an open one."""
    monkeypatch.setattr("autopilot.trust.clock.HostClock.wall_ns", lambda _self: NOW_MS * 1_000_000)
    for number in (1, 2):
        keep(tmp_path / "flights", number, began_ms=NOW_MS - 50 * DAY_MS)
    keep(tmp_path / "flights", 3, began_ms=NOW_MS, is_closed=False)
    path = tmp_path / "config.toml"
    node = 'schema_version = 1\n[node]\nkeys = "keys"\nflights = "flights"\nprojections = "p.db"\n'
    path.write_text(f"{node}[retention]\nkeep_newest = 1\nmin_free_mib = 0\n", encoding="utf-8")
    return path


def check_command(words: list[str], code: int, capsys: pytest.CaptureFixture[str], out: str = "", err: str = "") -> str:
    """Check exit code and parts of what is said; return what was printed on stdout."""
    assert run(flights, ["flights", *words]) == code
    told = capsys.readouterr()
    assert out in told.out
    assert err in told.err
    return told.out


def test_a_list(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A line a flight; one that can't be read says why."""
    root = config.parent / "flights"
    push(stock(root)[1], "archive")
    lines = check_command(["list", "--config", str(config)], 0, capsys).splitlines()
    assert len(lines) == ROWS
    assert "until 2026-08-02 14:13:21Z, stopped while disarmed; 6 records; no verdict; pushed to archive" in lines[0]
    assert lines[0].startswith("     1  01010101 ")
    assert lines[1].endswith("not pushed")
    assert "not closed; 5 records" in lines[2]
    (flights_in(root)[0].folder / "flight.db").write_bytes(b"no database" * 1000)
    assert "can't be read: " in check_command(["list", "--config", str(config)], 0, capsys)


def test_a_list_as_json(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every field, for a program that pushes what is not pushed."""
    root = config.parent / "flights"
    push(stock(root)[1], "archive")
    found = json.loads(check_command(["list", "--config", str(config), "--json"], 0, capsys))
    first, _, third = found
    assert (first["number"], first["flight_id"], first["records"]) == (1, "01" * 16, 6)
    assert (first["began_ms"], first["ended_ms"]) == (NOW_MS - 50 * DAY_MS, NOW_MS - 50 * DAY_MS + 1000)
    assert first["pushed"] == {"to": "archive", "at_ms": 5}
    assert first["last_leaf"] == stock(root)[1].head.leaf.hex()
    assert (first["closed_because"], first["verdict"]) == ("stopped while disarmed", None)
    assert (third["ended_ms"], third["closed_because"], third["pushed"]) == (None, None, None)


def test_a_verdict_is_in_the_list(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As the node signed it; one by somebody else is not to be believed."""
    from tests.autopilot.trust.world import people

    folder = flights_in(config.parent / "flights")[0].folder
    said = SignedVerdict(
        origin="waypoint/d/n/1", flight_id="01" * 16, seq=6, leaf="00" * 32, software="0", verdict="REPLAYS"
    )
    (folder / "verdict").write_text(sign_note(said.text(), "waypoint/d/n", people().alice.sign_key))
    assert "not to be believed" in check_command(["list", "--config", str(config)], 0, capsys)


def test_a_receipt(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """For what is closed and sound, and ends as what arrived."""
    one = stock(config.parent / "flights")[1]
    folder, leaf = one.flight.folder, one.head.leaf.hex()
    words = ["pushed", str(folder), "--to", "archive:/a"]
    check_command([*words, "--head", "00" * 32], 65, capsys, err="what was pushed ends otherwise")
    assert read_receipt(folder) is None
    check_command(
        [*words, "--head", leaf.upper()], 0, capsys, "flight 1, records 0 to 5, counts as pushed to archive:/a"
    )
    receipt = read_receipt(folder)
    assert receipt is not None
    assert receipt.names(one.flight_id, one.head)
    assert (receipt.flight_number, receipt.to, receipt.at_ms) == (1, "archive:/a", NOW_MS)
    check_command(["pushed", str(folder / "flight.db"), "--to", "b"], 0, capsys)


def test_no_receipt(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Not for an open flight, a damaged one, or none."""
    first, _, third = (one.folder for one in flights_in(config.parent / "flights"))
    check_command(["pushed", str(third), "--to", "b"], 65, capsys, err="the flight is not closed")
    connection = apsw.Connection(str(first / "flight.db"))
    connection.execute("UPDATE record SET body = zeroblob(9) WHERE seq = 3")
    connection.close()
    check_command(["pushed", str(first), "--to", "b"], 65, capsys, err="its leaf is not the hash")
    check_command(["pushed", str(first / "none"), "--to", "b"], 66, capsys, err="there is no log")
    assert [read_receipt(folder) for folder in (first, third)] == [None, None]


def test_pruning(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Said first, then done; the next start of the daemon tells of it."""
    root = config.parent / "flights"
    check_command(["prune", "--config", str(config)], 0, capsys, "no flight may go")
    push(stock(root)[1])
    check_command(["prune", "--config", str(config), "--dry-run"], 0, capsys, "flight 1 would be deleted")
    assert len(flights_in(root)) == ROWS
    with FolderLock(root):
        check_command(["prune", "--config", str(config)], 69, capsys, err="the daemon runs")
    out = check_command(["prune", "--config", str(config), "--json"], 0, capsys)
    assert json.loads(out) == {"deleted": [1], "short": None, "dry_run": False}
    assert [one.number for one in flights_in(root)] == [2, 3]
    assert [[file.name for file in grave.iterdir()] for grave in graves(root)] == [["pushed"]]


def test_a_short_disk_is_said(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """On stderr: it is no data."""
    config.write_text(config.read_text().replace("min_free_mib = 0", "min_free_mib = 1073741824"))
    check_command(
        ["prune", "--config", str(config)], 0, capsys, "no flight may go", "1 flights (0 MiB) wait to be pushed"
    )


def test_what_is_wrong(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """78 for the configuration, 74 for a folder that can't be looked into."""
    config.write_text("[nod]\n")
    check_command(["list", "--config", str(config)], 78, capsys, err="nod")
    check_command(["prune", "--config", str(config)], 78, capsys, err="nod")
