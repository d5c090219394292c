"""The post-flight bundle: MapObjectsBundle of seed 004, with audit, points of interest and a summary of the flight.

Building it twice from one log gives the same bytes: it reads nothing but the records, and its moments are theirs.
What differs from the seed: null stands where a size or a first sighting in a flight before is unknown, `mission_id`
is empty before a mission is planned, the box is that of what was seen, on the ground, and an object carried over
from a flight before is told as well. `number`, `sightings`, `poi_id`, `muted_by`, `muted`, `audit`, `pois` `flight`
and, of a redacted copy, `gaps` are ours.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

from events.records import Record, Stored
from projections import audit as audit_fold
from projections import objects as objects_fold
from projections import pois as pois_fold
from projections import status as status_fold
from projections.audit import AuditRow
from projections.canonical import Decimal, decimal
from projections.gaps import Left, whole_steps
from projections.objects import IgnoredRow, ObjectRow, Objects, ObservationRow
from projections.picture import Status
from projections.pois import PoiRow
from projections.words import ranges, timestamp

SCHEMA_VERSION = "1.0.0"


def build_redacted(log: Iterable[Stored]) -> dict[str, Any]:
    """Return the bundle of a redacted copy: of the steps that are whole, with what is missing named in `gaps`.

    Raises LookupError where the log does not begin with a manifest.
    """
    left = Left()
    bundle = build(whole_steps(log, left), left)
    return bundle | {"gaps": {"removed": ranges(left.removed), "left_out": ranges(left.left_out)}}


def build(records: Iterable[Record], left: Left | None = None) -> dict[str, Any]:
    """Return the bundle of a flight's records as a structure for `canonical.json_text`.

    With `left` a record that can't be placed is noted there. Raises LookupError where the records do not begin with a
    manifest, and where one can't be placed otherwise.
    """
    audit, objects, pois, status = audit_fold.start(), objects_fold.start(), pois_fold.start(), Status()
    for record in records:
        try:
            audit = audit_fold.apply(audit, record)
            objects = objects_fold.apply(objects, record)
            pois = pois_fold.apply(pois, record)
            status = status_fold.apply(status, record)
        except LookupError:
            if left is None:
                raise
            left.left_out.append(record.seq)
    if not status.picture.flight_id:
        raise LookupError("the flight has no manifest: there is nothing to make a bundle of")
    return {
        "schema_version": SCHEMA_VERSION,
        "mission_id": objects.mission_id,
        "bbox": _box([*objects.objects, *objects.observations]),
        "map_objects": [_object(row) for row in objects.objects],
        "observations": [_observation(row, status.picture.flight_id.hex()) for row in objects.observations],
        "ignored_items": [_ignored(row, objects) for row in objects.ignored if row.source == "local_appended"],
        "as_of": timestamp(status.at.wall_ns),
        "audit": [_audited(row) for row in audit.rows],
        "pois": [_poi(row) for row in pois.rows],
        "flight": _summary(status),
    }


def build_push(records: Iterable[Record]) -> dict[str, Any]:
    """Return what a mission office is given after a flight: what the flight saw and muted, of the same structure.

    What an office took whole, by a push in these records, is left out. `as_of` is the moment of the last record.
    Raises LookupError where the records do not begin with a manifest, and where one can't be placed.
    """
    objects, wall_ns = objects_fold.start(), 0
    for record in records:
        objects, wall_ns = objects_fold.apply(objects, record), record.at.wall_ns
    if not objects.flight_id:
        raise LookupError("the flight has no manifest: there is nothing to push")
    seen = [row for row in objects.observations if row.seq > objects.pushed_seq]
    muted = [row for row in objects.ignored if row.seq > objects.pushed_seq]  # of a flight before: -1
    observations = [_observation(row, objects.flight_id.hex()) for row in seen]
    ignored_items = [_ignored(row, objects) for row in muted]
    for told in (*observations, *ignored_items):
        told["mission_id"] = told["mission_id"] or objects.mission_id  # it was seen before the mission was planned
    return {
        "schema_version": SCHEMA_VERSION,
        "mission_id": objects.mission_id,
        "bbox": _box([*seen, *muted]),
        "map_objects": [],
        "observations": observations,
        "ignored_items": ignored_items,
        "as_of": timestamp(wall_ns),
    }


def _box(seen: Sequence[ObjectRow | ObservationRow | IgnoredRow]) -> list[dict[str, Decimal | None]] | None:
    """Return the north-western and south-eastern corner of all that was seen; None where nothing was."""
    if not seen:
        return None
    latitudes, longitudes = [row.latitude_e7 for row in seen], [row.longitude_e7 for row in seen]
    return [_corner(max(latitudes), min(longitudes)), _corner(min(latitudes), max(longitudes))]


def _corner(latitude_e7: int, longitude_e7: int) -> dict[str, Decimal | None]:
    return {"latitude": decimal(latitude_e7, 7), "longitude": decimal(longitude_e7, 7), "altitude_m": decimal(0, 1)}


def _moment(wall_ns: int | None) -> str | None:
    return None if wall_ns is None else timestamp(wall_ns)


def _object(row: ObjectRow) -> dict[str, Any]:
    return {
        "number": row.number,
        "h3_cell": row.h3_cell,
        "mgrs_key": row.mgrs_key,
        "class": row.class_name,
        "class_group": row.class_group,
        "gps_lat": decimal(row.latitude_e7, 7),
        "gps_lon": decimal(row.longitude_e7, 7),
        "size_width_m": decimal(row.width_mm, 3),
        "size_length_m": decimal(row.length_mm, 3),
        "confidence": decimal(row.confidence_e4, 4),
        "first_seen": _moment(row.first_seen_ns),
        "last_seen": _moment(row.last_seen_ns),
        "sightings": row.sightings,
        "mission_id": row.mission_id,
        "source": row.source,
        "pending_upload": row.pending_upload,
        "poi_id": row.poi_id,
        "muted_by": row.muted_by,
    }


def _observation(row: ObservationRow, flight_id: str) -> dict[str, Any]:
    return {
        "id": row.id,
        "object": row.object,
        "h3_cell": row.h3_cell,
        "class": row.class_name,
        "class_group": row.class_group,
        "mission_id": row.mission_id,
        "uav_id": row.uav_id,
        "observed_at_monotonic_ns": row.observed_at_monotonic_ns,
        "observed_at_wallclock": timestamp(row.observed_at_wall_ns),
        "gps_lat": decimal(row.latitude_e7, 7),
        "gps_lon": decimal(row.longitude_e7, 7),
        "mgrs": row.mgrs,
        "size_width_m": decimal(row.width_mm, 3),
        "size_length_m": decimal(row.length_mm, 3),
        "confidence": decimal(row.confidence_e4, 4),
        "diff_kind": row.diff_kind,
        "photo_ref": None,
        "raw_evidence": {
            "flight_id": flight_id,
            "seq": row.seq,
            "frame_seq": row.frame_seq,
            "detection": row.detection,
        },
    }


def _ignored(row: IgnoredRow, objects: Objects) -> dict[str, Any]:
    return {
        "id": row.id,
        "poi_id": row.poi_id,
        "mgrs": row.mgrs,
        "h3_cell": row.h3_cell,
        "gps_lat": decimal(row.latitude_e7, 7),
        "gps_lon": decimal(row.longitude_e7, 7),
        "class_group": row.class_group,
        "decline_time": _moment(row.decline_time_ns),
        "operator_id": row.operator_id,
        "mission_id": row.mission_id,
        "retention_scope": "mission",
        "expires_at": None,
        "source": row.source,
        "pending_upload": row.seq > objects.pushed_seq,
        "muted": row.muted,
    }


def _audited(row: AuditRow) -> dict[str, Any]:
    told = asdict(row) | {"at": timestamp(row.wall_ns), "seqs": list(row.seqs)}
    del told["wall_ns"]
    return told


def _poi(row: PoiRow) -> dict[str, Any]:
    return {
        "id": row.poi_id,
        "seq": row.seq,
        "state": row.state,
        "because": row.because,
        "class": row.class_name,
        "class_group": row.class_group,
        "confidence": decimal(row.confidence_e4, 4),
        "h3_cell": row.h3_cell,
        "mgrs": row.mgrs,
        "gps_lat": decimal(row.latitude_e7, 7),
        "gps_lon": decimal(row.longitude_e7, 7),
        "sightings": row.sightings,
        "objects": list(row.objects),
        "enqueued_at": timestamp(row.opened_wall_ns),
        "ended_at": _moment(row.ended_wall_ns),
        "judged_by": row.judged_by or None,
        "judged_callsign": row.judged_callsign or None,
    }


def _summary(status: Status) -> dict[str, Any]:
    picture = status.picture
    return {
        "flight_id": picture.flight_id.hex(),
        "flight_number": picture.flight_number,
        "node": picture.node,
        "software": picture.software,
        "records": status.head_seq + 1,
        "flight_ns": status.at.flight_ns,
        "open": picture.open,
        "closed_because": picture.closed_because,
        "starts": picture.starts,
        "health": picture.health,
        "orders": dict(picture.orders),
        "orders_malformed": picture.orders_malformed,
        "pois": dict(picture.pois),
        "map_objects": picture.map_objects,
        "steps_failed": picture.steps_failed,
        "samples_rejected": dict(picture.samples_rejected),
        "inputs_dropped": dict(picture.inputs_dropped),
    }
