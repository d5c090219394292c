"""A vehicle to test against: messages of an autopilot as bytes, effects, and a session with its outputs kept."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from typing import Any

from google.protobuf.message import Message
from pymavlink.dialects.v20 import common as dialect

from autopilot.adapters.vehicle.session import Report, Session, Transmit
from autopilot.ports.config import VehicleSection
from events.schema.common_pb2 import Place
from events.schema.mission_pb2 import ArmVehicle, PlannedItem, SetMissionItem, StartMission, UploadMission
from events.schema.safety_pb2 import FlightMode, FlyToPlace, SetVehicleMode
from events.schema.vehicle_pb2 import GiveUpGimbal, PointAtAngles, PointAtPlace, ReleasePointing, SetZoom, TakeGimbal

PEER = ("127.0.0.1", 14550)
S = 1_000_000_000
US = (1, 191)
LATITUDE_E7, LONGITUDE_E7, ALTITUDE_MM = 473_977_000, 85_456_000, 518_000


def packed(message: Any, system: int = 1, component: int = 1) -> bytes:
    """Return a message as the bytes of one datagram."""
    return bytes(message.pack(dialect.MAVLink(None, system, component)))


def framed(message_id: int, payload: bytes, sender: tuple[int, int] = (1, 1)) -> bytes:
    """Return any payload as a frame with a right checksum; of a message that is not known it is some checksum."""
    known = dialect.mavlink_map.get(message_id)
    header = bytes([len(payload), 0, 0, 0, *sender]) + message_id.to_bytes(3, "little")
    checksum: int = dialect.x25crc(header + payload + bytes([known.crc_extra if known else 77])).crc
    return b"\xfd" + header + payload + checksum.to_bytes(2, "little")


def signed(frame: bytes, key: bytes, ticks: int, link_id: int = 0) -> bytes:
    """Return a frame as another implementation signs it."""
    known = dialect.mavlink_map.get(int.from_bytes(frame[7:10], "little"))
    header = frame[1:2] + b"\x01" + frame[3:10]
    checksum: int = dialect.x25crc(header + frame[10:-2] + bytes([known.crc_extra if known else 77])).crc
    body = b"\xfd" + header + frame[10:-2] + checksum.to_bytes(2, "little")
    body += bytes([link_id]) + ticks.to_bytes(6, "little")
    return body + hashlib.sha256(key + body).digest()[:6]


def heartbeat(
    system: int = 1,
    component: int = 1,
    *,
    autopilot: int = 3,
    vehicle_type: int = 2,
    armed: bool = False,
    mode: int = 0,
) -> bytes:
    message = dialect.MAVLink_heartbeat_message(vehicle_type, autopilot, 128 if armed else 0, mode, 4, 3)
    return packed(message, system, component)


def position(boot_ms: int, **changes: int) -> bytes:
    fields = {"lat": LATITUDE_E7, "lon": LONGITUDE_E7, "alt": ALTITUDE_MM, "relative_alt": 30_000}
    fields |= {"vx": 0, "vy": 0, "vz": 0, "hdg": 9_000} | changes
    return packed(dialect.MAVLink_global_position_int_message(time_boot_ms=boot_ms, **fields))


def attitude(boot_ms: int, yaw_deg: float, yaw_rate_deg_s: float = 0.0) -> bytes:
    yaw, rate = math.radians(yaw_deg), math.radians(yaw_rate_deg_s)
    return packed(dialect.MAVLink_attitude_message(boot_ms, 0, 0, yaw, 0, 0, rate))


def quaternion(pitch_deg: float, yaw_deg: float) -> list[float]:
    """Return w, x, y, z of yaw, then pitch."""
    p, y = math.radians(pitch_deg) / 2, math.radians(yaw_deg) / 2
    sp, cp, sy, cy = math.sin(p), math.cos(p), math.sin(y), math.cos(y)
    return [cp * cy, -sp * sy, sp * cy, cp * sy]


def gimbal(boot_ms: int, pitch_deg: float, yaw_deg: float, flags: int = 32, component: int = 1) -> bytes:
    q = quaternion(pitch_deg, yaw_deg)
    message = dialect.MAVLink_gimbal_device_attitude_status_message(
        0, 0, boot_ms, flags, q, math.nan, math.nan, math.nan, 0
    )
    return packed(message, component=component)


def system_time(wall_ms: int, *, sender: tuple[int, int] = (1, 1)) -> bytes:
    return packed(dialect.MAVLink_system_time_message(wall_ms * 1000, 1), *sender)


def version() -> bytes:
    nothing = [0] * 8
    message = dialect.MAVLink_autopilot_version_message(0xF, 0x04060000, 0, 0, 9, nothing, nothing, nothing, 0, 0, 1)
    return packed(message)


def answer(command: int, result: int = 0, target: tuple[int, int] = US, progress: int = 0) -> bytes:
    return packed(dialect.MAVLink_command_ack_message(command, result, progress, 0, *target))


def at_place(
    latitude_e7: int = LATITUDE_E7 + 2_000, longitude_e7: int = LONGITUDE_E7, altitude_mm: int = 488_000
) -> PointAtPlace:
    return PointAtPlace(
        vehicle=1,
        camera=1,
        gimbal=1,
        life_ms=5_000,
        place=Place(latitude_e7=latitude_e7, longitude_e7=longitude_e7, altitude_mm=altitude_mm),
    )


def at_angles(pitch_cdeg: int = -3_000, yaw_cdeg: int = 9_000, *, yaw_locked: bool = True) -> PointAtAngles:
    return PointAtAngles(
        vehicle=1, camera=1, gimbal=1, life_ms=5_000, pitch_cdeg=pitch_cdeg, yaw_cdeg=yaw_cdeg, yaw_locked=yaw_locked
    )


def release() -> ReleasePointing:
    return ReleasePointing(vehicle=1, camera=1, gimbal=1, life_ms=5_000)


def mode(name: str, order: str = "") -> SetVehicleMode:
    return SetVehicleMode(
        vehicle=1, mode=FlightMode.Value(f"FLIGHT_MODE_{name}"), because="test", life_ms=5_000, order=order
    )


def arm() -> ArmVehicle:
    return ArmVehicle(vehicle=1, life_ms=5_000)


def start() -> StartMission:
    return StartMission(vehicle=1, life_ms=5_000)


def go_to_item(item: int) -> SetMissionItem:
    return SetMissionItem(vehicle=1, item=item, life_ms=5_000)


def fly_to(latitude_e7: int = LATITUDE_E7, longitude_e7: int = LONGITUDE_E7, altitude_mm: int = 540_000) -> FlyToPlace:
    place = Place(latitude_e7=latitude_e7, longitude_e7=longitude_e7, altitude_mm=altitude_mm)
    return FlyToPlace(vehicle=1, place=place, life_ms=5_000, order="alice/1")


def planned(command: int = 16, north: int = 0, **changes: Any) -> PlannedItem:
    """Return an item of a plan: located ones `north` steps of some 1.1 m from home, 30 m up."""
    item = PlannedItem(command=command)
    if command in (16, 21, 22):
        item.place.CopyFrom(Place(latitude_e7=LATITUDE_E7 + north * 100, longitude_e7=LONGITUDE_E7))
        item.height_mm = 30_000
    for name, value in changes.items():
        setattr(item, name, value)
    return item


def plan() -> list[PlannedItem]:
    """Return a copter's plan with each command that there is."""
    speed = planned(178, parameter_1_e3=1000, parameter_2_e3=8000, parameter_3_e3=-1000)
    return [planned(22), speed, planned(16, 50, parameter_1_e3=2500), planned(16, 90), planned(20), planned(21)]


def upload(items: list[PlannedItem] | None = None, life_ms: int = 120_000) -> UploadMission:
    return UploadMission(vehicle=1, mission_id="m", items=plan() if items is None else items, life_ms=life_ms)


def take() -> TakeGimbal:
    return TakeGimbal(vehicle=1, gimbal=1, life_ms=5_000)


def give_up() -> GiveUpGimbal:
    return GiveUpGimbal(vehicle=1, gimbal=1, life_ms=5_000)


def zoom(zoom_e4: int = 4_000, camera: int = 1) -> SetZoom:
    return SetZoom(vehicle=1, camera=camera, zoom_e4=zoom_e4, life_ms=5_000)


def information(
    pitch_deg: tuple[float, float] = (-90, 20),
    yaw_deg: tuple[float, float] = (-180, 180),
    flags: int = 0,
    component: int = 1,
) -> bytes:
    """Return a gimbal manager's GIMBAL_MANAGER_INFORMATION."""
    limits = [math.radians(limit) for limit in (*pitch_deg, *yaw_deg)]
    message = dialect.MAVLink_gimbal_manager_information_message(1, flags, 1, 0, 0, *limits)
    return packed(message, component=component)


def controlled(system: int, by: int, component: int = 1) -> bytes:
    """Return a gimbal manager's GIMBAL_MANAGER_STATUS with this primary control."""
    return packed(dialect.MAVLink_gimbal_manager_status_message(1, 12, 1, system, by, 0, 0), component=component)


def camera(flags: int = 64, component: int = 100) -> bytes:
    """Return a camera's CAMERA_INFORMATION."""
    name = b"camera".ljust(32, b"\0")
    message = dialect.MAVLink_camera_information_message(1, name, name, 0, 0, 0, 0, 0, 0, 0, flags, 0, b"")
    return packed(message, component=component)


def zoomed(percent: float, component: int = 100) -> bytes:
    """Return a camera's CAMERA_SETTINGS."""
    return packed(dialect.MAVLink_camera_settings_message(1, 0, percent, math.nan), component=component)


def plain_place(latitude_deg: float, longitude_deg: float, altitude_m: float) -> Place:
    """Return a place without its keys, which nothing here reads."""
    return Place(
        latitude_e7=round(latitude_deg * 1e7),
        longitude_e7=round(longitude_deg * 1e7),
        altitude_mm=round(altitude_m * 1000),
    )


def decode(data: bytes) -> Any:
    """Return the message in a datagram, as another implementation reads it."""
    (message,) = dialect.MAVLink(None).parse_buffer(data)
    return message


class Bench:
    """A session under test, with time in seconds and everything it wanted."""

    def __init__(
        self,
        settings: VehicleSection | None = None,
        *,
        healthy: Callable[[], bool] = lambda: True,
        place: Callable[[float, float, float], Place | None] = plain_place,
        peer: tuple[str, int] | None = PEER,
        on_time: Callable[[int], None] | None = None,
    ) -> None:
        self.fixes: list[tuple[float, float, float]] = []
        self.times: list[int] = []
        self.session = Session(
            settings or VehicleSection(connect="127.0.0.1:14550"),
            place,
            lambda *fix: self.fixes.append(fix),
            healthy,
            arrival_tolerance_deg=1.0,
            peer=peer,
            on_time=on_time or self.times.append,
        )
        self.sent: list[Any] = []  # decoded
        self.reports: list[Message] = []

    def hear(self, at_s: float, *datagrams: bytes, peer: tuple[str, int] = PEER) -> None:
        for datagram in datagrams:
            self.session.hear(round(at_s * S), peer, datagram)
        self.turn(at_s)

    def perform(self, at_s: float, seq: int, effect: Message) -> None:
        deadline_ns = round(at_s * S) + 5 * S
        self.session.perform(round(at_s * S), seq, effect, deadline_ns)
        self.turn(at_s)

    def turn(self, at_s: float) -> None:
        self.session.tick(round(at_s * S))
        while outputs := self.session.take():
            for output in outputs:
                if isinstance(output, Transmit):
                    self.sent.append(decode(output.data))
                    if output.effect_seq is not None:
                        self.session.sent(output.effect_seq)
                elif isinstance(output, Report):
                    self.reports.append(output.observation)

    def reported(self, *kinds: type[Message]) -> list[Message]:
        return [report for report in self.reports if isinstance(report, kinds)]

    def commands(self) -> list[int]:
        """Return the ids of the commands sent so far, those of upkeep left out."""
        return [message.command for message in self.sent if getattr(message, "command", 511) not in (511, 512)]
