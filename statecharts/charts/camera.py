"""Chart `camera`: who is the camera's master. One at any moment, always with a name.

Theory of operation. A camera is automatic (the node may move it), held by an operator, or released (nobody moves it).
An order that passed its gates takes the camera, also from another operator: the last write wins, and `camera_taken`
says whose it was (seed 000, Issuer UX). A hold ends by itself `operator_hold_ms` after the holder's last order; a
released camera goes back to automatic after `release_pause_ms`, so that a hand-over is not disturbed. An order to
follow a finding gives the camera to the node, whoever had it: the next order takes it back. After an outage of which
nobody knows how long it was, hold and pause count as over. It must never have two masters, and never move the camera
itself.

A hold rests on an order that the vehicle took. Where the vehicle refuses the order that took the camera, or it could
not be sent, the camera goes back: to who had it, for what is left of that hold; to its pause; else to automatic.
Silence is no refusal: the gimbal may be on its way.
"""

from __future__ import annotations

from dataclasses import dataclass

from google.protobuf.message import Message

from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.findings_pb2 import CameraTaken
from events.schema.flight_pb2 import NodeStarted
from statecharts.facts import Camera, Hold, Order, order_key
from statecharts.part import Part
from statecharts.state import State
from statecharts.table import Answer, Chart, ignore, move, moved

NS_PER_MS = 1_000_000


@dataclass(frozen=True, slots=True)
class _Facts:
    overtaken: bool = False
    before: str = "automatic"  # what it would go back to


_NO_FACTS = _Facts()


def overtaken(facts: _Facts) -> bool:
    """Another order holds the camera by now."""
    return facts.overtaken


def was_held(facts: _Facts) -> bool:
    """Somebody held it by an order that the vehicle took, and that hold is not over."""
    return facts.before == "operator"


def was_resting(facts: _Facts) -> bool:
    """It was released, and its pause is not over."""
    return facts.before == "released"


CHART: Chart[_Facts] = Chart(
    name="camera",
    initial="automatic",
    states=("automatic", "operator", "released"),
    terminal=(),
    triggers=("pointed", "zoomed", "let_go", "followed", "refused", "time_passed", "time_lost"),
    rows=(
        move("automatic", "pointed", "operator", "an operator points it"),
        move("operator", "pointed", "operator", "an operator points it: last write wins"),
        move("released", "pointed", "operator", "an operator points it"),
        move("automatic", "zoomed", "operator", "an operator zooms it"),
        move("operator", "zoomed", "operator", "an operator zooms it: last write wins"),
        move("released", "zoomed", "operator", "an operator zooms it"),
        move("automatic", "let_go", "released", "an operator lets it go"),
        move("operator", "let_go", "released", "an operator lets it go"),
        move("released", "let_go", "released", "an operator lets it go again"),
        ignore("automatic", "followed", "nobody holds it: the node follows with it"),
        move("operator", "followed", "automatic", "an operator lets the node follow with it: last write wins"),
        move("released", "followed", "automatic", "an operator lets the node follow with it"),
        ignore("automatic", "refused", "nobody holds it"),
        ignore("operator", "refused", "another order holds it by now", overtaken, band=1),
        move("operator", "refused", "operator", "the vehicle refused: back to who had it", was_held, band=2),
        move("operator", "refused", "released", "the vehicle refused: back to its pause", was_resting, band=3),
        move("operator", "refused", "automatic", "the vehicle refused: the hold is over", band=4),
        ignore("released", "refused", "who let it go has let it go, whatever the vehicle says"),
        ignore("automatic", "time_passed", "nothing to wait for"),
        move("operator", "time_passed", "automatic", "the hold ran out"),
        move("released", "time_passed", "automatic", "the pause is over"),
        ignore("automatic", "time_lost", "nothing to wait for"),
        move("operator", "time_lost", "automatic", "off for an unknown time: the hold is over"),
        move("released", "time_lost", "automatic", "off for an unknown time: the pause is over"),
    ),
)

_TRIGGER = {"point": "pointed", "zoom": "zoomed", "release": "let_go"}
_TAKES = ("point", "zoom")
_REFUSED = ("rejected", "unsupported")  # ends of an order that was under way: the vehicle does not do it


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
    if change.chart != "command":
        return ()
    order = state.orders[change.instance]
    if not order.camera:
        return ()
    if change.to_state == "accepted" and order.verb == "follow":
        return _fire(state, order.camera, "followed")
    if change.to_state == "intended":
        return (*_fire(state, order.camera, _TRIGGER[order.verb]), *_taken(state, order))
    if change.to_state in _REFUSED and change.from_state != "received":
        return _given_back(state, order, record.at.flight_ns)
    return ()


def _fire(state: State, key: str, trigger: str, facts: _Facts = _NO_FACTS) -> tuple[Message, ...]:
    row = CHART.ask(state.cameras[key].state, trigger, facts)
    return (moved(CHART, key, row),) if row.answer is Answer.MOVE else ()


def _given_back(state: State, order: Order, now_ns: int) -> tuple[Message, ...]:
    """Return what a refused order's hold on its camera gives way to."""
    camera = state.cameras[order.camera]
    overtaken = (camera.principal_id, camera.command_id) != (order.principal_id, order.command_id)
    hold = _standing(state, camera.before, now_ns)
    facts = _Facts(overtaken, hold.state if hold is not None else "automatic")
    moves = _fire(state, order.camera, "refused", facts)
    if not moves or hold is None or hold.state != "operator":
        return moves
    left_ms = (hold.until_ns - now_ns + NS_PER_MS - 1) // NS_PER_MS
    return (*moves, _taking(camera, hold.principal_id, hold.callsign, hold.command_id, left_ms))


def _standing(state: State, hold: Hold | None, now_ns: int) -> Hold | None:
    """Return a hold or pause that is not over, and does not rest on an order that was refused in the meantime."""
    if hold is None or hold.until_ns <= now_ns:
        return None
    order = state.orders.get(order_key(hold.principal_id, hold.command_id))
    return None if order is not None and order.state in _REFUSED else hold


def _taken(state: State, order: Order) -> tuple[Message, ...]:
    if order.verb not in _TAKES:
        return ()
    return (_taking(state.cameras[order.camera], order.principal_id, order.callsign, order.command_id),)


def _taking(
    camera: Camera, principal_id: str, callsign: str, command_id: str, held_for_ms: int | None = None
) -> CameraTaken:
    return CameraTaken(
        vehicle=camera.vehicle,
        camera=camera.camera,
        principal_id=principal_id,
        callsign=callsign,
        command_id=command_id,
        held_for_ms=held_for_ms,
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
    hold = Hold(before.state, before.principal_id, before.callsign, before.command_id, before.until_ns)
    kept = hold if change.to_state == "operator" else None
    state.cameras.put(change.instance, bare._replace(state=change.to_state, until_ns=until_ns, before=kept))


def _apply_taken(state: State, record: Record) -> None:
    taken = record.message
    assert isinstance(taken, CameraTaken)
    key = f"{taken.vehicle}/{taken.camera}"
    holder = state.cameras[key]._replace(
        principal_id=taken.principal_id, callsign=taken.callsign, command_id=taken.command_id
    )
    if taken.HasField("held_for_ms"):
        until_ns = record.at.flight_ns + taken.held_for_ms * NS_PER_MS
        holder = holder._replace(until_ns=until_ns, before=None)
        state.deadlines.put((CHART.name, key), until_ns)
    state.cameras.put(key, holder)


PART = Part(
    chart=CHART,
    alphabet=frozenset({"moved", "time_passed", "node_started"}),
    decide=decide,
    evolve={"moved": _apply_move, "camera_taken": _apply_taken},
    safety=True,
    moves_of=frozenset({"command"}),
)
