"""Chart `camera`: who is the camera's master. One at any moment, always with a name.

Theory of operation. A camera is automatic (the node may move it), held by an operator, or released (nobody moves it).
An order that passed its gates takes the camera, also from another operator: the last write wins, and `camera_taken`
says whose it was (seed 000, Issuer UX). A hold ends by itself `operator_hold_ms` after the holder's last order; a
released camera goes back to automatic after `release_pause_ms`, so that a hand-over is not disturbed. After an outage
of which nobody knows how long it was, both count as over. It must never have two masters, and never move the camera
itself.
"""

from __future__ import annotations

from dataclasses import dataclass

from google.protobuf.message import Message

from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.findings_pb2 import CameraTaken
from events.schema.flight_pb2 import NodeStarted
from statecharts.facts import Camera, Order
from statecharts.part import Part
from statecharts.state import State
from statecharts.table import Answer, Chart, ignore, move, moved

NS_PER_MS = 1_000_000


@dataclass(frozen=True, slots=True)
class _Facts:
    pass


_NO_FACTS = _Facts()

CHART: Chart[_Facts] = Chart(
    name="camera",
    initial="automatic",
    states=("automatic", "operator", "released"),
    terminal=(),
    triggers=("pointed", "let_go", "time_passed", "time_lost"),
    rows=(
        move("automatic", "pointed", "operator", "an operator points it"),
        move("operator", "pointed", "operator", "an operator points it: last write wins"),
        move("released", "pointed", "operator", "an operator points it"),
        move("automatic", "let_go", "released", "an operator lets it go"),
        move("operator", "let_go", "released", "an operator lets it go"),
        move("released", "let_go", "released", "an operator lets it go again"),
        ignore("automatic", "time_passed", "nothing to wait for"),
        move("operator", "time_passed", "automatic", "the hold ran out"),
        move("released", "time_passed", "automatic", "the pause is over"),
        ignore("automatic", "time_lost", "nothing to wait for"),
        move("operator", "time_lost", "automatic", "off for an unknown time: the hold is over"),
        move("released", "time_lost", "automatic", "off for an unknown time: the pause is over"),
    ),
)

_TRIGGER = {"point": "pointed", "release": "let_go"}


def decide(state: State, record: Record) -> tuple[Message, ...]:
    """Return the change of hands, if any."""
    if record.kind.name == "time_passed":
        passed = state.passed(CHART.name, record.at.flight_ns)
        return tuple(message for key in passed for message in _fire(state, key, "time_passed"))
    change = record.message
    if isinstance(change, NodeStarted):
        waiting = state.waiting(CHART.name) if change.HasField("outage_unbounded") else ()
        return tuple(message for key in waiting for message in _fire(state, key, "time_lost"))
    assert isinstance(change, Moved)
    if change.chart != "command" or change.to_state != "intended":
        return ()
    order = state.orders[change.instance]
    return (*_fire(state, order.camera, _TRIGGER[order.verb]), *_taken(state, order))


def _fire(state: State, key: str, trigger: str) -> tuple[Message, ...]:
    row = CHART.ask(state.cameras[key].state, trigger, _NO_FACTS)
    return (moved(CHART, key, row),) if row.answer is Answer.MOVE else ()


def _taken(state: State, order: Order) -> tuple[Message, ...]:
    if order.verb != "point":
        return ()
    camera = state.cameras[order.camera]
    return (
        CameraTaken(
            vehicle=camera.vehicle,
            camera=camera.camera,
            principal_id=order.principal_id,
            callsign=order.callsign,
            command_id=order.command_id,
        ),
    )


def _apply_move(state: State, record: Record) -> None:
    change = record.message
    assert isinstance(change, Moved)
    if change.chart != CHART.name:
        return
    limits, now_ns = state.flight.limits, record.at.flight_ns
    waits_ms = {"operator": limits.operator_hold_ms, "released": limits.release_pause_ms}.get(change.to_state)
    if waits_ms is None:
        until_ns = 0
        state.deadlines.drop((CHART.name, change.instance))
    else:
        until_ns = now_ns + waits_ms * NS_PER_MS
        state.deadlines.put((CHART.name, change.instance), until_ns)
    before = state.cameras[change.instance]
    bare = Camera(before.vehicle, before.camera, before.gimbal)
    state.cameras.put(change.instance, bare._replace(state=change.to_state, until_ns=until_ns))


def _apply_taken(state: State, record: Record) -> None:
    taken = record.message
    assert isinstance(taken, CameraTaken)
    key = f"{taken.vehicle}/{taken.camera}"
    holder = state.cameras[key]._replace(
        principal_id=taken.principal_id, callsign=taken.callsign, command_id=taken.command_id
    )
    state.cameras.put(key, holder)


PART = Part(
    chart=CHART,
    alphabet=frozenset({"moved", "time_passed", "node_started"}),
    decide=decide,
    evolve={"moved": _apply_move, "camera_taken": _apply_taken},
    safety=True,
)
