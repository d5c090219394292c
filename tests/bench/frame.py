"""The frame of the benchmarks: contestants run interleaved, a row is the median of five.

Machines are noisy and shared, so a row is a ratio within one run wherever there is something to compare
with: contestants take turns, each round gives one ratio, and the median of the rounds counts. A warm-up
round is thrown away. Nothing here knows what is measured.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

from tests.house import REPO

ROUNDS = 5
RESULT = REPO / "build" / "bench.json"
WORK = REPO / "build" / "bench-work"

# Runs once in a folder of its own and returns what it measured; only the part that counts is timed.
Contestant = Callable[[Path], float]


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table."""

    name: str
    value: float
    unit: str
    budget: float
    met: bool
    against: str


@dataclass(frozen=True, slots=True)
class Bench:
    """A measurement that has not run yet."""

    name: str
    run: Callable[[], Sequence[Row]]


@contextmanager
def fresh_folder() -> Iterator[Path]:
    """Give an empty folder on the disk of the repository, never in memory, and take it away again."""
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    try:
        yield WORK
    finally:
        shutil.rmtree(WORK, ignore_errors=True)


def interleaved(contestants: Mapping[str, Contestant], rounds: int = ROUNDS) -> dict[str, list[float]]:
    """Run each contestant once a round, the first one another each time; return the measures by name."""
    names = list(contestants)
    measures: dict[str, list[float]] = {name: [] for name in names}
    for turn in range(rounds + 1):
        first = turn % len(names)
        for name in names[first:] + names[:first]:
            with fresh_folder() as folder:
                measure = contestants[name](folder)
            if turn > 0:  # the first round warms up
                measures[name].append(measure)
    return measures


def ratio(measures: Mapping[str, Sequence[float]], ours: str, theirs: str) -> float:
    """Return the median of the rounds' ratios: how many times theirs is ours."""
    return median(mine / other for mine, other in zip(measures[ours], measures[theirs], strict=True))


def at_least(name: str, value: float, unit: str, budget: float, against: str) -> Row:
    """Return a row whose value must reach the budget."""
    return Row(name, value, unit, budget, value >= budget, against)


def at_most(name: str, value: float, unit: str, budget: float, against: str) -> Row:
    """Return a row whose value must stay within the budget."""
    return Row(name, value, unit, budget, value <= budget, against)


def figure(value: float) -> str:
    """Return a number as a person reads it: three digits that count, thousands apart."""
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def table(rows: Sequence[Row]) -> str:
    """Return the rows as text in columns."""
    head = ("name", "value", "unit", "budget", "met", "against")
    cells = [
        (row.name, figure(row.value), row.unit, figure(row.budget), "yes" if row.met else "no", row.against)
        for row in rows
    ]
    widths = [max(len(line[column]) for line in (head, *cells)) for column in range(len(head))]
    lines = ("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in (head, *cells))
    return "\n".join(line.rstrip() for line in lines)


def save(rows: Sequence[Row], path: Path = RESULT) -> None:
    """Write the rows as JSON, one object a row."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps([asdict(row) for row in rows], indent=2) + "\n", encoding="utf-8")
