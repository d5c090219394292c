"""The page of the statecharts: a diagram and a table of rows for each, drawn from the rows alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from docs.text import table
from statecharts.table import Answer, Chart, Row

HEAD = """# The statecharts

Drawn from the rows in `statecharts/charts/` by `make diagrams`; do not edit it here. A row answers a trigger in a
state: it *moves* the instance, *ignores* the trigger, or *refuses* it with a reason for whoever asked. Where a row has
a guard, it has to hold; where several rows are open, the lowest band decides, and two in one band are an error. Every
move is recorded with the reason in the last column. The diagrams show the moves without their guards.

`transfer` stands apart: the vehicle's adapter executes it, at the edge, and the core sees only how it ended.
"""


def _alias(state: str) -> str:
    return "".join(letter if letter.isalnum() else "_" for letter in state)


def _guard(row: Row[Any]) -> str:
    return row.guard.__name__.strip("_").replace("_", " ") if row.guard else ""


def _arrows(chart: Chart[Any]) -> Iterator[str]:
    """Yield one arrow for each pair of states, however many rows move between them."""
    triggers: dict[tuple[str, str], dict[str, None]] = {}
    for row in chart.rows:
        if row.answer is Answer.MOVE:
            triggers.setdefault((row.source, row.target), {})[row.trigger.replace("_", " ")] = None
    for (source, target), words in triggers.items():
        yield f"    {_alias(source)} --> {_alias(target)}: {', '.join(words)}"


def _diagram(chart: Chart[Any]) -> Iterator[str]:
    yield from ("```mermaid", "stateDiagram-v2")
    yield from (f'    state "{state}" as {_alias(state)}' for state in chart.states)
    yield f"    [*] --> {_alias(chart.initial)}"
    yield from _arrows(chart)
    yield from (f"    {_alias(state)} --> [*]" for state in chart.terminal)
    yield from ("```", "")


def _cells(row: Row[Any]) -> tuple[str, ...]:
    target = row.target if row.answer is Answer.MOVE else ""
    band = str(row.band) if row.guard or row.band else ""
    return row.source, row.trigger, _guard(row), band, row.answer.value, target, row.because


def page(charts: Iterable[Chart[Any]]) -> str:
    """Return docs/charts.md for these charts."""
    lines = [HEAD]
    for chart in charts:
        lines += [f"## {chart.name}", "", *_diagram(chart)]
        lines += table(("state", "trigger", "guard", "band", "answer", "to", "because"), map(_cells, chart.rows))
    return "\n".join(lines).rstrip() + "\n"
