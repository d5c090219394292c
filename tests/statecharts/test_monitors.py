"""The alarm itself is tested: each monitor is shown a flight that must not be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import pytest
from google.protobuf.message import Message

from events import Record, kind_of, make_record
from events.schema.common_pb2 import Moved
from events.schema.orders_pb2 import SendAck
from statecharts import steps_of
from tests.checks import check_equal
from tests.flights import story as whole_flight
from tests.monitors import complaints
from tests.stories import Story

Flight = list[list[Record]]


def scanned() -> Story:
    """Return a flight in which the node looks at a finding, and an operator takes the camera and judges."""
    story = Story(scan_enabled=True, sightings_to_ask=1, frame_rate_floor_mhz=0)
    for at_ms, words in ((0, "frame person@0,0"), (0, "time"), (10, "order a point"), (20, "answered a 0")):
        story.at(at_ms)
        story.tell(words)
    story.tell("order b confirm p1")
    story.tell("again a")
    return story


def steps(records: Sequence[Record]) -> Flight:
    """Return a flight as steps that a test may change."""
    return [list(step) for step in steps_of(records)]


def changed(record: Record, message: Message) -> Record:
    """Return a record with another message."""
    return make_record(record.seq, record.cause, record.at, message)


def where(flight: Flight, kind: str, **fields: Any) -> tuple[int, int]:
    """Return step and place of the first record of a kind with these fields."""
    return next(
        (number, place)
        for number, step in enumerate(flight)
        for place, record in enumerate(step)
        if record.kind.name == kind and all(getattr(record.message, name) == value for name, value in fields.items())
    )


def cut(kind: str, **fields: Any) -> Callable[[Flight], None]:
    """Take a record out."""

    def change(flight: Flight) -> None:
        number, place = where(flight, kind, **fields)
        del flight[number][place]

    return change


def twice(kind: str, **fields: Any) -> Callable[[Flight], None]:
    """Let a record be said twice."""

    def change(flight: Flight) -> None:
        number, place = where(flight, kind, **fields)
        flight[number].insert(place, flight[number][place])

    return change


def other(kind: str, new: dict[str, Any], **fields: Any) -> Callable[[Flight], None]:
    """Let a record say something else."""

    def change(flight: Flight) -> None:
        number, place = where(flight, kind, **fields)
        record = flight[number][place]
        message = kind_of(record.message).message()
        message.CopyFrom(record.message)
        for name, value in new.items():
            setattr(message, name, value)
        flight[number][place] = changed(record, message)

    return change


def limit(**new: Any) -> Callable[[Flight], None]:
    """Let the manifest have set other limits."""

    def change(flight: Flight) -> None:
        manifest: Any = kind_of(flight[0][0].message).message()
        manifest.CopyFrom(flight[0][0].message)
        for name, value in new.items():
            setattr(manifest.configuration.limits, name, value)
        flight[0][0] = changed(flight[0][0], manifest)

    return change


def late(flight: Flight) -> None:
    """Let a decision have another moment than its observation."""
    number, place = where(flight, "camera_taken")
    record = flight[number][place]
    flight[number][place] = replace(record, at=record.at._replace(flight_ns=1))


def safe(flight: Flight) -> None:
    """Let the node have been in safe mode from the start."""
    flight[1].append(changed(flight[1][0], Moved(chart="health", instance="node", to_state="safe_mode")))


def unasked(flight: Flight) -> None:
    """Let a finding be confirmed while time passes."""
    number, place = where(flight, "moved", chart="poi", to_state="confirmed")
    flight[where(flight, "time_passed")[0]].append(flight[number].pop(place))


def unheard(flight: Flight) -> None:
    """Let an answer be to another order."""
    number, place = where(flight, "send_ack", command_id="b")
    flight[number][place] = changed(flight[number][place], SendAck(command_id="c", principal_id="alpha", final=True))


@pytest.mark.parametrize(
    ("monitor", "change"),
    [
        ("in_order", cut("camera_taken")),
        ("in_order", late),
        ("moves_join", cut("moved", chart="scan", to_state="zoomed_in")),
        ("moves_join", other("moved", {"from_state": "accepted"}, chart="command", to_state="intended")),
        ("one_master", cut("camera_taken")),
        ("one_master", twice("camera_taken")),
        ("one_master", other("camera_taken", {"principal_id": "bravo"})),
        ("effects_are_intended", cut("moved", chart="command", to_state="intended")),
        ("effects_are_intended", twice("point_at_place", order="alpha/a")),
        ("every_order_is_answered", cut("send_ack", command_id="a")),
        ("every_order_is_answered", twice("send_ack", command_id="b")),
        ("every_order_is_answered", other("send_ack", {"final": False}, command_id="a", final=True)),
        ("answers_stand", other("send_ack", {"detail": "otherwise"}, command_id="a", duplicate=True)),
        ("answers_stand", other("send_ack", {"final": False}, command_id="a", duplicate=True)),
        ("every_order_is_answered", unheard),
        ("people_are_not_flooded", limit(asks_per_minute=0)),
        ("people_are_not_flooded", limit(ask_confidence_e4=8_001)),
        ("only_people_judge", unasked),
        ("only_people_judge", other("moved", {"to_state": "declined"}, chart="poi", to_state="confirmed")),
        ("only_people_judge", cut("moved", chart="command", instance="alpha/b")),
        ("hands_off", limit(scan_enabled=False)),
        ("hands_off", other("point_at_place", {"order": ""}, order="alpha/a")),
        ("safe_mode_is_quiet", safe),
    ],
)
def test_a_monitor_speaks_up(monitor: str, change: Callable[[Flight], None]) -> None:
    """One thing in the flight is not as it must be, and its monitor says so."""
    flight = steps(scanned().flight.records)
    check_equal(complaints(flight), [])
    change(flight)
    check_equal(monitor in {complaint.split(":")[0] for complaint in complaints(flight)}, True)


def followed(*told: str) -> Flight:
    """Return a flight in which a camera is ordered to follow where the node may not look by itself, and these words."""
    story = Story(sightings_to_ask=1, frame_rate_floor_mhz=0)
    for words in ("frame person@0,0", "time", "order b confirm p1", "order f follow p1", "frame person@6,0", *told):
        story.tell(words)
    return steps(story.flight.records)


@pytest.mark.parametrize(
    "change",
    [
        cut("order_received", command_id="f"),
        other("moved", {"to_state": "rejected"}, chart="command", instance="alpha/f", to_state="accepted"),
        lambda flight: flight.append([followed()[-1][0], *followed()[-1][1:]]),
    ],
)
def test_what_is_followed_was_ordered(change: Callable[[Flight], None]) -> None:
    """Nothing is said while it is; without the order, or after somebody took the camera, the node's hands are off."""
    check_equal([one for one in complaints(followed()) if one.startswith("hands_off")], [])
    flight = followed("order t turn")
    change(flight)
    check_equal("hands_off" in {complaint.split(":")[0] for complaint in complaints(flight)}, True)


def test_a_good_flight_is_quiet() -> None:
    """Nothing is said about a flight in which most things happen once."""
    check_equal(complaints(list(steps_of(whole_flight().records))), [])
