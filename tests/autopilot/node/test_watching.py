"""The monitors in flight: a broken property is told once, in the log, on standard error and in the status."""

from __future__ import annotations

from pathlib import Path

import pytest

from autopilot.node.loop import Stop
from autopilot.node.watching import Watching
from autopilot.ports.edges import InputClass
from events.kinds import Role
from events.records import Record
from events.schema.safety_pb2 import PropertyBroken
from statecharts import steps_of
from statecharts.monitors import Breach, Watch
from tests.autopilot.node.nodes import FakeClock, Node, heard_vehicle
from tests.checks import check_equal
from tests.flights import Flight, frame, point_at_place, position
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
    """It is in the log behind the batch of the step that broke it, which it names, and the node goes on."""
    node = Node(tmp_path, FakeClock(), monkeypatch).start()
    breaks(monkeypatch, "hands_off", "one_master")
    node.tell(frame(1), frame(2))
    node.turn(after_ms=200)
    check_equal(
        [(name, words) for name, words, _ in told(node)], [("hands_off", "so it is"), ("one_master", "so it is")]
    )
    check_equal(node.kinds()[-4:], ["frame_observed", "frame_observed", "property_broken", "property_broken"])
    check_equal([at_seq for _, _, at_seq in told(node)], [node.log()[-4].seq] * 2)
    check_equal(capsys.readouterr().err.count("is broken"), 2)


def test_those_who_watch_come_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A step is shown once, when it is durable and its effects are handed over; what is found is durable at once."""
    node = Node(tmp_path, FakeClock(), monkeypatch).start()
    node.tell(*heard_vehicle())
    node.disk.happened.clear()

    def see(_: Watch, step: tuple[Record, ...]) -> list[Breach]:
        node.disk.happened.append(f"watch {step[0].seq}-{step[-1].seq}")
        return [Breach("hands_off", "so it is", step[0].seq)]

    monkeypatch.setattr(Watch, "see", see)
    first = node.session.state.next_seq.value
    node.tell(point_at_place("a"), input_class=InputClass.ORDER)
    last = node.log()[-2].seq
    effects = [f"perform {record.seq}" for record in node.log()[first:last] if record.kind.role is Role.EFFECT]
    check_equal(len(effects) > 1, True)
    check_equal(
        node.disk.happened,
        [
            *(f"append {first}-{last}", *effects, f"watch {first}-{last}"),
            *(f"append {last + 1}-{last + 1}", f"watch {last + 1}-{last + 1}"),
        ],
    )


def test_what_is_found_at_the_end_is_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the step that broke it is the last before the flight is closed."""
    node = Node(tmp_path, FakeClock(), monkeypatch).start()
    breaks(monkeypatch, "hands_off")
    node.inbox.offer(InputClass.FRAME, frame(1))
    node.loop._finish(node.session, Stop())
    check_equal(node.kinds()[-3:], ["frame_observed", "property_broken", "flight_closed"])


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
