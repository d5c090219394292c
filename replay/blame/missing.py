"""Whether an input is missing.

What the recorded decisions speak of must have been observed; else one input, put in, may do.

What is put in is made of what the flight knows: deadlines that were waited for, effects without an outcome, answers
that are owed, links, orders and frames like those that the log has elsewhere. It changes the state and is not logged,
as an input that the node acted on and did not record.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from hashlib import sha256

from google.protobuf.message import Message

from events import NO_CAUSE, Record, make_record
from events.schema.common_pb2 import Place
from events.schema.eyes_pb2 import FrameObserved
from events.schema.flight_pb2 import NodeStarted, OriginSet, TimePassed
from events.schema.orders_pb2 import AckPublished, OrderReceived
from events.schema.vehicle_pb2 import (
    CommandAnswered,
    CommandSent,
    CommandUnanswered,
    GimbalReported,
    VehicleLinkChanged,
)
from replay.blame.case import Case, Group, copied, copy_of
from replay.blame.facts import missing_facts
from replay.blame.findings import Cause, Finding
from replay.blame.search import Best, Idea
from statecharts import State

ORDERS, FRAMES, EFFECTS = 6, 6, 3  # how many of those nearest to the divergence are imitated
EARLIER = 10  # steps by which an input that explains the step alone is tried earlier
_RESULTS = (0, 5, 3, 4)  # MAV_RESULT accepted, in progress, unsupported, failed


def missing(case: Case) -> Finding:
    """Look for facts, then put inputs in just before the step, then earlier."""
    state = case.at()
    fact = next(missing_facts(case, state), None)
    if fact is not None:
        return Finding(Cause.MISSING, *fact)
    best = Best()
    if not best.take(case, _put_in(case, state)) and not best.take(case, _put_in_earlier(case, tuple(best.partly))):
        best.take(case, _orders_earlier(case, state))
    return best.finding(Cause.MISSING, f"no fact speaks for it; {best.tried} inputs put in explain nothing")


def _put_in(case: Case, state: State) -> Iterator[Idea]:
    rest = case.groups[case.place :]
    for words, message in _wanted(case, state):
        told = f"{words}, put in before record {case.seq}"
        yield Idea(told, (_ghost(case.group, message), *rest), copied(state), message)


def _put_in_earlier(case: Case, partly: Sequence[Idea]) -> Iterator[Idea]:
    for idea in partly:
        for place in range(case.place - 1, max(case.place - EARLIER, 0), -1):
            group = case.groups[place]
            assert idea.put_in is not None
            told = f"{idea.words.split(', put in')[0]}, put in before record {group.observation.seq}"
            yield Idea(told, (_ghost(group, idea.put_in), *case.groups[place:]), case.at(place=place))


def _orders_earlier(case: Case, state: State) -> Iterator[Idea]:
    """Yield orders that came earlier: what became of them depends on when they came."""
    for place in range(case.place - 1, max(case.place - EARLIER, 0), -1):
        group = case.groups[place]
        for words, message in _of_orders(case, state):
            told = f"{words}, put in before record {group.observation.seq}"
            yield Idea(told, (_ghost(group, message), *case.groups[place:]), case.at(place=place), message)


def _ghost(before: Group, message: Message) -> Group:
    """Return a step that was not recorded, just before another."""
    there = before.observation
    return Group(make_record(there.seq, NO_CAUSE, there.at, message), (), logged=False)


def _wanted(case: Case, state: State) -> Iterator[tuple[str, Message]]:
    """Yield what may have been observed, the likeliest first."""
    yield "the passing of time", TimePassed()
    yield from _of_effects(state)
    yield from _of_vehicles(state)
    yield from _of_orders(case, state)
    yield from _of_frames(case)
    yield "a start of the daemon", NodeStarted(boot_id="", start=1)
    if state.origin.value is None and (place := _a_place(case)) is not None:
        yield "the origin", OriginSet(place=place, source="")


def _of_effects(state: State) -> Iterator[tuple[str, Message]]:
    newest = [seq for seq, effect in state.effects.items() if not effect.done][-EFFECTS:]
    for seq in reversed(newest):
        yield f"the sending of effect {seq}", CommandSent(effect_seq=seq)
        for result in _RESULTS:
            answer = CommandAnswered(effect_seq=seq, mav_result=result, progress=255, attempts=1)
            yield f"the vehicle's answer {result} to effect {seq}", answer
        for because in ("no answer", "no vehicle"):
            yield f"{because!r} to effect {seq}", CommandUnanswered(effect_seq=seq, attempts=1, because=because)
    owed = [seq for seq, _ in state.owed_acks.items() if seq >= 0]  # below 0: those of the flight before
    yield from ((f"that answer {seq} left", AckPublished(effect_seq=seq)) for seq in owed)
    for key, aim in state.aims.items():
        vehicle, gimbal = (int(part) for part in key.split("/"))
        if aim.effect_seq >= 0:
            report = GimbalReported(vehicle=vehicle, gimbal=gimbal, effect_seq=aim.effect_seq, error_cdeg=0)
            yield f"the arrival of gimbal {key}", report


def _of_vehicles(state: State) -> Iterator[tuple[str, Message]]:
    for vehicle in [number for number, _ in state.vehicles.items()] or [1]:
        for up in (True, False):
            yield f"link {'up' if up else 'down'} of vehicle {vehicle}", VehicleLinkChanged(vehicle=vehicle, up=up)


def _nearest(case: Case, kind: type[Message], count: int) -> list[Record]:
    """Return the observations of a kind that are nearest to the step, itself first."""
    all_of = [(abs(place - case.place), group.observation) for place, group in enumerate(case.groups)]
    there = sorted((gap, record.seq, record) for gap, record in all_of if isinstance(record.message, kind))
    return [record for _, _, record in there[:count]]


def _of_orders(case: Case, state: State) -> Iterator[tuple[str, Message]]:
    for record in _nearest(case, OrderReceived, ORDERS):
        asked = record.message
        assert isinstance(asked, OrderReceived)
        words = f"an order like that of record {record.seq}"
        yield f"{words} before it", _order(asked, command_id=asked.command_id, nonce=_fresh(asked))
        yield f"{words}, the same envelope", copy_of(asked)
        yield f"{words}, another body", _order(asked, body_digest=_fresh(asked), nonce=_fresh(asked))
        other = _order(asked, command_id="", nonce=_fresh(asked), order_seq=asked.order_seq + 1)
        yield f"{words}, a newer one", other
        stranger = _order(asked, command_id="", nonce=_fresh(asked))
        stranger.issuer.device_key_id = _fresh(asked)[:16]
        if state.cameras:
            yield f"{words}, of another device", stranger


def _order(asked: OrderReceived, **values: object) -> OrderReceived:
    order = OrderReceived()
    order.CopyFrom(asked)
    for name, value in values.items():
        setattr(order, name, value)
    return order


def _fresh(asked: OrderReceived) -> bytes:
    return sha256(asked.nonce).digest()[:24]


def _of_frames(case: Case) -> Iterator[tuple[str, Message]]:
    for record in _nearest(case, FrameObserved, FRAMES):
        frame = record.message
        assert isinstance(frame, FrameObserved)
        yield f"a frame like that of record {record.seq}", copy_of(frame)
        for index in range(len(frame.detections) if len(frame.detections) > 1 else 0):
            part = FrameObserved()
            part.CopyFrom(frame)
            del part.detections[:]
            part.detections.append(frame.detections[index])
            yield f"a frame with detection {index} of record {record.seq}", part


def _a_place(case: Case) -> Place | None:
    asked = case.group.observation.message
    if isinstance(asked, OrderReceived) and asked.WhichOneof("order") == "point_at_place":
        return asked.point_at_place.place
    return None
