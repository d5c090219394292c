"""The executor of rows: bands, holes, races, and what a chart must not be made of."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from statecharts.charts import CHARTS, transfer
from statecharts.table import (
    AmbiguousTransition,
    Answer,
    Chart,
    IllegalTransition,
    Row,
    ignore,
    move,
    moved,
    refuse,
    rows_text,
)
from tests.checks import check_equal


def small(facts: int) -> bool:
    """Below ten."""
    return facts < 10


def even(facts: int) -> bool:
    """Divisible by two."""
    return facts % 2 == 0


def chart_of(*rows: Row[int], terminal: tuple[str, ...] = ()) -> Chart[int]:
    """Return a chart of three states and two triggers."""
    return Chart("test", "a", ("a", "b", "c"), terminal, ("go", "stay"), rows)


CHART = chart_of(
    refuse("a", "go", "third", band=3),
    move("a", "go", "b", "first", small, band=1),
    move("a", "go", "c", "second", even, band=2),
    ignore("a", "stay", "nothing"),
    move("b", "go", "b", "again"),
)


@pytest.mark.parametrize(
    ("facts", "because", "target", "answer"),
    [
        (2, "first", "b", Answer.MOVE),
        (3, "first", "b", Answer.MOVE),
        (10, "second", "c", Answer.MOVE),
        (11, "third", "a", Answer.REFUSE),
    ],
)
def test_the_lowest_open_band_decides(facts: int, because: str, target: str, answer: Answer) -> None:
    """Whatever the order of the rows."""
    row = CHART.ask("a", "go", facts)
    check_equal((row.because, row.target, row.answer), (because, target, answer))


def test_a_row_may_lead_back_to_its_state() -> None:
    """A move all the same: it is recorded."""
    check_equal(CHART.ask("b", "go", 0).answer, Answer.MOVE)
    check_equal(CHART.ask("a", "stay", 0).answer, Answer.IGNORE)
    change = moved(CHART, "x", CHART.ask("a", "go", 2))
    check_equal(
        (change.chart, change.instance, change.from_state, change.to_state, change.because),
        ("test", "x", "a", "b", "first"),
    )


def check_raises(error: type[Exception], words: str, chart: Chart[int], state: str, trigger: str, facts: int) -> None:
    """Check that asking a chart is an error that says where."""
    with pytest.raises(error, match=words):
        chart.ask(state, trigger, facts)


def test_a_hole_is_loud() -> None:
    """No row for the cell, no cell at all, or no guard open."""
    check_raises(IllegalTransition, "test: no row is open for go in c", CHART, "c", "go", 0)
    check_raises(IllegalTransition, "no row is open for fly in a", CHART, "a", "fly", 0)
    check_raises(IllegalTransition, "no row is open", chart_of(move("a", "go", "b", "x", small)), "a", "go", 11)


def test_a_race_is_loud() -> None:
    """Two open rows in one band; closed ones and later bands are no race."""
    race = chart_of(
        move("a", "go", "b", "x", small, band=1),
        move("a", "go", "c", "y", even, band=1),
        ignore("a", "go", "z", band=2),
    )
    check_raises(AmbiguousTransition, "test: rows 0 and 1 are open at a", race, "a", "go", 2)
    check_equal([race.ask("a", "go", facts).because for facts in (3, 12, 11)], ["x", "y", "z"])


@pytest.mark.parametrize(
    "row", [move("a", "go", "nowhere", "x"), move("d", "go", "a", "x"), move("a", "fly", "b", "x")]
)
def test_a_row_names_what_the_chart_has(row: Row[int]) -> None:
    """A state or a trigger that is not there is an error at import."""
    with pytest.raises(ValueError, match="test: row 0 names a state or a trigger"):
        chart_of(row)


def test_the_executor_is_believed_only_where_it_ends_right() -> None:
    """A row that the executor takes elsewhere is an error."""
    chart = chart_of(move("a", "go", "b", "x"))
    object.__setattr__(chart, "_machine", chart_of(move("a", "go", "c", "x"))._machine)
    for _ in range(2):
        check_raises(IllegalTransition, "row 0 ended in c, not in b", chart, "a", "go", 0)


def test_a_row_is_put_to_the_executor_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each row that moves, the first time; one that does not move, never."""
    chart = chart_of(move("a", "go", "b", "x"), move("b", "go", "a", "y"), ignore("b", "stay", "z"))
    put: list[int] = []
    monkeypatch.setattr(Chart, "_execute", lambda _chart, number, _row: put.append(number))
    answers = [
        chart.ask(state, trigger, 0).because for state, trigger in (*(("a", "go"), ("b", "go")) * 2, ("b", "stay"))
    ]
    check_equal((answers, put), (["x", "y", "x", "y", "z"], [0, 1]))


@pytest.mark.parametrize("chart", [*CHARTS, transfer.CHART], ids=lambda chart: chart.name)
def test_every_move_of_every_chart_is_executed_as_written(chart: Chart[Any]) -> None:
    """`transitions` ends where the row says, for each row."""
    for number, row in enumerate(chart.rows):
        if row.answer is Answer.MOVE:
            chart._execute(number, row)
    check_equal(len(chart._machine.states), len(chart.states))


def test_the_digest_covers_every_part_of_a_row() -> None:
    """A chart that decides otherwise has another text."""
    row = move("a", "go", "b", "x", small, band=1)
    changes: list[dict[str, Any]] = [
        {"source": "b"},
        {"trigger": "stay"},
        {"answer": Answer.REFUSE},
        {"target": "c"},
        {"because": "y"},
        {"guard": even},
        {"guard": None},
        {"band": 2},
    ]
    texts = {rows_text([chart_of(row)])} | {rows_text([chart_of(replace(row, **change))]) for change in changes}
    check_equal(len(texts), 1 + len(changes))
    check_equal(rows_text([chart_of(row)]), "test|a|go|move|b|x|small|1\n")
