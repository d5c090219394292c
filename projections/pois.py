"""Projection `pois`: every point of interest of the flight and how it ended (seed 004, POI).

It says what was asked and answered; who may judge, and when silence is an answer, is the charts' business.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from events.ids import uuid_of
from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.findings_pb2 import PoiJoined, PoiLeft, PoiOpened, SightingMuted, SightingsClassified
from events.schema.flight_pb2 import BaselineCarried, FlightOpened
from events.schema.orders_pb2 import OrderReceived
from projections.picture import Bounds
from projections.rows import Projection, Table
from projections.status import decision_window_ns


@dataclass(frozen=True, slots=True)
class PoiRow:
    """A point of interest."""

    poi_id: str
    seq: int  # record that opened it
    state: str
    vehicle: int
    camera: int
    class_name: str
    class_group: str
    confidence_e4: int  # of the sighting that opened it
    h3_cell: int
    mgrs: str
    latitude_e7: int
    longitude_e7: int
    sightings: int  # of all map objects that belong to it
    objects: tuple[int, ...]  # map objects, the first one it is about
    opened_wall_ns: int
    surfaced_ns: int | None  # flight_ns
    decide_by_ns: int | None  # flight_ns
    ended_wall_ns: int | None
    because: str  # of its newest move
    judged_by: str  # principal; "" where nobody judged
    judged_callsign: str


class Pois:
    """The rows, and how often each map object was seen before it belonged to one."""

    def __init__(self) -> None:
        self.rows: Table[str, PoiRow] = Table(PoiRow, "poi_id")
        self.flight_id = b""
        self.bounds = Bounds()
        self.order: Record | None = None
        self.poi_of: dict[int, str] = {}
        self.seen: dict[int, int] = {}


def start() -> Pois:
    """Return no points of interest."""
    return Pois()


def apply(pois: Pois, record: Record) -> Pois:
    """Return the points of interest after one more record."""
    change = _CHANGES.get(record.kind.name)
    if change is not None:
        change(pois, record, record.message)
    return pois


def tables(pois: Pois) -> Mapping[str, Table[Any, Any]]:
    """Return the rows."""
    return {"pois": pois.rows}


def _flight(pois: Pois, _record: Record, opened: FlightOpened) -> None:
    pois.flight_id, pois.bounds = opened.flight_id, Bounds.of(opened.configuration.limits)


def _carried(pois: Pois, _record: Record, carried: BaselineCarried) -> None:
    pois.seen.update((thing.number, thing.sightings) for thing in carried.state.objects)


def _ordered(pois: Pois, record: Record, _order: OrderReceived) -> None:
    pois.order = record


def _classified(pois: Pois, _record: Record, classified: SightingsClassified) -> None:
    for sighting in classified.sightings:
        pois.seen[sighting.object] = pois.seen.get(sighting.object, 0) + 1
        poi_id = pois.poi_of.get(sighting.object)
        if poi_id is not None:
            row = pois.rows[poi_id]
            pois.rows.put(poi_id, replace(row, sightings=row.sightings + 1))


def _opened(pois: Pois, record: Record, opened: PoiOpened) -> None:
    poi_id = uuid_of(pois.flight_id, record.seq)
    pois.poi_of[opened.object] = poi_id
    row = PoiRow(
        poi_id=poi_id,
        seq=record.seq,
        state="enqueued",
        vehicle=opened.vehicle,
        camera=opened.camera,
        class_name=opened.class_name,
        class_group=opened.class_group,
        confidence_e4=opened.confidence_e4,
        h3_cell=opened.place.h3_cell,
        mgrs=opened.place.mgrs,
        latitude_e7=opened.place.latitude_e7,
        longitude_e7=opened.place.longitude_e7,
        sightings=pois.seen[opened.object],
        objects=(opened.object,),
        opened_wall_ns=record.at.wall_ns,
        surfaced_ns=None,
        decide_by_ns=None,
        ended_wall_ns=None,
        because="",
        judged_by="",
        judged_callsign="",
    )
    pois.rows.put(poi_id, row)


def _joined(pois: Pois, _record: Record, joined: PoiJoined) -> None:
    row = pois.rows[joined.poi_id]
    pois.poi_of[joined.object] = joined.poi_id
    if joined.object not in row.objects:
        pois.rows.put(joined.poi_id, replace(row, objects=(*row.objects, joined.object)))


def _muted(pois: Pois, _record: Record, muted: SightingMuted) -> None:
    pois.poi_of.pop(muted.object, None)


def _left(pois: Pois, _record: Record, left: PoiLeft) -> None:
    pois.poi_of.pop(left.object, None)


def _moved(pois: Pois, record: Record, moved: Moved) -> None:
    if moved.chart != "poi":
        return
    row = replace(pois.rows[moved.instance], state=moved.to_state, because=moved.because)
    if moved.to_state == "surfaced":
        surfaced_ns = record.at.flight_ns
        decide_by_ns = surfaced_ns + decision_window_ns(pois.bounds, row.confidence_e4)
        pois.rows.put(row.poi_id, replace(row, surfaced_ns=surfaced_ns, decide_by_ns=decide_by_ns))
    else:
        ended = replace(row, ended_wall_ns=record.at.wall_ns)
        pois.rows.put(row.poi_id, _judged(pois, record, ended))


def _judged(pois: Pois, record: Record, row: PoiRow) -> PoiRow:
    order = pois.order
    if order is None or order.seq != record.cause or row.state not in ("confirmed", "declined"):
        return row
    assert isinstance(order.message, OrderReceived)
    issuer = order.message.issuer
    return replace(row, judged_by=issuer.principal_id, judged_callsign=issuer.callsign)


_CHANGES: dict[str, Callable[[Pois, Record, Any], None]] = {
    "flight_opened": _flight,
    "baseline_carried": _carried,
    "order_received": _ordered,
    "sightings_classified": _classified,
    "poi_opened": _opened,
    "poi_joined": _joined,
    "sighting_muted": _muted,
    "poi_left": _left,
    "moved": _moved,
}

PROJECTION = Projection("pois", 1, start, apply, tables)
