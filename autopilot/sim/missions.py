"""A mission on board: its items, and the runner that flies them one after the other.

Items that are places or take time are NAV items; all others are DO items, which are done at once
when the NAV item before them is over. Which of them are told as reached differs between autopilots
(`Manner`): ArduPilot tells of a waypoint and the DO items behind it only the last; PX4 tells each of
them. A place of zeros is where the aircraft is. Jumps (DO_JUMP) aren't flown. Nothing here knows how
a mission came on board (`transfer.py`) or how a body moves (`flight.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Protocol

from pymavlink.dialects.v20 import common as dialect

from autopilot.geo import LocalFrame
from autopilot.sim.flight import STEP_S, Down, Fly, Frame, Rest, Rise, Stay, Wish

WAYPOINT, LOITER_FOREVER, LOITER_TURNS, LOITER_TIME, RETURN, LAND, TAKE_OFF = 16, 17, 18, 19, 20, 21, 22
SPLINE, DELAY = 82, 93
PLACES = frozenset({WAYPOINT, LOITER_FOREVER, LOITER_TURNS, LOITER_TIME, LAND, TAKE_OFF, SPLINE})
NAV = PLACES | {RETURN, DELAY}
SPEED, ROI_PLACE, ROI_OLD, ROI_NONE = 178, 195, 201, 197
ABOVE_SEA = frozenset({0, 5, 2})  # MAV_FRAME_GLOBAL, _GLOBAL_INT, and _MISSION, which ArduPilot takes for it
TURN_S = 20.0  # a multirotor's turn about a point takes as long as this, standing
_NAMES = {
    WAYPOINT: "WP",
    LOITER_FOREVER: "LoitUnlim",
    LOITER_TURNS: "LoitTurns",
    LOITER_TIME: "LoitTime",
    RETURN: "RTL",
    LAND: "Land",
    TAKE_OFF: "Takeoff",
    SPLINE: "SplineWP",
    DELAY: "Delay",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """A mission item as MISSION_ITEM_INT has it; x and y are 1e-7 degrees where it has a place."""

    command: int
    frame: int = 3
    p1: float = 0.0
    p2: float = 0.0
    p3: float = 0.0
    p4: float = 0.0
    x: int = 0
    y: int = 0
    z: float = 0.0

    @property
    def parameters(self) -> tuple[float, float, float, float, int, int, float]:
        """All seven, in order."""
        return self.p1, self.p2, self.p3, self.p4, self.x, self.y, self.z

    def point_m(self, home: LocalFrame) -> tuple[float, float, float]:
        """Return east, north and up in metres from home. Raises ValueError for what isn't on the Earth."""
        place = home.place_e7(self.x, self.y, 0)
        up_m = self.z - home.altitude_m if self.frame in ABOVE_SEA else self.z
        return place.east_mm / 1000, place.north_mm / 1000, up_m


@dataclass(frozen=True, slots=True)
class Manner:
    """How an autopilot goes through a mission."""

    first: int  # index of the first item to fly: 1 where item 0 is home
    tells_each: bool  # each item as reached, and no words


class Craft(Protocol):
    """What a runner asks of the aircraft and may change of it."""

    frame: Frame
    home: LocalFrame
    speed_m_s: float | None

    @property
    def seen_m(self) -> tuple[float, float, float]:
        """Where the autopilot believes that it is."""

    @property
    def grounded(self) -> bool:
        """Whether it stands on the ground."""

    def say(self, text: str) -> None:
        """Tell by STATUSTEXT."""

    def reach(self, seq: int) -> None:
        """Tell that an item was reached."""

    def do(self, item: Item) -> None:
        """Do a DO item."""

    def homeward(self, fresh: bool) -> Wish:
        """Return what a return to home wishes; fresh where it begins."""


@dataclass(slots=True)
class Runner:
    """Flies `items`; edit them as an upload does, then `restart`."""

    manner: Manner
    items: list[Item] = field(default_factory=list)
    current: int = 0
    running: bool = False
    finished: bool = False
    _begin_at: int | None = None  # where to go on
    _item: Item | None = None  # that is flown, whatever is uploaded meanwhile
    _from_m: tuple[float, float] | None = None
    _there_s: float | None = None  # how long it has been where it was to be
    _fresh: bool = True

    def reset(self) -> None:
        """Forget how far it went, as on the ground after a flight."""
        self.running = self.finished = False
        self.current, self._begin_at, self._from_m = 0, None, None

    def start(self, craft: Craft) -> None:
        """Begin, or go on where it was interrupted."""
        self.running, self.finished = True, False
        begin_at = self.manner.first if self._begin_at is None else self._begin_at
        self._enter(craft, begin_at)

    def interrupt(self) -> None:
        """Another mode flies from now on; the item is kept for later."""
        self.running = False
        self._from_m = None

    def restart(self, craft: Craft) -> None:
        """Begin the current item anew, as after an upload in flight."""
        if self.running:
            self._from_m = None
            self._enter(craft, max(self.current, self.manner.first))

    def choose(self, craft: Craft, seq: int) -> bool:
        """Make an item the current one; say whether there is such an item."""
        if not 0 <= seq < max(len(self.items), 1):
            return False
        self._begin_at = max(seq, self.manner.first)
        self.finished = False
        if self.running:
            self._from_m = None
            self._enter(craft, self._begin_at)
        else:
            self.current = seq
        return True

    def starts_with_take_off(self) -> bool:
        """Whether the first NAV item leaves the ground."""
        nav = (item.command for item in self.items[self.manner.first :] if item.command in NAV)
        return next(nav, None) == TAKE_OFF

    def step(self, craft: Craft) -> Wish:
        """Return what the current item wishes; goes on to the next one where it is over."""
        item = self._item
        if item is None or self.finished or not self.running:
            return _stay_here(craft)
        if self._over(craft, item):
            self._pass(craft, item)
            return self.step(craft)
        wish = self._wish(craft, item)
        self._fresh = False
        return wish

    def _pass(self, craft: Craft, item: Item) -> None:
        """The current item is over."""
        seq = self.current
        if not self.manner.tells_each:
            craft.say(f"Reached command #{seq}")
        self._from_m = item.point_m(craft.home)[:2] if item.command in (WAYPOINT, SPLINE) else None
        self._enter(craft, seq + 1, reached=seq)

    def _enter(self, craft: Craft, seq: int, reached: int | None = None) -> None:
        """Do the DO items from here on, and begin the next NAV item."""
        told = [] if reached is None else [reached]
        while seq < len(self.items) and self.items[seq].command not in NAV:
            craft.do(self.items[seq])
            told.append(seq)
            seq += 1
        for one in told if self.manner.tells_each else told[-1:]:
            craft.reach(one)
        self._there_s, self._fresh = None, True
        self.finished = seq >= len(self.items)
        self._begin_at = None if self.finished else seq
        self._item = None if self.finished else _placed(self.items[seq], craft)
        if not self.finished:
            self.current = seq
            if not self.manner.tells_each:
                craft.say(f"Mission: {seq} {_NAMES[self.items[seq].command]}")

    def _over(self, craft: Craft, item: Item) -> bool:
        """Whether an item is done."""
        if item.command in (LOITER_FOREVER, RETURN, LAND):
            return False
        if item.command == TAKE_OFF:
            return craft.seen_m[2] >= item.point_m(craft.home)[2] - 0.5
        if self._there_s is None and not self._fresh and self._arrived(craft, item):
            self._there_s = 0.0
        if self._there_s is None:
            return False
        self._there_s += STEP_S
        return self._there_s > self._wait_s(craft, item)

    def _arrived(self, craft: Craft, item: Item) -> bool:
        """Whether the place of an item is reached, or passed."""
        if item.command == DELAY:
            return True
        east_m, north_m, up_m = item.point_m(craft.home)
        at_m = craft.seen_m
        away_m = math.hypot(east_m - at_m[0], north_m - at_m[1])
        if craft.frame.hovers:
            return away_m <= craft.frame.near_m and abs(up_m - at_m[2]) < 1.0
        start_m = self._from_m
        passed = start_m is not None and _passed(start_m, (east_m, north_m), at_m)
        loiters = item.command in (LOITER_TURNS, LOITER_TIME)
        return away_m <= (4 * craft.frame.near_m if loiters else craft.frame.near_m) or (passed and not loiters)

    def _wait_s(self, craft: Craft, item: Item) -> float:
        """How long an item wants the aircraft to stay where it is."""
        if item.command == LOITER_TURNS:
            return item.p1 * TURN_S
        if item.command in (LOITER_TIME, DELAY):
            return item.p1
        return item.p1 if craft.frame.hovers and item.p1 > 0 else 0.0

    def _wish(self, craft: Craft, item: Item) -> Wish:
        if item.command == RETURN:
            return craft.homeward(self._fresh)
        if item.command == DELAY:
            return _stay_here(craft)
        east_m, north_m, up_m = item.point_m(craft.home)
        if item.command == LAND:
            return self._land(craft, east_m, north_m)
        if item.command == TAKE_OFF:
            return Rise(up_m=up_m)
        speed_m_s = craft.speed_m_s or craft.frame.cruise_m_s
        if self._there_s is not None or (item.command != WAYPOINT and self._arrived(craft, item)):
            return Stay(east_m=east_m, north_m=north_m, up_m=up_m, speed_m_s=speed_m_s)
        if self._from_m is None:
            self._from_m = craft.seen_m[:2]
        stops = item.command not in (WAYPOINT, SPLINE) or item.p1 > 0
        return Fly(start_m=self._from_m, east_m=east_m, north_m=north_m, up_m=up_m, speed_m_s=speed_m_s, stops=stops)

    def _land(self, craft: Craft, east_m: float, north_m: float) -> Wish:
        """Fly over the place, then come down."""
        at_m = craft.seen_m
        if craft.frame.hovers and self._there_s is None:
            if math.hypot(east_m - at_m[0], north_m - at_m[1]) > craft.frame.near_m:
                speed_m_s = craft.speed_m_s or craft.frame.cruise_m_s
                start_m = self._from_m or at_m[:2]
                return Fly(start_m=start_m, east_m=east_m, north_m=north_m, up_m=at_m[2], speed_m_s=speed_m_s)
            self._there_s = 0.0
        return Down(east_m=east_m, north_m=north_m)


def _placed(item: Item, craft: Craft) -> Item:
    """Return an item with a place: here, where it names none."""
    if item.command not in PLACES or item.x or item.y:
        return item
    here = craft.home.from_east_north(*craft.seen_m[:2], 0.0)
    return replace(item, x=here.latitude_e7, y=here.longitude_e7)


def _stay_here(craft: Craft) -> Wish:
    """What nothing further is wished for by: stay, or rest on the ground."""
    if craft.grounded:
        return Rest()
    east_m, north_m, up_m = craft.seen_m
    return Stay(east_m=east_m, north_m=north_m, up_m=up_m, speed_m_s=craft.frame.cruise_m_s)


def _passed(start_m: tuple[float, float], end_m: tuple[float, float], at_m: tuple[float, float, float]) -> bool:
    """Whether a place lies beyond the end of a leg."""
    east_m, north_m = end_m[0] - start_m[0], end_m[1] - start_m[1]
    return (at_m[0] - end_m[0]) * east_m + (at_m[1] - end_m[1]) * north_m > 0


def item_of(message: dialect.MAVLink_message) -> Item:
    """Return the item of a MISSION_ITEM_INT, or of a MISSION_ITEM with its degrees as 1e-7 degrees.

    Degrees that fit into no int32 become the largest one, which no autopilot takes.
    """
    x, y = message.x, message.y
    if message.get_msgId() == dialect.MAVLINK_MSG_ID_MISSION_ITEM:
        x, y = _e7(x), _e7(y)
    return Item(
        command=message.command,
        frame=message.frame,
        p1=message.param1,
        p2=message.param2,
        p3=message.param3,
        p4=message.param4,
        x=x,
        y=y,
        z=message.z,
    )


def _e7(degrees: float) -> int:
    scaled = degrees * 1e7
    return round(scaled) if math.isfinite(scaled) and abs(scaled) < 2**31 - 1 else 2**31 - 1
