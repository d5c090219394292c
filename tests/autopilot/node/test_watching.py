"""The monitors in flight: a broken property is told once, in the log, on standard error and in the status."""

from __future__ import annotations

from pathlib import Path

import pytest

from autopilot.node.watching import Watching
from events.schema.safety_pb2 import PropertyBroken
from statecharts import steps_of
from statecharts.monitors import Breach, Watch
from tests.autopilot.node.nodes import FakeClock, Node, heard_vehicle
from tests.checks import check_equal
from tests.flights import Flight, frame, position
from tests.stories import Story


def breaks(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Let every step break these properties."""
    monkeypatch.setattr(Watch, "see", lambda _, step: [Breach(name, "so it is", step[0].seq) for name in names])


def told(node: Node) -> list[tuple[str, str, int]]:
    """Return what the log was told of properties."""
    messages = [record.message for record in node.log() if record.kind.name == "property_broken"]
    return [(one.property, one.words, one.at_seq) for one in messages]  # type: ignore[attr-defined]


def test_a_good_flight_is_told_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The opening, reports and what follows from them."""
    node = Node(tmp_path, FakeClock(), monkeypatch).start()
    node.tell(*heard_vehicle(), frame(1), position(0, 0))
    node.turn(after_ms=200)
    check_equal(told(node), [])


def test_a_broken_property_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is in the log behind the step that broke it, and the node goes on."""
    node = Node(tmp_path, FakeClock(), monkeypatch).start()
    breaks(monkeypatch, "hands_off", "one_master")
    node.tell(frame(1), frame(2))
    node.turn(after_ms=200)
    check_equal(
        [(name, words) for name, words, _ in told(node)], [("hands_off", "so it is"), ("one_master", "so it is")]
    )
    check_equal(node.kinds()[-4:], ["frame_observed", "property_broken", "property_broken", "frame_observed"])
    check_equal(capsys.readouterr().err.count("is broken"), 2)


def test_monitors_that_fail_stop_and_say_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A defect in a monitor is told like a broken property; nothing is watched any more."""
    flight = Flight()
    watching = Watching(flight.state)

    def fails(*_: object) -> list[Breach]:
        raise ZeroDivisionError

    monkeypatch.setattr(Watch, "see", fails)
    step = flight.tell(frame(1))
    check_equal([one.property for one in watching.see(step)], ["monitors"])
    check_equal("ZeroDivisionError" in capsys.readouterr().err, True)
    check_equal(watching.see(step), [])


def test_it_begins_anywhere() -> None:
    """Without false alarms, also in the middle of a flight in which somebody holds the camera."""
    story = Story(scan_enabled=True)
    for words in ("order a point", "answered a 0", "frame person@0,0"):
        story.tell(words)
    watching, begun = Watching(story.flight.state), len(story.flight.records)
    for at_ms, words in ((50_000, "order b turn by=bravo"), (50_001, "answered b 2"), (50_002, "again a")):
        story.at(at_ms)
        story.tell(words)
    found: list[PropertyBroken] = []
    for step in steps_of(story.flight.records[begun:]):
        found += watching.see(step)
    check_equal(found, [])
