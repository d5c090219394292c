"""The one loop's pure middle: a record in, the records that follow from it out.

`step` takes an observation, applies it, and asks each chart in its fixed order what follows; each decision
is applied before the next chart looks. A chart hears the observation and the decisions of the charts
before it, never its own, so there are no cycles. The engine has no clock, no file and no chance: seq,
cause and moment of a decision follow from the observation.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256

from events.kinds import Role
from events.records import Record, make_record
from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import StepFailed
from events.schema.orders_pb2 import OrderReceived
from statecharts.charts import CHARTS, PARTS, PLAIN
from statecharts.part import Evolve, Part
from statecharts.state import State
from statecharts.table import rows_text


@dataclass(frozen=True, slots=True)
class Step:
    """What one observation led to."""

    records: tuple[Record, ...]  # the observation first, then its decisions
    due: int | None  # flight_ns of the next deadline


def _evolvers(tables: Sequence[Mapping[str, Evolve]]) -> dict[str, tuple[Evolve, ...]]:
    changes: dict[str, list[Evolve]] = {}
    for table in tables:
        for kind, change in table.items():
            changes.setdefault(kind, []).append(change)
    return {kind: tuple(found) for kind, found in changes.items()}


def _hearers(parts: Sequence[Part]) -> dict[str, int]:
    """Return for each kind the charts that hear it, as bits in their order."""
    hearers: dict[str, int] = {}
    for index, part in enumerate(parts):
        for kind in sorted(part.alphabet):
            hearers[kind] = hearers.get(kind, 0) | 1 << index
    return hearers


def _concerned(chart: str) -> tuple[Part, ...]:
    """Return the charts that a move of one concerns, itself among them."""
    return tuple(part for part in PARTS if part.moves_of is None or chart == part.chart.name or chart in part.moves_of)


_EVOLVE = _evolvers([*PLAIN, *(part.evolve for part in PARTS)])
_HEARERS = _hearers(PARTS)
# The same for moves, by the chart that moves: most charts care for the moves of one or two others.
_MOVES_EVOLVE = {
    chart.name: _evolvers([*PLAIN, *(part.evolve for part in _concerned(chart.name))]).get("moved", ())
    for chart in CHARTS
}
_MOVES_HEARERS = {
    chart.name: sum(1 << PARTS.index(part) for part in _concerned(chart.name) if "moved" in part.alphabet)
    for chart in CHARTS
}
_PLACES = tuple((1 << index, part) for index, part in enumerate(PARTS))
_ALL = frozenset(part.chart.name for part in PARTS)
_SAFETY = frozenset(part.chart.name for part in PARTS if part.safety)


def charts_digest() -> bytes:
    """Return the SHA-256 over the rows of all charts, as the manifest holds it."""
    return sha256(rows_text(CHARTS).encode()).digest()


def evolve(state: State, record: Record) -> None:
    """Apply a record to the state, which the caller owns. Raises whatever a broken record leads to."""
    state.next_seq.set(record.seq + 1)
    message = record.message
    changes = _MOVES_EVOLVE.get(message.chart) if isinstance(message, Moved) else None
    for change in _EVOLVE.get(record.kind.name, ()) if changes is None else changes:
        change(state, record)


def _heard_by(record: Record) -> int:
    """Return the charts that hear a record, as bits in their order."""
    message = record.message
    hearers = _MOVES_HEARERS.get(message.chart) if isinstance(message, Moved) else None
    return _HEARERS.get(record.kind.name, 0) if hearers is None else hearers


def step(state: State, observation: Record) -> Step:
    """Apply an observation and everything that follows from it.

    Where that raises, nothing of it stays: the observation is recorded with `step_failed` and never applied.
    Until the next step the whole step can be undone with `state.journal.rollback()`.
    """
    state.journal.clear()
    chart = "evolve"
    records, heard_by = [observation], [_heard_by(observation)]
    try:
        evolve(state, observation)
        asked = heard_by[0]
        for place, part in _PLACES:
            if asked & place and (part.safety or state.health.value == "normal"):
                chart = part.chart.name
                asked |= _ask(state, place, part, records, heard_by)
    except Exception as error:  # noqa: BLE001 - whatever a chart raises must not stop the node
        state.journal.rollback()
        records = _failed(state, observation, chart, error)
    return Step(tuple(records), _due(state, observation))


def _ask(state: State, place: int, part: Part, records: list[Record], heard_by: list[int]) -> int:
    """Ask one chart about everything said so far that it hears; return the charts that hear its answers."""
    observation, hearers = records[0], 0
    for index in range(len(records)):
        if heard_by[index] & place:
            for message in part.decide(state, records[index]):
                record = make_record(state.next_seq.value, observation.seq, observation.at, message)
                evolve(state, record)
                records.append(record)
                heard_by.append(_heard_by(record))
                hearers |= heard_by[-1]
    return hearers


def _failed(state: State, observation: Record, chart: str, error: Exception) -> list[Record]:
    failure = make_record(observation.seq + 1, observation.seq, observation.at, _failure(observation, chart, error))
    evolve(state, failure)
    records, heard_by = [failure], [_heard_by(failure)]
    for place, part in _PLACES:
        if heard_by[0] & place:
            _ask_about_failure(state, place, part, records, heard_by)
    return [observation, *records]


def _ask_about_failure(state: State, place: int, part: Part, records: list[Record], heard_by: list[int]) -> None:
    try:
        _ask(state, place, part, records, heard_by)
    except Exception:  # noqa: BLE001 - a chart that can't even hear of a failure has nothing to add to it
        return


def _failure(observation: Record, chart: str, error: Exception) -> StepFailed:
    failure = StepFailed(chart=chart, error=type(error).__name__)
    order = observation.message
    if isinstance(order, OrderReceived):
        failure.command_id, failure.principal_id = order.command_id, order.issuer.principal_id
        failure.in_reply_to = order.in_reply_to
    return failure


def _due(state: State, observation: Record) -> int | None:
    """Return the next deadline that somebody waits for.

    Right after `time_passed` that is a later one: what had passed was offered then. In safe mode the charts that are
    not asked wait for nothing; a start afterwards finds their deadlines where they were.
    """
    told = observation.kind.name == "time_passed"
    if not told and state.health.value == "normal":
        return state.deadlines.least()
    waiting = _SAFETY if state.health.value != "normal" else _ALL
    after_ns = observation.at.flight_ns if told else -1
    return min(
        (at_ns for key, at_ns in state.deadlines.items() if key[0] in waiting and at_ns > after_ns), default=None
    )


def steps_of(records: Iterable[Record]) -> Iterator[tuple[Record, ...]]:
    """Group a log into steps: an observation and the decisions that follow it."""
    group: list[Record] = []
    for record in records:
        if record.kind.role is Role.OBSERVATION and group:
            yield tuple(group)
            group = []
        group.append(record)
    if group:
        yield tuple(group)


def restore(state: State, recorded: Sequence[Record]) -> int | None:
    """Apply one recorded step without deciding anything, and return the next deadline as `step` does.

    A failed observation is passed over, as it was then.
    """
    state.journal.clear()
    failed = len(recorded) > 1 and recorded[1].kind.name == "step_failed"
    for record in recorded[1:] if failed else recorded:
        evolve(state, record)
    return _due(state, recorded[0])
