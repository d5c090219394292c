"""What the recorded decisions of a step say of the state that they were made in, held against the log before them.

Every move, every object and every question is a recorded decision, so the log alone tells in which state each chart
was and what was on the map. A decision that speaks of another state follows from something that the log does not hold.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from events import Record
from events.schema.common_pb2 import Moved
from events.schema.eyes_pb2 import FrameObserved
from events.schema.findings_pb2 import (
    EXISTING,
    ItemIgnored,
    PoiJoined,
    PoiLeft,
    Sighting,
    SightingMuted,
    SightingsClassified,
)
from events.schema.orders_pb2 import OrderReceived, SendAck
from replay.blame.case import Case, Group
from replay.blame.findings import Weight
from statecharts import CHARTS, State
from statecharts.facts import order_key

_INITIAL = {chart.name: chart.initial for chart in CHARTS}


def missing_facts(case: Case, state: State) -> Iterator[tuple[Weight, str]]:
    """Yield what the step's recorded decisions speak of and the log before them does not hold, the weightiest first."""
    group = case.group
    for fact in (*_foreign(case), *_moves(group, state)):
        yield Weight.PROVED, fact
    for fact in (*_known_order(group, state), *_answered(group, state), *_distances(case, state)):
        yield Weight.WHOLE, fact
    for decision in group.decisions:
        for fact in _unknown(decision, state):
            yield Weight.WHOLE, fact


def _foreign(case: Case) -> Iterator[str]:
    """Yield decisions that were made on an observation that is not there."""
    moments = {group.observation.at for group in case.groups}
    for decision in case.group.decisions:
        if decision.at not in moments:
            yield f"record {decision.seq} was decided at a moment at which nothing was observed"
        elif decision.cause != case.seq:
            yield f"record {decision.seq} follows from record {decision.cause}, which is no observation before it"


def _moves(group: Group, state: State) -> Iterator[str]:
    """Yield moves that begin where the moves in the log do not end."""
    at: dict[tuple[str, str], str] = {}
    for decision in group.decisions:
        change = decision.message
        if not isinstance(change, Moved) or change.chart not in _WHERE:
            continue
        key = change.chart, change.instance
        before = at.get(key) or _WHERE[change.chart](state, change.instance)
        if before is None and change.from_state != _INITIAL[change.chart]:
            yield f"record {decision.seq} moves {change.chart} {change.instance}, which the log does not know before"
        elif before is not None and before != change.from_state:
            names = f"{change.chart} {change.instance} from {change.from_state}"
            yield f"record {decision.seq} moves {names}; by the log it was {before}"
        at[key] = change.to_state


def _known_order(group: Group, state: State) -> Iterator[str]:
    """Yield an order that was answered as one that is known, and came for the first time."""
    order = group.observation.message
    if not isinstance(order, OrderReceived) or not group.decisions:
        return
    key = order_key(order.issuer.principal_id, order.command_id)
    first = group.decisions[0]
    if key not in state.orders and first.kind.name == "send_ack":
        yield f"record {first.seq} answers order {key} as one that came before; no record brought it"


def _answered(group: Group, state: State) -> Iterator[str]:
    """Yield the answer to an order that neither the log nor this step brought."""
    brought = group.observation.kind.name in ("order_received", "order_malformed")
    for decision in () if brought else group.decisions:
        ack = decision.message
        if isinstance(ack, SendAck) and ack.final:
            key = order_key(ack.principal_id, ack.command_id)
            if key not in state.orders:
                yield f"record {decision.seq} answers order {key}, which no record brought"


def _unknown(decision: Record, state: State) -> Iterator[str]:
    """Yield questions and objects that a decision names and nothing made."""
    match decision.message:
        case SightingMuted(poi_id=poi_id) if poi_id not in state.ignored:
            yield f"record {decision.seq} mutes by {poi_id}, which nobody declined"
        case PoiJoined(poi_id=poi_id) | PoiLeft(poi_id=poi_id) | ItemIgnored(poi_id=poi_id) if (
            poi_id not in state.pois and poi_id not in state.ignored
        ):
            yield f"record {decision.seq} names question {poi_id}, which was never opened"
        case SightingsClassified(sightings=sightings):
            known = len(state.objects)
            new = [one for one in sightings if one.diff != EXISTING]
            for one in sightings:
                highest = known + len(new)
                if one.object > highest or (one.diff == EXISTING and one.object > known):
                    yield f"record {decision.seq} names object {one.object}; the log put {known} on the map before"


def _distances(case: Case, state: State) -> Iterator[str]:
    """Yield an object that was met at another distance than the log has it, where others were met rightly before."""
    for decision in case.group.decisions:
        for one, here in _met(case.group.observation, decision):
            thing = state.objects.get(one.object)
            if thing is None:
                continue
            east, north = here[0] - thing.spot.east_mm, here[1] - thing.spot.north_mm
            if not _is_root(one.distance_mm, east * east + north * north) and _met_before(case):
                yield (
                    f"record {decision.seq} meets object {one.object} {one.distance_mm} mm from where it was; "
                    "by the log it was elsewhere"
                )


def _met(observation: Record, decision: Record) -> Iterator[tuple[Sighting, tuple[int, int]]]:
    frame, classified = observation.message, decision.message
    if not isinstance(frame, FrameObserved) or not isinstance(classified, SightingsClassified):
        return
    for one in classified.sightings:
        if one.diff == EXISTING and one.detection < len(frame.detections):
            place = frame.detections[one.detection].place
            yield one, (place.east_mm, place.north_mm)


def _met_before(case: Case) -> bool:
    """Whether an object was met again at some distance before, and came out rightly: distances are understood."""
    return any(
        one.distance_mm > 1
        for group in case.groups[: case.place]
        for decision in group.decisions
        for one, _ in _met(group.observation, decision)
    )


def _is_root(root: int, square: int) -> bool:
    return root * root <= square < (root + 1) * (root + 1)


_WHERE: dict[str, Callable[[State, str], str | None]] = {
    "command": lambda state, key: state.orders[key].state if key in state.orders else None,
    "camera": lambda state, key: state.cameras[key].state if key in state.cameras else None,
    "poi": lambda state, key: state.pois[key].state if key in state.pois else None,
    "scan": lambda state, key: state.scans[key].state if key in state.scans else None,
    "aim": lambda state, key: state.aims[key].state if key in state.aims else None,
    "control": lambda state, key: state.controls[key].state if key in state.controls else None,
    "health": lambda state, _: state.health.value,
}
