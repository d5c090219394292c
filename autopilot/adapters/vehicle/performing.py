"""Effects to the protocol that performs them: commands to `commands`, an upload to `transfer`; why one can't be.

What can't be performed is refused at once and by name, and never leaves. It looks at what the vehicle said of itself
(`reports`): its kind, and whether it is armed. No socket, no clock, no decision about the flight.
"""

from __future__ import annotations

from google.protobuf.message import Message

from autopilot.adapters.vehicle.commands import Exchange, Send
from autopilot.adapters.vehicle.egress import check
from autopilot.adapters.vehicle.flight_words import NotEncodable
from autopilot.adapters.vehicle.heard import Answer, Sender, Transferred
from autopilot.adapters.vehicle.mission_form import Unflyable, given
from autopilot.adapters.vehicle.modes import Kind
from autopilot.adapters.vehicle.orders import IN_THE_AIR, Order, order_of
from autopilot.adapters.vehicle.reports import Reports
from autopilot.adapters.vehicle.transfer import Say, Transfer, Upload
from autopilot.ports.config import VehicleSection
from events.schema.mission_pb2 import ArmVehicle, SetMissionItem, StartMission, UploadMission

NOBODY = Sender(system=0, component=0)  # target of a trial, and of an answer from a peer that does not fill it in
ACCEPTED = 0  # MAV_RESULT


class Performing:
    """What is performed on one link."""

    def __init__(self, settings: VehicleSection, reports: Reports) -> None:
        self._items_max = settings.mission_items_max
        self._reports = reports
        self._exchange = Exchange(settings)
        self._transfer = Transfer(settings)
        self._vehicle: Sender | None = None

    def aim(self, vehicle: Sender | None) -> None:
        """Say which autopilot it is; None while there is no vehicle."""
        self._vehicle = vehicle
        self._exchange.aim(vehicle)

    def submit(
        self, now_ns: int, effect_seq: int, effect: Message, deadline_ns: int, target: Sender | None = None
    ) -> None:
        """Take an effect; what comes of it is reported with its seq. `target` is another than the autopilot."""
        if isinstance(effect, UploadMission):
            because = self._upload(now_ns, effect_seq, effect, deadline_ns)
            if because:
                self._transfer.refuse(effect_seq, because)
        elif because := self._unfit(effect):
            self._exchange.refuse(effect_seq, because)
        else:
            self._exchange.submit(now_ns, order_of(effect_seq, effect, deadline_ns, self._reports.kind, target))

    def answered(self, now_ns: int, answer: Answer) -> Order | str:
        """Return the order that it answers, or the name of a rejection."""
        order = self._exchange.hear(now_ns, answer)
        if isinstance(order, Order) and (answer.result == ACCEPTED or order.has_message(answer.result)):
            self._accepted(order.effect)
        return order

    def transferred(self, now_ns: int, heard: Transferred) -> bool:
        """Take a message of the mission protocol; False where it answers nothing that is under way."""
        return self._transfer.hear(now_ns, heard)

    def sent(self, effect_seq: int) -> None:
        """Learn that the bytes of a command left."""
        self._exchange.sent(effect_seq)

    def tick(self, now_ns: int) -> None:
        """Do what is due."""
        self._exchange.tick(now_ns)
        self._transfer.tick(now_ns)

    def due_ns(self) -> int | None:
        """Return when `tick` must be called next, or None."""
        dues = (self._exchange.due_ns(), self._transfer.due_ns())
        return min((due for due in dues if due is not None), default=None)

    def take(self) -> list[Send | Say | Message]:
        """Return what is to be sent and reported, in order, and forget it."""
        return [*self._exchange.take(), *self._transfer.take()]

    def _unfit(self, effect: Message) -> str:
        """Return why an effect can't be said to this vehicle; empty where it can."""
        if self._vehicle is None:
            kind: Kind | None = Kind(autopilot=3, vehicle_type=2)  # as good as any: nothing leaves
        else:
            kind = self._reports.kind
            if isinstance(effect, IN_THE_AIR) and not self._reports.armed:
                return "disarmed"
        try:
            check(effect, kind)
        except NotEncodable:
            return "not encodable"
        return ""

    def _upload(self, now_ns: int, effect_seq: int, effect: UploadMission, deadline_ns: int) -> str:
        """Begin an upload; return why it can't be, or nothing."""
        vehicle, kind = self._vehicle, self._reports.kind
        if vehicle is None or kind is None:
            return "no vehicle"
        if self._transfer.busy:
            return "another upload is under way"
        if effect.vehicle != 1 or len(effect.items) > self._items_max:
            return f"vehicle {effect.vehicle}, {len(effect.items)} items: vehicle 1 takes {self._items_max}"
        try:
            items = given(effect.items, kind.family)
        except Unflyable as unflyable:
            return str(unflyable)
        self._reports.mission_begins()
        self._transfer.begin(
            now_ns,
            Upload(effect_seq=effect_seq, items=items, family=kind.family, target=vehicle, deadline_ns=deadline_ns),
        )
        return ""

    def _accepted(self, effect: Message) -> None:
        """Know at once what the next heartbeat will tell, and what begins."""
        if isinstance(effect, ArmVehicle):
            self._reports.armed = True
        elif isinstance(effect, StartMission | SetMissionItem):
            self._reports.mission_begins()
