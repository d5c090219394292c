"""Golden flights in which things go wrong or are strange: failed steps, losses, extremes. They check nothing."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message

from events.kinds import KINDS, Kind, Role
from events.schema.eyes_pb2 import EyesChanged
from events.schema.flight_pb2 import (
    CLOSE_DISK_FULL,
    BaselineCarried,
    ClassGroup,
    DiskFull,
    FlightOpened,
    InputsDropped,
    LogRecovered,
    NodeStarted,
    RejectedCount,
    SamplesRejected,
)
from events.schema.state_pb2 import CarriedOrder, CarriedState
from events.schema.vehicle_pb2 import VehicleLinkChanged, VehicleStateReported
from statecharts import LOGIC
from tests.flights import (
    FLIGHT_ID,
    Flight,
    closed,
    limits,
    opened_well,
    point_at_place,
    position,
)
from tests.golden.telling import follow, tell_all
from tests.stories import Story

STRANGE = "Ωλφ \u202e\N{HELICOPTER}\x00\n'\"\\"
DROPPED = ("frame", "order", "telemetry", "outcome")
REJECTED = ("not_an_envelope", "bad_signature", "replayed", "stale", "too_large", "unknown_device", "no_token")
EXTREMES: dict[int, tuple[Any, Any]] = {
    FieldDescriptor.CPPTYPE_INT32: (-(2**31), 2**31 - 1),
    FieldDescriptor.CPPTYPE_INT64: (-(2**63), 2**63 - 1),
    FieldDescriptor.CPPTYPE_UINT32: (0, 2**32 - 1),
    FieldDescriptor.CPPTYPE_UINT64: (0, 2**64 - 1),
    FieldDescriptor.CPPTYPE_BOOL: (False, True),
    FieldDescriptor.CPPTYPE_STRING: ("", STRANGE),
}
NOT_TWICE = ("flight_opened", "flight_closed")
SURVIVED_MS = 61_000  # longer than the window in which failures count


def failing() -> Flight:
    """Three frames in a minute that no chart can judge (objects of no size): safe mode, until the next start."""
    story = Story(same_object_mm=0, sightings_to_ask=1, operator_hold_ms=1_000)
    seen = (
        "frame person@1,1",
        "order {} turn",
        "frame person@2,2",
        "frame person@3,3",
        "order {} point",
        "frame car@1,1",
    )
    for name in ("a", "b"):
        follow(story, (words.format(name + str(number)) for number, words in enumerate(seen)))
        story.flight.wait(2_000)  # the camera is freed while nobody asks the scan
        follow(story, ("start", "frame", "vehicle up", f"order {name}9 point", f"answered {name}9 0"))
    story.flight.wait(SURVIVED_MS)
    follow(story, ("frame person@1,1", "frame person@1,1"))
    story.flight.wait(SURVIVED_MS)
    follow(story, ("frame person@1,1", "order c point", "close"))
    return story.flight


def outages() -> Flight:
    """Starts that nobody knows the time before: with an operator at the camera, in a pause, with open questions."""
    story = Story(sightings_to_ask=1, asks_per_minute=1, release_pause_ms=30_000)
    follow(story, ("order a1 point", "sent newest", "answered newest 0", "frame person@1,1 car@200,200"))
    follow(story, ("start the wall clock went back", "frame truck@400,1 person@-300,2"))
    story.flight.wait(SURVIVED_MS)
    follow(story, ("vehicle up", "order a2 point", "answered newest 0", "order a3 release", "answered newest 0"))
    follow(story, ("start nobody knows the time", "start", "frame person@1,1", "close"))
    return story.flight


def poisoned() -> Flight:
    """An order of the baseline is in a state that no chart has: repeats fail, in safe mode too, and are answered."""
    head, *rest = opened_well()
    strange = CarriedOrder(principal_id="alpha", command_id="a", chart_state=STRANGE, keep_ms=2**64 - 1)
    flight = Flight(head, BaselineCarried(state=CarriedState(orders=[strange])), *rest)
    repeats = [point_at_place("a", send=number) for number in range(6)]
    tell_all(flight, [*repeats, NodeStarted(boot_id="boot", start=2), VehicleLinkChanged(vehicle=1, up=True)])
    return tell_all(flight, [point_at_place("b", order_seq=2), repeats[0], closed()])


def losses() -> Flight:
    """Inputs dropped, samples rejected for every reason, eyes and vehicle that come and go, a disk that fills up."""
    flight = Flight()
    tell_all(flight, (InputsDropped(input_class=name, count=7**nth) for nth, name in enumerate(DROPPED)))
    counts = [RejectedCount(reason=reason, count=nth + 1) for nth, reason in enumerate(REJECTED)]
    tell_all(flight, [SamplesRejected(rejected=counts), SamplesRejected(), SamplesRejected(rejected=counts[:1])])
    tell_all(flight, (EyesChanged(vehicle=1, camera=1, state=state) for state in ("lost", "running", "ended")))
    tell_all(flight, [VehicleLinkChanged(vehicle=1, up=up) for up in (False, True, False)], 400)
    tell_all(flight, [point_at_place("a"), position(10, 20), VehicleLinkChanged(vehicle=1, up=True)])
    tell_all(flight, [VehicleStateReported(vehicle=1, armed=False), LogRecovered(flight_id=FLIGHT_ID, found="torn")])
    tell_all(flight, [DiskFull(reserved_bytes=4 << 20), point_at_place("b", order_seq=2), closed(CLOSE_DISK_FULL)])
    return flight


def extremes() -> Flight:
    """Every kind that can be observed: empty, with the least, with the greatest of each field; names nobody expects."""
    flight = Flight(*_strangely_opened())
    for kind in KINDS:
        if kind.role is Role.OBSERVATION and kind.name not in NOT_TWICE:
            tell_all(flight, _extremes_of(kind))
    tell_all(flight, [closed()])
    return flight


def _strangely_opened() -> Iterator[Message]:
    manifest, *rest = opened_well(limits(failures_to_safe_mode=1_000, sightings_to_ask=1, scan_enabled=True))
    assert isinstance(manifest, FlightOpened)
    manifest.configuration.class_groups.append(ClassGroup(name=STRANGE, classes=[STRANGE, ""]))
    manifest.node = STRANGE
    yield from (manifest, *rest)


def _extremes_of(kind: Kind) -> Iterator[Message]:
    yield kind.message()
    for end in (0, 1):
        message = kind.message()
        fill(message, end)
        if isinstance(message, NodeStarted):
            message.logic = LOGIC  # a later one would not be replayed
        yield message


def fill(message: Message, end: int) -> None:
    """Set every field of a message to its least (0) or greatest (1) value; lists hold one. Of a oneof the last wins."""
    for field in message.DESCRIPTOR.fields:
        if field.message_type is not None:
            inner = getattr(message, field.name)
            fill(inner.add() if field.is_repeated else inner, end)
        elif field.is_repeated:
            getattr(message, field.name).append(_extreme(field, end))
        else:
            setattr(message, field.name, _extreme(field, end))


def _extreme(field: Any, end: int) -> Any:
    if field.enum_type is not None:
        return field.enum_type.values[-end].number
    if field.type == FieldDescriptor.TYPE_BYTES:
        return bytes([255]) * 32 * end
    return EXTREMES[field.cpp_type][end]
