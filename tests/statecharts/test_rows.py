"""All pairs (style 31): in every state every trigger of a chart has exactly one open row, whatever its guards say."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import pytest

from events import Moment, Record, make_record
from events.kinds import KINDS, Role
from events.schema.common_pb2 import Moved
from statecharts import State
from statecharts.charts import CHARTS, PARTS, poi, transfer
from statecharts.engine import _EVOLVE, _heard_by
from statecharts.part import Part
from statecharts.table import Answer, Chart, Row, moved
from tests.checks import check_equal, check_exactly_one_row, dump, name_of
from tests.stories import Story

COMPLEMENTS = (
    frozenset({("confirmed", True), ("declined", True)}),
    frozenset({("confirmed", False), ("declined", False)}),
)


ALL = (*CHARTS, transfer.CHART)  # the last is executed at the edge


def by_name(chart: Chart[Any]) -> str:
    """Name a chart in the names of tests."""
    return chart.name


@pytest.mark.parametrize("chart", ALL, ids=by_name)
def test_exactly_one_row_is_open(chart: Chart[Any]) -> None:
    """No hole and no race in any state, for any trigger and any answers of the guards."""
    check_exactly_one_row(chart, COMPLEMENTS)


def test_what_is_taken_for_a_complement_is_one() -> None:
    """The two guards of a judgement never agree."""
    answers = [(poi.confirmed(facts), poi.declined(facts)) for facts in (poi.Facts(False), poi.Facts(True))]
    check_equal(answers, [(False, True), (True, False)])


def faults(chart: Chart[Any]) -> Iterator[str]:
    """Yield what is wrong with the rows of a chart at a look."""
    for state, trigger in product(chart.states, chart.triggers):
        cell = chart.cell(state, trigger)
        last = [row for row in cell if row.band == max(one.band for one in cell)]
        if len(last) == 1 and last[0].guard is not None:
            yield f"{state}, {trigger}: the last row is guarded"
        if [row for row in cell if row.guard is None] not in ([], last):
            yield f"{state}, {trigger}: a row behind an unguarded one is never reached"
        if len({name_of(row) for row in cell}) != len(cell):
            yield f"{state}, {trigger}: a guard twice"
    for row in chart.rows:
        if row.source in chart.terminal and row.answer is Answer.MOVE:
            yield f"{row.source} is terminal and moves"
        if not row.because.strip():
            yield f"{row.source}, {row.trigger}: no reason"
    reached = {chart.initial} | {row.target for row in chart.rows if row.answer is Answer.MOVE}
    yield from (f"{state} is never reached" for state in chart.states if state not in reached)


@pytest.mark.parametrize("chart", ALL, ids=by_name)
def test_rows_are_in_order(chart: Chart[Any]) -> None:
    """Last bands without a guard, no shadowed row, terminal states at rest, reasons everywhere, every state reached."""
    check_equal(list(faults(chart)), [])


def test_faults_are_found() -> None:
    """A bad chart breaks each rule."""
    never = Row("a", "go", Answer.MOVE, "b", "why", poi.confirmed)
    bad: Chart[Any] = Chart(
        "bad", "a", ("a", "b", "c"), ("b",), ("go",), (never, Row("b", "go", Answer.MOVE, "a", " ", None, 1))
    )
    found = list(faults(bad))
    check_equal(
        found,
        ["a, go: the last row is guarded", "b is terminal and moves", "b, go: no reason", "c is never reached"],
    )
    shadowed: Chart[Any] = Chart(
        "bad",
        "a",
        ("a",),
        (),
        ("go",),
        (
            Row("a", "go", Answer.IGNORE, "a", "x"),
            Row("a", "go", Answer.IGNORE, "a", "y", poi.confirmed, 1),
            Row("a", "go", Answer.IGNORE, "a", "z", poi.confirmed, 2),
        ),
    )
    check_equal(
        list(faults(shadowed))[1:],
        [
            "a, go: a row behind an unguarded one is never reached",
            "a, go: a guard twice",
        ],
    )


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.chart.name)
def test_an_alphabet_names_kinds(part: Part) -> None:
    """Every kind that a chart hears or applies is in the catalogue, and every trigger has a row."""
    names = {kind.name for kind in KINDS}
    check_equal(sorted((part.alphabet | part.evolve.keys()) - names), [])
    check_equal(sorted({row.trigger for row in part.chart.rows}), sorted(part.chart.triggers))


def test_every_observation_and_decision_has_a_reader() -> None:
    """What the core neither hears nor applies is named here, so that a forgotten kind is noticed."""
    heard = {kind for part in PARTS for kind in part.alphabet} | set(_EVOLVE)
    silent = {kind.name for kind in KINDS if kind.role is not Role.EFFECT} - heard
    for_people = {"eyes_changed", "inputs_dropped", "samples_rejected", "property_broken"}
    for_people |= {"log_recovered", "log_damaged", "disk_full", "flight_deleted", "log_key_certified", "seal_refused"}
    for_people |= {"checkpoint_cosigned", "trust_alarm", "camera_zoomed"}
    for_people |= {"vehicle_identified", "vehicle_time_compared", "raw_changed", "raw_segment_closed"}
    check_equal(silent, for_people)


@pytest.mark.parametrize(
    "part", [part for part in PARTS if part.moves_of is not None], ids=lambda part: part.chart.name
)
def test_a_move_concerns_nobody_else(part: Part) -> None:
    """Whose moves a chart says do not concern it, of those it would decide nothing and keep nothing."""
    assert part.moves_of is not None
    check_equal(sorted(part.moves_of - {chart.name for chart in CHARTS}), [])
    told = Story(scan_enabled=True)
    for words in ("frame person@0,0", "order a point", "order b follow p1", "answered a 0"):
        told.tell(words)
    state, at = told.flight.state, told.flight.moment()
    before = dump(state)
    for chart in (chart for chart in CHARTS if chart.name not in (*part.moves_of, part.chart.name)):
        for row, instance in product(chart.rows, _instances(state)):
            record = make_record(state.next_seq.value, 0, at, moved(chart, instance, row))
            if "moved" in part.alphabet:
                check_equal(part.decide(state, record), ())
            if "moved" in part.evolve:
                part.evolve["moved"](state, record)
    check_equal(dump(state), before)


def _instances(state: State) -> list[str]:
    """Return names that moves are about in this state, and one that nothing has."""
    return [*state.orders.whole(), *state.cameras.whole(), *state.pois.whole(), "nobody"]


def test_a_move_is_heard_by_those_that_it_concerns() -> None:
    """By the charts that name the one that moved, and those that name none; one that nobody knows, by all."""
    check_equal(names_of(_heard_by(move_of("camera"))), ["safety", "camera", "scan", "mission", "control"])
    check_equal(names_of(_heard_by(move_of("aim"))), ["safety", "mission"])
    check_equal(names_of(_heard_by(move_of("gone"))), [part.chart.name for part in PARTS if "moved" in part.alphabet])


def move_of(chart: str) -> Record:
    """Return a record of a move of a chart."""
    return make_record(1, 0, Moment(0, 0, 1, 0, 0), Moved(chart=chart, instance="x"))


def names_of(hearers: int) -> list[str]:
    """Return the charts that bits stand for."""
    return [part.chart.name for place, part in enumerate(PARTS) if hearers & 1 << place]


SAFETY_NAMES = ["health", "link", "safety", "command", "override", "camera", "aim"]
CHART_NAMES = [
    *("health", "link", "safety", "command", "override", "selftest", "camera"),
    *("map", "poi", "scan", "mission", "control", "aim"),
]


def test_the_order_of_the_charts() -> None:
    """Safety first, and in safe mode only what keeps the vehicle and its answers in order."""
    check_equal([part.chart.name for part in PARTS], CHART_NAMES)
    check_equal([part.chart.name for part in PARTS if part.safety], SAFETY_NAMES)
