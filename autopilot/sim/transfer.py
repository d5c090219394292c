"""The vehicle's end of MAVLink's mission protocol, with the manners of ArduPilot or PX4 (`Rules`).

ArduPilot writes each item over the old mission as it comes and cuts that to the new length at
MISSION_COUNT: an upload that is refused or breaks off leaves a mixture, which it would fly. A refusal
doesn't end the upload; until it does, nobody may download. PX4 takes a mission as a whole or not at
all, and a refusal ends it. Time is an argument; what is to be sent is returned with its address.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from pymavlink.dialects.v20 import common as dialect

from autopilot.sim.extended import mission_ack, mission_count
from autopilot.sim.missions import Item, item_of

Address = tuple[str, int]
Sent = tuple[Address, Any]

ACCEPTED, ERROR, UNSUPPORTED_FRAME, UNSUPPORTED, NO_SPACE, INVALID = range(6)  # MAV_MISSION_RESULT
PARAM1, PARAM2, PARAM3, PARAM4, PARAM5_X, PARAM6_Y, PARAM7 = range(6, 13)
INVALID_SEQUENCE, DENIED, CANCELLED = 13, 14, 15

MISSION, ALL = 0, 255  # MAV_MISSION_TYPE


@dataclass(frozen=True, slots=True, kw_only=True)
class Rules:
    """How one kind of autopilot goes about it."""

    atomic: bool
    asks_by_int: bool
    retry_s: float
    timeout_s: float
    refusal_ends: bool
    tells_timeout: bool  # by an acknowledgement OPERATION_CANCELLED
    has_ids: bool  # opaque_id and mission_id
    capacity: int
    home_first: bool  # item 0 is home, whatever was sent
    judge: Callable[[Item, int], int]  # MAV_MISSION_RESULT of an item
    kept: Callable[[Item, int], Item]  # what is left of it


class Board(Protocol):
    """Where the mission lies."""

    @property
    def items(self) -> list[Item]:
        """The mission; written in place."""

    def home_item(self) -> Item:
        """Return the item that stands for home."""

    def loaded(self, current: int | None) -> None:
        """A whole mission was taken over; it marked an item as current, or none."""

    def busy(self) -> bool:
        """Whether the mission is being flown, so that it can't be cleared."""

    def say(self, text: str) -> None:
        """Tell by STATUSTEXT."""


@dataclass(slots=True)
class _Upload:
    peer: Address
    partner: tuple[int, int]
    count: int
    heard_s: float
    asked_s: float
    taken: list[Item]
    current: int | None = None


class Transfer:
    """One mission, one upload at a time, downloads as they are asked for."""

    def __init__(self, rules: Rules, board: Board) -> None:
        self.rules = rules
        self._board = board
        self._upload: _Upload | None = None
        self._handlers: dict[int, Callable[[float, Address, Any], list[Sent]]] = {
            dialect.MAVLINK_MSG_ID_MISSION_COUNT: self._count,
            dialect.MAVLINK_MSG_ID_MISSION_ITEM_INT: self._item,
            dialect.MAVLINK_MSG_ID_MISSION_ITEM: self._item,
            dialect.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: self._list,
            dialect.MAVLINK_MSG_ID_MISSION_REQUEST_INT: self._request,
            dialect.MAVLINK_MSG_ID_MISSION_REQUEST: self._request,
            dialect.MAVLINK_MSG_ID_MISSION_CLEAR_ALL: self._clear,
            dialect.MAVLINK_MSG_ID_MISSION_ACK: self._ack,
        }

    @property
    def mission_id(self) -> int:
        """The mission's id: of its items, never 0; 0 where there is no mission or no such thing as an id."""
        items = self._board.items
        if not self.rules.has_ids or not items:
            return 0
        packed = (struct.pack("<HBffffiif", item.command, item.frame, *item.parameters) for item in items)
        return zlib.crc32(b"".join(packed)) or 1

    def hear(self, now_s: float, peer: Address, message: Any) -> list[Sent]:
        """Take a message of the protocol; any other is nothing to it."""
        handler = self._handlers.get(message.get_msgId())
        if handler is None:
            return []
        if getattr(message, "mission_type", MISSION) not in (MISSION, ALL):
            wanted = message.get_msgId() != dialect.MAVLINK_MSG_ID_MISSION_ACK
            return [self._answer(peer, message, UNSUPPORTED)] if wanted else []
        return handler(now_s, peer, message)

    def tick(self, now_s: float) -> list[Sent]:
        """Ask again for what didn't come, and give up in time."""
        upload = self._upload
        if upload is None:
            return []
        if now_s - upload.heard_s >= self.rules.timeout_s:
            self._upload = None
            self._board.say("Mission upload timeout")
            ack = mission_ack(upload.partner, CANCELLED)
            return [(upload.peer, ack)] if self.rules.tells_timeout else []
        return self._ask(upload, now_s) if now_s - upload.asked_s >= self.rules.retry_s else []

    def forget(self) -> None:
        """Drop what is under way, as a reboot does."""
        self._upload = None

    def _count(self, now_s: float, peer: Address, message: Any) -> list[Sent]:
        partner = _sender(message)
        if self._upload is not None and self._upload.partner != partner:
            return [self._answer(peer, message, DENIED if self.rules.home_first else ERROR)]
        if message.count > self.rules.capacity:
            return [self._answer(peer, message, NO_SPACE)]
        if message.count == 0:
            return self._clear(now_s, peer, message)
        taken = [] if self.rules.atomic else self._board.items
        del taken[message.count :]
        self._upload = _Upload(peer, partner, message.count, now_s, now_s, taken)
        if not self.rules.atomic:
            self._seq = 0
        return self._ask(self._upload, now_s)

    _seq = 0  # the item that is asked for; where items are taken one by one this isn't their number

    def _next(self, upload: _Upload) -> int:
        return len(upload.taken) if self.rules.atomic else self._seq

    def _ask(self, upload: _Upload, now_s: float) -> list[Sent]:
        upload.asked_s = now_s
        by_int = self.rules.asks_by_int
        kind = dialect.MAVLink_mission_request_int_message if by_int else dialect.MAVLink_mission_request_message
        return [(upload.peer, kind(*upload.partner, self._next(upload), MISSION))]

    def _item(self, now_s: float, peer: Address, message: Any) -> list[Sent]:
        upload, partner = self._upload, _sender(message)
        if upload is None or upload.partner != partner:
            return [self._answer(peer, message, ERROR)]
        if message.seq != self._next(upload):
            return self._ask(upload, now_s) if self.rules.atomic else [self._answer(peer, message, INVALID_SEQUENCE)]
        item = item_of(message)
        result = ACCEPTED if self.rules.home_first and message.seq == 0 else self.rules.judge(item, message.seq)
        if result != ACCEPTED:
            if self.rules.refusal_ends:
                self._upload = None
            return [self._answer(peer, message, result)]
        upload.heard_s = now_s
        self._take(upload, item, message)
        if self._next(upload) < upload.count:
            return self._ask(upload, now_s)
        return self._complete(upload, message)

    def _take(self, upload: _Upload, item: Item, message: Any) -> None:
        seq = self._next(upload)
        kept = self._board.home_item() if self.rules.home_first and seq == 0 else self.rules.kept(item, seq)
        upload.taken[seq : seq + 1] = [kept]
        self._seq += 1
        if message.current:
            upload.current = seq

    def _complete(self, upload: _Upload, message: Any) -> list[Sent]:
        self._upload = None
        if self.rules.atomic:
            self._board.items[:] = upload.taken
        self._board.loaded(upload.current)
        return [self._answer(upload.peer, message, ACCEPTED, self.mission_id)]

    def _list(self, now_s: float, peer: Address, message: Any) -> list[Sent]:
        del now_s
        if self._upload is not None:
            return self._busy(peer, message)
        count = mission_count(_sender(message), len(self._board.items), MISSION, self.mission_id)
        return [(peer, count)]

    def _busy(self, peer: Address, message: Any) -> list[Sent]:
        """Somebody is uploading: PX4 says nothing about it but words."""
        if self.rules.home_first:
            return [self._answer(peer, message, DENIED)]
        self._board.say("Mission download request ignored, currently active")
        return []

    def _request(self, now_s: float, peer: Address, message: Any) -> list[Sent]:
        """Answer in the form that was asked for."""
        del now_s
        if self._upload is not None:
            return self._busy(peer, message)
        items = self._board.items
        if message.seq >= len(items):
            return [self._answer(peer, message, INVALID_SEQUENCE if self.rules.home_first else ERROR)]
        as_int = message.get_msgId() == dialect.MAVLINK_MSG_ID_MISSION_REQUEST_INT
        return [(peer, _told(items[message.seq], message.seq, _sender(message), as_int))]

    def _clear(self, now_s: float, peer: Address, message: Any) -> list[Sent]:
        del now_s
        if self.rules.home_first and self._board.busy():
            return [self._answer(peer, message, ERROR)]
        self._upload = None
        self._board.items.clear()
        self._board.loaded(None)
        return [self._answer(peer, message, ACCEPTED)]

    def _ack(self, now_s: float, peer: Address, message: Any) -> list[Sent]:
        """The end of a download, or a client that gives up its upload: PX4 lets go then, ArduPilot doesn't."""
        del now_s, peer
        upload = self._upload
        if upload is not None and upload.partner == _sender(message) and self.rules.atomic:
            self._upload = None
        return []

    def _answer(self, peer: Address, message: Any, result: int, opaque_id: int = 0) -> Sent:
        mission_type = getattr(message, "mission_type", MISSION)
        return peer, mission_ack(_sender(message), result, mission_type, opaque_id)


def _sender(message: Any) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


def _told(item: Item, seq: int, target: tuple[int, int], as_int: bool) -> Any:
    """Return an item as MISSION_ITEM_INT or, in float degrees, as MISSION_ITEM."""
    shared = (seq, item.frame, item.command, 0, 1, item.p1, item.p2, item.p3, item.p4)
    if as_int:
        return dialect.MAVLink_mission_item_int_message(*target, *shared, item.x, item.y, item.z, MISSION)
    return dialect.MAVLink_mission_item_message(*target, *shared, item.x / 1e7, item.y / 1e7, item.z, MISSION)
