"""Projection `objects`: the map, what was seen of it, and what was muted (seed 004, MapObject, MapObjectObservation,
IgnoredItem).

The id of an observation derives like every other id, from flight and seq of the classification, with the index
of the sighting mixed in: uuid_of(flight_id || "sighting" || BE32(index), seq). To keep it small, an EXISTING
observation of an object is kept at most once a second of flight time; a NEW one always. The object counts them all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from events.ids import uuid_of
from events.records import Record
from events.schema.common_pb2 import Place
from events.schema.eyes_pb2 import Detection, FrameObserved
from events.schema.findings_pb2 import (
    NEW,
    ItemIgnored,
    PoiJoined,
    PoiLeft,
    PoiOpened,
    Sighting,
    SightingMuted,
    SightingsClassified,
)
from events.schema.flight_pb2 import BaselineCarried, FlightOpened
from events.schema.mission_pb2 import MissionPlanned, PushObservations, PushReported
from projections.rows import Projection, Table
from projections.words import NS_PER_S

KEEP_EVERY_NS = NS_PER_S
NO_MISSION = ""  # where none was planned yet


@dataclass(frozen=True, slots=True)
class ObjectRow:
    """A thing on the map."""

    number: int
    h3_cell: int
    mgrs_key: str
    class_name: str
    class_group: str
    latitude_e7: int
    longitude_e7: int
    width_mm: int | None
    length_mm: int | None
    confidence_e4: int
    first_seen_ns: int | None  # wall clock, nanoseconds since 1970; None: in a flight before
    last_seen_ns: int | None
    last_seq: int  # classification that saw it last; -1: in a flight before
    sightings: int
    mission_id: str
    source: str  # "local_observed": nothing is pulled from a central map yet
    pending_upload: bool
    poi_id: str
    muted_by: str  # the declined point of interest that it lies at


@dataclass(frozen=True, slots=True)
class ObservationRow:
    """One sighting of a map object."""

    id: str
    seq: int  # the classification
    object: int
    h3_cell: int
    class_name: str
    class_group: str
    mission_id: str
    uav_id: str
    observed_at_monotonic_ns: int
    observed_at_wall_ns: int
    latitude_e7: int
    longitude_e7: int
    mgrs: str
    width_mm: int | None
    length_mm: int | None
    confidence_e4: int
    diff_kind: str  # "NEW", "EXISTING"
    frame_seq: int
    detection: int  # index in the frame


@dataclass(frozen=True, slots=True)
class IgnoredRow:
    """A muted place."""

    poi_id: str
    id: str
    seq: int  # -1: of a flight before
    mgrs: str
    h3_cell: int
    latitude_e7: int
    longitude_e7: int
    class_group: str
    decline_time_ns: int | None  # wall clock; None: in a flight before
    operator_id: str
    mission_id: str
    source: str  # "local_appended", or "carried" from a flight before
    muted: int  # sightings that stayed quiet because of it


class Objects:
    """The rows, and what is needed to read the next classification."""

    def __init__(self) -> None:
        self.objects: Table[int, ObjectRow] = Table(ObjectRow, "number")
        self.observations: Table[str, ObservationRow] = Table(ObservationRow, "id", append_only=True)
        self.ignored: Table[str, IgnoredRow] = Table(IgnoredRow, "poi_id")
        self.flight_id = b""
        self.node = ""
        self.mission_id = NO_MISSION
        self.pushed_seq = -1  # the newest push that the mission office took whole: it has all before this record
        self.frame: FrameObserved | None = None
        self.kept_ns: dict[int, int] = {}  # map object: flight_ns of its newest observation that was kept


def start() -> Objects:
    """Return an empty map."""
    return Objects()


def apply(objects: Objects, record: Record) -> Objects:
    """Return the map after one more record."""
    change = _CHANGES.get(record.kind.name)
    if change is not None:
        change(objects, record, record.message)
    return objects


def tables(objects: Objects) -> Mapping[str, Table[Any, Any]]:
    """Return the rows."""
    return {"objects": objects.objects, "observations": objects.observations, "ignored": objects.ignored}


def observation_id(flight_id: bytes, seq: int, index: int) -> str:
    """Return the UUIDv8 of sighting `index` in the classification `seq`."""
    return uuid_of(flight_id + b"sighting" + index.to_bytes(4, "big"), seq)


def _opened(objects: Objects, _record: Record, opened: FlightOpened) -> None:
    objects.flight_id, objects.node = opened.flight_id, opened.node


def _carried(objects: Objects, _record: Record, carried: BaselineCarried) -> None:
    for thing in carried.state.objects:
        row = _object_at(thing.number, thing.class_name, thing.class_group, thing.place, thing.confidence_e4)
        objects.objects.put(row.number, replace(row, sightings=thing.sightings))
    for item in carried.state.ignored:
        row_of_item = _ignored_at(item.poi_id, item.poi_id, item.class_group, item.place, item.principal_id)
        objects.ignored.put(item.poi_id, replace(row_of_item, muted=item.muted))


def _object_at(number: int, class_name: str, class_group: str, place: Place, confidence_e4: int) -> ObjectRow:
    return ObjectRow(
        number=number,
        h3_cell=place.h3_cell,
        mgrs_key=place.mgrs,
        class_name=class_name,
        class_group=class_group,
        latitude_e7=place.latitude_e7,
        longitude_e7=place.longitude_e7,
        width_mm=None,
        length_mm=None,
        confidence_e4=confidence_e4,
        first_seen_ns=None,
        last_seen_ns=None,
        last_seq=-1,
        sightings=0,
        mission_id=NO_MISSION,
        source="local_observed",
        pending_upload=True,
        poi_id="",
        muted_by="",
    )


def _planned(objects: Objects, _record: Record, of: MissionPlanned | PushObservations) -> None:
    objects.mission_id = of.mission_id


def _pushed(objects: Objects, _record: Record, report: PushReported) -> None:
    """Note what needs no upload any more: all that was seen before a push that the office took whole."""
    if report.because:
        return
    objects.pushed_seq = report.effect_seq
    for row in [row for row in objects.objects if row.pending_upload and 0 <= row.last_seq < report.effect_seq]:
        objects.objects.put(row.number, replace(row, pending_upload=False))


def _ignored_at(poi_id: str, row_id: str, class_group: str, place: Place, principal_id: str) -> IgnoredRow:
    return IgnoredRow(
        poi_id=poi_id,
        id=row_id,
        seq=-1,
        mgrs=place.mgrs,
        h3_cell=place.h3_cell,
        latitude_e7=place.latitude_e7,
        longitude_e7=place.longitude_e7,
        class_group=class_group,
        decline_time_ns=None,
        operator_id=principal_id,
        mission_id=NO_MISSION,
        source="carried",
        muted=0,
    )


def _frame(objects: Objects, _record: Record, frame: FrameObserved) -> None:
    objects.frame = frame


def _classified(objects: Objects, record: Record, classified: SightingsClassified) -> None:
    frame = objects.frame
    if frame is None:
        raise LookupError(f"record {record.seq} classifies a frame that the log does not have before it")
    for index, sighting in enumerate(classified.sightings):
        detection = frame.detections[sighting.detection]
        _sight(objects, record, sighting, detection)
        kept_ns = objects.kept_ns.get(sighting.object)
        if kept_ns is None or record.at.flight_ns - kept_ns >= KEEP_EVERY_NS:
            objects.kept_ns[sighting.object] = record.at.flight_ns
            row = _observation(objects, record, index, sighting, detection, frame.frame_seq)
            objects.observations.put(row.id, row)


def _sight(objects: Objects, record: Record, sighting: Sighting, detection: Detection) -> None:
    before, now_ns = objects.objects.get(sighting.object), record.at.wall_ns
    if before is None:
        first = _object_at(sighting.object, detection.class_name, sighting.class_group, detection.place, 0)
        before = replace(first, first_seen_ns=now_ns)
    width_mm, length_mm = size(detection)
    row = replace(
        before,
        h3_cell=detection.place.h3_cell,
        mgrs_key=detection.place.mgrs,
        latitude_e7=detection.place.latitude_e7,
        longitude_e7=detection.place.longitude_e7,
        width_mm=before.width_mm if width_mm is None else width_mm,
        length_mm=before.length_mm if length_mm is None else length_mm,
        confidence_e4=detection.confidence_e4,
        last_seen_ns=now_ns,
        last_seq=record.seq,
        sightings=before.sightings + 1,
        mission_id=objects.mission_id or before.mission_id,
        pending_upload=True,
    )
    objects.objects.put(row.number, row)
    if row.muted_by:
        _count_muted(objects, row.muted_by)


def _observation(
    objects: Objects, record: Record, index: int, sighting: Sighting, detection: Detection, frame_seq: int
) -> ObservationRow:
    width_mm, length_mm = size(detection)
    return ObservationRow(
        id=observation_id(objects.flight_id, record.seq, index),
        seq=record.seq,
        object=sighting.object,
        h3_cell=detection.place.h3_cell,
        class_name=detection.class_name,
        class_group=sighting.class_group,
        mission_id=objects.mission_id,
        uav_id=objects.node,
        observed_at_monotonic_ns=record.at.mono_ns,
        observed_at_wall_ns=record.at.wall_ns,
        latitude_e7=detection.place.latitude_e7,
        longitude_e7=detection.place.longitude_e7,
        mgrs=detection.place.mgrs,
        width_mm=width_mm,
        length_mm=length_mm,
        confidence_e4=detection.confidence_e4,
        diff_kind="NEW" if sighting.diff == NEW else "EXISTING",
        frame_seq=frame_seq,
        detection=sighting.detection,
    )


def size(detection: Detection) -> tuple[int | None, int | None]:
    """Return width and length on the ground in millimetres, None where unknown."""
    width_mm = detection.width_mm if detection.HasField("width_mm") else None
    return width_mm, detection.length_mm if detection.HasField("length_mm") else None


def _belongs(objects: Objects, record: Record, message: PoiOpened | PoiJoined) -> None:
    poi_id = uuid_of(objects.flight_id, record.seq) if isinstance(message, PoiOpened) else message.poi_id
    objects.objects.put(message.object, replace(objects.objects[message.object], poi_id=poi_id))


def _ignored(objects: Objects, record: Record, ignored: ItemIgnored) -> None:
    row_id = uuid_of(objects.flight_id, record.seq)
    row = _ignored_at(ignored.poi_id, row_id, ignored.class_group, ignored.place, ignored.principal_id)
    own = replace(row, seq=record.seq, decline_time_ns=record.at.wall_ns, mission_id=objects.mission_id)
    objects.ignored.put(row.poi_id, replace(own, source="local_appended"))


def _muted(objects: Objects, _record: Record, muted: SightingMuted) -> None:
    objects.objects.put(muted.object, replace(objects.objects[muted.object], muted_by=muted.poi_id))
    _count_muted(objects, muted.poi_id)


def _left(objects: Objects, _record: Record, left: PoiLeft) -> None:
    objects.objects.put(left.object, replace(objects.objects[left.object], poi_id="", muted_by=""))


def _count_muted(objects: Objects, poi_id: str) -> None:
    item = objects.ignored[poi_id]
    objects.ignored.put(poi_id, replace(item, muted=item.muted + 1))


_CHANGES: dict[str, Callable[[Objects, Record, Any], None]] = {
    "flight_opened": _opened,
    "baseline_carried": _carried,
    "mission_planned": _planned,
    "push_observations": _planned,
    "push_reported": _pushed,
    "frame_observed": _frame,
    "sightings_classified": _classified,
    "poi_opened": _belongs,
    "poi_joined": _belongs,
    "item_ignored": _ignored,
    "sighting_muted": _muted,
    "poi_left": _left,
}

PROJECTION = Projection("objects", 2, start, apply, tables)
