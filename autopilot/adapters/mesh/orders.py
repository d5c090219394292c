"""From an opened DeviceCommand to the observation that the core judges.

It decodes, checks ranges, and works out places; whether the order may be carried out is not asked
here. A variant that this node does not know is no error: it becomes an order with nothing ordered.
"""

from __future__ import annotations

from dataclasses import dataclass

from google.protobuf.message import DecodeError

from autopilot.adapters.mesh.flight_orders import FlightOrdered, read_flight_order
from autopilot.adapters.mesh.reading import Locate, read_place, require_range, require_uuid
from autopilot.trust.keys import digest
from autopilot.trust.verdict import Malformed, Opened, Sealed, Unreadable
from autopilot.wire.keys import order_address
from events.schema.common_pb2 import Issuer
from events.schema.orders_pb2 import (
    AcknowledgeSelftestOrder,
    FlyToPlaceOrder,
    FollowPoiOrder,
    JudgePoiOrder,
    MissionOrder,
    OrderMalformed,
    OrderReceived,
    OverrideSafetyOrder,
    PointAtAnglesOrder,
    PointAtPlaceOrder,
    ReleaseCameraOrder,
    SetFlightModeOrder,
    ZoomCameraOrder,
)
from events.schema.waypoint_pb2 import DeviceCommand

PITCH_CDEG_MAX = 9_000
YAW_CDEG_MAX = 35_999
ZOOM_E4_MAX = 10_000

Ordered = PointAtPlaceOrder | PointAtAnglesOrder | ReleaseCameraOrder | JudgePoiOrder | ZoomCameraOrder | FlightOrdered
# The arm of OrderReceived that holds it.
ARMS: dict[type[Ordered], str] = {
    PointAtPlaceOrder: "point_at_place",
    PointAtAnglesOrder: "point_at_angles",
    ReleaseCameraOrder: "release_camera",
    ZoomCameraOrder: "zoom_camera",
    JudgePoiOrder: "judge_poi",
    FlyToPlaceOrder: "fly_to_place",
    SetFlightModeOrder: "set_flight_mode",
    OverrideSafetyOrder: "override_safety",
    AcknowledgeSelftestOrder: "acknowledge_selftest",
    MissionOrder: "mission",
    FollowPoiOrder: "follow_poi",
}


@dataclass(frozen=True, slots=True)
class Order:
    """A DeviceCommand whose every field is in its range; `ordered` is None for an unknown variant."""

    command_id: str
    target_public_key: bytes
    ordered: Ordered | None


def read_order(message: Sealed, content: bytes, locate: Locate) -> Order:
    """Decode a DeviceCommand and check every field. Raises Unreadable naming the field."""
    command = DeviceCommand()
    try:
        command.ParseFromString(content)
    except DecodeError as error:
        raise Unreadable("the content is no DeviceCommand, or a text in it is not UTF-8") from error
    require_uuid("command_id", command.command_id)
    address = order_address(message.key_expr)
    if address is None or address.command_id != command.command_id:
        raise Unreadable("command_id: is not the one in the key")
    return Order(command.command_id, command.target_node_pubkey, _ordered(command, locate))


def order_received(opened: Opened[Order]) -> OrderReceived:
    """Make the observation of an order that could be read."""
    message, order = opened.message, opened.value
    observation = OrderReceived(
        issuer=issuer_of(message),
        command_id=order.command_id,
        body_digest=digest(opened.content),
        target_public_key=order.target_public_key,
        order_seq=opened.order_seq,
        nonce=message.nonce,
        nonce_life_ms=message.nonce_life_ms,
        life_ms=message.life_ms,
        in_reply_to=message.digest,
        issued_at_ms=message.issued_at_ms,
        envelope=message.envelope,
        opened=message.plaintext,
    )
    if message.overdue_ms:
        observation.revocation_overdue_ms = message.overdue_ms
    if message.time_uncertain:
        observation.time_uncertain = True
    if message.before_memory:
        observation.before_memory = True
    if order.ordered is not None:
        getattr(observation, ARMS[type(order.ordered)]).CopyFrom(order.ordered)
    return observation


def order_malformed(malformed: Malformed) -> OrderMalformed:
    """Make the observation of an authentic order that can't be read; its answer needs the key's id."""
    message = malformed.message
    address = order_address(message.key_expr)
    return OrderMalformed(
        issuer=issuer_of(message),
        command_id=address.command_id if address else "",
        because=malformed.because,
        in_reply_to=message.digest,
        nonce=message.nonce,
        nonce_life_ms=message.nonce_life_ms,
    )


def _ordered(command: DeviceCommand, locate: Locate) -> Ordered | None:
    match command.WhichOneof("command"):
        case "camera_roi":
            return _at_place(command, locate)
        case "camera_pitch_yaw":
            return _at_angles(command)
        case "camera_release":
            return ReleaseCameraOrder(camera=command.camera_release.camera or 1)
        case "camera_zoom":
            return _zoom(command)
        case "poi_confirm":
            require_uuid("poi_confirm.poi_id", command.poi_confirm.poi_id)
            return JudgePoiOrder(poi_id=command.poi_confirm.poi_id, confirmed=True)
        case "poi_decline":
            require_uuid("poi_decline.poi_id", command.poi_decline.poi_id)
            return JudgePoiOrder(poi_id=command.poi_decline.poi_id, confirmed=False)
    return read_flight_order(command, locate)


def _at_place(command: DeviceCommand, locate: Locate) -> PointAtPlaceOrder:
    roi = command.camera_roi
    place = read_place("camera_roi", roi.lat_e7, roi.lon_e7, roi.altitude_dm, locate)
    return PointAtPlaceOrder(camera=roi.camera or 1, place=place)


def _at_angles(command: DeviceCommand) -> PointAtAnglesOrder:
    angles = command.camera_pitch_yaw
    require_range("camera_pitch_yaw.pitch_cdeg", angles.pitch_cdeg, -PITCH_CDEG_MAX, PITCH_CDEG_MAX)
    require_range("camera_pitch_yaw.yaw_cdeg", angles.yaw_cdeg, 0, YAW_CDEG_MAX)
    return PointAtAnglesOrder(
        camera=angles.camera or 1,
        pitch_cdeg=angles.pitch_cdeg,
        yaw_cdeg=angles.yaw_cdeg,
        yaw_locked=angles.yaw_locked,
    )


def _zoom(command: DeviceCommand) -> ZoomCameraOrder:
    zoom = command.camera_zoom
    require_range("camera_zoom.zoom_e4", zoom.zoom_e4, 0, ZOOM_E4_MAX)
    return ZoomCameraOrder(camera=zoom.camera or 1, zoom_e4=zoom.zoom_e4)


def issuer_of(message: Sealed) -> Issuer:
    """Return who stands behind a message, as its token says it."""
    sender = message.sender
    return Issuer(
        principal_id=sender.principal_id,
        callsign=sender.callsign,
        device_key_id=sender.device_key_id,
        roles=sender.roles,
    )
