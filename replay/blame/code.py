"""Whether it is the code.

The manifest says what decided then; where it says nothing of a difference, code is what is left.

Names the chart, and the row that was open then and is not now. It runs nothing.
"""

from __future__ import annotations

from collections.abc import Iterable

from events import Record
from events.schema.common_pb2 import Moved
from replay.blame.case import Case
from replay.blame.findings import Cause, Finding, Weight
from statecharts import CHARTS, charts_digest, logic, step


def code(case: Case, software: str | None, *, lifted: bool) -> Finding:
    """Hold the manifest against this software; `software` is this one's version, None where nobody knows it.

    `lifted`: older records were lifted, so other code is expected, and says less.
    """
    opened = case.manifest
    rules = [
        *([f"logic {opened.logic}, here {logic.LOGIC}"] if opened.logic != logic.LOGIC else []),
        *(["other rows of charts"] if opened.charts_digest != charts_digest() else []),
    ]
    version = [f"software {opened.software}, here {software}"] if software not in (None, opened.software) else []
    where = _where(case)
    if rules or version:
        weight = Weight.DIFFERS if rules and not lifted else Weight.OLDER
        return Finding(Cause.CODE, weight, f"recorded by other code ({', '.join(rules + version)}); {where}")
    words = "logic, rows and software are those of the recording, but a guard or a message may have been others, or"
    return Finding(Cause.CODE, Weight.LEFT, f"{words} the log was written by somebody else; {where}")


def _where(case: Case) -> str:
    """Return the chart and the rows at which the step parts, in words."""
    state = case.at()
    made = step(state, case.group.observation).records[1:]
    index = next(
        (i for i, (one, other) in enumerate(zip(made, case.group.decisions, strict=False)) if one.body != other.body),
        min(len(made), len(case.group.decisions)),
    )
    recorded, replayed = _move(case.group.decisions, index), _move(made, index)
    if recorded is None and replayed is None:
        return f"no chart moves otherwise: look at what is said of {case.first.kind}"
    told = [
        f"{'recorded' if number == 0 else 'replayed'} {change.chart} {change.from_state} -> {change.to_state}, "
        f"{change.because!r}{_row(change)}"
        for number, change in enumerate((recorded, replayed))
        if change is not None
    ]
    return "; ".join(told)


def _move(decisions: Iterable[Record], index: int) -> Moved | None:
    """Return the move at a place of a step, or the last one before it that says why something was said."""
    moves = [record.message for record in list(decisions)[: index + 1] if isinstance(record.message, Moved)]
    return moves[-1] if moves else None


def _row(change: Moved) -> str:
    """Return which row of ours a move is, in words."""
    rows = [chart.rows for chart in CHARTS if chart.name == change.chart]
    for number, row in enumerate(rows[0] if rows else ()):
        if (row.source, row.target, row.because) == (change.from_state, change.to_state, change.because):
            guard = f", guard {row.guard.__name__}" if row.guard else ""
            return f" (row {number}{guard})"
    return " (no row of ours gives this reason)"
