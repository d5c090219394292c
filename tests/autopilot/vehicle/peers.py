"""Vehicles that take missions, as ArduPilot and PX4 do, with faults; and a network that loses, repeats and delays.

Plain values on both sides, time as an argument, chance from a seed. Written after what is known of each autopilot, not
after the code that it tests: what a peer gives back is its own arithmetic.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from random import Random

from google.protobuf.message import Message

from autopilot.adapters.vehicle.heard import (
    Item,
    ItemCount,
    ItemGiven,
    ItemRequest,
    MissionAnswer,
    Sender,
    Transferred,
)
from autopilot.adapters.vehicle.mission_form import given
from autopilot.adapters.vehicle.modes import Family
from autopilot.adapters.vehicle.transfer import Say, Transfer, Upload, Word
from autopilot.ports.config import VehicleSection
from events.schema.mission_pb2 import MissionUploaded, MissionUploadFailed
from tests.autopilot.vehicle.vehicles import plan

VEHICLE, NODE = Sender(system=1, component=1), Sender(system=1, component=191)
MS, S = 1_000_000, 1_000_000_000
OLD = (Item(seq=0, frame=3, command=16, current=False, goes_on=True, parameters=(0, 0, 0, 0), x=7, y=7, z=7.0),)


@dataclass(slots=True)
class Faults:
    """What is wrong with a vehicle."""

    refuses: int = -1  # item that it never takes
    alters: int = -1  # item that it stores otherwise than given
    stops_at: int = -1  # item from which on it accepts early and stores no more
    miscounts: bool = False  # it lists one item too few
    no_clear: bool = False  # it flies, and refuses to be cleared
    mute: frozenset[Word] = frozenset()  # what it never answers


@dataclass(slots=True)
class Peer:
    """A vehicle and its mission."""

    family: Family
    faults: Faults = field(default_factory=Faults)
    mission: list[Item] = field(default_factory=lambda: list(OLD))
    opaque_id: int = 0
    _count: int | None = None  # of an upload that it receives
    _next: int = 0
    _staged: list[Item] = field(default_factory=list)
    _heard_ns: int = 0
    _asked_ns: int = 0

    def hear(self, now_ns: int, say: Say) -> list[Transferred]:
        """Take a message and return the answers."""
        if say.word in self.faults.mute:
            return []
        match say.word:
            case Word.COUNT:
                return self._offered(now_ns, say.number)
            case Word.ITEM:
                assert say.item is not None
                return self._given(now_ns, say.item)
            case Word.LIST:
                count = len(self.mission) - self.faults.miscounts
                return [ItemCount(sender=VEHICLE, target=NODE, count=count, opaque_id=self.opaque_id)]
            case Word.REQUEST:
                return self._asked(say.number)
            case Word.CLEAR:
                return self._cleared()
        return []

    def tick(self, now_ns: int) -> list[Transferred]:
        """Ask again each second; after 8 s give the upload up."""
        if self._count is None:
            return []
        if now_ns - self._heard_ns > 8 * S:
            self._count = None
            return [self._answer(15)]
        if now_ns - self._asked_ns >= S:
            self._asked_ns = now_ns
            return [self._request()]
        return []

    def _offered(self, now_ns: int, count: int) -> list[Transferred]:
        self._count, self._next, self._staged, self._heard_ns, self._asked_ns = count, 0, [], now_ns, now_ns
        if self.family is not Family.PX4:
            self.mission = self.mission[:count]
        return [self._request()]

    def _given(self, now_ns: int, item: Item) -> list[Transferred]:
        if self._count is None:
            return [self._answer(1)]
        if item.seq != self._next:
            return [self._request()] if self.family is Family.PX4 else [self._answer(13)]
        self._heard_ns = self._asked_ns = now_ns
        if item.seq == self.faults.refuses:
            if self.family is Family.PX4:
                self._count = None
            return [self._answer(3)]
        self._store(_altered(item) if item.seq == self.faults.alters else item)
        self._next += 1
        if self._next == self._count or self._next == self.faults.stops_at:
            return self._whole()
        return [self._request()]

    def _store(self, item: Item) -> None:
        if self.family is Family.PX4:
            self._staged.append(item)
        else:
            self.mission[item.seq : item.seq + 1] = [item]

    def _whole(self) -> list[Transferred]:
        self._count = None
        if self.family is Family.PX4:
            self.mission, self.opaque_id = self._staged, self.opaque_id + 1
        return [self._answer(0)]

    def _asked(self, number: int) -> list[Transferred]:
        if self._count is not None or number >= len(self.mission):
            return [self._answer(14)]
        return [ItemGiven(sender=VEHICLE, target=NODE, item=self._kept(self.mission[number]))]

    def _cleared(self) -> list[Transferred]:
        if self.faults.no_clear:
            return [self._answer(14)]
        self.mission, self._count = [], None
        return [self._answer(0)]

    def _kept(self, item: Item) -> Item:
        """Return an item as this autopilot gives it back."""
        one, two, three, four = item.parameters
        located = item.command in (16, 21, 22)
        if self.family is Family.PX4:
            if not located:
                return item
            return replace(item, frame=6, parameters=(one if item.command == 16 else 0.0, two, 0.0, four))
        if not located:
            speed = item.command == 178
            kept = (float(int(one)), two, three, 0.0) if speed else (0.0, 0.0, 0.0, 0.0)
            return replace(item, frame=0, parameters=kept, x=0, y=0, z=0.0, goes_on=True)
        fourth = 1.0 if item.command == 21 else 0.0
        height_m = math.trunc(item.z * 100) / 100
        return replace(item, parameters=(float(int(one)), 0.0, 0.0, fourth), z=height_m, goes_on=True)

    def _request(self) -> ItemRequest:
        return ItemRequest(sender=VEHICLE, target=NODE, seq=self._next)

    def _answer(self, result: int) -> MissionAnswer:
        opaque_id = self.opaque_id if result == 0 else 0
        return MissionAnswer(sender=VEHICLE, target=NODE, result=result, opaque_id=opaque_id)


def _altered(item: Item) -> Item:
    if item.command in (16, 21, 22):
        return replace(item, z=item.z + 5)
    return replace(item, parameters=(item.parameters[0], item.parameters[1] + 5, *item.parameters[2:]))


@dataclass(slots=True)
class Network:
    """Between a transfer and a peer."""

    seed: int = 0
    loss: float = 0.0
    twice: float = 0.0
    late_ms: int = 0  # each message by a random part of it, so they overtake each other

    def run(self, transfer: Transfer, peer: Peer, seconds: int = 200) -> list[Message]:
        """Run for so long and return what the transfer reported."""
        chance = Random(self.seed)
        queue: list[tuple[int, int, Callable[[int], None]]] = []
        reports: list[Message] = []

        def post(now_ns: int, deliver: Callable[[int], None]) -> None:
            for _ in range(2 if chance.random() < self.twice else 1):
                if chance.random() >= self.loss:
                    late_ns = round(chance.random() * self.late_ms * MS) + MS
                    heapq.heappush(queue, (now_ns + late_ns, len(reports) + chance.getrandbits(40), deliver))

        def hear(message: Transferred, at_ns: int) -> None:
            transfer.hear(at_ns, message)

        def obey(say: Say, at_ns: int) -> None:
            to_node(at_ns, peer.hear(at_ns, say))

        def to_node(now_ns: int, messages: Sequence[Transferred]) -> None:
            for message in messages:
                post(now_ns, partial(hear, message))

        def work_off(now_ns: int) -> None:
            for item in transfer.take():
                if isinstance(item, Say):
                    post(now_ns, partial(obey, item))
                else:
                    reports.append(item)

        now_ns = 0
        while now_ns < seconds * S:
            work_off(now_ns)
            dues = [transfer.due_ns(), queue[0][0] if queue else None, (now_ns // (S // 4) + 1) * (S // 4)]
            now_ns = max(now_ns, min(due for due in dues if due is not None))
            while queue and queue[0][0] <= now_ns:
                heapq.heappop(queue)[2](now_ns)
            transfer.tick(now_ns)
            to_node(now_ns, peer.tick(now_ns))
        return reports


def uploading(family: Family, *, life_s: int = 120, settings: VehicleSection | None = None) -> tuple[Transfer, Upload]:
    """Return a transfer that has begun to upload the plan, and the upload."""
    transfer = Transfer(settings or VehicleSection())
    upload = Upload(effect_seq=5, items=given(plan(), family), family=family, target=VEHICLE, deadline_ns=life_s * S)
    transfer.begin(0, upload)
    return transfer, upload


def outcome(reports: list[Message]) -> MissionUploaded | MissionUploadFailed:
    """Return the one report that there is."""
    (report,) = reports
    assert isinstance(report, MissionUploaded | MissionUploadFailed)
    assert report.effect_seq == 5
    return report
