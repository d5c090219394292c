"""Chart `override`: which failsafes a person holds off, who, why, and until when (seed 004, safety_override).

Theory of operation. Instances are a vehicle and a scope: "1/battery_return", "1/link_return", "1/fence_return". An
order that the chart `command` accepted begins one, with the name and the words of whoever gave it; a later one takes
its place, which is said. It ends by itself when its time is over; after an outage of which nobody knows how long it
was it is over, too. What it holds off is judged by the chart `safety`, which reads the end itself and comes first: in
the step in which the time is over the failsafe commands already.

It must never hold a landing off: there is no scope for it. It must never begin by itself, or outlive the time that the
order names.
"""

from __future__ import annotations

from dataclasses import dataclass

from google.protobuf.message import Message

from events.records import Record
from events.schema import safety_pb2
from events.schema.flight_pb2 import NodeStarted
from events.schema.orders_pb2 import OrderReceived
from events.schema.safety_pb2 import OverrideBegun, OverrideEnded
from statecharts.facts import Override
from statecharts.part import Part
from statecharts.state import State
from statecharts.table import Answer, Chart, ignore, move, moved

NS_PER_MS = 1_000_000
VEHICLE = 1  # orders name no vehicle: there is one
SCOPES: dict[int, str] = {
    safety_pb2.OVERRIDE_BATTERY_RETURN: "battery_return",
    safety_pb2.OVERRIDE_LINK_RETURN: "link_return",
    safety_pb2.OVERRIDE_FENCE_RETURN: "fence_return",
}
_NUMBERS = {name: number for number, name in SCOPES.items()}


@dataclass(frozen=True, slots=True)
class _Facts:
    """Nothing that a guard asks."""


_NO_FACTS = _Facts()

CHART: Chart[_Facts] = Chart(
    name="override",
    initial="idle",
    states=("idle", "holding"),
    terminal=(),
    triggers=("ordered", "time_passed", "time_lost"),
    rows=(
        move("idle", "ordered", "holding", "a person holds it off"),
        move("holding", "ordered", "holding", "replaced"),
        ignore("idle", "time_passed", "nothing is held off"),
        move("holding", "time_passed", "idle", "its time is over"),
        ignore("idle", "time_lost", "nothing is held off"),
        move("holding", "time_lost", "idle", "off for an unknown time"),
    ),
)


def decide(state: State, record: Record) -> tuple[Message, ...]:
    """Return what begins and what ends."""
    message = record.message
    if isinstance(message, OrderReceived):
        return _ordered(state, message)
    if isinstance(message, NodeStarted):
        waiting = state.waiting(CHART.name) if message.HasField("outage_unbounded") else ()
        return tuple(said for key in waiting for said in _ended(state, key, "time_lost"))
    passed = state.passed(CHART.name, record.at.flight_ns)
    return tuple(said for key in passed for said in _ended(state, key, "time_passed"))


def _ordered(state: State, received: OrderReceived) -> tuple[Message, ...]:
    """Begin what an order asks for that was accepted in this step, and not before."""
    arrival = state.arrival.value
    if received.WhichOneof("order") != "override_safety" or arrival is None or arrival.known:
        return ()
    order, asked = state.orders[arrival.key], received.override_safety
    if order.state != "accepted":
        return ()
    begun = OverrideBegun(
        vehicle=VEHICLE,
        scope=asked.scope,
        principal_id=order.principal_id,
        callsign=order.callsign,
        command_id=order.command_id,
        reason=asked.reason,
        held_for_ms=asked.held_for_ms,
    )
    return (*_ended(state, f"{VEHICLE}/{SCOPES[asked.scope]}", "ordered"), begun)


def _ended(state: State, key: str, trigger: str) -> tuple[Message, ...]:
    held = state.overrides.get(_parsed(key))
    row = CHART.ask("idle" if held is None else "holding", trigger, _NO_FACTS)
    if row.answer is not Answer.MOVE:
        return ()
    said: tuple[Message, ...] = (moved(CHART, key, row),)
    if held is not None:
        said += (OverrideEnded(vehicle=held.vehicle, scope=held.scope, because=row.because),)  # type: ignore[arg-type]
    return said


def _parsed(key: str) -> tuple[int, int]:
    """Return vehicle and scope of an instance."""
    vehicle, _, name = key.partition("/")
    return int(vehicle), _NUMBERS[name]


def hold(state: State, override: Override) -> None:
    """Put an override into the state, with its end."""
    state.overrides.put((override.vehicle, override.scope), override)
    instance = f"{override.vehicle}/{SCOPES[override.scope]}"
    state.deadlines.put((CHART.name, instance), override.until_ns)


def _begin(state: State, record: Record) -> None:
    begun = record.message
    assert isinstance(begun, OverrideBegun)
    until_ns = record.at.flight_ns + begun.held_for_ms * NS_PER_MS
    names = begun.principal_id, begun.callsign, begun.command_id, begun.reason
    hold(state, Override(begun.vehicle, begun.scope, *names, until_ns))


def _end(state: State, record: Record) -> None:
    ended = record.message
    assert isinstance(ended, OverrideEnded)
    state.overrides.drop((ended.vehicle, ended.scope))
    state.deadlines.drop((CHART.name, f"{ended.vehicle}/{SCOPES[ended.scope]}"))


PART = Part(
    chart=CHART,
    alphabet=frozenset({"order_received", "time_passed", "node_started"}),
    decide=decide,
    evolve={"override_begun": _begin, "override_ended": _end},
    safety=True,
)
