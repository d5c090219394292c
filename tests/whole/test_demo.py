"""`autopilot demo` as a newcomer runs it: one command, a flight of 15 s, and what it leaves."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from events import read_record
from events.store import flights_in, read_flight
from replay.verify import verify

pytestmark = pytest.mark.whole

AUTOPILOT = str(Path(sys.executable).with_name("autopilot"))
RESULTS = {"accepted", "rejected", "timeout", "unsupported", "unauthorised"}
POI_STATES = {"enqueued", "suppressed", "surfaced", "confirmed", "declined", "expired", "withdrawn"}


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """Fly the short demo once."""
    folder = tmp_path_factory.mktemp("demo") / "here"
    command = [AUTOPILOT, "demo", "--dir", str(folder), "--act", "camera", "--seconds", "15", "--seed", "5", "--json"]
    return folder, subprocess.run(command, capture_output=True, text=True, timeout=110, check=False)


def said(demo: tuple[Path, subprocess.CompletedProcess[str]]) -> dict[str, Any]:
    """Return the one JSON object that the demo ends with."""
    run = demo[1]
    assert run.returncode == 0, run.stderr[-2000:]
    lines = run.stdout.splitlines()
    assert len(lines) == 1
    (summary,) = json.loads(lines[0]).values()
    told: dict[str, Any] = summary
    return told


def check_counts(found: Any, keys: set[str], *, all_keys: bool) -> None:
    """Check an object of counts: known keys, whole numbers from 0."""
    assert set(found) <= keys
    assert not all_keys or set(found) == keys
    assert [count for count in found.values() if type(count) is not int or count < 0] == []


def test_it_ends_with_one_object(demo: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    """Its keys and what they hold."""
    folder, summary = demo[0], said(demo)
    expected = {"flight", "events", "orders", "pois", "map_objects", "samples_dropped", "replay", "bundle"}
    assert set(summary) == expected
    assert summary["replay"] == "identical"
    assert (type(summary["events"]), type(summary["map_objects"])) == (int, int)
    check_counts(summary["orders"], RESULTS, all_keys=True)
    check_counts(summary["pois"], POI_STATES, all_keys=False)
    check_counts(summary["samples_dropped"], set(summary["samples_dropped"]), all_keys=True)
    assert Path(summary["flight"]).parent == folder / "node" / "flights"
    assert isinstance(json.loads(Path(summary["bundle"]).read_text()), dict)


def test_it_tells_what_happened(demo: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    """The numbers are those of the story: orders done, a viewer refused, a finding confirmed, forgeries counted."""
    summary = said(demo)
    assert summary["orders"]["accepted"] >= 3
    assert summary["orders"]["unauthorised"] == 1
    assert sum(summary["samples_dropped"].values()) >= 2
    assert summary["pois"].get("confirmed", 0) >= 1
    assert summary["map_objects"] >= 1


def test_it_leaves_a_flight_that_replays(demo: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    """Closed by the landing's SIGTERM, as many records as it said, decided again with the same result."""
    summary = said(demo)
    (flight,) = flights_in(demo[0] / "node" / "flights")
    assert flight.folder == Path(summary["flight"])
    assert re.fullmatch(r"000001-[0-9a-f]{8}", flight.folder.name)
    reader = read_flight(flight.folder)
    try:
        assert verify(reader).holds
        assert reader.head.seq + 1 == summary["events"]
        assert reader.flight_id.hex().startswith(flight.folder.name.partition("-")[2])
        last = [read_record(stored) for stored in reader.stored(reader.head.seq - 5)]
    finally:
        reader.close()
    assert "flight_closed" in [record.kind.name for record in last]


def test_it_leaves_files_where_they_belong(demo: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    """Directory, operators, node; what is secret is for the owner only."""
    said(demo)
    node = demo[0] / "node"
    assert {"directory", "operators", "node"} <= {path.name for path in demo[0].iterdir()}
    assert {"config.toml", "keys", "projections.db", "flights"} <= {path.name for path in node.iterdir()}
    secret = [*(node / "keys").iterdir(), *(demo[0] / "directory").iterdir(), *(demo[0] / "operators").rglob("*")]
    names = {"device.sign", "device.box", "root.key", "token.key", "epoch.key", "revoke.key", "time.key"}
    files = [path for path in secret if path.is_file() and (path.name in names or path.suffix in (".key", ".secret"))]
    assert len(files) > 10
    assert [path for path in files if path.stat().st_mode & 0o777 != 0o600] == []


def test_what_it_did_can_be_proved(demo: tuple[Path, subprocess.CompletedProcess[str]], tmp_path: Path) -> None:
    """By the commands alone; its key is gone, and the operators have kept what it signed."""
    folder = Path(said(demo)["flight"])
    reader = read_flight(folder)
    acks = [stored.seq for stored in reader.stored() if read_record(stored).kind.name == "send_ack"]
    reader.close()
    proof = str(tmp_path / "proof.json")
    for words in (["export", "proof", str(folder), "--seq", str(acks[-1]), proof], ["verify", proof]):
        run = subprocess.run([AUTOPILOT, *words], capture_output=True, text=True, timeout=60, check=False)
        assert run.returncode == 0, run.stderr
    assert run.stdout.startswith(f"Proved: record {acks[-1]}")
    assert not (folder / "log_key").exists()
    kept = {path.name for path in demo[0].glob("**/witness/wasp-01/*")}
    assert kept == {"000001.json"}


def test_the_whole_story(tmp_path: Path) -> None:
    """From 45 s on every scene is played; one that does not come true ends the demo with 1."""
    command = [AUTOPILOT, "demo", "--dir", str(tmp_path / "here"), "--act", "camera", "--seconds", "45", "--seed", "2"]
    command.append("--json")
    run = subprocess.run(command, capture_output=True, text=True, timeout=150, check=False)
    assert run.returncode == 0, run.stderr[-3000:]
    summary = json.loads(run.stdout)["camera"]
    assert summary["replay"] == "identical"
    assert summary["orders"] == {"accepted": 7, "rejected": 0, "timeout": 0, "unsupported": 0, "unauthorised": 1}
    assert (summary["pois"]["confirmed"], summary["pois"]["declined"]) == (1, 1)
    bundle = json.loads(Path(summary["bundle"]).read_text())
    assert [row["duplicates"] > 0 for row in bundle["audit"] if row["result"] == "accepted"].count(True) >= 2
    assert sum(item["muted"] for item in bundle["ignored_items"]) > 0
    assert re.search(r"published [2-9] times, and done once", run.stderr)


def test_a_mission_from_the_office_to_the_landing(tmp_path: Path) -> None:
    """The second act: it is flown once, nothing that must not be was seen, and all of its region was."""
    command = [AUTOPILOT, "demo", "--act", "mission", "--dir", str(tmp_path / "here"), "--json"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=200, check=False)
    assert run.returncode == 0, run.stderr[-3000:]
    summary = json.loads(run.stdout)["mission"]
    assert summary["replay"] == "identical"
    assert summary["orders"] == {"accepted": 1, "rejected": 0, "timeout": 0, "unsupported": 0, "unauthorised": 1}
    assert "BROKEN" not in run.stderr
    (seen,) = re.findall(r"truly seen ([0-9.]+) %", run.stderr)
    assert float(seen) >= 98
