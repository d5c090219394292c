"""A record in one line of words, for people who read a log. Integer formatting only.

It shows what the record says and concludes nothing from it; every kind of the catalogue has words here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from events.records import Record
from events.schema import flight_pb2, orders_pb2
from events.schema.common_pb2 import Issuer, Place
from events.schema.eyes_pb2 import EyesChanged, FrameObserved
from events.schema.findings_pb2 import (
    NEW,
    CameraTaken,
    ItemIgnored,
    PoiJoined,
    PoiOpened,
    SightingMuted,
    SightingsClassified,
)
from events.schema.flight_pb2 import CLOCK_BOUNDED, CLOCK_TRUSTED, CLOCK_UNSET
from events.schema.link_pb2 import RawSegmentClosed, VehicleIdentified, VehicleTimeCompared
from events.schema.orders_pb2 import AckPublished, OrderMalformed, OrderReceived, SendAck
from events.schema.trust_pb2 import TimeLearned, TrustAlarm
from events.schema.vehicle_pb2 import (
    CommandAnswered,
    CommandUnanswered,
    GimbalControlChanged,
    GimbalDescribed,
    GimbalReported,
    PointAtAngles,
    PointAtPlace,
    PositionReported,
    ReleasePointing,
    SetZoom,
    VehicleStateReported,
)
from projections.describe_flight import MODES, SCOPES, named
from projections.describe_flight import WORDS as _FLIGHT_WORDS
from projections.words import NS_PER_MS, coordinates, degrees, metres, percent, seconds

_RESULTS: dict[int, str] = {
    orders_pb2.ACK_ACCEPTED: "accepted",
    orders_pb2.ACK_REJECTED: "rejected",
    orders_pb2.ACK_TIMEOUT: "timeout",
    orders_pb2.ACK_UNSUPPORTED: "unsupported",
    orders_pb2.ACK_UNAUTHORISED: "unauthorised",
}
_STAGES: dict[int, str] = {
    orders_pb2.ACK_STAGE_RECEIVED: "received, not yet decided",
    orders_pb2.ACK_STAGE_SENT: "sent to the vehicle",
    orders_pb2.ACK_STAGE_IN_PROGRESS: "in progress",
}
_MISSION_VERBS: dict[int, str] = {
    orders_pb2.MISSION_BEGIN: "begin",
    orders_pb2.MISSION_PAUSE: "pause",
    orders_pb2.MISSION_RESUME: "go on with",
    orders_pb2.MISSION_ABORT: "abort",
}
_CLOSE_REASONS: dict[int, str] = {
    flight_pb2.CLOSE_REASON_UNSPECIFIED: "for no reason that was given",
    flight_pb2.CLOSE_STOPPED: "stopped while disarmed",
    flight_pb2.CLOSE_DISARMED: "disarmed long enough",
    flight_pb2.CLOSE_ABANDONED: "abandoned: found disarmed after it was armed",
    flight_pb2.CLOSE_LOGIC_CHANGED: "another logic number took over",
    flight_pb2.CLOSE_INPUT_ENDED: "the input ended",
    flight_pb2.CLOSE_DISK_FULL: "the disk is full",
}


def describe(record: Record) -> str:
    """Return one line about a record, without its seq, time and kind."""
    return _WORDS[record.kind.name](record.message)


def order_verb(order: OrderReceived) -> str:
    """Return what kind of order it is: "point_at_place", ...; "unknown" for a variant that is not known."""
    return order.WhichOneof("order") or "unknown"


def order_words(order: OrderReceived) -> str:
    """Return what an order asks for."""
    match order.WhichOneof("order"):
        case "point_at_place":
            return f"look at {place_words(order.point_at_place.place)}, camera {order.point_at_place.camera}"
        case "point_at_angles":
            asked = order.point_at_angles
            return f"look to {angles_words(asked.pitch_cdeg, asked.yaw_cdeg, asked.yaw_locked)}, camera {asked.camera}"
        case "release_camera":
            return f"let go of camera {order.release_camera.camera}"
        case "zoom_camera":
            return f"zoom to {percent(order.zoom_camera.zoom_e4)}, camera {order.zoom_camera.camera}"
        case "judge_poi":
            return f"{'confirm' if order.judge_poi.confirmed else 'decline'} finding {order.judge_poi.poi_id}"
    return _flight_order_words(order)


def _flight_order_words(order: OrderReceived) -> str:
    match order.WhichOneof("order"):
        case "fly_to_place":
            return f"fly to {place_words(order.fly_to_place.place)}"
        case "set_flight_mode":
            return f"put the vehicle into {named(MODES, order.set_flight_mode.mode)}"
        case "override_safety":
            asked = order.override_safety
            held = seconds(asked.held_for_ms * NS_PER_MS)
            return f"hold off {named(SCOPES, asked.scope)} for {held} s: {asked.reason}"
        case "acknowledge_selftest":
            return f"take on self-test {order.acknowledge_selftest.report_id} as it is"
        case "mission":
            return f"{named(_MISSION_VERBS, order.mission.verb)} the mission"
        case "follow_poi":
            return f"keep finding {order.follow_poi.poi_id} in view, camera {order.follow_poi.camera}"
    return "an order of an unknown kind"


def result_word(result: int) -> str:
    """Return one of the five answers of seed 000 as a word; a number that is none of them as itself."""
    return _RESULTS.get(result, f"result {result}")


def close_words(reason: int) -> str:
    """Return why a flight ended."""
    return _CLOSE_REASONS.get(reason, f"reason {reason}")


def place_words(place: Place) -> str:
    """Return a place for people: degrees, altitude, grid."""
    grid = f" ({place.mgrs})" if place.mgrs else ""
    return f"{coordinates(place.latitude_e7, place.longitude_e7)}, {metres(place.altitude_mm)} m AMSL{grid}"


def angles_words(pitch_cdeg: int, yaw_cdeg: int, yaw_locked: bool) -> str:
    """Return a direction for people."""
    frame = "from north" if yaw_locked else "from the nose"
    return f"pitch {degrees(pitch_cdeg)}, yaw {degrees(yaw_cdeg)} {frame}"


def control_words(system_id: int, component_id: int, *, ours: bool) -> str:
    """Return who controls a gimbal: "this node", "nobody", or another by its MAVLink ids as "255/190"."""
    return "this node" if ours else f"{system_id}/{component_id}" if system_id else "nobody"


def who(issuer: Issuer) -> str:
    """Return a name for people and the principal behind it."""
    return f"{issuer.callsign} ({issuer.principal_id})" if issuer.callsign else issuer.principal_id


def _opened(one: flight_pb2.FlightOpened) -> str:
    return f"flight {one.flight_number} of {one.node}, software {one.software}, logic {one.logic}"


def _carried(one: flight_pb2.BaselineCarried) -> str:
    state = one.state
    mission = f", a mission in the air, {state.mission.chart_state}" if state.HasField("mission") else ""
    counts = f"{len(state.objects)} objects, {len(state.ignored)} muted places, {len(state.orders)} orders"
    return f"carried over: {counts}{mission}"


def _started(one: flight_pb2.NodeStarted) -> str:
    outage = f", {seconds(one.outage_ns)} s after the last record" if one.outage_ns else ""
    unbounded = f"; how long it was off can't be known: {one.outage_unbounded}" if one.outage_unbounded else ""
    return f"daemon started, start {one.start} of this flight{outage}{unbounded}"


def _failed(one: flight_pb2.StepFailed) -> str:
    return f"deciding raised {one.error} in {one.chart}: what it was about was not applied"


def _rejected(one: flight_pb2.SamplesRejected) -> str:
    counts = ", ".join(f"{entry.count} {entry.reason}" for entry in one.rejected)
    return f"samples rejected: {counts}"


def _ordered(one: OrderReceived) -> str:
    return f"{who(one.issuer)} orders {one.command_id}: {order_words(one)}"


def _malformed(one: OrderMalformed) -> str:
    return f"{who(one.issuer)} sent order {one.command_id} that can't be read: {one.because}"


def _ack(one: SendAck) -> str:
    result = result_word(one.result) if one.final else _STAGES.get(one.stage, "not decided")
    again = "again " if one.duplicate else ""
    return f"tell {one.principal_id} {again}about {one.command_id}: {result}, {one.detail}"


def _published(one: AckPublished) -> str:
    return f"answer {one.effect_seq} did not leave: {one.failure}" if one.failure else f"answer {one.effect_seq} left"


def _for(order: str) -> str:
    return f" for {order}" if order else " by the node's own wish"


def _at_place(one: PointAtPlace) -> str:
    looked_at = f", finding {one.poi_id}" if one.poi_id else ""
    return f"point gimbal {one.vehicle}/{one.gimbal} at {place_words(one.place)}{looked_at}{_for(one.order)}"


def _at_angles(one: PointAtAngles) -> str:
    direction = angles_words(one.pitch_cdeg, one.yaw_cdeg, one.yaw_locked)
    return f"point gimbal {one.vehicle}/{one.gimbal} to {direction}{_for(one.order)}"


def _release(one: ReleasePointing) -> str:
    return f"let gimbal {one.vehicle}/{one.gimbal} go{_for(one.order)}"


def _answered(one: CommandAnswered) -> str:
    return f"vehicle answered effect {one.effect_seq} with MAV_RESULT {one.mav_result}, {one.attempts} attempts"


def _unanswered(one: CommandUnanswered) -> str:
    return f"no answer to effect {one.effect_seq}: {one.because}, {one.attempts} attempts"


def _vehicle(one: VehicleStateReported) -> str:
    return f"vehicle {one.vehicle} is {'armed' if one.armed else 'disarmed'}, mode {one.custom_mode}"


def _position(one: PositionReported) -> str:
    return f"vehicle {one.vehicle} at {place_words(one.place)}, {metres(one.height_mm)} m above home"


def _gimbal(one: GimbalReported) -> str:
    off = f", {degrees(one.error_cdeg)} off effect {one.effect_seq}" if one.HasField("error_cdeg") else ""
    at = f"{'told' if one.demanded else 'at'} pitch {degrees(one.pitch_cdeg)}, yaw {degrees(one.yaw_cdeg)}"
    return f"gimbal {one.vehicle}/{one.gimbal} {at}{off}"


def _described(one: GimbalDescribed) -> str:
    limits = []
    if one.HasField("pitch_min_cdeg"):
        limits.append(f"pitch {degrees(one.pitch_min_cdeg)} to {degrees(one.pitch_max_cdeg)}")
    if one.HasField("yaw_min_cdeg"):
        limits.append(f"yaw {degrees(one.yaw_min_cdeg)} to {degrees(one.yaw_max_cdeg)} from the nose")
    parts = ["has a manager" if one.managed else "has no manager that answers", *limits]
    parts += [] if one.pans else ["does not pan"]
    parts += ["a place to look at turns the vehicle"] if one.turns_vehicle else []
    return f"gimbal {one.vehicle}/{one.gimbal} {', '.join(parts)}"


def _control(one: GimbalControlChanged) -> str:
    by = control_words(one.system_id, one.component_id, ours=one.ours)
    return f"gimbal {one.vehicle}/{one.gimbal} is controlled by {by}"


def _zoom(one: SetZoom) -> str:
    return f"zoom camera {one.vehicle}/{one.camera} to {percent(one.zoom_e4)}{_for(one.order)}"


def _frame(one: FrameObserved) -> str:
    found = ", ".join(f"{entry.class_name} {percent(entry.confidence_e4)}" for entry in one.detections)
    return f"frame {one.frame_seq} of camera {one.vehicle}/{one.camera}: {found or 'nothing'}"


def _eyes(one: EyesChanged) -> str:
    because = f": {one.because}" if one.because else ""
    return f"eyes of camera {one.vehicle}/{one.camera} are {one.state}{because}"


def _classified(one: SightingsClassified) -> str:
    known = (
        f"object {entry.object} {'new' if entry.diff == NEW else metres(entry.distance_mm) + ' m from before'}"
        for entry in one.sightings
    )
    return ", ".join(known)


def _poi(one: PoiOpened) -> str:
    return f"worth a look: {one.class_name} {percent(one.confidence_e4)} at {place_words(one.place)}"


def _ignored(one: ItemIgnored) -> str:
    return f"{one.principal_id} declined {one.poi_id}: {one.class_group} near {place_words(one.place)} stays quiet"


def _taken(one: CameraTaken) -> str:
    again = f" again, for {seconds(one.held_for_ms * NS_PER_MS)} s" if one.HasField("held_for_ms") else ""
    return f"{one.callsign or one.principal_id} has camera {one.vehicle}/{one.camera} by order {one.command_id}{again}"


def _joined(one: PoiJoined) -> str:
    return f"object {one.object} belongs to finding {one.poi_id}"


def _muted(one: SightingMuted) -> str:
    return f"object {one.object} lies where finding {one.poi_id} was declined"


def _alarm(one: TrustAlarm) -> str:
    return f"ALARM: {one.what} of {one.document}: {one.offered_version} was offered, {one.held_version} is held"


def _time(one: TimeLearned) -> str:
    before, after = (_QUALITY[quality] for quality in (one.from_quality, one.to_quality))
    said = f"time is {after}, was {before}, by {one.source}; floor {one.floor_ms}"
    return f"{said}; {one.source} was off by {one.jump_ms} ms and is not followed" if one.jump_ms else said


def _identified(one: VehicleIdentified) -> str:
    major, minor, patch, _ = one.software_version.to_bytes(4, "big")
    maker = _AUTOPILOTS.get(one.autopilot, f"autopilot {one.autopilot}")
    return (
        f"vehicle {one.vehicle} is {maker} {major}.{minor}.{patch}, type {one.vehicle_type}, can {one.capabilities:#x}"
    )


def _compared(one: VehicleTimeCompared) -> str:
    surely = f"+-{one.round_trip_us // 2} us, spread {one.spread_us} us"
    return f"vehicle {one.vehicle}'s clock less ours: {one.offset_us} us {surely}"


def _segment(one: RawSegmentClosed) -> str:
    found = ", left open by an earlier start" if one.found else ""
    return f"raw file {one.name}: {one.frames} frames, SHA-256 {one.sha256.hex()[:16]}{found}"


_AUTOPILOTS = {3: "ArduPilot", 12: "PX4"}
_QUALITY = {CLOCK_UNSET: "unset", CLOCK_BOUNDED: "bounded", CLOCK_TRUSTED: "trusted"}
_WORDS: dict[str, Callable[[Any], str]] = {
    "flight_opened": _opened,
    "baseline_carried": _carried,
    "node_started": _started,
    "flight_closed": lambda one: f"flight closed: {close_words(one.reason)}",
    "time_passed": lambda _: "a deadline passed",
    "origin_set": lambda one: f"origin at {place_words(one.place)}, {one.source}",
    "step_failed": _failed,
    "inputs_dropped": lambda one: f"{one.count} of class {one.input_class} dropped: the inbox was full",
    "samples_rejected": _rejected,
    "log_recovered": lambda one: f"the log was not ended in order: {one.found}",
    "log_damaged": lambda one: f"damaged log kept in {one.folder or '?'}: {one.found}",
    "disk_full": lambda one: f"the disk is full: {one.reserved_bytes >> 10} KiB given up for the end of the flight",
    "flight_deleted": lambda one: f"flight {one.flight_number}, pushed to {one.pushed_to}, was deleted here",
    "log_key_certified": lambda one: f"key of this log: {one.certificate.partition('key ')[2].partition(chr(10))[0]}",
    "seal_refused": lambda one: f"the log is signed no more: {one.because}",
    "checkpoint_cosigned": lambda one: f"{one.witness.callsign} cosigned {one.size} records of {one.origin}",
    "moved": lambda one: f"{one.chart} {one.instance}: {one.from_state} -> {one.to_state}, {one.because}",
    "order_received": _ordered,
    "order_malformed": _malformed,
    "send_ack": _ack,
    "ack_published": _published,
    "point_at_place": _at_place,
    "point_at_angles": _at_angles,
    "release_pointing": _release,
    "command_sent": lambda one: f"effect {one.effect_seq} left for the vehicle",
    "command_answered": _answered,
    "command_unanswered": _unanswered,
    "vehicle_state_reported": _vehicle,
    "vehicle_link_changed": lambda one: f"vehicle {one.vehicle} is {'heard' if one.up else 'silent'}",
    "position_reported": _position,
    "gimbal_reported": _gimbal,
    "gimbal_described": _described,
    "gimbal_control_changed": _control,
    "take_gimbal": lambda one: f"take control of gimbal {one.vehicle}/{one.gimbal}",
    "give_up_gimbal": lambda one: f"give up control of gimbal {one.vehicle}/{one.gimbal}",
    "camera_described": lambda one: f"camera {one.vehicle}/{one.camera} can{'' if one.zooms else 'not'} zoom",
    "camera_zoomed": lambda one: f"camera {one.vehicle}/{one.camera} is zoomed to {percent(one.zoom_e4)}",
    "set_zoom": _zoom,
    "frame_observed": _frame,
    "eyes_changed": _eyes,
    "sightings_classified": _classified,
    "poi_opened": _poi,
    "item_ignored": _ignored,
    "camera_taken": _taken,
    "poi_joined": _joined,
    "sighting_muted": _muted,
    "revocations_taken": lambda one: f"revocation list {one.list_version} of key {one.key_id.hex()[:8]}",
    "epoch_taken": lambda one: f"group key of epoch {one.epoch_id}",
    "root_taken": lambda one: f"TrustRoot {one.root_version}; lists are signed by key {one.revoke_key_id.hex()[:8]}",
    "trust_alarm": _alarm,
    "time_learned": _time,
    "vehicle_identified": _identified,
    "vehicle_time_compared": _compared,
    "raw_segment_closed": _segment,
    "raw_changed": lambda one: f"the link is{'' if one.recording else ' not'} recorded in files {one.because}".rstrip(),
    "poi_left": lambda one: f"object {one.object} has moved away from finding {one.poi_id}",
    **_FLIGHT_WORDS,
}
