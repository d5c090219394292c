"""Ten minutes of a node as it records them, in no time: the real link, thinning and charts against the simulated
aircraft. It is what growth is measured on; nothing here measures.

Flying: the aircraft circles at 8 m/s, the detector gives ten frames a second, with people in a third of the time, and
an operator points the camera four times a minute. Idle: it stands on the ground, disarmed; the GPS wanders about a
metre and the gimbal trembles; the camera may be on, and sees nothing, or off.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from dataclasses import dataclass, replace

from google.protobuf.message import Message

from autopilot.adapters.eyes.thinning import Empties
from autopilot.adapters.vehicle.session import Report, Session, Transmit
from autopilot.geo import LocalFrame
from autopilot.node.limits import configuration_message
from autopilot.ports.config import Config
from autopilot.sim.aircraft import HOME, Aircraft
from autopilot.sim.route import Motion
from events.kinds import Role
from events.records import NO_CAUSE, Moment, Record, make_record
from events.schema.common_pb2 import Issuer, Place
from events.schema.eyes_pb2 import FrameObserved
from events.schema.flight_pb2 import BaselineCarried, FlightOpened, NodeStarted, OriginSet, TimePassed
from events.schema.orders_pb2 import OrderReceived, PointAtPlaceOrder
from events.schema.state_pb2 import CarriedState
from statecharts import LOGIC, State, step
from tests.bench.flight import FLIGHT_ID, detection

S = 1_000_000_000
TURN_S = 0.05
MINUTES = 10
FRAMES_A_SECOND = 10
ORDERS_EVERY_S = 15
PEER = ("127.0.0.1", 14550)
GPS_WANDER_M = 1.0  # slow, as a receiver that stands still shows it
TREMBLE_DEG = 0.05
SPEED_M_S, RADIUS_M = 8.0, 60.0


@dataclass(frozen=True, slots=True)
class Day:
    """A sort of day."""

    flying: bool
    camera: bool


class Circling(Aircraft):
    """An aircraft that never comes down."""

    @property
    def motion(self) -> Motion:
        """Where it is."""
        angle = self.time_s * SPEED_M_S / RADIUS_M
        before = self.route.at(self.route.seconds / 2)  # armed, in its mode
        return replace(
            before,
            east_m=RADIUS_M * math.sin(angle),
            north_m=RADIUS_M * math.cos(angle),
            up_m=30.0,
            yaw_deg=(90 + math.degrees(angle)) % 360,
            east_m_s=SPEED_M_S * math.cos(angle),
            north_m_s=-SPEED_M_S * math.sin(angle),
            up_m_s=0.0,
            yaw_deg_s=math.degrees(SPEED_M_S / RADIUS_M),
        )


class Standing(Aircraft):
    """An aircraft on the ground, as its sensors see it."""

    @property
    def motion(self) -> Motion:
        """Where it seems to be."""
        wander = [
            GPS_WANDER_M * math.sin(self.time_s / period + phase) for period, phase in ((97, 0), (61, 1), (143, 2))
        ]
        east_m, north_m, up_m = wander
        seen = replace(self.route.at(0.0), east_m=east_m, north_m=north_m, up_m=up_m)
        return replace(seen, yaw_deg=(seen.yaw_deg + TREMBLE_DEG * math.sin(self.time_s * 7)) % 360)


def config(thinned: bool = True) -> Config:
    """Return the default configuration of a node that takes orders; or one that thins nothing but by the clock."""
    vehicle: dict[str, object] = {"connect": "127.0.0.1:14550"}
    full = {"position_threshold_m": 0, "heading_threshold_deg": 0, "gimbal_threshold_deg": 1e-9}
    return Config.model_validate(
        {
            "node": {"keys": "k", "flights": "f", "projections": "p"},
            "command": {"enabled": True, "camera_roles": ["camera"], "roi_turns_vehicle": "warn"},
            "vehicle": vehicle if thinned else vehicle | full,
            "eyes": {} if thinned else {"empty_frame_period_s": 0},
        }
    )


def recorded(day: Day, settings: Config | None = None, minutes: int = MINUTES) -> list[Record]:
    """Return the log of a stretch of a day."""
    return _Node(day, settings or config()).run(minutes * 60)


class _Node:
    """The core, the link and a camera, with the time in one hand."""

    def __init__(self, day: Day, settings: Config) -> None:
        self._day = day
        self._aircraft = Circling(7, 60) if day.flying else Standing(7, 60)
        self._frame = LocalFrame(*HOME)
        self._settings = settings
        self._link = Session(
            settings.vehicle,
            self._place,
            lambda *_: None,
            lambda: True,
            arrival_tolerance_deg=1.0,
            peer=PEER,
            on_time=lambda _: None,
        )
        self._empties = Empties(settings.eyes.empty_frame_period_s)
        self._state = State()
        self._chance = random.Random(7)
        self._due: int | None = None
        self._orders = 0
        self._log: list[Record] = []

    def run(self, seconds: int) -> list[Record]:
        """Let time pass; return everything that was recorded."""
        for message in self._opening():
            self._take(0, message)
        for turn in range(round(seconds / TURN_S)):
            self._turn(round(turn * TURN_S * S))
        return self._log

    def _opening(self) -> Iterator[Message]:
        configuration = configuration_message(self._settings)
        yield FlightOpened(
            flight_id=FLIGHT_ID,
            flight_number=1,
            node="bench",
            node_public_key=bytes(32),
            logic=LOGIC,
            configuration=configuration,
        )
        yield BaselineCarried(state=CarriedState())
        yield NodeStarted(boot_id="bench", start=1)
        yield OriginSet(place=self._frame.place(*HOME), source="configured")

    def _turn(self, now_ns: int) -> None:
        self._aircraft.step(TURN_S)
        self._aircraft.meet(PEER)
        for _, datagram in self._aircraft.take():
            self._link.hear(now_ns, PEER, datagram)
        self._link.tick(now_ns)
        self._work_off(now_ns)
        while self._due is not None and self._due <= now_ns:
            self._take(now_ns, TimePassed())
        for message in self._world(now_ns):
            self._take(now_ns, message)

    def _work_off(self, now_ns: int) -> None:
        while items := self._link.take():
            for item in items:
                if isinstance(item, Transmit):
                    self._aircraft.hear(PEER, item.data)
                    if item.effect_seq is not None:
                        self._link.sent(item.effect_seq)
                elif isinstance(item, Report):
                    self._take(now_ns, item.observation)

    def _take(self, now_ns: int, message: Message) -> None:
        at = Moment(now_ns, 10**15 + now_ns, 1, 1_790_000_000 * S + now_ns, 2)
        made = step(self._state, make_record(self._state.next_seq.value, NO_CAUSE, at, message))
        self._log.extend(made.records)
        self._due = made.due
        for record in made.records:
            if record.kind.role is Role.EFFECT and record.kind.port == "vehicle":
                self._link.perform(now_ns, record.seq, record.message, now_ns + 5 * S)

    def _world(self, now_ns: int) -> Iterator[Message]:
        number = round(now_ns / S * FRAMES_A_SECOND)
        if self._day.camera and round(now_ns / S / TURN_S) % round(1 / FRAMES_A_SECOND / TURN_S) == 0:
            seen = self._seen(number, now_ns)
            if self._empties.news(seen):
                yield seen
        if self._day.flying and now_ns // S >= (self._orders + 1) * ORDERS_EVERY_S:
            self._orders += 1
            yield self._order()

    def _seen(self, number: int, now_ns: int) -> FrameObserved:
        """Return a frame; flying, there are people in a third of the stretches of ten seconds."""
        people = number % 4 + 1 if self._day.flying and number // 100 % 3 == 0 else 0
        seen = [detection((number // 100 * 4 + nth) % 40 * 997) for nth in range(people)]
        return FrameObserved(
            vehicle=1, camera=1, frame_seq=number, captured_ns=now_ns, latency_us=31_000, detections=seen
        )

    def _order(self) -> OrderReceived:
        place = self._place(
            HOME[0] + self._chance.uniform(-5e-4, 5e-4), HOME[1] + self._chance.uniform(-5e-4, 5e-4), 488.0
        )
        asked = PointAtPlaceOrder(camera=1, place=place)
        issuer = Issuer(principal_id="alice", callsign="ALICE", device_key_id=b"a" * 16, roles=["camera"])
        nonce = self._chance.randbytes(24)
        return OrderReceived(
            issuer=issuer,
            command_id=f"order-{self._orders:04d}-of-the-bench",
            body_digest=self._chance.randbytes(32),
            target_public_key=bytes(32),
            order_seq=self._orders,
            nonce=nonce,
            nonce_life_ms=45_000,
            life_ms=15_000,
            in_reply_to=self._chance.randbytes(32),
            issued_at_ms=1_790_000_000_000,
            point_at_place=asked,
        )

    def _place(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Place:
        return self._frame.place(latitude_deg, longitude_deg, altitude_m)
