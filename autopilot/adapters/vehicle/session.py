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
from autopilot.adapters.vehicle.attached import Attached
from autopilot.adapters.vehicle.commands import IN_PROGRESS, Send
from autopilot.adapters.vehicle.egress import (
    ATTITUDE,
    CURRENT,
    GIMBAL_ATTITUDE,
    GIMBAL_STATUS,
    GLOBAL_POSITION,
    GPS_RAW,
    HOME,
    LANDED,
    REQUEST_MESSAGE,
    SET_MESSAGE_INTERVAL,
    SYSTEM_STATUS,
    SYSTEM_TIME,
    Egress,
)
from autopilot.adapters.vehicle.heard import (
    Answer,
    Attitude,
    Battery,
    CameraInformation,
    CameraSettings,
    Current,
    Fix,
    Flown,
    GimbalAttitude,
    GimbalLimits,
    GimbalStatus,
    Heard,
    Heartbeat,
    Home,
    ItemCount,
    ItemGiven,
    ItemRequest,
    Landed,
    MissionAnswer,
    OfCamera,
    OfGimbal,
    Position,
    Reached,
    Reception,
    Rejected,
    Sender,
    SystemTime,
    Timesync,
    Transferred,
    Version,
)
from autopilot.adapters.vehicle.performing import ACCEPTED, NOBODY, Performing
from autopilot.adapters.vehicle.presence import Address, Presence, Vehicle
from autopilot.adapters.vehicle.reports import Reports
from autopilot.adapters.vehicle.telemetry import MakePlace, Telemetry
from autopilot.adapters.vehicle.timesync import Timing, is_question_to
from autopilot.adapters.vehicle.transfer import Say
from autopilot.adapters.vehicle.upkeep import Heart, Stream, Streams
from autopilot.ports.config import VehicleSection
from autopilot.ports.edges import InputClass
from events.schema.link_pb2 import VehicleIdentified
from events.schema.vehicle_pb2 import VehicleLinkChanged

_UPKEEP = (SET_MESSAGE_INTERVAL, REQUEST_MESSAGE)
_STREAM_OF: dict[type[Heard], int] = {
    Position: GLOBAL_POSITION,
    Attitude: ATTITUDE,
    GimbalAttitude: GIMBAL_ATTITUDE,
    Fix: GPS_RAW,
    SystemTime: SYSTEM_TIME,
    GimbalStatus: GIMBAL_STATUS,
    Reception: GPS_RAW,
    Battery: SYSTEM_STATUS,
    Current: CURRENT,
    Landed: LANDED,
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
        self._presence = Presence(settings)
        self._heart = Heart()
        self._streams = Streams()
        self._version = Stream(once=True)
        self._timing = Timing(settings.time_threshold_ms)
        self._home = Stream(once=True)
        self._attached = Attached(settings.gimbal_measures)
        self._known: Vehicle | None = None
        self._fixed = False
        self._out: list[Transmit | Report] = []
        self.reports = Reports(settings, place)
        self._performing = Performing(settings, self.reports)
        self.telemetry = Telemetry(settings, place, arrival_tolerance_deg, drift_deg)
        self.rejected: Counter[str] = Counter()

    def perform(self, now_ns: int, effect_seq: int, effect: Message, deadline_ns: int) -> None:
        """Take an effect; what comes of it is reported with its seq."""
        self._performing.submit(now_ns, effect_seq, effect, deadline_ns, self._attached.target_of(effect))
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
        self._performing.tick(now_ns)
        self._keep_up(now_ns)
        self._collect()

    def due_ns(self) -> int:
        """Return when `tick` must be called next."""
        dues = [self._heart.due_ns(), self._performing.due_ns(), self._presence.due_ns()]
        if self._known is not None:
            dues += [self._streams.due_ns(), self._attached.due_ns(), self._home.due_ns()]
            dues += [self._version.due_ns(), self._timing.due_ns()]
        return min(due for due in dues if due is not None)

    def sent(self, effect_seq: int) -> None:
        """Learn that the bytes of an effect left."""
        self._performing.sent(effect_seq)
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
                self._report(self.reports.heartbeat(now_ns, heard))
            case Answer():
                self._answered(now_ns, heard)
            case Position():
                self._first_fix(heard)
                self._report_telemetry(self.telemetry.position(now_ns, heard, armed=self.reports.armed))
            case Attitude():
                self.telemetry.attitude(now_ns, heard)
            case GimbalAttitude():
                self.reports.note(now_ns, "gimbal")
                known = self._known
                demanded = known is not None and self._attached.is_demand(self.reports.state, known.sender, heard)
                self._report_telemetry(self.telemetry.view(now_ns, heard, demanded=demanded))
            case Fix():
                self._first_fix(heard)
                self.reports.flown(now_ns, heard)
            case SystemTime():
                self._on_time(heard.wall_ms)
            case Timesync():
                self._timesync(now_ns, heard)
            case Version():
                self._identified(now_ns, heard)
            case GimbalLimits() | GimbalStatus() | CameraInformation() | CameraSettings():
                self._report(self._attached.hear(now_ns, heard, self._us))
                self._report(self._attached.described(now_ns, self.reports.state))
            case Battery() | Home() | Landed() | Current() | Reached() | Reception():
                self._flown(now_ns, heard)
            case ItemRequest() | MissionAnswer() | ItemCount() | ItemGiven():
                self._transferred(now_ns, heard)

    def _flown(self, now_ns: int, heard: Flown) -> None:
        self._report(self.reports.flown(now_ns, heard))
        if self.reports.home_is_told:
            self._home.heard(now_ns)

    def _transferred(self, now_ns: int, heard: Transferred) -> None:
        """Take a message of the mission protocol, where it is for this node."""
        if heard.target not in (self._us, NOBODY):
            self.rejected["mission of another"] += 1
        elif not self._performing.transferred(now_ns, heard):
            self.rejected["unmatched mission message"] += 1
        self._collect()

    def _first_fix(self, fix: Position | Fix) -> None:
        if not self._fixed:
            self._fixed = True
            self._on_first_fix(fix.latitude_e7 / 1e7, fix.longitude_e7 / 1e7, fix.altitude_mm / 1000)

    @property
    def _us(self) -> Sender:
        return Sender(system=self._presence.system, component=self._settings.component_id)

    def _identified(self, now_ns: int, version: Version) -> None:
        """Report what the autopilot says that it is, once each time that it comes."""
        state = self.reports.state
        if state is not None and self._version.due_ns() is not None:
            identified = VehicleIdentified(
                vehicle=1,
                autopilot=state.autopilot,
                vehicle_type=state.vehicle_type,
                capabilities=version.capabilities,
                software_version=version.software_version,
                board_version=version.board_version,
            )
            self._out.append(Report(InputClass.OUTCOME, identified))
        self._version.heard(now_ns)

    def _timesync(self, now_ns: int, heard: Timesync) -> None:
        """Answer a question that is for us, or take the vehicle's answer; others' talk of the time is their own."""
        vehicle, us = self._known, self._us
        if vehicle is None:
            return
        if is_question_to(us, heard):
            answer = self._egress.timesync(us.system, heard.sender, now_ns, heard.ts1_ns)
            self._out.append(Transmit(vehicle.peer, answer))
        elif heard.tc1_ns != 0 and heard.sender == vehicle.sender and heard.target in (us, NOBODY):
            compared = self._timing.hear(now_ns, heard)
            if isinstance(compared, str):
                self.rejected[compared] += 1
            else:
                self._report_telemetry(compared)

    def _answered(self, now_ns: int, answer: Answer) -> None:
        if answer.target not in (self._us, NOBODY):
            self.rejected["answer to another"] += 1
        elif answer.command not in _UPKEEP:
            order = self._performing.answered(now_ns, answer)
            if isinstance(order, str):
                self.rejected[order] += 1
            elif answer.result == ACCEPTED:
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
        self._performing.aim(None if vehicle is None else vehicle.sender)
        self._out.append(Report(InputClass.OUTCOME, VehicleLinkChanged(vehicle=1, up=vehicle is not None)))
        self.telemetry.begin()
        self.reports.begin()
        self._home.reset(now_ns)
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
        wanted = [*self._attached.wanted(now_ns), *([HOME] if self._home.tick(now_ns) else [])]
        for message_id in wanted:
            self._out.append(Transmit(vehicle.peer, self._egress.ask_message(system, message_id)))
        self._report(self._attached.described(now_ns, self.reports.state))

    def _report(self, observation: Message | None) -> None:
        """Offer what changed, as an outcome: one that is lost would never be said again."""
        if observation is not None:
            self._out.append(Report(InputClass.OUTCOME, observation))

    def _report_telemetry(self, observation: Message | None) -> None:
        if observation is not None:
            self._out.append(Report(InputClass.TELEMETRY, observation))

    def _collect(self) -> None:
        """Move what exchange and transfer want to the outputs, encoded."""
        for item in self._performing.take():
            if isinstance(item, Send):
                self._transmit(item)
            elif isinstance(item, Say):
                self._say(item)
            else:
                self._report(item)

    def _say(self, say: Say) -> None:
        peer = self.peer
        if peer is not None:
            self._out.append(Transmit(peer, self._egress.say(self._presence.system, say)))

    def _transmit(self, send: Send) -> None:
        order, peer = send.order, self.peer
        if peer is None or self._known is None:  # a vehicle that is lost is its own failsafe's business
            return
        if send.confirmation == 0 and not order.flight:
            self.telemetry.pointing.ask(order.effect_seq, order.effect)
        data = self._egress.effect(
            self._presence.system,
            send.target,
            order.effect,
            send.confirmation,
            form=send.form,
            kind=order.kind,
        )
        self._out.append(Transmit(peer, data, order.effect_seq))
