"""Chart `aim`: whether the gimbal got to where it was asked to look.

Theory of operation. COMMAND_ACK means "valid and will be attempted", not "points there". So each pointing effect
starts a measurement: the edge reports the angle between what was asked and what the gimbal says of itself, and
within `arrival_tolerance_cdeg` it has arrived. After `arrival_patience_ms`, or when the vehicle refuses the command, it
has missed. A newer effect starts over. A start of the daemon ends the measurement, for what is measured against was in
the process before: the gimbal did not miss, nobody looks any more. It must never call an accepted command an arrival.
"""

from __future__ import annotations

from dataclasses import dataclass

from google.protobuf.message import Message

from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.vehicle_pb2 import (
    CommandAnswered,
    CommandUnanswered,
    GimbalReported,
    PointAtAngles,
    PointAtPlace,
    ReleasePointing,
)
from statecharts.facts import Aim, fitting_key
from statecharts.part import Part
from statecharts.state import State
from statecharts.table import Answer, Chart, Row, ignore, move, moved

NS_PER_MS = 1_000_000
MAV_GOES_ON = (0, 5)  # MAV_RESULT accepted, in progress


@dataclass(frozen=True, slots=True)
class _Facts:
    error_cdeg: int = 0
    tolerance_cdeg: int = 0


def near(facts: _Facts) -> bool:
    """The reported error is within the tolerance."""
    return facts.error_cdeg <= facts.tolerance_cdeg


def _rows_of_rest(source: str) -> tuple[Row[_Facts], ...]:
    return (
        move(source, "asked", "moving", "asked to look somewhere"),
        move(source, "let_go", "idle", "let go")
        if source != "idle"
        else ignore(source, "let_go", "nothing is asked of it"),
        ignore(source, "measured", "nothing is waited for"),
        ignore(source, "refused", "nothing is waited for"),
        ignore(source, "time_passed", "nothing is waited for"),
        ignore(source, "node_started", "nothing is waited for"),
    )


CHART: Chart[_Facts] = Chart(
    name="aim",
    initial="idle",
    states=("idle", "moving", "arrived", "missed"),
    terminal=(),
    triggers=("asked", "let_go", "measured", "refused", "time_passed", "node_started"),
    rows=(
        *_rows_of_rest("idle"),
        move("moving", "asked", "moving", "asked to look elsewhere"),
        move("moving", "let_go", "idle", "let go"),
        move("moving", "measured", "arrived", "measured within the tolerance", near, band=1),
        ignore("moving", "measured", "on its way", band=2),
        move("moving", "refused", "missed", "the vehicle did not take the command"),
        move("moving", "time_passed", "missed", "not there in time"),
        move("moving", "node_started", "idle", "started again: nobody measures it any more"),
        *_rows_of_rest("arrived"),
        *_rows_of_rest("missed"),
    ),
)


def decide(state: State, record: Record) -> tuple[Message, ...]:
    """Return the moves of the gimbals that a record is about."""
    message = record.message
    match record.kind.name:
        case "point_at_place" | "point_at_angles":
            return _fire(state, _gimbal(record), "asked")
        case "release_pointing":
            return _fire(state, _gimbal(record), "let_go")
        case "time_passed":
            passed = state.passed(CHART.name, record.at.flight_ns)
            return tuple(move for key in passed for move in _fire(state, key, "time_passed"))
        case "node_started":
            return tuple(move for key in state.waiting(CHART.name) for move in _fire(state, key, "node_started"))
        case "gimbal_reported":
            assert isinstance(message, GimbalReported)
            return _measured(state, message)
    assert isinstance(message, CommandAnswered | CommandUnanswered)
    return _answered(state, message)


def _measured(state: State, report: GimbalReported) -> tuple[Message, ...]:
    key = fitting_key(report.vehicle, report.gimbal)
    aim = state.aims.get(key)
    if aim is None or not report.HasField("error_cdeg") or report.effect_seq != aim.effect_seq:
        return ()
    return _fire(state, key, "measured", _Facts(report.error_cdeg, state.flight.limits.arrival_tolerance_cdeg))


def _answered(state: State, answer: CommandAnswered | CommandUnanswered) -> tuple[Message, ...]:
    effect = state.effects.get(answer.effect_seq)
    refused = isinstance(answer, CommandUnanswered) or answer.mav_result not in MAV_GOES_ON
    if effect is None or not refused:
        return ()
    aim = state.aims.get(effect.gimbal)
    if aim is None or aim.effect_seq != answer.effect_seq:
        return ()
    return _fire(state, effect.gimbal, "refused")


def _fire(state: State, key: str, trigger: str, facts: _Facts | None = None) -> tuple[Message, ...]:
    aim = state.aims.get(key) or Aim()
    row = CHART.ask(aim.state, trigger, facts or _Facts())
    return (moved(CHART, key, row),) if row.answer is Answer.MOVE else ()


def _gimbal(record: Record) -> str:
    effect = record.message
    assert isinstance(effect, PointAtPlace | PointAtAngles | ReleasePointing)
    return fitting_key(effect.vehicle, effect.gimbal)


def _ask(state: State, record: Record) -> None:
    key = _gimbal(record)
    before = state.aims.get(key) or Aim()
    effect = record.message
    assert isinstance(effect, PointAtPlace | PointAtAngles)
    state.aims.put(
        key, before._replace(effect_seq=record.seq, order=effect.order, asked_ns=record.at.flight_ns, error_cdeg=None)
    )
    patience_ms = state.flight.limits.arrival_patience_ms
    state.deadlines.put((CHART.name, key), record.at.flight_ns + patience_ms * NS_PER_MS)


def _let_go(state: State, record: Record) -> None:
    key = _gimbal(record)
    state.aims.put(key, (state.aims.get(key) or Aim())._replace(effect_seq=-1, order="", error_cdeg=None))


def _measure(state: State, record: Record) -> None:
    report = record.message
    assert isinstance(report, GimbalReported)
    key = fitting_key(report.vehicle, report.gimbal)
    aim = state.aims.get(key)
    if aim is not None and report.HasField("error_cdeg") and report.effect_seq == aim.effect_seq:
        state.aims.put(key, aim._replace(error_cdeg=report.error_cdeg))


def _apply_move(state: State, record: Record) -> None:
    change = record.message
    assert isinstance(change, Moved)
    if change.chart != CHART.name:
        return
    aim = state.aims.get(change.instance) or Aim()
    state.aims.put(change.instance, aim._replace(state=change.to_state))
    if change.to_state != "moving":
        state.deadlines.drop((CHART.name, change.instance))


PART = Part(
    chart=CHART,
    alphabet=frozenset(
        {
            "point_at_place",
            "point_at_angles",
            "release_pointing",
            "gimbal_reported",
            "command_answered",
            "command_unanswered",
            "time_passed",
            "node_started",
        }
    ),
    decide=decide,
    evolve={
        "point_at_place": _ask,
        "point_at_angles": _ask,
        "release_pointing": _let_go,
        "gimbal_reported": _measure,
        "moved": _apply_move,
    },
    safety=True,
)
