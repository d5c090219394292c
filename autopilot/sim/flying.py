"""A flight: what the aircraft does in each of its modes, what it runs on, and when it arms and disarms.

It is told (`enter`, `arm`, `take_off`, `go_to`) and steps by a fixed length; the mission's part is
`missions.py`, the body's `flight.py`. Whether a wish is granted is for the personality to judge.
What happens is told in `texts` and `reached`, which the caller empties. Not here: MAVLink.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from autopilot.geo import LocalFrame
from autopilot.sim.flight import STEP_S, Body, Down, Fly, Frame, Rest, Rise, Stay, Wind, Wish
from autopilot.sim.missions import SPEED, Item, Manner, Runner
from autopilot.sim.modes import NAMES, Doing
from autopilot.sim.route import Motion
from autopilot.sim.supplies import Battery, Gps

IDLE_DISARM_S = 10.0  # armed and never off the ground
LANDED_DISARM_S = 1.0
BLIND_S = 5.0  # without satellites before it gives up going anywhere
RETURN_WAITS_S = 3.0  # above home, before it lands
UNMOVED_M = 0.5

STANDS, FLIES, TAKES_OFF, LANDS = 1, 2, 3, 4  # MAV_LANDED_STATE


def _nothing(item: Item) -> None:
    """Do nothing with a DO item."""
    del item


@dataclass(slots=True, kw_only=True)
class Flight:
    """Edit it between steps: `flight.battery.charge_percent = 12`, `flight.wind.east_m_s = 7`."""

    frame: Frame
    home: LocalFrame
    manner: Manner
    doing: Doing
    after_mission: Doing  # Doing.MISSION: it stays in that mode
    waits_for_start: bool = False  # a mission on the ground begins at MISSION_START only
    return_up_m: float = 15.0
    takeoff_up_m: float = 40.0
    home_first: bool = False  # item 0 of a mission is home
    on_do: Callable[[Item], None] = _nothing
    armed: bool = False
    body: Body = field(default_factory=Body)
    wind: Wind = field(default_factory=Wind)
    battery: Battery = field(default_factory=Battery)
    gps: Gps = field(default_factory=Gps)
    speed_m_s: float | None = None
    texts: list[str] = field(default_factory=list)
    reached: list[int] = field(default_factory=list)
    started: bool = False  # MISSION_START was given
    runner: Runner = field(init=False)
    wish: Wish = field(default_factory=Rest)  # of the last step, as the autopilot sees it
    _goal: Wish | None = None
    _paused: bool = False
    _anchor_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    _return: str = "climb"
    _waited_s: float = 0.0
    _ground_s: float = 0.0
    _blind_s: float = 0.0

    def __post_init__(self) -> None:
        self.runner = Runner(self.manner)

    @property
    def seen_m(self) -> tuple[float, float, float]:
        """Where the autopilot believes that it is."""
        return self.body.east_m + self.gps.jump_east_m, self.body.north_m + self.gps.jump_north_m, self.body.up_m

    @property
    def grounded(self) -> bool:
        """Whether it stands on the ground."""
        return self.body.grounded

    @property
    def landed_state(self) -> int:
        """MAV_LANDED_STATE."""
        if self.body.grounded:
            return STANDS
        kinds = {Rise: TAKES_OFF, Down: LANDS}
        return kinds.get(type(self.wish), FLIES)

    def motion(self, custom_mode: int, *, seen: bool = False) -> Motion:
        """Return how it moves, in truth or as the autopilot sees it."""
        body = self.body
        east_m, north_m = self.seen_m[:2] if seen else (body.east_m, body.north_m)
        return Motion(
            east_m=east_m,
            north_m=north_m,
            up_m=body.up_m,
            yaw_deg=body.yaw_deg,
            east_m_s=body.east_m_s,
            north_m_s=body.north_m_s,
            up_m_s=body.up_m_s,
            yaw_deg_s=body.yaw_deg_s,
            armed=self.armed,
            mode=custom_mode,
        )

    @property
    def items(self) -> list[Item]:
        """The mission on board."""
        return self.runner.items

    def home_item(self) -> Item:
        """Return the item that stands for home."""
        home = self.home
        latitude_e7, longitude_e7 = round(home.latitude_deg * 1e7), round(home.longitude_deg * 1e7)
        return Item(command=16, frame=0, x=latitude_e7, y=longitude_e7, z=home.altitude_m)

    def busy(self) -> bool:
        """Whether the mission is being flown."""
        return self.doing is Doing.MISSION and self.runner.running and not self.runner.finished

    def loaded(self, current: int | None) -> None:
        """A mission was taken over: its current item begins anew, or the one that is marked as current (PX4)."""
        if self.home_first:
            self.say("Flight plan received")
            self.runner.restart(self)
        elif not self.items:
            self.runner.reset()
        else:
            self.runner.choose(self, current if current is not None else min(self.runner.current, len(self.items) - 1))

    def say(self, text: str) -> None:
        """Tell by STATUSTEXT."""
        self.texts.append(text)

    def reach(self, seq: int) -> None:
        """Tell that an item was reached."""
        self.reached.append(seq)

    def do(self, item: Item) -> None:
        """Do a DO item."""
        if item.command == SPEED:
            self.speed_m_s = item.p2 if item.p2 > 0 else self.speed_m_s
        else:
            self.on_do(item)

    def arm(self) -> None:
        """Start the motors."""
        self.armed, self._ground_s = True, 0.0

    def disarm(self) -> None:
        """Stop the motors, wherever it is."""
        self.armed, self.started = False, False
        self.runner.reset()
        self._goal = None

    def enter(self, doing: Doing) -> None:
        """Fly in another mode from now on."""
        if doing is self.doing:
            return
        if self.doing is Doing.MISSION:
            self.runner.interrupt()
        self.doing, self._goal, self._paused, self.started = doing, None, False, False
        self.speed_m_s = None
        self._anchor_m = self.seen_m
        self._return, self._waited_s = "climb", 0.0
        if doing is Doing.TAKE_OFF:
            self._goal = Rise(up_m=self.takeoff_up_m)

    def take_off(self, up_m: float) -> None:
        """Leave the ground in the present mode, to this height above home."""
        self._goal = Rise(up_m=up_m)

    def go_to(self, east_m: float, north_m: float, up_m: float) -> None:
        """Fly to a point and stay there."""
        speed_m_s = self.speed_m_s or self.frame.cruise_m_s
        if not self.body.grounded:
            self._goal = Fly(start_m=self.seen_m[:2], east_m=east_m, north_m=north_m, up_m=up_m, speed_m_s=speed_m_s)

    def pause(self, paused: bool) -> None:
        """Stop where it is, or go on."""
        if paused and not self._paused:
            self._anchor_m = self.seen_m
        self._paused = paused

    def step(self) -> None:
        """Let one step of time pass."""
        body = self.body
        self.battery.step(STEP_S, self.armed and not body.grounded, body.up_m_s, self.wind.strength_m_s)
        if self.armed:
            self._fail_safe()
        self.wish = self._wish() if self.armed else Rest()
        self.frame.step(body, self._true(self.wish), self.wind)
        if self.armed:
            self._settle()

    def _true(self, wish: Wish) -> Wish:
        """Return what a wish means where the receiver is wrong: the autopilot steers by what it sees."""
        east_m, north_m = self.gps.jump_east_m, self.gps.jump_north_m
        if isinstance(wish, Rest | Rise) or not (east_m or north_m):
            return wish
        if isinstance(wish, Fly):
            wish = replace(wish, start_m=(wish.start_m[0] - east_m, wish.start_m[1] - north_m))
        return replace(wish, east_m=wish.east_m - east_m, north_m=wish.north_m - north_m)

    def _fail_safe(self) -> None:
        """What an autopilot does by itself: come down without charge, or when it can't know where it is."""
        self._blind_s = 0.0 if self.gps.good else self._blind_s + STEP_S
        lands = self.doing is Doing.LAND or self.body.grounded
        if self.battery.charge_percent <= 0 and not lands:
            self.say("Battery 1 is critical, landing")
            self.enter(Doing.LAND)
        elif self._blind_s > BLIND_S and self.frame.hovers and not lands and self.doing is not Doing.MANUAL:
            self.say("EKF Failsafe: changed to LAND Mode")
            self.enter(Doing.LAND)

    def _wish(self) -> Wish:
        if self._paused and not self.body.grounded:
            return self._stay()
        if self.doing is Doing.MISSION:
            return self._mission()
        if self.doing is Doing.RETURN:
            return self.homeward(False)
        if self.doing is Doing.LAND:
            return Rest() if self.body.grounded else Down(east_m=self._anchor_m[0], north_m=self._anchor_m[1])
        return self._towards_goal()

    def _mission(self) -> Wish:
        """Begin where nothing is to be waited for, and fly it."""
        if not self.runner.running:
            if self.body.grounded and self.waits_for_start and not self.started:
                return Rest()
            self.runner.start(self)
        wish = self.runner.step(self)
        if not self.runner.finished:
            self._anchor_m = self.seen_m
            return wish
        if self.after_mission is not Doing.MISSION and not self.body.grounded:
            self.enter(self.after_mission)
            return self._wish()
        return self._stay()

    def _towards_goal(self) -> Wish:
        goal = self._goal
        if isinstance(goal, Rise) and self.seen_m[2] >= goal.up_m - 0.3:
            self._anchor_m = (*self.seen_m[:2], goal.up_m)
            self._goal = None
            if self.doing is Doing.TAKE_OFF:
                self.doing = Doing.HOLD
            return self._stay()
        if goal is None:
            return Rest() if self.body.grounded else self._stay()
        if isinstance(goal, Fly) and self._near(goal.east_m, goal.north_m):
            self._anchor_m = goal.east_m, goal.north_m, goal.up_m
            self._goal = None
            return self._stay()
        if isinstance(goal, Fly) and self.speed_m_s is not None:
            return replace(goal, speed_m_s=self.speed_m_s)
        return goal

    def _stay(self) -> Wish:
        if self.body.grounded:
            return Rest()
        east_m, north_m, up_m = self._anchor_m
        speed_m_s = self.speed_m_s or self.frame.cruise_m_s
        return Stay(east_m=east_m, north_m=north_m, up_m=up_m, speed_m_s=speed_m_s)

    def homeward(self, fresh: bool) -> Wish:
        """Climb, fly home, wait, and come down; a fixed wing circles there."""
        if fresh:
            self._return, self._waited_s, self._anchor_m = "climb", 0.0, self.seen_m
        if self.body.grounded and self._return != "down":
            return Rest()
        up_m = max(self._anchor_m[2], self.return_up_m)
        if self._return == "climb" and (self.seen_m[2] >= up_m - UNMOVED_M or not self.frame.hovers):
            self._return = "home"
        speed_m_s = self.frame.cruise_m_s
        if self._return == "climb":
            return Stay(east_m=self._anchor_m[0], north_m=self._anchor_m[1], up_m=up_m, speed_m_s=speed_m_s)
        if self._return == "home" and self._near(0.0, 0.0):
            self._return = "wait"
        if self._return == "home":
            return Fly(start_m=self._anchor_m[:2], east_m=0.0, north_m=0.0, up_m=up_m, speed_m_s=speed_m_s)
        if self._return == "wait":
            self._waited_s += STEP_S
            if self._waited_s >= RETURN_WAITS_S and self.frame.hovers:
                self._return = "down"
            return Stay(east_m=0.0, north_m=0.0, up_m=up_m, speed_m_s=speed_m_s)
        return Down(east_m=0.0, north_m=0.0)

    def _near(self, east_m: float, north_m: float) -> bool:
        at_m = self.seen_m
        return math.hypot(at_m[0] - east_m, at_m[1] - north_m) <= self.frame.near_m

    def _settle(self) -> None:
        """Disarm on the ground: soon after a landing, later where it never left."""
        body = self.body
        stands = body.grounded and math.hypot(body.east_m_s, body.north_m_s) < UNMOVED_M
        if not stands or isinstance(self.wish, Rise):
            self._ground_s = 0.0
            return
        self._ground_s += STEP_S
        lands = isinstance(self.wish, Down) or self.doing in (Doing.LAND, Doing.RETURN)
        if self._ground_s >= (LANDED_DISARM_S if lands else IDLE_DISARM_S):
            self.disarm()
            self.say("Disarming motors")

    def describe(self) -> str:
        """Return its mode in a word, as ArduPilot's texts have it."""
        return NAMES[self.doing]
