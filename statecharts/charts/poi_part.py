"""What the chart `poi` says and how its part of the state changes. The rows are in `poi.py`."""

from __future__ import annotations

from collections.abc import Iterator

from google.protobuf.message import Message

from events.ids import uuid_of
from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.eyes_pb2 import FrameObserved
from events.schema.findings_pb2 import (
    ItemIgnored,
    PoiJoined,
    PoiLeft,
    PoiOpened,
    SightingMuted,
    SightingsClassified,
)
from events.schema.flight_pb2 import NodeStarted
from statecharts.charts.poi import CHART, LIVE, Facts
from statecharts.facts import Ignored, MapObject, Poi, Spot
from statecharts.part import Part
from statecharts.state import State
from statecharts.table import Answer, moved

NS_PER_MS = 1_000_000
MINUTE_NS = 60_000_000_000
QUEUE = "queue"  # the deadline at which another question may be put
FULL_CONFIDENCE_E4 = 10_000


def decide(state: State, record: Record) -> tuple[Message, ...]:
    """Return what follows for points of interest."""
    message, now_ns = record.message, record.at.flight_ns
    match record.kind.name:
        case "sightings_classified":
            assert isinstance(message, SightingsClassified)
            return _sighted(state, record, message)
        case "time_passed":
            keys = tuple(key for key in state.passed(CHART.name, now_ns) if key != QUEUE)
            ended = tuple(move for key in keys for move in _fire(state, key, "time_passed"))
            return (*ended, *_surface(state, now_ns, ended=keys))
        case "flight_closed":
            return tuple(move for key, _ in state.pois.items() for move in _fire(state, key, "flight_closed"))
        case "node_started":
            assert isinstance(message, NodeStarted)
            return _time_lost(state) if message.HasField("outage_unbounded") else ()
    assert isinstance(message, Moved)
    return _judged(state, message) if message.chart == "command" and message.to_state == "accepted" else ()


def _time_lost(state: State) -> tuple[Message, ...]:
    """Let every question expire: the time to answer it may be over."""
    return tuple(move for key, _ in state.open_pois.items() for move in _fire(state, key, "time_lost"))


def _sighted(state: State, record: Record, classified: SightingsClassified) -> tuple[Message, ...]:
    said: list[Message] = []
    opened: list[PoiOpened] = []
    for sighting in classified.sightings:
        thing = state.objects[sighting.object]
        if (left := _has_left(state, thing)) is not None:
            said.append(PoiLeft(poi_id=left, object=thing.number))
        elif not _is_settled(state, thing, record.at.flight_ns):
            found = _place_in(state, record, thing, opened, sighting.detection)
            said.extend(found)
            opened.extend(message for message in found if isinstance(message, PoiOpened))
    return (*said, *_surface(state, record.at.flight_ns, ()))


def _has_left(state: State, thing: MapObject) -> str | None:
    """Return the muted place or the question that a thing belongs to but is no longer at.

    A mute is a place's, not a thing's: whoever walks past it is seen again. What a question is about stays with it.
    """
    item = state.ignored.get(thing.muted_by)
    if item is not None:
        return None if _same(state, item.class_group, item.spot, thing) else item.poi_id
    poi = state.pois.get(thing.poi_id)
    if poi is None or poi.object == thing.number or _same(state, poi.class_group, poi.spot, thing):
        return None
    return poi.poi_id


def _is_settled(state: State, thing: MapObject, now_ns: int) -> bool:
    """Whether nothing new is to be said of this thing: it is muted, or belongs to a question."""
    if thing.muted_by:
        return True
    poi = state.pois.get(thing.poi_id)
    return poi is not None and (poi.state in LIVE or _left_alone(state, poi, now_ns))


def _left_alone(state: State, poi: Poi, now_ns: int) -> bool:
    if poi.state == "withdrawn":
        return True
    return poi.state == "expired" and now_ns < poi.ended_ns + state.flight.limits.ask_again_ms * NS_PER_MS


def _place_in(
    state: State, record: Record, thing: MapObject, opened: list[PoiOpened], index: int
) -> tuple[Message, ...]:
    """Return where a thing belongs: to a muted place, to an open question, to a new one, or nowhere yet."""
    limits = state.flight.limits
    if thing.sightings < limits.sightings_to_ask or thing.confidence_e4 < limits.ask_confidence_e4:
        return ()  # the cheap questions first: there are many doubtful sightings, and in the end many questions
    for item in state.ignored.values():
        if _same(state, item.class_group, item.spot, thing):
            return (SightingMuted(poi_id=item.poi_id, object=thing.number),)
    for poi in _near(state, thing, record.at.flight_ns):
        return (PoiJoined(poi_id=poi.poi_id, object=thing.number),)
    if any(_same(state, other.class_group, Spot.of(other.place), thing) for other in opened):
        return ()
    frame = _frame(state)
    return (
        PoiOpened(
            vehicle=frame.vehicle,
            camera=frame.camera,
            object=thing.number,
            class_name=thing.class_name,
            class_group=thing.class_group,
            confidence_e4=thing.confidence_e4,
            place=frame.detections[index].place,
            frame_seq=frame.frame_seq,
        ),
    )


def _frame(state: State) -> FrameObserved:
    assert state.frame.value is not None
    frame = state.frame.value.message
    assert isinstance(frame, FrameObserved)
    return frame


def _near(state: State, thing: MapObject, now_ns: int) -> Iterator[Poi]:
    for poi in state.pois.values():
        asked = poi.state in LIVE or _left_alone(state, poi, now_ns)
        if asked and _same(state, poi.class_group, poi.spot, thing):
            yield poi


def _same(state: State, class_group: str, spot: Spot, thing: MapObject) -> bool:
    return class_group == thing.class_group and spot.within(thing.spot, state.flight.limits.same_poi_mm)


def _surface(state: State, now_ns: int, ended: tuple[str, ...]) -> tuple[Message, ...]:
    """Put as many waiting questions to the operator as the minute still allows, the surest and oldest first."""
    recent = sum(1 for at_ns in state.surfacings.value if at_ns > now_ns - MINUTE_NS)
    room = state.flight.limits.asks_per_minute - recent
    if room <= 0:
        return ()
    waiting = [poi for poi in _open_pois(state) if poi.state == "enqueued" and poi.poi_id not in ended]
    waiting.sort(key=lambda poi: (-poi.confidence_e4, poi.opened_ns, poi.poi_id))
    return tuple(move for poi in waiting[:room] for move in _fire(state, poi.poi_id, "may_ask"))


def _judged(state: State, change: Moved) -> tuple[Message, ...]:
    order = state.orders[change.instance]
    if order.verb != "judge":
        return ()
    moves = _fire(state, order.poi_id, "judged", Facts(order.confirmed))
    if order.confirmed or not moves:
        return moves
    poi = state.pois[order.poi_id]
    ignored = ItemIgnored(
        poi_id=poi.poi_id, class_group=poi.class_group, place=poi.spot.place, principal_id=order.principal_id
    )
    alike = [
        other
        for other in state.pois.values()
        if other.poi_id != poi.poi_id
        and other.class_group == poi.class_group
        and other.spot.within(poi.spot, state.flight.limits.same_poi_mm)
    ]
    return (*moves, ignored, *(move for other in alike for move in _fire(state, other.poi_id, "muted")))


def _open_pois(state: State) -> Iterator[Poi]:
    """Yield the questions that have not ended: a long flight has many that have."""
    return (state.pois[poi_id] for poi_id, _ in state.open_pois.items())


def _fire(state: State, poi_id: str, trigger: str, facts: Facts | None = None) -> tuple[Message, ...]:
    row = CHART.ask(state.pois[poi_id].state, trigger, facts or Facts())
    return (moved(CHART, poi_id, row),) if row.answer is Answer.MOVE else ()


def _open(state: State, record: Record) -> None:
    opened = record.message
    assert isinstance(opened, PoiOpened)
    poi_id, now_ns = uuid_of(state.flight.flight_id, record.seq), record.at.flight_ns
    thing = state.objects[opened.object]
    poi = Poi(
        poi_id=poi_id,
        state=CHART.initial,
        vehicle=opened.vehicle,
        camera=opened.camera,
        object=opened.object,
        class_name=opened.class_name,
        class_group=opened.class_group,
        confidence_e4=opened.confidence_e4,
        spot=Spot.of(opened.place),
        opened_ns=now_ns,
        sightings=thing.sightings,
    )
    state.pois.put(poi_id, poi)
    state.open_pois.put(poi_id, None)
    state.objects.put(opened.object, thing._replace(poi_id=poi_id))
    state.deadlines.put((CHART.name, poi_id), now_ns + state.flight.limits.queue_longest_ms * NS_PER_MS)
    _wait_for_room(state, now_ns)


def _join(state: State, record: Record) -> None:
    joined = record.message
    assert isinstance(joined, PoiJoined)
    state.objects.put(joined.object, state.objects[joined.object]._replace(poi_id=joined.poi_id))


def _mute(state: State, record: Record) -> None:
    muted = record.message
    assert isinstance(muted, SightingMuted)
    state.objects.put(muted.object, state.objects[muted.object]._replace(muted_by=muted.poi_id))
    _count_muted(state, muted.poi_id)


def _leave(state: State, record: Record) -> None:
    left = record.message
    assert isinstance(left, PoiLeft)
    state.objects.put(left.object, state.objects[left.object]._replace(poi_id="", muted_by=""))


def _count_muted(state: State, poi_id: str) -> None:
    item = state.ignored[poi_id]
    state.ignored.put(poi_id, item._replace(muted=item.muted + 1))


def _count(state: State, record: Record) -> None:
    """Count the sightings of a frame for the questions and mutes that their objects belong to."""
    classified = record.message
    assert isinstance(classified, SightingsClassified)
    for sighting in classified.sightings:
        thing = state.objects.get(sighting.object)
        if thing is None:
            continue
        poi = state.pois.get(thing.poi_id)
        if thing.muted_by:
            _count_muted(state, thing.muted_by)
        elif poi is not None:
            state.pois.put(poi.poi_id, poi._replace(sightings=poi.sightings + 1))


def _ignore(state: State, record: Record) -> None:
    ignored = record.message
    assert isinstance(ignored, ItemIgnored)
    item = Ignored(ignored.poi_id, ignored.class_group, Spot.of(ignored.place), ignored.principal_id)
    state.ignored.put(ignored.poi_id, item)


def _apply_move(state: State, record: Record) -> None:
    change = record.message
    assert isinstance(change, Moved)
    if change.chart != CHART.name:
        return
    poi, now_ns = state.pois[change.instance], record.at.flight_ns
    if change.to_state == "surfaced":
        decide_by_ns = now_ns + _window_ns(state, poi.confidence_e4)
        state.pois.put(poi.poi_id, poi._replace(state="surfaced", decide_by_ns=decide_by_ns))
        state.deadlines.put((CHART.name, poi.poi_id), decide_by_ns)
        recent = tuple(at_ns for at_ns in state.surfacings.value if at_ns > now_ns - MINUTE_NS)
        state.surfacings.set((*recent, now_ns))
    else:
        state.pois.put(poi.poi_id, poi._replace(state=change.to_state, ended_ns=now_ns))
        state.open_pois.drop(poi.poi_id)
        state.deadlines.drop((CHART.name, poi.poi_id))
    _wait_for_room(state, now_ns)


def _wait_for_room(state: State, now_ns: int) -> None:
    """While questions wait, keep the deadline at which the minute has room for one: now, if it has."""
    if not any(poi.state == "enqueued" for poi in _open_pois(state)):
        state.deadlines.drop((CHART.name, QUEUE))
        return
    recent = [at_ns for at_ns in state.surfacings.value if at_ns > now_ns - MINUTE_NS]
    too_many = len(recent) - state.flight.limits.asks_per_minute
    state.deadlines.put((CHART.name, QUEUE), now_ns if too_many < 0 else recent[too_many] + MINUTE_NS)


def _window_ns(state: State, confidence_e4: int) -> int:
    """Return the time to decide: linear from the lowest confidence that is asked to full confidence."""
    limits = state.flight.limits
    above = max(confidence_e4 - limits.ask_confidence_e4, 0)
    span = max(FULL_CONFIDENCE_E4 - limits.ask_confidence_e4, 1)
    longer_ms = (limits.decide_longest_ms - limits.decide_shortest_ms) * above // span
    return (limits.decide_shortest_ms + longer_ms) * NS_PER_MS


PART = Part(
    chart=CHART,
    alphabet=frozenset({"sightings_classified", "time_passed", "node_started", "flight_closed", "moved"}),
    decide=decide,
    evolve={
        "sightings_classified": _count,
        "poi_opened": _open,
        "poi_joined": _join,
        "sighting_muted": _mute,
        "poi_left": _leave,
        "item_ignored": _ignore,
        "moved": _apply_move,
    },
    moves_of=frozenset({"command"}),
)
