"""Flights by chance, for properties that hold for all of them: what Hypothesis draws is interpreted as observations.

Draws are small numbers, so that a failing flight shrinks to a few lines. Nothing here checks anything.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from google.protobuf.message import Message
from hypothesis import strategies as st

from events.schema.eyes_pb2 import Detection
from events.schema.flight_pb2 import ROI_TURNING_WARN, NodeStarted, RejectedCount, SamplesRejected
from events.schema.orders_pb2 import ZoomCameraOrder
from events.schema.vehicle_pb2 import CameraDescribed, GimbalControlChanged, GimbalDescribed, VehicleLinkChanged
from events.store.protocol import Appender
from tests import random_missions
from tests.flights import (
    Flight,
    answered,
    closed,
    detection,
    frame,
    gimbal,
    judge,
    limits,
    malformed,
    point_at_angles,
    point_at_place,
    position,
    published,
    received,
    release,
    sent,
    unanswered,
)

Draw = tuple[str, int, int, int]  # what, and three numbers that it makes something of

WHO = ("alpha", "bravo", "viewer")
CLASSES = ("person", "car", "sports ball")
PAUSES_MS = (20, 150, 4_000, 61_000)


def _frame(flight: Flight, one: int, two: int, three: int) -> Message:
    found = [_thing(one + nth, two) for nth in range(three)]
    return frame(len(flight.records), *found, camera=1 + one % 2)


def _thing(one: int, two: int) -> Detection:
    return detection(one * 7_000, two * 4_000, CLASSES[one % 3], 3_000 + 900 * two)


def _order(_flight: Flight, one: int, two: int, three: int) -> Message:
    who, roles = WHO[one % 3], ("viewer",) if one % 3 == 2 else ("camera",)
    name = f"o{two}"
    kinds = (
        lambda: point_at_place(name, three * 1000, camera=1 + two % 3, order_seq=two, who=who, send=one, roles=roles),
        lambda: point_at_angles(name, yaw_cdeg=three * 900, order_seq=two, who=who, send=one, roles=roles),
        lambda: release(name, order_seq=two, who=who, send=one, roles=roles),
        lambda: received(
            name, two, who, one, roles=roles, zoom_camera=ZoomCameraOrder(camera=1 + two % 3, zoom_e4=900 * one)
        ),
    )
    return kinds[three % 4]()


def _control(_flight: Flight, one: int, two: int, _three: int) -> Message:
    system, component = ((0, 0), (255, 190), (1, 191), (9, 1))[one % 4]
    return GimbalControlChanged(
        vehicle=1, gimbal=1, system_id=system, component_id=component, ours=system == 1 and two < 5
    )


def _described(_flight: Flight, one: int, two: int, three: int) -> Message:
    if three > 3:
        return CameraDescribed(vehicle=1, camera=1 + one % 2, zooms=two % 2 == 0)
    return GimbalDescribed(
        vehicle=1,
        gimbal=1,
        managed=True,
        pans=two > 2,
        turns_vehicle=two <= 2,
        pitch_min_cdeg=-9_000,
        pitch_max_cdeg=-1_000 * one,
    )


def _judge(flight: Flight, one: int, two: int, three: int) -> Message:
    waiting = flight.surfaced() or ["00000000-0000-8000-8000-000000000000"]
    poi_id = waiting[three % len(waiting)]
    return judge(f"j{len(flight.records)}", poi_id, confirmed=one % 2 == 0, order_seq=10 + len(flight.records) + two)


def _effect(flight: Flight) -> int:
    return next((record.seq for record in reversed(flight.records) if record.kind.port == "vehicle"), 0)


def _rejected(_flight: Flight, one: int, two: int, _three: int) -> Message:
    return SamplesRejected(rejected=[RejectedCount(reason=f"reason{one}", count=two + 1)])


def _started(one: int, unbounded: str) -> NodeStarted:
    started = NodeStarted(boot_id="boot", start=2 + one)
    if unbounded:
        started.outage_unbounded = unbounded
    return started


_MAKE: dict[str, Callable[[Flight, int, int, int], Message]] = {
    "frame": _frame,
    "order": _order,
    "judge": _judge,
    "sent": lambda flight, _one, _two, _three: sent(_effect(flight)),
    "answered": lambda flight, one, _two, _three: answered(_effect(flight), (0, 5, 3, 4)[one % 4]),
    "unanswered": lambda flight, one, _two, _three: unanswered(_effect(flight), attempts=one),
    "gimbal": lambda flight, one, two, _three: gimbal(-one * 100, two * 100, _effect(flight), one * 30),
    "control": _control,
    "described": _described,
    "position": lambda _flight, one, two, _three: position(one * 1000, two * 1000),
    "published": lambda flight, one, _two, _three: published(max(len(flight.records) - 1 - one, 0)),
    "malformed": lambda _flight, one, two, _three: malformed(f"m{one}", WHO[two % 3]),
    "rejected": _rejected,
    "link": lambda _flight, one, _two, _three: VehicleLinkChanged(vehicle=1, up=one % 3 > 0),
    "started": lambda _flight, one, two, _three: _started(one, "no clock" if two > 3 else ""),
    **random_missions.MAKE,
}
_LIKELY = ("frame", "frame", "frame", "order", "judge", "answered", "gimbal", "control", "wait")
WHATS: tuple[str, ...] = (*_LIKELY, *random_missions.LIKELY, *_MAKE)

draws: st.SearchStrategy[list[Draw]] = st.lists(
    st.tuples(
        st.sampled_from(WHATS),
        st.integers(0, 5),
        st.integers(0, 5),
        st.integers(0, 5),
    ),
    max_size=40,
)


def fly(drawn: Sequence[Draw], store: Appender | None = None, end: bool = True) -> Flight:
    """Return the flight that was drawn: the node looks at findings, asks after two sightings, and flies missions."""
    bounds = limits(
        **random_missions.LIMITS,
        scan_enabled=True,
        sightings_to_ask=2,
        frame_rate_floor_mhz=1_000,
        asks_per_minute=2,
        drift_cdeg=100,
        drift_settle_ms=1_000,
        roi_turning=ROI_TURNING_WARN,
    )
    flight = Flight(store=store, limits=bounds)
    for what, one, two, three in drawn:
        flight.wait(PAUSES_MS[two % 4] if what == "wait" else 30)
        for _ in range(random_missions.times(what, three)):
            flight.tell(_MAKE[what](flight, one, two, three))
    if end:
        flight.tell(closed(), 500)
    return flight
