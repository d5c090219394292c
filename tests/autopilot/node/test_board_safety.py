"""Failsafes in the words of the wire."""

from __future__ import annotations

from autopilot.node.board_safety import say_safety
from events.schema.flight_pb2 import BaselineCarried
from events.schema.waypoint_pb2 import NodeStatus
from projections import status
from projections.picture import Picture
from statecharts import carry_over
from tests.checks import check_equal
from tests.flights import Flight, opened_well
from tests.stories import Story
from tests.stories_of_safety import SAFE_LIMITS


def said(picture: Picture, now_ns: int) -> NodeStatus:
    """Return what operators are told."""
    told = NodeStatus()
    say_safety(told, picture, now_ns)
    return told


def pictured(flight: Flight) -> Picture:
    """Return what the projection makes of a flight."""
    now = status.Status()
    for record in flight.records:
        now = status.apply(now, record)
    return now.picture


def endangered() -> Story:
    """Return a flight outside its fence, with little charge and its return held off."""
    story = Story(**SAFE_LIMITS)
    for words in ("heard alpha", "fence in=-9,-9,9,9", "spot 20,0", "battery 24", "order a override battery because=x"):
        story.tell(words)
    story.flight.wait(5_000)
    return story


def test_what_operators_are_told() -> None:
    """Link, charge, failsafes that are not at rest, and overrides with what is left."""
    told = said(pictured(endangered().flight), 6_000_000_000)
    check_equal((told.failsafes_enabled, told.operator_link, told.battery_percent), (True, "degraded", 24))
    found = [(one.name, one.state, one.because) for one in told.failsafes]
    check_equal(
        found, [("fence", "returning", "outside an inclusion fence"), ("battery", "held off", "battery at 24 %")]
    )
    held = [(one.scope, one.callsign, one.reason, one.left_ms) for one in told.overrides]
    check_equal(held, [("battery_return", "ALPHA", "x", 54_000)])


def test_a_node_without_a_say() -> None:
    """It tells nothing but that."""
    check_equal(said(pictured(Story().flight), 0), NodeStatus(failsafes_enabled=False))


def test_the_next_flight_tells_what_it_took_over() -> None:
    """And an override that ended is told no more."""
    story = endangered()
    carried = carry_over(story.flight.state, story.flight.now_ns)
    manifest, *rest = opened_well(story.flight.state.flight.limits)
    after = Flight(manifest, BaselineCarried(state=carried), *rest)
    check_equal([one.left_ms for one in said(pictured(after), 0).overrides], [55_000])
    after.wait(60_000)
    check_equal(list(said(pictured(after), 0).overrides), [])
