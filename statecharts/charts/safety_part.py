"""What the chart `safety` says and how its part of the state changes. The rows are in `safety.py`."""

from __future__ import annotations

from google.protobuf.message import Message

from events.records import Record
from events.schema import safety_pb2
from events.schema.common_pb2 import Moved
from events.schema.mission_pb2 import MissionPlanned
from events.schema.safety_pb2 import OverrideBegun, SetVehicleMode
from statecharts import geometry
from statecharts.charts.link import OPERATORS
from statecharts.charts.safety import CHART, COMMANDS, DEMANDING, Facts
from statecharts.facts import Failsafe, Whereabouts
from statecharts.geometry import Fence, Point
from statecharts.part import Part
from statecharts.state import State
from statecharts.table import Answer, Row, moved

NS_PER_MS = 1_000_000
# A manifest that allows less is not believed: nobody can comply sooner, and the log would fill.
AGAIN_LEAST_MS = 1_000
# How long nothing is demanded where an episode is over though the vehicle never obeyed: two places at their slowest,
# so that one that is wrong does not end it, and as long as the least time between two commands.
CALM_MS = AGAIN_LEAST_MS

FENCE, BATTERY, LINK = "fence", "battery", "link"
SCOPES = {
    FENCE: safety_pb2.OVERRIDE_FENCE_RETURN,
    BATTERY: safety_pb2.OVERRIDE_BATTERY_RETURN,
    LINK: safety_pb2.OVERRIDE_LINK_RETURN,
}
MODES = {"returning": safety_pb2.FLIGHT_MODE_RETURN, "landing": safety_pb2.FLIGHT_MODE_LAND}
COMPLYING = {
    "returning": (safety_pb2.FLIGHT_MODE_RETURN, safety_pb2.FLIGHT_MODE_LAND),
    "landing": (safety_pb2.FLIGHT_MODE_LAND,),
}
_BREACHES = {
    geometry.INCLUSION_EXIT: ("outside an inclusion fence", "on the way out of an inclusion fence"),
    geometry.EXCLUSION_ENTRY: ("inside an exclusion fence", "on the way into an exclusion fence"),
}


def decide(state: State, record: Record) -> tuple[Message, ...]:
    """Return what every failsafe of every vehicle makes of the facts now."""
    change = record.message
    if isinstance(change, Moved) and change.chart != "link":
        return ()
    if not state.commands_flight:
        return ()
    said: list[Message] = []
    for number, vehicle in state.vehicles.items():
        demands = {name: _demand(state, name, number) if vehicle.armed else "" for name in SCOPES}
        for name, demand in demands.items():
            said += _look(state, number, name, demand, record.at.flight_ns, demands)
    return tuple(said)


def again_ns(state: State) -> int:
    """Return how long a failsafe waits before it commands again."""
    return max(state.flight.limits.failsafe_again_ms, AGAIN_LEAST_MS) * NS_PER_MS


def failsafe_flies(state: State, number: int) -> bool:
    """Whether a failsafe of a vehicle demands something that nobody holds off."""
    own = (failsafe.state for key, failsafe in state.failsafes.items() if key.partition("/")[0] == str(number))
    return any(one in DEMANDING for one in own)


def _demand(state: State, name: str, number: int) -> str | None:
    """Return what a failsafe demands of an armed vehicle; "" for nothing, None where that is not known."""
    limits = state.flight.limits
    match name:
        case "battery":
            percent = state.batteries.get(number)
            if percent is None:
                return ""
            if limits.battery_land_percent and percent <= limits.battery_land_percent:
                return "landing"
            return "returning" if limits.battery_return_percent and percent <= limits.battery_return_percent else ""
        case "link":
            link = state.links.get(OPERATORS)
            return "returning" if link is not None and link.state == "lost" else ""
    here = state.whereabouts.get(number)
    if not len(state.fences):
        return ""
    if here is None:
        return None
    return "" if geometry.judge(state.fences.values(), *_way(state, here)) == geometry.OK else "returning"


def _way(state: State, here: Whereabouts) -> tuple[Point, Point]:
    """Return where a vehicle is, and where it will be at this speed when the look ahead ends."""
    ahead_ms, at = state.flight.limits.fence_ahead_ms, (here.spot.east_mm, here.spot.north_mm)
    return at, (at[0] + here.east_mm_s * ahead_ms // 1000, at[1] + here.north_mm_s * ahead_ms // 1000)


def _look(
    state: State, number: int, name: str, demand: str | None, now_ns: int, demands: dict[str, str | None]
) -> tuple[Message, ...]:
    key, vehicle = f"{number}/{name}", state.vehicles[number]
    failsafe = state.failsafes.get(key) or Failsafe()
    if not demand and failsafe.state == "ok":
        return ()
    held = state.overrides.get((number, SCOPES[name]))
    facts = Facts(
        demand=demand or "",
        known=demand is not None,
        held=held is not None and held.until_ns > now_ns,
        link=vehicle.link,
        landing_elsewhere=any(other == "landing" for other in demands.values()),
        complies=not vehicle.armed or vehicle.flight_mode in COMPLYING.get(demand or failsafe.commanded, ()),
        rested=failsafe.state == "settling" and now_ns >= state.deadlines[CHART.name, key],
        commanded=failsafe.commanded,
        since_ns=now_ns - failsafe.commanded_ns,
        again_ns=again_ns(state),
    )
    row = CHART.ask(failsafe.state, "looked", facts)
    if row.answer is not Answer.MOVE:
        return ()
    return (moved(CHART, key, row), *_command(state, number, name, row))


def _command(state: State, number: int, name: str, row: Row[Facts]) -> tuple[Message, ...]:
    """Return the command of a move that commands. It lives until the next one would be due."""
    if row.target not in COMMANDS:
        return ()
    because, life_ms = _because(state, name, number), again_ns(state) // NS_PER_MS
    return (SetVehicleMode(vehicle=number, mode=MODES[row.target], because=because, life_ms=life_ms),)


def _because(state: State, name: str, number: int) -> str:
    if name == BATTERY:
        return f"battery at {state.batteries[number]} %"
    if name == LINK:
        return "no operator is heard any more"
    at, ahead = _way(state, state.whereabouts[number])
    now = geometry.judge(state.fences.values(), at, at)
    return _BREACHES[now][0] if now != geometry.OK else _BREACHES[geometry.judge(state.fences.values(), at, ahead)][1]


def _fence(state: State, record: Record) -> None:
    """Take the fences of a plan in the place of those before."""
    planned = record.message
    assert isinstance(planned, MissionPlanned)
    state.fences.drop_where(lambda _: True)
    for index, fence in enumerate(planned.fences):
        corners = tuple((corner.east_mm, corner.north_mm) for corner in fence.vertices)
        state.fences.put(index, Fence(fence.inclusion, corners))


def _apply_move(state: State, record: Record) -> None:
    change = record.message
    assert isinstance(change, Moved)
    if change.chart != CHART.name:
        return
    key, to, now_ns = change.instance, change.to_state, record.at.flight_ns
    # With the episode what it commanded is forgotten.
    before = Failsafe() if to == "ok" else state.failsafes.get(key) or Failsafe()
    failsafe = before._replace(state=to)
    if to in COMMANDS:  # its command is the next record of this step
        failsafe = failsafe._replace(commanded=to, commanded_ns=now_ns)
    state.failsafes.put(key, failsafe)
    if to in (*COMMANDS, "pending"):
        state.deadlines.put((CHART.name, key), failsafe.commanded_ns + again_ns(state))
    elif to == "settling":
        state.deadlines.put((CHART.name, key), now_ns + CALM_MS * NS_PER_MS)
    else:
        state.deadlines.drop((CHART.name, key))


def _held_off(state: State, record: Record) -> None:
    """Look at once at what a person begins to hold off, unless it is the landing: that look is sure to move."""
    begun = record.message
    assert isinstance(begun, OverrideBegun)
    for name, scope in SCOPES.items():
        failsafe = state.failsafes.get(f"{begun.vehicle}/{name}")
        demands = scope == begun.scope and failsafe is not None and failsafe.state in DEMANDING
        if demands and _demand(state, name, begun.vehicle) != "landing":
            state.deadlines.put((CHART.name, f"{begun.vehicle}/{name}"), record.at.flight_ns)


PART = Part(
    chart=CHART,
    alphabet=frozenset(
        {
            "position_reported",
            "battery_reported",
            "vehicle_state_reported",
            "vehicle_link_changed",
            "mission_planned",
            "moved",
            "time_passed",
            "node_started",
        }
    ),
    decide=decide,
    evolve={"mission_planned": _fence, "moved": _apply_move, "override_begun": _held_off},
    safety=True,
)
