"""`autopilot status`: one screen, how old it is, and what is missing where there is none."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from autopilot.cli import status
from autopilot.node import notice
from events.schema.safety_pb2 import PropertyBroken
from projections import status as fold
from projections.picture import Status
from projections.store import Projector
from tests.autopilot.cli.flown import run
from tests.flights import (
    Flight,
    detection,
    frame,
    gimbal,
    limits,
    point_at_angles,
    position,
    resealed,
    story,
)
from tests.stories import Story
from tests.stories_of_safety import SAFE_LIMITS


def kept(path: Path, flight: Flight) -> Path:
    """Keep a flight's projections at `path`."""
    projector = Projector(path)
    projector.catch_up(resealed(flight.records))
    projector.close()
    return path


def plain(flight: Flight) -> dict[str, Any]:
    """Return the status of a flight as the database holds it."""
    now = Status()
    for record in flight.records:
        now = fold.apply(now, record)
    read: dict[str, Any] = json.loads(json.dumps(fold.plain(now)))
    return read


def check_screen(flight: Flight, *lines: str) -> None:
    """Check that these lines are on the screen."""
    shown = [" ".join(line.split()) for line in status.screen(plain(flight), 3_000_000_000)]
    assert [line for line in lines if line not in shown] == [], "\n".join(shown)


def test_a_screen_in_flight() -> None:
    """Vehicle, camera with its master, gimbal with its arrival, the questions that wait."""
    flight = Flight(limits=limits(asks_per_minute=1))
    flight.tell(position(10_000, 20_000), 500)
    flight.tell(point_at_angles("p1", -3_000, 9_000), 500)
    flight.tell(gimbal(-2_990, 9_010, flight.effect(), 10), 1_500)
    for number in range(4):
        flight.tell(frame(number, detection(3_000, 4_000, confidence_e4=7_000), detection(90_000, 0, "car")), 100)
    waiting = sorted(flight.state.pois.values(), key=lambda poi: poi.opened_ns)
    surfaced, enqueued = sorted(waiting, key=lambda poi: poi.state == "enqueued")
    check_screen(
        flight,
        "node node-1, software 0.1.0, normal",
        "flight 1 (00010203), open, record " + str(len(flight.records) - 1),
        "age 3 s since the newest record, 2.9 s into the flight",
        "vehicle 1 heard, armed, at 52.1001801 4.3001470, 50.0 m above home",
        "camera 1/1 operator ALPHA by order p1, 58.1 s left",
        "camera 1/2 automatic",
        "gimbal 1/1 arrived, asked pitch -30.0, yaw 90.0 from north, looks pitch -29.9, yaw 90.1, 0.1 off, "
        "there after 1.5 s",
        "map 2 objects, 0 muted places",
        "findings 1 enqueued, 1 surfaced",
        f"{surfaced.poi_id} car 80 % at 31UFT5009050000, seen {surfaced.sightings} times, 90.0 s to decide",
        f"{enqueued.poi_id} person 70 % at 31UFT5000350004, seen {enqueued.sightings} times, waits to be asked",
        "orders taken: none",
    )


def test_a_screen_after_the_flight() -> None:
    """What was answered, rejected and dropped."""
    check_screen(
        story(),
        "flight 1 (00010203), closed: stopped while disarmed, record 120",
        "orders taken: 3 accepted, 1 rejected, 2 timeout, 2 unsupported, 1 unauthorised, 1 unreadable",
        "rejected 3 bad_signature, 1 stale",
        "dropped 7 frame",
        "findings 1 confirmed, 1 declined",
        "camera 1/1 automatic, eyes lost: the detector ended",
    )


def test_a_screen_of_a_gimbal_that_somebody_took() -> None:
    """Who has it, since when nothing is where it was asked, and what an operator should know."""
    told = Story(drift_cdeg=200, drift_settle_ms=500)
    for line in ("zoomed 4000", "described turns", "control 255/190", "order a turn", "gimbal a demanded error=40"):
        told.tell(line)
    asked = "asked pitch -30.0, yaw 90.0 from north, told pitch -10.0, yaw 0.0"
    check_screen(
        told.flight,
        f"gimbal 1/1 commanded, {asked}, 0.4 off, there after 0.0 s, controlled by 255/190",
        "caution no gimbal that pans: a place to look at turns the vehicle itself",
        "camera 1/1 operator ALPHA by order a, 60.0 s left, zoom 40 %",
    )
    told.tell("gimbal a demanded error=900")
    told.flight.wait(500)
    check_screen(
        told.flight,
        f"gimbal 1/1 drifted: 255/190 took it, {asked}, 9.0 off, there after 0.0 s, controlled by 255/190",
    )


@pytest.mark.parametrize(
    ("age_s", "words"), [(0, "0 s"), (119, "119 s"), (120, "2 min"), (7_200, "2 h"), (172_800, "2 days")]
)
def test_ages(age_s: int, words: str) -> None:
    """In the unit that a person would use."""
    assert status.age(age_s * 1_000_000_000) == words


def test_status_from_the_database(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By path and as JSON with its age."""
    path = kept(tmp_path / "p.db", story())
    wall_ns = plain(story())["wall_ns"]
    monkeypatch.setattr("time.time_ns", lambda: wall_ns + 5_500_000_000)
    assert run(status, ["status", "--projections", str(path)]) == 0
    assert "age       5 s since the newest record" in capsys.readouterr().out
    assert run(status, ["status", "--projections", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["age_s"], told["head_seq"], told["map_objects"]) == (5, 120, 2)


def test_status_by_configuration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The database that the node's configuration names, relative to its file."""
    kept(tmp_path / "p.db", story())
    config = tmp_path / "config.toml"
    config.write_text(
        'schema_version = 1\n[node]\nkeys = "keys"\nflights = "flights"\nprojections = "p.db"\n', encoding="utf-8"
    )
    assert run(status, ["status", "--config", str(config)]) == 0
    assert "node-1" in capsys.readouterr().out
    config.write_text("[node]\nprojektions = 1\n", encoding="utf-8")
    assert run(status, ["status", "--config", str(config)]) == 78
    assert "projektions" in capsys.readouterr().err


def test_a_node_that_does_not_record(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """First of all lines, beside what was known last; also where nothing is known any more."""
    path = kept(tmp_path / "p.db", story())
    wall_ns = plain(story())["wall_ns"]
    monkeypatch.setattr("time.time_ns", lambda: wall_ns + 65_000_000_000)
    notice.leave(path, notice.Notice("the disk is gone", wall_ns // 1_000_000))
    line = "SILENT    this node has not been recording for 65 s: the disk is gone\n"
    words = ["status", "--projections", str(path)]
    assert run(status, words) == 0
    assert capsys.readouterr().out.startswith(line + "node ")
    assert run(status, [*words, "--json"]) == 0
    said = {"because": "the disk is gone", "since_ms": wall_ns // 1_000_000}
    assert json.loads(capsys.readouterr().out)["not_recording"] == said
    path.unlink()
    assert run(status, words) == 66
    assert capsys.readouterr().out == line
    assert run(status, [*words, "--json"]) == 66
    assert json.loads(capsys.readouterr().out) == {"not_recording": said}
    notice.take_away(path)
    assert run(status, words) == 66
    assert capsys.readouterr().out == ""


def test_no_status(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """66, and a question that leads further."""
    assert run(status, ["status", "--projections", str(tmp_path / "none.db")]) == 66
    assert "has the node run?" in capsys.readouterr().err


def test_a_screen_in_danger() -> None:
    """Failsafes that are not at rest, who holds one off, and what must never be."""
    story = Story(**SAFE_LIMITS)
    for words in ("heard alpha", "fence in=-9,-9,9,9", "spot 20,0", "battery 24", "order a override battery because=x"):
        story.tell(words)
    story.flight.tell(PropertyBroken(property="hands_off", words="so it is", at_seq=7))
    story.flight.wait(5_000)
    check_screen(
        story.flight,
        "vehicle 1 heard, armed, battery 24 %, at 52.1000000 4.3002941, 50.0 m above home",
        "failsafes on, link to operators degraded",
        "1/fence returning: outside an inclusion fence",
        "1/battery held off: battery at 24 %",
        "ALPHA holds battery return off: x, 55.0 s left",
        "BROKEN hands_off, which must never be: record 7: so it is",
    )


def test_a_screen_without_a_say_in_the_flight() -> None:
    """Nothing of failsafes is shown where there are none."""
    shown = list(status.screen(plain(Flight()), 0))
    assert [line for line in shown if "failsafe" in line] == []
