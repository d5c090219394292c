"""Projection `status`: what the node is doing right now, as one frozen value.

The daemon folds it along with every record and publishes NodeStatus from it, so a record that changes nothing that is
shown costs next to nothing. Deadlines are flight_ns; they follow from recorded moves and the manifest's limits as
the charts' do, and a test holds the two to each other. An observation whose step failed is shown as well: it happened.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from typing import Any

from events.ids import uuid_of
from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.eyes_pb2 import EyesChanged
from events.schema.findings_pb2 import NEW, CameraTaken, PoiJoined, PoiLeft, PoiOpened, SightingsClassified
from events.schema.flight_pb2 import (
    BaselineCarried,
    FlightClosed,
    FlightOpened,
    InputsDropped,
    NodeStarted,
    SamplesRejected,
)
from events.schema.safety_pb2 import BatteryReported
from events.schema.vehicle_pb2 import (
    CameraZoomed,
    PositionReported,
    VehicleLinkChanged,
    VehicleStateReported,
)
from projections import aiming, status_mission, status_safety
from projections.describe import close_words
from projections.picture import (
    RESULTS,
    Bounds,
    CameraPicture,
    GimbalPicture,
    Picture,
    Question,
    VehiclePicture,
    key_of,
    with_row,
)
from projections.picture import Status as Status
from projections.words import NS_PER_MS

NAME = "status"
VERSION = 3
FULL_CONFIDENCE_E4 = 10_000


def apply(status: Status, record: Record) -> Status:
    """Return the status after one more record; a manifest begins a new flight."""
    change = _CHANGES.get(record.kind.name)
    picture = status.picture if change is None else change(status.picture, record, record.message)
    return Status(record.seq, record.at, picture)


def plain(status: Status) -> dict[str, Any]:
    """Return the status as a JSON-able structure; moments in flight_ns, and the wall clock of the newest record."""
    shown = asdict(status.picture)
    shown["flight_id"] = status.picture.flight_id.hex()
    del shown["members"], shown["bounds"]
    for key, gimbal in status.picture.gimbals.items():
        shown["gimbals"][key]["caution"] = gimbal.caution
    return shown | {"head_seq": status.head_seq, "flight_ns": status.at.flight_ns, "wall_ns": status.at.wall_ns}


def _counted(counts: Mapping[str, int], key: str, by: int = 1) -> dict[str, int]:
    return {**counts, key: counts.get(key, 0) + by}


def _opened(_picture: Picture, _record: Record, opened: FlightOpened) -> Picture:
    cameras, gimbals = {}, {}
    for one in opened.configuration.cameras:
        gimbal = key_of(one.vehicle, one.gimbal) if one.gimbal else ""
        cameras[key_of(one.vehicle, one.camera)] = CameraPicture(one.vehicle, one.camera, gimbal)
        if gimbal:
            gimbals[gimbal] = GimbalPicture()
    picture = Picture(
        flight_id=opened.flight_id,
        flight_number=opened.flight_number,
        node=opened.node,
        software=opened.software,
        open=True,
        command_enabled=opened.configuration.limits.command_enabled,
        camera_roles=tuple(opened.configuration.limits.camera_roles),
        flight_roles=tuple(opened.configuration.limits.flight_roles),
        cameras=cameras,
        gimbals=gimbals,
        bounds=Bounds.of(opened.configuration.limits),
    )
    picture = status_mission.opened(picture, opened.configuration.limits)
    return status_safety.opened(picture, opened.configuration.limits)


def _carried(picture: Picture, record: Record, carried: BaselineCarried) -> Picture:
    picture = status_safety.carried(picture, record, carried.state)
    picture = status_mission.carried(picture, record, carried.state)
    if carried.state.HasField("mission"):
        picture = _vehicle_with(picture, carried.state.mission.vehicle, armed=True)
    return replace(picture, map_objects=len(carried.state.objects), ignored=len(carried.state.ignored))


def _started(picture: Picture, _record: Record, started: NodeStarted) -> Picture:
    silent = {number: replace(vehicle, link=False) for number, vehicle in picture.vehicles.items()}
    return replace(picture, starts=started.start, vehicles=silent)


def _closed(picture: Picture, _record: Record, closed: FlightClosed) -> Picture:
    return replace(picture, open=False, closed_because=close_words(closed.reason))


def _step_failed(picture: Picture, _record: Record, _message: Any) -> Picture:
    return replace(picture, steps_failed=picture.steps_failed + 1)


def _dropped(picture: Picture, _record: Record, dropped: InputsDropped) -> Picture:
    return replace(picture, inputs_dropped=_counted(picture.inputs_dropped, dropped.input_class, dropped.count))


def _rejected(picture: Picture, _record: Record, rejected: SamplesRejected) -> Picture:
    counts = picture.samples_rejected
    for entry in rejected.rejected:
        counts = _counted(counts, entry.reason, entry.count)
    return replace(picture, samples_rejected=counts)


def _malformed(picture: Picture, _record: Record, _message: Any) -> Picture:
    return replace(picture, orders_malformed=picture.orders_malformed + 1)


def _moved(picture: Picture, record: Record, moved: Moved) -> Picture:
    change = _MOVES.get(moved.chart)
    return picture if change is None else change(picture, record, moved)


def _command_moved(picture: Picture, _record: Record, moved: Moved) -> Picture:
    if moved.to_state not in RESULTS:
        return picture
    return replace(picture, orders=_counted(picture.orders, moved.to_state))


def _camera_moved(picture: Picture, record: Record, moved: Moved) -> Picture:
    bounds, before = picture.bounds, picture.cameras[moved.instance]
    waits_ms = {"operator": bounds.operator_hold_ms, "released": bounds.release_pause_ms}.get(moved.to_state)
    until_ns = 0 if waits_ms is None else record.at.flight_ns + waits_ms * NS_PER_MS
    camera = CameraPicture(
        before.vehicle,
        before.camera,
        before.gimbal,
        state=moved.to_state,
        held_until_ns=until_ns,
        zoom_e4=before.zoom_e4,
    )  # `camera_taken` names the holder
    return replace(picture, cameras=with_row(picture.cameras, moved.instance, camera))


def _taken(picture: Picture, record: Record, taken: CameraTaken) -> Picture:
    key = key_of(taken.vehicle, taken.camera)
    until_ns = picture.cameras[key].held_until_ns
    if taken.HasField("held_for_ms"):
        until_ns = record.at.flight_ns + taken.held_for_ms * NS_PER_MS
    camera = replace(
        picture.cameras[key],
        callsign=taken.callsign,
        principal_id=taken.principal_id,
        command_id=taken.command_id,
        held_until_ns=until_ns,
    )
    return replace(picture, cameras=with_row(picture.cameras, key, camera))


def _zoomed(picture: Picture, _record: Record, zoomed: CameraZoomed) -> Picture:
    key = key_of(zoomed.vehicle, zoomed.camera)
    if key not in picture.cameras:
        return picture
    camera = replace(picture.cameras[key], zoom_e4=zoomed.zoom_e4)
    return replace(picture, cameras=with_row(picture.cameras, key, camera))


def _vehicle_with(picture: Picture, number: int, **values: Any) -> Picture:
    vehicle = replace(picture.vehicles.get(str(number)) or VehiclePicture(), **values)
    return replace(picture, vehicles=with_row(picture.vehicles, str(number), vehicle))


def _vehicle(picture: Picture, _record: Record, report: VehicleStateReported) -> Picture:
    return _vehicle_with(picture, report.vehicle, armed=report.armed, custom_mode=report.custom_mode)


def _link(picture: Picture, _record: Record, change: VehicleLinkChanged) -> Picture:
    return _vehicle_with(picture, change.vehicle, link=change.up)


def _battery(picture: Picture, _record: Record, report: BatteryReported) -> Picture:
    if not report.HasField("charge_percent"):
        return picture
    return _vehicle_with(picture, report.vehicle, battery_percent=report.charge_percent)


def _position(picture: Picture, _record: Record, report: PositionReported) -> Picture:
    return _vehicle_with(
        picture,
        report.vehicle,
        latitude_e7=report.place.latitude_e7,
        longitude_e7=report.place.longitude_e7,
        altitude_mm=report.place.altitude_mm,
        height_mm=report.height_mm,
        heading_cdeg=report.heading_cdeg if report.HasField("heading_cdeg") else None,
    )


def _eyes(picture: Picture, _record: Record, change: EyesChanged) -> Picture:
    words = f"{change.state}: {change.because}" if change.because else change.state
    return replace(picture, eyes=with_row(picture.eyes, key_of(change.vehicle, change.camera), words))


def _scan_moved(picture: Picture, _record: Record, moved: Moved) -> Picture:
    return replace(picture, scans=with_row(picture.scans, moved.instance, moved.to_state))


def _health_moved(picture: Picture, _record: Record, moved: Moved) -> Picture:
    return replace(picture, health=moved.to_state.replace("_", " "))


def _classified(picture: Picture, _record: Record, classified: SightingsClassified) -> Picture:
    new, waiting = 0, None
    for sighting in classified.sightings:
        new += sighting.diff == NEW
        poi_id = picture.members.get(sighting.object)
        if poi_id is not None:
            waiting = waiting or dict(picture.waiting)
            waiting[poi_id] = replace(waiting[poi_id], sightings=waiting[poi_id].sightings + 1)
    if not new and waiting is None:
        return picture
    return replace(picture, map_objects=picture.map_objects + new, waiting=waiting or picture.waiting)


def _poi_opened(picture: Picture, record: Record, opened: PoiOpened) -> Picture:
    question = Question(
        poi_id=uuid_of(picture.flight_id, record.seq),
        state="enqueued",
        class_name=opened.class_name,
        class_group=opened.class_group,
        confidence_e4=opened.confidence_e4,
        latitude_e7=opened.place.latitude_e7,
        longitude_e7=opened.place.longitude_e7,
        mgrs=opened.place.mgrs,
        sightings=picture.bounds.sightings_to_ask,
    )
    return replace(
        picture,
        waiting={**picture.waiting, question.poi_id: question},
        members={**picture.members, opened.object: question.poi_id},
        pois=_counted(picture.pois, "enqueued"),
    )


def _poi_joined(picture: Picture, _record: Record, joined: PoiJoined) -> Picture:
    if joined.poi_id not in picture.waiting:
        return picture
    return replace(picture, members={**picture.members, joined.object: joined.poi_id})


def _poi_left(picture: Picture, _record: Record, left: PoiLeft) -> Picture:
    return replace(picture, members={thing: poi for thing, poi in picture.members.items() if thing != left.object})


def _poi_moved(picture: Picture, record: Record, moved: Moved) -> Picture:
    pois = _counted(_counted(picture.pois, moved.from_state, -1), moved.to_state)
    waiting = dict(picture.waiting)
    if moved.to_state == "surfaced":
        question = waiting[moved.instance]
        decide_by_ns = record.at.flight_ns + decision_window_ns(picture.bounds, question.confidence_e4)
        waiting[moved.instance] = replace(question, state="surfaced", decide_by_ns=decide_by_ns)
        return replace(picture, pois=pois, waiting=waiting)
    del waiting[moved.instance]
    members = {thing: poi_id for thing, poi_id in picture.members.items() if poi_id != moved.instance}
    return replace(picture, pois=pois, waiting=waiting, members=members)


def decision_window_ns(bounds: Bounds, confidence_e4: int) -> int:
    """Return how long an operator has: linear between the lowest confidence that is asked and full confidence."""
    above = max(confidence_e4 - bounds.ask_confidence_e4, 0)
    span = max(FULL_CONFIDENCE_E4 - bounds.ask_confidence_e4, 1)
    longer_ms = (bounds.decide_longest_ms - bounds.decide_shortest_ms) * above // span
    return (bounds.decide_shortest_ms + longer_ms) * NS_PER_MS


def _ignored(picture: Picture, _record: Record, _message: Any) -> Picture:
    return replace(picture, ignored=picture.ignored + 1)


_Change = Callable[[Picture, Record, Any], Picture]

_MOVES: dict[str, _Change] = {
    "command": _command_moved,
    "camera": _camera_moved,
    "aim": aiming.aim_moved,
    "scan": _scan_moved,
    "poi": _poi_moved,
    "health": _health_moved,
    "mission": status_mission.mission_moved,
    "selftest": status_mission.selftest_moved,
    "link": status_safety.link_moved,
    "safety": status_safety.safety_moved,
}
_CHANGES: dict[str, _Change] = {
    **aiming.CHANGES,
    **status_mission.CHANGES,
    **status_safety.CHANGES,
    "battery_reported": _battery,
    "flight_opened": _opened,
    "baseline_carried": _carried,
    "node_started": _started,
    "flight_closed": _closed,
    "step_failed": _step_failed,
    "inputs_dropped": _dropped,
    "samples_rejected": _rejected,
    "order_malformed": _malformed,
    "moved": _moved,
    "camera_taken": _taken,
    "camera_zoomed": _zoomed,
    "vehicle_state_reported": _vehicle,
    "vehicle_link_changed": _link,
    "position_reported": _position,
    "eyes_changed": _eyes,
    "sightings_classified": _classified,
    "poi_opened": _poi_opened,
    "poi_joined": _poi_joined,
    "poi_left": _poi_left,
    "item_ignored": _ignored,
}
