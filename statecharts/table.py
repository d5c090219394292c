"""Charts as frozen rows, and the one place where `transitions` executes them.

The rows are the only truth. Asking a chart evaluates every candidate row: the lowest band with an open
guard decides, and two open guards in one band are an error, never a race (style 19). Only a row that
moves is put to `transitions`, on a bare model, with one trigger name a row, without auto transitions,
callbacks or timeouts: its own defaults would pick the first match and let any state be reached. So a row
has nothing there that could come out otherwise a second time, and is put to it once in a process.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Generic, TypeVar, cast

from transitions import Machine

from events.schema.common_pb2 import Moved

F = TypeVar("F")


class Answer(Enum):
    """What a row does with its trigger."""

    MOVE = "move"
    IGNORE = "ignore"
    REFUSE = "refuse"


class IllegalTransition(RuntimeError):
    """No row is open for a trigger inside the alphabet: the table has a hole. Our fault, never the input's."""


class AmbiguousTransition(RuntimeError):
    """Two rows of one band are open. Our fault, never the input's."""


@dataclass(frozen=True, slots=True)
class Row(Generic[F]):
    """One line of a chart. A guard is a named predicate of plain values."""

    source: str
    trigger: str
    answer: Answer
    target: str  # where it ends; its source for a row that does not move
    because: str
    guard: Callable[[F], bool] | None = None
    band: int = 0


def move(
    source: str, trigger: str, target: str, because: str, guard: Callable[[F], bool] | None = None, band: int = 0
) -> Row[F]:
    """Return a row that moves."""
    return Row(source, trigger, Answer.MOVE, target, because, guard, band)


def ignore(source: str, trigger: str, because: str, guard: Callable[[F], bool] | None = None, band: int = 0) -> Row[F]:
    """Return a row that stays, and nobody needs to be told."""
    return Row(source, trigger, Answer.IGNORE, source, because, guard, band)


def refuse(source: str, trigger: str, because: str, guard: Callable[[F], bool] | None = None, band: int = 0) -> Row[F]:
    """Return a row that stays and has a reason for whoever asked."""
    return Row(source, trigger, Answer.REFUSE, source, because, guard, band)


class _Model:
    """A bare model: `transitions` keeps the state here for the length of one question."""

    state: str
    trigger: Callable[[str], bool]


@dataclass(frozen=True)
class Chart(Generic[F]):
    """A chart: states, the triggers of its alphabet, and rows."""

    name: str
    initial: str
    states: tuple[str, ...]
    terminal: tuple[str, ...]
    triggers: tuple[str, ...]
    rows: tuple[Row[F], ...]
    _by_cell: dict[tuple[str, str], tuple[tuple[int, Row[F]], ...]] = field(init=False, repr=False, compare=False)
    _machine: Machine = field(init=False, repr=False, compare=False)
    _executed: set[int] = field(init=False, repr=False, compare=False, default_factory=set)  # rows that ended right

    def __post_init__(self) -> None:
        """Index the rows and build the executor. Raises ValueError for a row that names no state or trigger."""
        object.__setattr__(self, "_by_cell", _cells(self))
        object.__setattr__(self, "_machine", _machine(self))

    def ask(self, state: str, trigger: str, facts: F) -> Row[F]:
        """Return the one open row. Raises IllegalTransition and AmbiguousTransition."""
        chosen: tuple[int, Row[F]] | None = None
        for number, row in self._by_cell.get((state, trigger), ()):
            if chosen is not None and row.band > chosen[1].band:
                break
            if row.guard is None or row.guard(facts):
                if chosen is not None:
                    raise AmbiguousTransition(f"{self.name}: rows {chosen[0]} and {number} are open at {state}")
                chosen = (number, row)
        if chosen is None:
            raise IllegalTransition(f"{self.name}: no row is open for {trigger} in {state}")
        if chosen[1].answer is Answer.MOVE and chosen[0] not in self._executed:
            self._execute(*chosen)
            self._executed.add(chosen[0])
        return chosen[1]

    def cell(self, state: str, trigger: str) -> tuple[Row[F], ...]:
        """Return all rows for a state and a trigger, in the order of their bands."""
        return tuple(row for _, row in self._by_cell.get((state, trigger), ()))

    def _execute(self, number: int, row: Row[F]) -> None:
        model = cast(_Model, self._machine.model)
        model.state = row.source
        model.trigger(f"row_{number}")
        if model.state != row.target:
            raise IllegalTransition(f"{self.name}: row {number} ended in {model.state}, not in {row.target}")


def moved(chart: Chart[F], instance: str, row: Row[F]) -> Moved:
    """Return the decision that records a move."""
    return Moved(chart=chart.name, instance=instance, from_state=row.source, to_state=row.target, because=row.because)


def _cells(chart: Chart[F]) -> dict[tuple[str, str], tuple[tuple[int, Row[F]], ...]]:
    cells: dict[tuple[str, str], list[tuple[int, Row[F]]]] = {}
    for number, row in enumerate(chart.rows):
        if row.source not in chart.states or row.target not in chart.states or row.trigger not in chart.triggers:
            raise ValueError(f"{chart.name}: row {number} names a state or a trigger that the chart does not have")
        cells.setdefault((row.source, row.trigger), []).append((number, row))
    return {cell: tuple(sorted(rows, key=lambda numbered: numbered[1].band)) for cell, rows in cells.items()}


def _machine(chart: Chart[F]) -> Machine:
    machine = Machine(
        model=_Model(),
        states=list(chart.states),
        initial=chart.initial,
        auto_transitions=False,
        send_event=False,
        queued=False,
    )
    for number, row in enumerate(chart.rows):
        if row.answer is Answer.MOVE:
            machine.add_transition(f"row_{number}", row.source, row.target)
    return machine


def rows_text(charts: Sequence[Chart[F]]) -> str:
    """Return all rows as text, one a line: what the manifest's digest of the charts covers."""
    return "".join(
        f"{chart.name}|{row.source}|{row.trigger}|{row.answer.value}|{row.target}|{row.because}|"
        f"{row.guard.__name__ if row.guard else ''}|{row.band}\n"
        for chart in charts
        for row in chart.rows
    )
