"""The vehicle's time on its way from MAVLink to the node's clock, through the edges as a daemon makes them."""

from __future__ import annotations

import pytest

from autopilot.geo import Origin
from autopilot.node.edges import make_edges
from autopilot.node.inbox import Inbox
from autopilot.ports.config import Config
from autopilot.trust.freshness import TrustClock
from events.schema.flight_pb2 import CLOCK_BOUNDED, CLOCK_TRUSTED, CLOCK_UNSET
from tests.autopilot.trust.papers import HOUR_MS, HostClocks
from tests.autopilot.trust.world import NOW_MS, people, seeded
from tests.autopilot.vehicle.vehicles import PEER, heartbeat, system_time

MINUTE_MS = 60_000
YEARS_MS = 10 * 365 * 24 * HOUR_MS
FLOOR_MS = NOW_MS - HOUR_MS
CONFIG = Config.model_validate(
    {"node": {"keys": "k", "flights": "f", "projections": "p"}, "vehicle": {"listen": "127.0.0.1:14550"}}
)


def told(*messages: bytes, host_trusted: bool = False) -> TrustClock:
    """Return the clock of a node that heard these datagrams, after a vehicle's heartbeat."""
    clock = TrustClock(HostClocks(), host_trusted=host_trusted, floor_ms=FLOOR_MS, random=seeded(3))
    edges = make_edges(CONFIG, people().wasp, clock, Inbox(CONFIG.limits, clock), Origin(), lambda: True)
    assert edges.vehicle is not None
    for message in (heartbeat(), *messages):
        edges.vehicle.hear(PEER, message)
    assert clock.floor_ms == FLOOR_MS
    return clock


def check_told(clock: TrustClock, quality: int, now_ms: int, *news: tuple[str, int, int]) -> None:
    """The clock shows this, and has this to record: source, quality then, and how far off it was."""
    assert (clock.time().quality, clock.time().now_ms) == (quality, now_ms)
    assert [(one.source, one.to_quality, one.jump_ms) for one in clock.news()] == list(news)


def test_gps_time_makes_an_unset_clock_bounded() -> None:
    check_told(told(), CLOCK_UNSET, FLOOR_MS)
    check_told(told(system_time(0)), CLOCK_UNSET, FLOOR_MS)
    check_told(told(system_time(NOW_MS)), CLOCK_BOUNDED, NOW_MS, ("gps", CLOCK_BOUNDED, 0))
    clock = told(system_time(NOW_MS), system_time(NOW_MS + 10 * MINUTE_MS))
    check_told(clock, CLOCK_BOUNDED, NOW_MS + 10 * MINUTE_MS, ("gps", CLOCK_BOUNDED, 0))


@pytest.mark.parametrize("jump_ms", [YEARS_MS, -YEARS_MS, 11 * MINUTE_MS, -11 * MINUTE_MS])
def test_a_gps_that_jumps_is_recorded_and_not_followed(jump_ms: int) -> None:
    jumped = system_time(NOW_MS + jump_ms)
    bounded = told(system_time(NOW_MS), jumped, jumped)
    check_told(bounded, CLOCK_BOUNDED, NOW_MS, ("gps", CLOCK_BOUNDED, 0), ("gps", CLOCK_BOUNDED, jump_ms))
    trusted = told(jumped, host_trusted=True)
    check_told(trusted, CLOCK_TRUSTED, NOW_MS, ("host", CLOCK_TRUSTED, 0), ("gps", CLOCK_TRUSTED, jump_ms))


@pytest.mark.parametrize(("wrong_ms", "quality"), [(YEARS_MS, CLOCK_BOUNDED), (-YEARS_MS, CLOCK_UNSET)])
def test_a_gps_that_is_wrong_from_the_start_moves_no_floor(wrong_ms: int, quality: int) -> None:
    """What is surely over is judged by the floor; a guess of years ahead changes nothing there."""
    clock = told(system_time(NOW_MS + wrong_ms))
    assert clock.time().earliest_ms == FLOOR_MS
    assert clock.time().quality == quality


def test_only_the_vehicle_tells_the_time() -> None:
    others = (system_time(NOW_MS, sender=sender) for sender in ((9, 1), (1, 9)))
    check_told(told(*others), CLOCK_UNSET, FLOOR_MS)
