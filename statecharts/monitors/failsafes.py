"""What a vehicle in danger is told, and what it is not told: the levels of the chart `safety`, watched from outside.

It takes reports and decisions for what they say, also where a chart failed on them. A condition that has held for
longer than failsafes may wait without the command that it demands is a breach; a second is allowed for a shell that is
late. Only places count here, not the look ahead of the chart; and silence of the operators with the whole grace of a
following, whether anything is followed or not.

A command may come again sooner where the one before is done with: nothing was demanded while the vehicle was in its
mode or disarmed, or nothing was for a second on end. That nothing is demanded is what the chart says; it is doubted
where the newest reports demand it, and, of a fence, where nobody knows where the vehicle is.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

from google.protobuf.message import Message

from events.schema import safety_pb2
from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import BaselineCarried, Limits, NodeStarted
from events.schema.mission_pb2 import MissionPlanned
from events.schema.safety_pb2 import BatteryReported, OverrideBegun, OverrideEnded, SetVehicleMode
from events.schema.vehicle_pb2 import PositionReported, VehicleLinkChanged, VehicleStateReported
from statecharts.monitors.monitor import Monitor, Said, Step
from statecharts.state import State

NS_PER_MS = 1_000_000
LATE_NS = 1_000_000_000
LEAST_AGAIN_MS = 1_000
WORDS = ("operator_heard", "order_received", "order_malformed")  # of operators
LANDING, RETURNING = safety_pb2.FLIGHT_MODE_LAND, safety_pb2.FLIGHT_MODE_RETURN
_COMMANDS = {"landing": LANDING, "returning": RETURNING}
_OBEYS: dict[int, tuple[int, ...]] = {LANDING: (LANDING,), RETURNING: (RETURNING, LANDING)}
CALM, CALM_NS = ("ok", "settling"), 1_000_000_000  # states in which nothing is demanded
_SCOPES = {
    "battery": safety_pb2.OVERRIDE_BATTERY_RETURN,
    "link": safety_pb2.OVERRIDE_LINK_RETURN,
    "fence": safety_pb2.OVERRIDE_FENCE_RETURN,
}

Spot = tuple[int, int]  # millimetres east and north
Area = tuple[bool, tuple[Spot, ...]]  # inclusion, corners


@dataclass(slots=True)
class _Vehicle:
    """What is known of a vehicle."""

    up: bool = False
    armed: bool = False
    mode: int = 0
    percent: int | None = None
    spot: Spot | None = None
    since: dict[str, int] = field(default_factory=dict)  # since when a property demands a command: flight_ns
    told: dict[int, int] = field(default_factory=dict)  # when a mode was last commanded: flight_ns


def winding(spot: Spot, corners: tuple[Spot, ...]) -> int | None:
    """Return how often a polygon goes round a place; None where the place lies on it."""
    turns = 0
    for (east, north), (to_east, to_north) in pairwise((*corners, corners[0])) if corners else ():
        side = (to_east - east) * (spot[1] - north) - (spot[0] - east) * (to_north - north)
        if side == 0 and (spot[0] - east) * (spot[0] - to_east) + (spot[1] - north) * (spot[1] - to_north) <= 0:
            return None
        if north <= spot[1] < to_north and side > 0:
            turns += 1
        elif to_north <= spot[1] < north and side < 0:
            turns -= 1
    return turns


def is_outside(spot: Spot, areas: list[Area]) -> bool:
    """Whether a place is in an exclusion, or not in an inclusion; each with its edge."""
    found = [(inclusion, winding(spot, corners)) for inclusion, corners in areas]
    return any(turns is None or (turns % 2 == 1) != inclusion for inclusion, turns in found)


class Failsafes(Monitor):
    """Failsafes command while they must, not more often than they may, and not what a person holds off."""

    def __init__(self, limits: Limits, whole: bool) -> None:
        super().__init__(limits, whole)
        self._vehicles: dict[int, _Vehicle] = {}
        self._areas: list[Area] = []
        self._held: dict[tuple[int, int], int] = {}  # vehicle, scope: until, flight_ns
        self._word_ns: int | None = None  # since when operators are silent: flight_ns; None: it does not count
        self._heard = False  # any of them was, in this flight
        self._commanded: dict[tuple[str, int], int] = {}  # instance and mode, until it is done with: when, flight_ns
        self._calm: dict[str, int] = {}  # instance: since when nothing is demanded, flight_ns

    def resume(self, state: State) -> None:
        """Take over what was told before the start, and is not told again."""
        self._areas = [(fence.inclusion, fence.vertices) for fence in state.fences.values()]
        self._held = {key: held.until_ns for key, held in state.overrides.items()}
        for number, known in state.vehicles.items():
            mode, percent = known.flight_mode, state.batteries.get(number)
            self._vehicles[number] = _Vehicle(armed=known.armed, mode=mode, percent=percent)
        for link in state.links.values():
            self._word_ns, self._heard = link.since_ns, link.heard

    def look(self, step: Step) -> Said:
        """Follow the reports, see the commands, and ask what is still missing."""
        if not (self.limits.flight_enabled or self.limits.mission_enabled):
            return
        now_ns = step[0].at.flight_ns
        if not isinstance(step[0].message, NodeStarted | VehicleLinkChanged):
            self._forget(now_ns)
        self._hear(step[0].message, now_ns)
        if step[0].kind.name in WORDS:
            self._word_ns, self._heard = now_ns, True
        for place, record in enumerate(step):
            match record.message:
                case Moved(chart="safety") as change:
                    yield from self._moves(change, now_ns, step[place + 1 : place + 2])
                case SetVehicleMode() as command:
                    self._of(command.vehicle).told[command.mode] = now_ns
                case OverrideBegun() as begun:
                    self._held[begun.vehicle, begun.scope] = now_ns + begun.held_for_ms * NS_PER_MS
                case OverrideEnded() as ended:
                    self._held.pop((ended.vehicle, ended.scope), None)
        for instance in [one for one in self._calm if self._doubts(one, now_ns)]:
            del self._calm[instance]
        self._forget(now_ns)
        for number, vehicle in self._vehicles.items():
            yield from self._missing(number, vehicle, now_ns)

    def _of(self, number: int) -> _Vehicle:
        return self._vehicles.setdefault(number, _Vehicle())

    def _hear(self, message: Message, now_ns: int) -> None:
        match message:
            case PositionReported(vehicle=number, place=place):
                self._of(number).spot = place.east_mm, place.north_mm
            case BatteryReported(vehicle=number) if message.HasField("charge_percent"):
                self._of(number).percent = message.charge_percent
            case VehicleStateReported(vehicle=number):
                self._of(number).armed, self._of(number).mode = message.armed, message.flight_mode
                if not self._heard:
                    self._word_ns = (now_ns if self._word_ns is None else self._word_ns) if message.armed else None
            case VehicleLinkChanged(vehicle=number, up=up):
                self._of(number).up = up
                self._of(number).spot = self._of(number).spot if up else None
            case NodeStarted():
                for vehicle in self._vehicles.values():
                    vehicle.up, vehicle.spot = False, None
                if message.HasField("outage_unbounded"):
                    self._held.clear()
            case MissionPlanned(fences=fences):
                self._areas = [
                    (one.inclusion, tuple((corner.east_mm, corner.north_mm) for corner in one.vertices))
                    for one in fences
                ]
            case BaselineCarried(state=carried):
                self._areas = [
                    (one.inclusion, tuple((corner.east_mm, corner.north_mm) for corner in one.corners))
                    for one in carried.fences
                ]
                for held in carried.overrides:
                    self._held[held.vehicle, held.scope] = now_ns + held.left_ms * NS_PER_MS

    def _again_ns(self) -> int:
        return max(self.limits.failsafe_again_ms, LEAST_AGAIN_MS) * NS_PER_MS

    def _forget(self, now_ns: int) -> None:
        """Forget the commands that are done with."""
        for instance, mode in tuple(self._commanded):
            since_ns, vehicle = self._calm.get(instance), self._of(int(instance.partition("/")[0]))
            obeyed = not vehicle.armed or vehicle.mode in _OBEYS[mode]
            if since_ns is not None and (obeyed or now_ns - since_ns >= CALM_NS):
                del self._commanded[instance, mode]

    def _doubts(self, instance: str, now_ns: int) -> bool:
        """Whether the newest reports say otherwise than a chart that says that nothing is demanded."""
        number, _, name = instance.partition("/")
        vehicle = self._of(int(number))
        unseen = name == "fence" and bool(self._areas) and vehicle.spot is None
        return vehicle.armed and (unseen or self._is_demanded(name, vehicle, now_ns))

    def _moves(self, change: Moved, now_ns: int, following: Step) -> Said:
        """Follow a move of a failsafe, and judge one that commands."""
        if change.to_state in CALM:
            self._calm.setdefault(change.instance, now_ns)
        else:
            self._calm.pop(change.instance, None)
        if change.to_state in _COMMANDS:
            yield from self._commands(change, now_ns, following)

    def _commands(self, change: Moved, now_ns: int, following: Step) -> Said:
        """Judge a move that commands; the command is the record behind it."""
        number, _, name = change.instance.partition("/")
        mode = _COMMANDS[change.to_state]
        key = change.instance, mode
        if not (following and isinstance(one := following[0].message, SetVehicleMode) and one.mode == mode):
            yield "failsafes_command", f"{change.instance} is {change.to_state} and commands nothing"
        if key in self._commanded and now_ns - self._commanded[key] < self._again_ns():
            yield "failsafes_wait", f"{change.instance} is {change.to_state} again too soon"
        self._commanded[key] = now_ns
        if mode == RETURNING and self._is_held(int(number), name, now_ns):
            yield "overrides_hold", f"{change.instance} is {change.to_state}, which a person holds off"
        if mode == RETURNING and self._is_empty(self._of(int(number))):
            yield "landing_is_stronger", f"{change.instance} is {change.to_state} while it must land"

    def _is_held(self, number: int, name: str, now_ns: int) -> bool:
        return self._held.get((number, _SCOPES[name]), now_ns) > now_ns

    def _is_empty(self, vehicle: _Vehicle) -> bool:
        percent, land = vehicle.percent, self.limits.battery_land_percent
        return bool(land) and percent is not None and percent <= land and vehicle.armed and vehicle.up

    def _is_low(self, vehicle: _Vehicle) -> bool:
        percent, back = vehicle.percent, self.limits.battery_return_percent
        return bool(back) and percent is not None and percent <= back

    def _is_unheard(self, now_ns: int) -> bool:
        lost_ms, grace_ms = self.limits.operator_lost_ms, self.limits.operator_lost_following_ms
        return (
            bool(lost_ms) and self._word_ns is not None and now_ns - self._word_ns >= (lost_ms + grace_ms) * NS_PER_MS
        )

    def _is_demanded(self, name: str, vehicle: _Vehicle, now_ns: int) -> bool:
        """Whether reports demand the return of a vehicle, by the name of a failsafe."""
        match name:
            case "battery":
                return self._is_low(vehicle)
            case "link":
                return self._is_unheard(now_ns)
        return vehicle.spot is not None and is_outside(vehicle.spot, self._areas)

    def _returns(self, number: int, vehicle: _Vehicle, name: str, now_ns: int) -> bool:
        return self._is_demanded(name, vehicle, now_ns) and not self._is_held(number, name, now_ns)

    def _missing(self, number: int, vehicle: _Vehicle, now_ns: int) -> Said:
        """Say which command has been due for too long."""
        empty, flies = self._is_empty(vehicle), vehicle.armed and vehicle.up
        homes = (RETURNING, LANDING)
        astray = flies and vehicle.mode not in homes
        returns = (("returns_at_fence", "fence"), ("returns_when_low", "battery"), ("returns_unheard", "link"))
        demands = (
            ("lands_when_empty", empty and vehicle.mode != LANDING, (LANDING,)),
            *((name, astray and self._returns(number, vehicle, scope, now_ns), homes) for name, scope in returns),
        )
        for name, demanded, modes in demands:
            if not demanded:
                vehicle.since.pop(name, None)
                continue
            since_ns = vehicle.since.setdefault(name, now_ns)
            told_ns = max([since_ns, *(vehicle.told.get(mode, since_ns) for mode in modes)])
            if now_ns - told_ns > self._again_ns() + LATE_NS:
                vehicle.since[name] = now_ns
                yield name, f"vehicle {number} was not told so since {told_ns}"
