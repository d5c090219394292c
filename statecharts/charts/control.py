"""Chart `control`: who controls a gimbal (MAVLink guide, Gimbal Protocol v2), and what this node does about it.

Theory of operation. A gimbal's manager says who has primary control of it. PX4 takes angles from nobody else, ArduPilot
from anybody, and a place to look at both take from anybody; so control is asked for once, before the first angles or
place of an operator's order leave, one to follow a finding included, and only where nobody has it. Another who has it
is left it: two stations that take a gimbal from each other in turn help nobody. The configuration may say otherwise
(`take_from_others`). Control is given up once, when the camera is automatic again; a gimbal that is told to be this
node's while nobody holds the camera (after a start, or in the next flight) is given up too.

It must never send anything where no manager has told of itself, and never fight. The command itself is the chart
`command`'s to say, for it must leave before the pointing; this chart follows it.
"""

from __future__ import annotations

from dataclasses import dataclass

from google.protobuf.message import Message

from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.vehicle_pb2 import GimbalControlChanged, GiveUpGimbal, TakeGimbal
from statecharts.facts import Control, fitting_key
from statecharts.part import Part
from statecharts.state import State
from statecharts.table import Answer, Chart, Row, ignore, move, moved

GIVES_UP = ("camera_free", "seen_ours")  # what makes this node give a gimbal up, where it ends with nobody


@dataclass(frozen=True, slots=True)
class _Facts:
    wanted: bool = True  # an operator holds a camera on this gimbal, or it rests


def left_alone(facts: _Facts) -> bool:
    """No operator holds a camera on it."""
    return not facts.wanted


def _seen(source: str) -> tuple[Row[_Facts], ...]:
    return (
        move(source, "seen_free", "nobody", "nobody controls it")
        if source != "nobody"
        else ignore(source, "seen_free", "known already"),
        move(source, "seen_other", "others", "another controls it")
        if source != "others"
        else ignore(source, "seen_other", "another still, or another of them"),
    )


def _seen_ours(source: str) -> tuple[Row[_Facts], ...]:
    return (
        move(source, "seen_ours", "nobody", "given up: no operator holds the camera", left_alone, band=1),
        move(source, "seen_ours", "ours", "this node controls it", band=2)
        if source != "ours"
        else ignore(source, "seen_ours", "known already", band=2),
    )


def _ours(source: str) -> tuple[Row[_Facts], ...]:
    return (
        ignore(source, "asked_for", "asked for once"),
        move(source, "camera_free", "nobody", "given up: no operator holds the camera any more"),
        *_seen(source),
        *_seen_ours(source),
    )


def _not_ours(source: str) -> tuple[Row[_Facts], ...]:
    return (
        move(source, "asked_for", "asked", "asked for: an operator points it"),
        ignore(source, "camera_free", "there is nothing to give up"),
        *_seen(source),
        *_seen_ours(source),
    )


CHART: Chart[_Facts] = Chart(
    name="control",
    initial="unknown",
    states=("unknown", "nobody", "asked", "ours", "others"),
    terminal=(),
    triggers=("asked_for", "camera_free", "seen_free", "seen_ours", "seen_other"),
    rows=(
        *_not_ours("unknown"),
        *_not_ours("nobody"),
        *_ours("asked"),
        *_ours("ours"),
        *_not_ours("others"),
    ),
)


def taking(state: State, gimbal: str) -> TakeGimbal | None:
    """Return what must leave before an operator's order points this gimbal; None where nothing must."""
    control, limits = state.controls.get(gimbal) or Control(), state.flight.limits
    from_another = control.state == "others" and limits.take_from_others
    if control.state != "nobody" and not from_another:
        return None
    vehicle, number = (int(part) for part in gimbal.split("/"))
    return TakeGimbal(vehicle=vehicle, gimbal=number, life_ms=limits.own_command_life_ms)


def other_controller(state: State, gimbal: str) -> str:
    """Return who else controls a gimbal, as "255/190"; "" where nobody else is known to."""
    control = state.controls.get(gimbal)
    return f"{control.system_id}/{control.component_id}" if control is not None and control.state == "others" else ""


def decide(state: State, record: Record) -> tuple[Message, ...]:
    """Return the change of hands, and what gives the gimbal up."""
    match record.message:
        case TakeGimbal(vehicle=vehicle, gimbal=gimbal):
            return _fire(state, fitting_key(vehicle, gimbal), "asked_for")
        case GimbalControlChanged(vehicle=vehicle, gimbal=gimbal, ours=ours, system_id=system_id):
            trigger = "seen_ours" if ours else "seen_other" if system_id else "seen_free"
            return _fire(state, fitting_key(vehicle, gimbal), trigger)
        case Moved(chart="camera", to_state="automatic", instance=camera):
            key = fitting_key(state.cameras[camera].vehicle, state.cameras[camera].gimbal)
            return () if _is_wanted(state, key) else _fire(state, key, "camera_free")
    return ()


def _fire(state: State, key: str, trigger: str) -> tuple[Message, ...]:
    control = state.controls.get(key) or Control()
    row = CHART.ask(control.state, trigger, _Facts(_is_wanted(state, key)))
    if row.answer is not Answer.MOVE:
        return ()
    change = moved(CHART, key, row)
    if row.target != "nobody" or row.trigger not in GIVES_UP:
        return (change,)
    vehicle, gimbal = (int(part) for part in key.split("/"))
    life_ms = state.flight.limits.own_command_life_ms
    return change, GiveUpGimbal(vehicle=vehicle, gimbal=gimbal, life_ms=life_ms)


def _is_wanted(state: State, key: str) -> bool:
    """Whether somebody holds a camera on this gimbal, or it rests, or follows what an operator has it follow."""
    cameras = (name for name, one in state.cameras.items() if fitting_key(one.vehicle, one.gimbal) == key)
    return any(state.cameras[name].state != "automatic" or _follows(state, name) for name in cameras)


def _follows(state: State, camera: str) -> bool:
    scan = state.scans.get(camera)
    return scan is not None and scan.state == "following"


def _changed(state: State, record: Record) -> None:
    change = record.message
    assert isinstance(change, GimbalControlChanged)
    key = fitting_key(change.vehicle, change.gimbal)
    before = state.controls.get(key) or Control()
    state.controls.put(
        key,
        before._replace(system_id=change.system_id, component_id=change.component_id, since_ns=record.at.flight_ns),
    )


def _apply_move(state: State, record: Record) -> None:
    change = record.message
    assert isinstance(change, Moved)
    if change.chart == CHART.name:
        before = state.controls.get(change.instance) or Control()
        state.controls.put(change.instance, before._replace(state=change.to_state))


PART = Part(
    chart=CHART,
    alphabet=frozenset({"take_gimbal", "gimbal_control_changed", "moved"}),
    decide=decide,
    evolve={"gimbal_control_changed": _changed, "moved": _apply_move},
    moves_of=frozenset({"camera"}),
)
