"""The whole link without its socket: datagrams and effects in, datagrams and observations out.

Time is an argument. The owner calls one of `hear`, `perform` and `tick`, then works off `take()` in
order: sends each `Transmit` (and says `sent` where it did), offers each `Report`; it calls `tick`
again by `due_ns()`. What does not fit is counted by name in `rejected` and changes nothing else.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from google.protobuf.message import Message

from autopilot.adapters.vehicle import ingress
from autopilot.adapters.vehicle.attached import Attached, lane_of
from autopilot.adapters.vehicle.commands import IN_PROGRESS, Exchange, Order, Send
from autopilot.adapters.vehicle.egress import (
    ATTITUDE,
    COMMAND_OF,
    GIMBAL_ATTITUDE,
    GIMBAL_STATUS,
    GLOBAL_POSITION,
    GPS_RAW,
    REQUEST_MESSAGE,
    SET_MESSAGE_INTERVAL,
    SYSTEM_TIME,
    Egress,
    NotEncodable,
    check,
)
from autopilot.adapters.vehicle.heard import (
    Answer,
    Attitude,
    CameraInformation,
    CameraSettings,
    Fix,
    GimbalAttitude,
    GimbalLimits,
    GimbalStatus,
    Heard,
    Heartbeat,
    OfCamera,
    OfGimbal,
    Position,
    Rejected,
    Sender,
    SystemTime,
    Timesync,
    Version,
)
from autopilot.adapters.vehicle.presence import Address, Presence, Vehicle
from autopilot.adapters.vehicle.telemetry import MakePlace, Telemetry
from autopilot.adapters.vehicle.timesync import Timing, is_question_to
from autopilot.adapters.vehicle.upkeep import Heart, Stream, Streams
from autopilot.ports.config import VehicleSection
from autopilot.ports.edges import InputClass
from events.schema.link_pb2 import VehicleIdentified
from events.schema.vehicle_pb2 import VehicleLinkChanged, VehicleStateReported

MAV_RESULT_ACCEPTED = 0
_UPKEEP = (SET_MESSAGE_INTERVAL, REQUEST_MESSAGE)
_NOBODY = Sender(system=0, component=0)  # target of an answer from a peer that does not fill it in
_STREAM_OF: dict[type[Heard], int] = {
    Position: GLOBAL_POSITION,
    Attitude: ATTITUDE,
    GimbalAttitude: GIMBAL_ATTITUDE,
    Fix: GPS_RAW,
    SystemTime: SYSTEM_TIME,
    GimbalStatus: GIMBAL_STATUS,
}


@dataclass(frozen=True, slots=True)
class Transmit:
    """Bytes for a peer; `effect_seq` where they carry an effect."""

    peer: Address
    data: bytes
    effect_seq: int | None = None


@dataclass(frozen=True, slots=True)
class Report:
    """An observation for the node."""

    input_class: InputClass
    observation: Message


class Session:
    """One vehicle, one gimbal, one peer."""

    def __init__(
        self,
        settings: VehicleSection,
        place: MakePlace,
        on_first_fix: Callable[[float, float, float], None],
        healthy: Callable[[], bool],
        *,
        arrival_tolerance_deg: float,
        peer: Address | None,
        on_time: Callable[[int], None],
        admit: Callable[[bytes], str] = ingress.admit_all,
        drift_deg: float = 2.0,
    ) -> None:
        """`on_time` is told what time the vehicle says it is, in ms since 1970; `admit` judges frames (`ingress`)."""
        self._settings = settings
        self._on_time = on_time
        self._admit = admit
        self._on_first_fix = on_first_fix
        self._healthy = healthy
        self._configured_peer = peer
        self._egress = Egress(settings.component_id)
        self._exchange = Exchange(settings)
        self._presence = Presence(settings)
        self._heart = Heart()
        self._streams = Streams()
        self._version = Stream(once=True)
        self._timing = Timing(settings.time_threshold_ms)
        self._attached = Attached(settings.gimbal_measures)
        self._known: Vehicle | None = None
        self._state: VehicleStateReported | None = None
        self._fixed = False
        self._out: list[Transmit | Report] = []
        self.telemetry = Telemetry(settings, place, arrival_tolerance_deg, drift_deg)
        self.rejected: Counter[str] = Counter()

    def perform(self, now_ns: int, effect_seq: int, effect: Message, deadline_ns: int) -> None:
        """Take an effect; what comes of it is reported with its seq."""
        try:
            check(effect)
        except NotEncodable:
            self._exchange.refuse(effect_seq, "not encodable")
        else:
            order = Order(
                effect_seq=effect_seq,
                effect=effect,
                command=COMMAND_OF[type(effect)],
                gimbal=lane_of(effect),
                deadline_ns=deadline_ns,
                target=self._attached.target_of(effect),
            )
            self._exchange.submit(now_ns, order)
        self._collect()

    def hear(self, now_ns: int, peer: Address, datagram: bytes) -> None:
        """Take a datagram from whoever sent it."""
        if self.peer is not None and peer != self.peer:
            self.rejected["foreign peer"] += 1
            return
        for item in ingress.read(datagram, self._admit):
            if isinstance(item, Rejected):
                self.rejected[item.because] += 1
            else:
                self._heard(now_ns, peer, item)
        self._follow(now_ns)

    def tick(self, now_ns: int) -> None:
        """Do what is due."""
        self._presence.tick(now_ns)
        self._follow(now_ns)
        self._exchange.tick(now_ns)
        self._keep_up(now_ns)
        self._collect()

    def due_ns(self) -> int:
        """Return when `tick` must be called next."""
        dues = [self._heart.due_ns(), self._exchange.due_ns(), self._presence.due_ns()]
        if self._known is not None:
            dues += [self._streams.due_ns(), self._attached.due_ns()]
            dues += [self._version.due_ns(), self._timing.due_ns()]
        return min(due for due in dues if due is not None)

    def sent(self, effect_seq: int) -> None:
        """Learn that the bytes of an effect left."""
        self._exchange.sent(effect_seq)
        self._collect()

    def take(self) -> list[Transmit | Report]:
        """Return what is to be sent and offered, in order, and forget it."""
        out, self._out = self._out, []
        return out

    @property
    def limits(self) -> GimbalLimits | None:
        """How far the gimbal turns, once it told."""
        return self._attached.limits

    @property
    def peer(self) -> Address | None:
        """The only address that is listened and spoken to; None while anybody may be it."""
        if self._configured_peer is not None:
            return self._configured_peer
        return None if self._presence.vehicle is None else self._presence.vehicle.peer

    def _heard(self, now_ns: int, peer: Address, heard: Heard) -> None:
        if isinstance(heard, Heartbeat):
            self._presence.hear(now_ns, heard, peer)
            self._follow(now_ns)
        vehicle = self._presence.vehicle
        if vehicle is None or heard.sender.system != vehicle.sender.system:
            self.rejected["foreign system"] += 1
        elif isinstance(heard, OfGimbal | OfCamera | Answer | Timesync) or heard.sender == vehicle.sender:
            self._from_vehicle(now_ns, heard)
        else:
            self.rejected["foreign component"] += 1

    def _from_vehicle(self, now_ns: int, heard: Heard) -> None:
        if type(heard) in _STREAM_OF:
            self._streams.heard(now_ns, _STREAM_OF[type(heard)])
        match heard:
            case Heartbeat():
                self._state_is(heard)
            case Answer():
                self._answered(now_ns, heard)
            case Position():
                self._first_fix(heard)
                self._report_telemetry(self.telemetry.position(now_ns, heard))
            case Attitude():
                self.telemetry.attitude(now_ns, heard)
            case GimbalAttitude():
                known = self._known
                demanded = known is not None and self._attached.is_demand(self._state, known.sender, heard)
                self._report_telemetry(self.telemetry.view(now_ns, heard, demanded=demanded))
            case Fix():
                self._first_fix(heard)
            case SystemTime():
                self._on_time(heard.wall_ms)
            case Timesync():
                self._timesync(now_ns, heard)
            case Version():
                self._identified(now_ns, heard)
            case GimbalLimits() | GimbalStatus() | CameraInformation() | CameraSettings():
                self._report_news(self._attached.hear(now_ns, heard, self._us()))
                self._report_news(self._attached.described(now_ns, self._state))

    def _us(self) -> Sender:
        return Sender(system=self._presence.system, component=self._settings.component_id)

    def _first_fix(self, fix: Position | Fix) -> None:
        if not self._fixed:
            self._fixed = True
            self._on_first_fix(fix.latitude_e7 / 1e7, fix.longitude_e7 / 1e7, fix.altitude_mm / 1000)

    def _state_is(self, heartbeat: Heartbeat) -> None:
        """Report the state when it changed. As an outcome: one that is lost would never be said again."""
        state = VehicleStateReported(
            vehicle=1,
            system_id=heartbeat.sender.system,
            autopilot=heartbeat.autopilot,
            vehicle_type=heartbeat.vehicle_type,
            armed=heartbeat.armed,
            custom_mode=heartbeat.custom_mode,
        )
        if state != self._state:
            self._state = state
            self._out.append(Report(InputClass.OUTCOME, state))

    def _identified(self, now_ns: int, version: Version) -> None:
        """Report what the autopilot says that it is, once each time that it comes."""
        if self._state is not None and self._version.due_ns() is not None:
            identified = VehicleIdentified(
                vehicle=1,
                autopilot=self._state.autopilot,
                vehicle_type=self._state.vehicle_type,
                capabilities=version.capabilities,
                software_version=version.software_version,
                board_version=version.board_version,
            )
            self._out.append(Report(InputClass.OUTCOME, identified))
        self._version.heard(now_ns)

    def _timesync(self, now_ns: int, heard: Timesync) -> None:
        """Answer a question that is for us, or take the vehicle's answer; others' talk of the time is their own."""
        vehicle, us = self._known, Sender(system=self._presence.system, component=self._settings.component_id)
        if vehicle is None:
            return
        if is_question_to(us, heard):
            answer = self._egress.timesync(us.system, heard.sender, now_ns, heard.ts1_ns)
            self._out.append(Transmit(vehicle.peer, answer))
        elif heard.tc1_ns != 0 and heard.sender == vehicle.sender and heard.target in (us, _NOBODY):
            compared = self._timing.hear(now_ns, heard)
            if isinstance(compared, str):
                self.rejected[compared] += 1
            else:
                self._report_telemetry(compared)

    def _answered(self, now_ns: int, answer: Answer) -> None:
        if answer.target not in (self._us(), _NOBODY):
            self.rejected["answer to another"] += 1
        elif answer.command not in _UPKEEP:
            order = self._exchange.hear(now_ns, answer)
            if order is None:
                self.rejected["unmatched answer"] += 1
            elif answer.result == MAV_RESULT_ACCEPTED:
                self.telemetry.say_again()
                self._attached.accepted(now_ns, order.effect)
            elif answer.result != IN_PROGRESS:
                self.telemetry.pointing.drop(order.effect_seq)
        self._collect()

    def _follow(self, now_ns: int) -> None:
        """Notice that the vehicle came or went."""
        vehicle = self._presence.vehicle
        if vehicle == self._known:
            return
        self._known = vehicle
        self._exchange.aim(None if vehicle is None else vehicle.sender)
        self._out.append(Report(InputClass.OUTCOME, VehicleLinkChanged(vehicle=1, up=vehicle is not None)))
        self.telemetry.begin()
        if vehicle is None:
            self._state = None
        self._streams.reset(now_ns)
        self._attached.reset(now_ns)
        self._version.reset(now_ns)
        self._timing.reset(now_ns)

    def _keep_up(self, now_ns: int) -> None:
        """Heartbeat and stream requests."""
        peer, vehicle, system = self.peer, self._known, self._presence.system
        if self._heart.tick(now_ns) and peer is not None and self._healthy():
            self._out.append(Transmit(peer, self._egress.heartbeat(system)))
        if vehicle is None:
            return
        for message_id in self._streams.tick(now_ns):
            self._out.append(Transmit(vehicle.peer, self._egress.ask_stream(system, vehicle.sender, message_id)))
        if self._version.tick(now_ns):
            self._out.append(Transmit(vehicle.peer, self._egress.ask_version(system, vehicle.sender)))
        if (ts1_ns := self._timing.ask(now_ns)) is not None:
            self._out.append(Transmit(vehicle.peer, self._egress.timesync(system, vehicle.sender, 0, ts1_ns)))
        for message_id in self._attached.wanted(now_ns):
            self._out.append(Transmit(vehicle.peer, self._egress.ask_message(system, message_id)))
        self._report_news(self._attached.described(now_ns, self._state))

    def _report_news(self, observation: Message | None) -> None:
        """Report what would never be said again if it was lost."""
        if observation is not None:
            self._out.append(Report(InputClass.OUTCOME, observation))

    def _report_telemetry(self, observation: Message | None) -> None:
        if observation is not None:
            self._out.append(Report(InputClass.TELEMETRY, observation))

    def _collect(self) -> None:
        """Move what the exchange wants to the outputs, encoded."""
        for item in self._exchange.take():
            if isinstance(item, Send):
                self._transmit(item)
            else:
                self._out.append(Report(InputClass.OUTCOME, item))

    def _transmit(self, send: Send) -> None:
        order, peer = send.order, self.peer
        if peer is None or self._known is None:  # a vehicle that is lost is its own failsafe's business
            return
        if send.confirmation == 0:
            self.telemetry.pointing.ask(order.effect_seq, order.effect)
        data = self._egress.effect(self._presence.system, send.target, order.effect, send.confirmation)
        self._out.append(Transmit(peer, data, order.effect_seq))
