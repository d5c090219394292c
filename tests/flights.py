"""A flight in memory: steps observations through the core and keeps the log, with a clock that the test moves.

    flight = Flight()                        # opened, started, with an origin and a vehicle that is heard
    flight.tell(point_at_place("a1"))        # -> the records of the step: the observation and its decisions
    flight.tell(answered(flight.effect()), after_ms=120)

The builders below make common observations; every field that a test cares about can be given. Nothing here checks
anything, and nothing but the arguments decides what comes out.
"""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import blake2b, sha256
from typing import Any

from google.protobuf.message import Message

from events import NO_CAUSE, Moment, Record, make_record, read_record
from events.kinds import Role
from events.schema.common_pb2 import Issuer, Place
from events.schema.eyes_pb2 import Detection, EyesChanged, FrameObserved
from events.schema.flight_pb2 import (
    CLOSE_STOPPED,
    CameraFitting,
    ClassGroup,
    CloseReason,
    Configuration,
    FlightClosed,
    FlightOpened,
    InputsDropped,
    Limits,
    NodeStarted,
    OriginSet,
    RejectedCount,
    SamplesRejected,
    TimePassed,
)
from events.schema.orders_pb2 import (
    AckPublished,
    JudgePoiOrder,
    OrderMalformed,
    OrderReceived,
    PointAtAnglesOrder,
    PointAtPlaceOrder,
    ReleaseCameraOrder,
    SendAck,
)
from events.schema.vehicle_pb2 import (
    CommandAnswered,
    CommandSent,
    CommandUnanswered,
    GimbalReported,
    PositionReported,
    VehicleLinkChanged,
    VehicleStateReported,
)
from events.store import MemoryStore
from events.store.protocol import Appender
from statecharts import State, charts_digest, step
from statecharts.logic import LOGIC

FLIGHT_ID = bytes(range(16))
SECRET = bytes(range(32))
NODE_KEY = b"N" * 32
NS_PER_MS = 1_000_000
START_WALL_NS = 1_790_000_000_000_000_000
BASE_LATITUDE_E7 = 521_000_000
BASE_LONGITUDE_E7 = 43_000_000


class Flight:
    """One flight: the core's state, the log so far, and the time."""

    def __init__(self, *opening: Message, store: Appender | None = None, limits: Limits | None = None) -> None:
        """Open the flight with these observations, or with `opened_well(limits)`."""
        self.store = store or MemoryStore(FLIGHT_ID, SECRET)
        self.state = State()
        self.records: list[Record] = []
        self.now_ns = 0
        self.due: int | None = None
        for message in opening or opened_well(limits):
            self.tell(message)

    def tell(self, message: Message, after_ms: int = 0) -> tuple[Record, ...]:
        """Let time pass, record an observation and what the core decides; return the records of the step."""
        self.now_ns += after_ms * NS_PER_MS
        observation = make_record(self.store.head.seq + 1, NO_CAUSE, self.moment(), message)
        made = step(self.state, observation)
        self.store.append(made.records)
        self.records.extend(made.records)
        self.due = made.due
        return made.records

    def wait(self, up_to_ms: int) -> tuple[Record, ...]:
        """Let time pass; `time_passed` is recorded at each deadline that falls into it, as the shell does."""
        end_ns, told = self.now_ns + up_to_ms * NS_PER_MS, list[Record]()
        while self.due is not None and self.due <= end_ns:
            self.now_ns = max(self.now_ns, self.due)
            told.extend(self.tell(TimePassed()))
        self.now_ns = end_ns
        return tuple(told)

    def moment(self) -> Moment:
        """Return now as a record holds it."""
        return Moment(self.now_ns, 5_000_000_000 + self.now_ns, 1, START_WALL_NS + self.now_ns, 2)

    def effect(self) -> int:
        """Return the seq of the newest effect for the vehicle."""
        return next(record.seq for record in reversed(self.records) if record.kind.port == "vehicle")

    def surfaced(self) -> list[str]:
        """Return the points of interest that wait for a person."""
        return [poi_id for poi_id, poi in self.state.pois.items() if poi.state == "surfaced"]


def story(store: Appender | None = None) -> Flight:
    """Return a whole flight, in which most things happen once: every answer, two questions, a mute, an arrival."""
    flight = Flight(store=store)
    flight.tell(position(0, 0), 500)
    _point(flight)
    _find(flight)
    _judge(flight)
    _misuse(flight)
    flight.wait(130_000)
    flight.tell(closed(), 1000)
    return flight


def _point(flight: Flight) -> None:
    flight.tell(point_at_place("p1", 20_000, 30_000), 100)
    effect = flight.effect()
    flight.tell(sent(effect), 2)
    flight.tell(answered(effect), 30)
    flight.tell(gimbal(-2_000, 3_000, effect, 900), 400)
    flight.tell(gimbal(-4_000, 3_400, effect, 40), 900)
    flight.tell(point_at_place("p1", 20_000, 30_000, send=2), 500)
    flight.tell(point_at_angles("p2", order_seq=1, who="bravo"), 500)
    flight.tell(unanswered(flight.effect()), 2_100)
    flight.tell(release("p3", order_seq=2), 100)
    flight.tell(answered(flight.effect(), mav_result=3), 30)


def _find(flight: Flight) -> None:
    for number in range(1, 8):
        near, far = detection(40_000 + 100 * number, 10_000), detection(-60_000, -20_000, "car", 6_500)
        flight.tell(frame(number, near, far, detection(5, 5, "sports ball")), 80)
    flight.tell(frame(8), 80)


def _judge(flight: Flight) -> None:
    person, car = sorted(flight.surfaced(), key=lambda poi_id: flight.state.pois[poi_id].class_group)
    flight.tell(judge("j1", person, confirmed=True, order_seq=3), 4_000)
    flight.tell(judge("j2", car, confirmed=False, order_seq=4), 1_000)
    for number in range(9, 13):
        flight.tell(frame(number, detection(-61_000, -22_000, "truck", 7_000)), 80)


def _misuse(flight: Flight) -> None:
    flight.tell(point_at_place("v1", who="viewer", roles=("viewer",)), 50)
    flight.tell(point_at_place("p4", order_seq=2), 50)
    flight.tell(malformed("m1"), 50)
    flight.tell(received("u1", order_seq=5), 50)
    rejected = [RejectedCount(reason="bad_signature", count=3), RejectedCount(reason="stale", count=1)]
    flight.tell(SamplesRejected(rejected=rejected), 50)
    flight.tell(InputsDropped(input_class="frame", count=7), 50)
    flight.tell(EyesChanged(vehicle=1, camera=1, state="lost", because="the detector ended"), 50)
    flight.tell(published(first_answer(flight)), 5)
    flight.tell(point_at_place("p5", order_seq=6), 50)
    flight.tell(NodeStarted(boot_id="boot", start=2, outage_ns=900_000_000), 900)
    flight.tell(position(1_000, 0))


def first_answer(flight: Flight) -> int:
    """Return the seq of the first last word."""
    acks = ((one.seq, one.message) for one in flight.records)
    return next(seq for seq, message in acks if isinstance(message, SendAck) and message.final)


def said(records: Sequence[Record]) -> list[str]:
    """Return the kinds of the decisions among these records."""
    return [record.kind.name for record in records if record.kind.role is not Role.OBSERVATION]


def resealed(records: Sequence[Record], flight_id: bytes = FLIGHT_ID) -> MemoryStore:
    """Return a store in which these records, changed by whoever holds the secret, form a chain that holds."""
    store = MemoryStore(flight_id, SECRET)
    store.append(records)
    return store


def read_back(store: Appender) -> list[Record]:
    """Return everything in a store, decoded."""
    return [read_record(stored) for stored in store.stored()]


def limits(**changes: Any) -> Limits:
    """Return limits as a flight has them by default, with changes."""
    values: dict[str, Any] = {
        "command_enabled": True,
        "camera_roles": ["camera"],
        "operator_hold_ms": 60_000,
        "release_pause_ms": 3_000,
        "arrival_tolerance_cdeg": 100,
        "arrival_patience_ms": 10_000,
        "dedup_keep_ms": 86_400_000,
        "same_object_mm": 8_000,
        "same_poi_mm": 15_000,
        "ask_confidence_e4": 4_000,
        "asks_per_minute": 5,
        "decide_shortest_ms": 30_000,
        "decide_longest_ms": 120_000,
        "queue_longest_ms": 300_000,
        "ask_again_ms": 300_000,
        "look_ms": 4_000,
        "frame_rate_floor_mhz": 10_000,
        "sweep_pitch_cdeg": -3_500,
        "scan_enabled": False,
        "failures_to_safe_mode": 3,
        "failure_window_ms": 60_000,
        "sightings_to_ask": 3,
        "own_command_life_ms": 5_000,
        "overdue_camera_ms": 259_200_000,
        "overdue_flight_ms": 3_600_000,
    }
    return Limits(**(values | changes))


def opened(bounds: Limits | None = None, **changes: Any) -> FlightOpened:
    """Return a manifest: one camera on a gimbal (1/1), a fixed one (1/2), and the groups person, vehicle."""
    configuration = Configuration(
        limits=bounds or limits(),
        class_groups=[
            ClassGroup(name="person", classes=["person"]),
            ClassGroup(name="vehicle", classes=["car", "truck"]),
        ],
        cameras=[CameraFitting(vehicle=1, camera=1, gimbal=1), CameraFitting(vehicle=1, camera=2, gimbal=0)],
    )
    values: dict[str, Any] = {
        "flight_id": FLIGHT_ID,
        "flight_number": 1,
        "node": "node-1",
        "node_public_key": NODE_KEY,
        "deployment_id": "test",
        "software": "0.1.0",
        "logic": LOGIC,
        "charts_digest": charts_digest(),
        "configuration": configuration,
    }
    return FlightOpened(**(values | changes))


def opened_well(bounds: Limits | None = None) -> tuple[Message, ...]:
    """Return how a flight begins on a node whose vehicle is heard."""
    return (
        opened(bounds),
        NodeStarted(boot_id="boot", start=1),
        OriginSet(place=place(0, 0), source="configured"),
        VehicleLinkChanged(vehicle=1, up=True),
        VehicleStateReported(vehicle=1, system_id=1, autopilot=3, vehicle_type=2, armed=True, custom_mode=4),
    )


def place(east_mm: int, north_mm: int, altitude_mm: int = 0) -> Place:
    """Return a place so far from the origin; latitude and longitude near enough for a test."""
    return Place(
        latitude_e7=BASE_LATITUDE_E7 + north_mm * 10 // 111,
        longitude_e7=BASE_LONGITUDE_E7 + east_mm * 10 // 68,
        altitude_mm=altitude_mm,
        h3_cell=0x8A1969C0A007FFF,
        mgrs=f"31UFT{50_000 + east_mm // 1000:05d}{50_000 + north_mm // 1000:05d}",
        east_mm=east_mm,
        north_mm=north_mm,
    )


def detection(east_mm: int, north_mm: int, class_name: str = "person", confidence_e4: int = 8_000) -> Detection:
    """Return a detection on the ground."""
    return Detection(
        class_name=class_name,
        confidence_e4=confidence_e4,
        x_min_e4=4_000,
        y_min_e4=4_000,
        x_max_e4=4_400,
        y_max_e4=5_000,
        place=place(east_mm, north_mm),
    )


def frame(frame_seq: int, *detections: Detection, camera: int = 1, every_ms: int = 50) -> FrameObserved:
    """Return a frame of a camera that gives one every `every_ms`."""
    captured_ns = frame_seq * every_ms * NS_PER_MS
    return FrameObserved(
        vehicle=1, camera=camera, frame_seq=frame_seq, captured_ns=captured_ns, latency_us=30_000, detections=detections
    )


def issuer(who: str = "alpha", roles: Sequence[str] = ("camera",)) -> Issuer:
    """Return an operator: principal `who`, callsign in capitals, one device."""
    device = blake2b(who.encode(), digest_size=16).digest()
    return Issuer(principal_id=who, callsign=who.upper(), device_key_id=device, roles=roles)


def received(command_id: str, order_seq: int = 1, who: str = "alpha", send: int = 1, **values: Any) -> OrderReceived:
    """Return an order; `send` grows when the issuer publishes it again (another nonce, the same body)."""
    roles = values.pop("roles", ("camera",))
    body = repr(sorted((name, str(value)) for name, value in values.items())).encode()
    settled: dict[str, Any] = {
        "issuer": issuer(who, roles),
        "command_id": command_id,
        "body_digest": blake2b(body, digest_size=32).digest(),
        "target_public_key": NODE_KEY,
        "order_seq": order_seq,
        "nonce": sha256(f"{who}/{command_id}/{send}".encode()).digest()[:24],
        "nonce_life_ms": 45_000,
        "life_ms": 15_000,
        "in_reply_to": sha256(f"reply {who}/{command_id}/{send}".encode()).digest(),
        "issued_at_ms": 1_790_000_000_000,
    }
    return OrderReceived(**(settled | values))


def point_at_place(
    command_id: str, east_mm: int = 1000, north_mm: int = 1000, camera: int = 1, **values: Any
) -> OrderReceived:
    """Return an order to look at a place."""
    asked = PointAtPlaceOrder(camera=camera, place=place(east_mm, north_mm))
    return received(command_id, point_at_place=asked, **values)


def point_at_angles(
    command_id: str,
    pitch_cdeg: int = -3000,
    yaw_cdeg: int = 9000,
    camera: int = 1,
    yaw_locked: bool = True,
    **values: Any,
) -> OrderReceived:
    """Return an order to look in a direction, from north, or from the nose."""
    asked = PointAtAnglesOrder(camera=camera, pitch_cdeg=pitch_cdeg, yaw_cdeg=yaw_cdeg, yaw_locked=yaw_locked)
    return received(command_id, point_at_angles=asked, **values)


def release(command_id: str, camera: int = 1, **values: Any) -> OrderReceived:
    """Return an order to let a camera go."""
    return received(command_id, release_camera=ReleaseCameraOrder(camera=camera), **values)


def judge(command_id: str, poi_id: str, confirmed: bool, **values: Any) -> OrderReceived:
    """Return a person's word on a finding."""
    return received(command_id, judge_poi=JudgePoiOrder(poi_id=poi_id, confirmed=confirmed), **values)


def malformed(command_id: str, who: str = "alpha", because: str = "camera_roi.lat_e7: 95 degrees") -> OrderMalformed:
    """Return an order that could not be read."""
    nonce = sha256(f"malformed {who}/{command_id}".encode()).digest()[:24]
    return OrderMalformed(
        issuer=issuer(who), command_id=command_id, because=because, nonce=nonce, nonce_life_ms=45_000, in_reply_to=nonce
    )


def sent(effect_seq: int) -> CommandSent:
    """Return: the bytes left."""
    return CommandSent(effect_seq=effect_seq)


def answered(effect_seq: int, mav_result: int = 0, attempts: int = 1) -> CommandAnswered:
    """Return the vehicle's COMMAND_ACK."""
    return CommandAnswered(effect_seq=effect_seq, mav_result=mav_result, progress=255, attempts=attempts)


def unanswered(effect_seq: int, attempts: int = 3, because: str = "no answer") -> CommandUnanswered:
    """Return: no COMMAND_ACK came."""
    return CommandUnanswered(effect_seq=effect_seq, attempts=attempts, because=because)


def published(effect_seq: int, failure: str = "") -> AckPublished:
    """Return: an answer left the node."""
    return AckPublished(effect_seq=effect_seq, failure=failure)


def gimbal(pitch_cdeg: int, yaw_cdeg: int, effect_seq: int | None = None, error_cdeg: int = 0) -> GimbalReported:
    """Return what the gimbal says of itself."""
    report = GimbalReported(vehicle=1, gimbal=1, pitch_cdeg=pitch_cdeg, yaw_cdeg=yaw_cdeg)
    if effect_seq is not None:
        report.effect_seq, report.error_cdeg = effect_seq, error_cdeg
    return report


def position(east_mm: int, north_mm: int, height_mm: int = 50_000) -> PositionReported:
    """Return where the vehicle is."""
    here = place(east_mm, north_mm, height_mm)
    return PositionReported(vehicle=1, place=here, height_mm=height_mm, heading_cdeg=4_500)


def closed(reason: CloseReason.ValueType = CLOSE_STOPPED) -> FlightClosed:
    """Return the end of a flight."""
    return FlightClosed(reason=reason)
