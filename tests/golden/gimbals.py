"""A golden flight about gimbals and cameras: who controls them, what they can't do, drift, zoom. It checks nothing."""

from __future__ import annotations

from events.schema.flight_pb2 import ROI_TURNING_REFUSE
from events.schema.vehicle_pb2 import GimbalControlChanged
from tests.flights import Flight
from tests.golden.telling import tell
from tests.stories import Story


def gimbals() -> Flight:
    """Control comes and goes in each state; places and angles are refused; what arrived drifts and comes back."""
    story = Story(
        operator_hold_ms=5_000,
        release_pause_ms=1_000,
        drift_cdeg=200,
        drift_settle_ms=1_000,
        roi_turning=ROI_TURNING_REFUSE,
        take_from_others=True,
    )
    story.flight.tell(GimbalControlChanged(vehicle=1, gimbal=2, system_id=255, component_id=190))
    tell(story, _KNOWN + _CONTROL + _DRIFT)
    return story.flight


_KNOWN = """
    0.1  | order a point
    0.2  | described turns
    0.3  | order b point
    0.4  | described pans pitch=-9000,2000 yaw=-3000,3000
    0.5  | order c turn pitch=2001
    0.6  | order d zoom
    0.7  | lens zooms
    0.8  | order e zoom
    0.9  | zoomed 4000
    1    | answered e 0
    1.1  | order f zoom by=bravo
    1.2  | order g release
    1.3  | order h zoom
    1.4  | answered h 3
"""
_CONTROL = """
    10   | order ca turn
    10.1 | control 1/191 ours
    20   | control 0/0
    20.1 | control 0/0
    20.2 | control 1/191 ours
    21   | order cb turn
    21.1 | control 255/190
    21.2 | control 9/1
    21.3 | control 1/191 ours
    21.4 | control 1/191 ours
    21.5 | control 0/0
    21.6 | control 1/191 ours
    21.7 | control 255/190
    30   | control 0/0
    30.1 | control 255/190
    30.2 | control 1/191 ours
    30.3 | order cc turn
    30.4 | control 0/0
    30.5 | order cd turn
    30.6 | answered cd 0
    40   | order ce turn
    40.1 | control 1/191 ours
    50   | control 255/190
    50.1 | order cf turn
    50.2 | control 255/190
    50.3 | control 0/0
"""
_DRIFT = """
    70   | order da turn
    70.1 | gimbal da demanded error=90
    70.2 | gimbal da demanded error=300
    72   | gimbal da error=150
    72.1 | gimbal da error=90
    72.2 | gimbal da error=300
    74   | answered da 4
    74.1 | order db point
    74.2 | gimbal db error=0
    74.3 | control 255/190
    74.4 | gimbal db error=900
    76   | order dc release
    77   | order dd point
    77.1 | gimbal dd error=0
    77.2 | gimbal dd error=900
    77.3 | start
    80   | close
"""
