"""Chart `aim`: whether the gimbal got to where it was asked to look.

Theory of operation. COMMAND_ACK means "valid and will be attempted", not "points there". So each pointing effect
starts a measurement: the edge reports the angle between what was asked and what the gimbal says of itself, and
within `arrival_tolerance_cdeg` it has arrived. After `arrival_patience_ms`, or when the vehicle refuses the command, it
has missed. A newer effect starts over. A start of the daemon ends the measurement, for what is measured against was in
the process before: the gimbal did not miss, nobody looks any more. It must never call an accepted command an arrival.

One that arrived and then is off by more than `drift_cdeg` for `drift_settle_ms` has drifted, and where another took
control of it since it was asked, that is said; back within the tolerance it has arrived again. A gust or a turn of the
vehicle that the gimbal makes good within that time is no drift. Where nothing measures (a servo mount reports what it
was told) the reasons say so: arrived is then "commanded".
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
from statecharts.charts.control import other_controller
from statecharts.facts import Aim, fitting_key
from statecharts.part import Part
from statecharts.state import State
from statecharts.table import Answer, Chart, Row, ignore, move, moved
from statecharts.words import degrees_rounded

NS_PER_MS = 1_000_000
MAV_GOES_ON = (0, 5)  # MAV_RESULT accepted, in progress


@dataclass(frozen=True, slots=True)
class _Facts:
    error_cdeg: int = 0
    tolerance_cdeg: int = 0
    demanded: bool = False


def near(facts: _Facts) -> bool:
    """The reported error is within the tolerance."""
    return facts.error_cdeg <= facts.tolerance_cdeg


def near_by_demand(facts: _Facts) -> bool:
    """What was demanded of the servos is within the tolerance; nothing measures where they are."""
    return facts.demanded and near(facts)


def _rows_of_rest(source: str) -> tuple[Row[_Facts], ...]:
    """Return what happens where nothing is waited for."""
    return (
        *_rows_of_asking(source),
        ignore(source, "measured", "nothing is waited for"),
        ignore(source, "refused", "nothing is waited for"),
        ignore(source, "time_passed", "nothing is waited for"),
        ignore(source, "node_started", "nothing is waited for"),
    )


def _rows_of_asking(source: str) -> tuple[Row[_Facts], ...]:
    return (
        move(source, "asked", "moving", "asked to look somewhere"),
        move(source, "let_go", "idle", "let go")
        if source != "idle"
        else ignore(source, "let_go", "nothing is asked of it"),
    )


CHART: Chart[_Facts] = Chart(
    name="aim",
    initial="idle",
    states=("idle", "moving", "arrived", "drifted", "missed"),
    terminal=(),
    triggers=("asked", "let_go", "measured", "refused", "time_passed", "node_started"),
    rows=(
        *_rows_of_rest("idle"),
        move("moving", "asked", "moving", "asked to look elsewhere"),
        move("moving", "let_go", "idle", "let go"),
        move("moving", "measured", "arrived", "commanded there: nothing measures it", near_by_demand, band=1),
        move("moving", "measured", "arrived", "measured within the tolerance", near, band=2),
        ignore("moving", "measured", "on its way", band=3),
        move("moving", "refused", "missed", "the vehicle did not take the command"),
        move("moving", "time_passed", "missed", "not there in time"),
        move("moving", "node_started", "idle", "started again: nobody measures it any more"),
        *_rows_of_asking("arrived"),
        ignore("arrived", "measured", "there, or off for a moment: time tells"),
        ignore("arrived", "refused", "it is there, whatever the vehicle says"),
        move("arrived", "time_passed", "drifted", "off for too long"),
        ignore("arrived", "node_started", "nobody measures it any more"),
        *_rows_of_asking("drifted"),
        move("drifted", "measured", "arrived", "back within the tolerance", near, band=1),
        ignore("drifted", "measured", "still off", band=2),
        ignore("drifted", "refused", "it was there, whatever the vehicle says"),
        ignore("drifted", "time_passed", "known already"),
        ignore("drifted", "node_started", "nobody measures it any more"),
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
    tolerance_cdeg = state.flight.limits.arrival_tolerance_cdeg
    return _fire(state, key, "measured", _Facts(report.error_cdeg, tolerance_cdeg, report.demanded))


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
    if row.answer is not Answer.MOVE:
        return ()
    change = moved(CHART, key, row)
    change.because = _because(state, key, aim, row)
    return (change,)


def _because(state: State, key: str, aim: Aim, row: Row[_Facts]) -> str:
    """Return why, naming who else has the gimbal and how far it is off."""
    other = other_controller(state, key)
    if row.target == "missed" and other:
        return f"{row.because}: {other} controls it"
    if row.target != "drifted":
        return row.because
    if other:
        return f"{other} took it" if state.controls[key].since_ns >= aim.asked_ns else f"{other} controls it"
    return f"{degrees_rounded(aim.error_cdeg or 0)} deg off"


def _gimbal(record: Record) -> str:
    effect = record.message
    assert isinstance(effect, PointAtPlace | PointAtAngles | ReleasePointing)
    return fitting_key(effect.vehicle, effect.gimbal)


def _ask(state: State, record: Record) -> None:
    key = _gimbal(record)
    before = state.aims.get(key) or Aim()
    effect = record.message
    assert isinstance(effect, PointAtPlace | PointAtAngles)
    asked = Aim(state=before.state, effect_seq=record.seq, order=effect.order, asked_ns=record.at.flight_ns)
    state.aims.put(key, asked)
    patience_ms = state.flight.limits.arrival_patience_ms
    state.deadlines.put((CHART.name, key), record.at.flight_ns + patience_ms * NS_PER_MS)


def _let_go(state: State, record: Record) -> None:
    key = _gimbal(record)
    before = state.aims.get(key) or Aim()
    state.aims.put(key, Aim(state=before.state, asked_ns=before.asked_ns))


def _measure(state: State, record: Record) -> None:
    report = record.message
    assert isinstance(report, GimbalReported)
    key = fitting_key(report.vehicle, report.gimbal)
    aim = state.aims.get(key)
    if aim is None or not report.HasField("error_cdeg") or report.effect_seq != aim.effect_seq:
        return
    state.aims.put(key, aim._replace(error_cdeg=report.error_cdeg, demanded=report.demanded))
    if aim.state == "arrived":
        _watch_drift(state, key, report.error_cdeg, record.at.flight_ns)


def _watch_drift(state: State, key: str, error_cdeg: int, now_ns: int) -> None:
    """Start to wait where it is off, once; stop where it is not."""
    limits, deadline = state.flight.limits, (CHART.name, key)
    if not limits.drift_settle_ms or error_cdeg <= max(limits.drift_cdeg, limits.arrival_tolerance_cdeg):
        state.deadlines.drop(deadline)
    elif deadline not in state.deadlines:
        state.deadlines.put(deadline, now_ns + limits.drift_settle_ms * NS_PER_MS)


def _started(state: State, _record: Record) -> None:
    """Wait for no drift any more: nobody measures against what was asked before a start."""
    for key, aim in state.aims.items():
        if aim.state == "arrived":
            state.deadlines.drop((CHART.name, key))


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
        "node_started": _started,
        "moved": _apply_move,
    },
    safety=True,
    moves_of=frozenset(),
)
