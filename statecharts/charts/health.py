"""Chart `health`: whether this node may still be trusted to decide.

Theory of operation. A step that raises has changed nothing and is recorded as `step_failed`. One such step may
be a single strange input. Several within a short window mean that the software is wrong about the world it
is in: the node goes to safe mode, in which orders are refused (with that reason), nothing is looked for, and
only the charts that keep the vehicle and its answers in order run on. It must never leave safe mode by itself:
only a new start of the daemon does, which a person or a supervisor has seen.
"""

from __future__ import annotations

from dataclasses import dataclass

from google.protobuf.message import Message

from events.records import Record
from events.schema.common_pb2 import Moved
from statecharts.part import Part
from statecharts.state import State
from statecharts.table import Answer, Chart, ignore, move, moved

NS_PER_MS = 1_000_000


@dataclass(frozen=True, slots=True)
class _Facts:
    failures: int
    failures_to_safe_mode: int


def too_many_failures(facts: _Facts) -> bool:
    """Failed steps in the window have reached the limit."""
    return facts.failures >= facts.failures_to_safe_mode


CHART: Chart[_Facts] = Chart(
    name="health",
    initial="normal",
    states=("normal", "safe_mode"),
    terminal=(),
    triggers=("step_failed", "node_started"),
    rows=(
        move("normal", "step_failed", "safe_mode", "too many failed steps", too_many_failures, band=1),
        ignore("normal", "step_failed", "a single failed step", band=2),
        ignore("safe_mode", "step_failed", "in safe mode already"),
        ignore("normal", "node_started", "nothing to leave"),
        move("safe_mode", "node_started", "normal", "started again"),
    ),
)


def decide(state: State, record: Record) -> tuple[Message, ...]:
    """Return the move, if any."""
    if state.manifest.value is None:
        return ()  # the manifest itself could not be applied: there is no limit to judge by
    limits = state.flight.limits
    facts = _Facts(len(state.failures.value), limits.failures_to_safe_mode)
    row = CHART.ask(state.health.value, record.kind.name, facts)
    return (moved(CHART, "node", row),) if row.answer is Answer.MOVE else ()


def _count_failure(state: State, record: Record) -> None:
    window_ns = state.flight.limits.failure_window_ms * NS_PER_MS if state.manifest.value else 0
    since_ns = record.at.flight_ns - window_ns
    recent = tuple(at_ns for at_ns in state.failures.value if at_ns > since_ns)
    state.failures.set((*recent, record.at.flight_ns))


def _apply_move(state: State, record: Record) -> None:
    change = record.message
    assert isinstance(change, Moved)
    if change.chart == CHART.name:
        state.health.set(change.to_state)
        state.failures.set(())


PART = Part(
    chart=CHART,
    alphabet=frozenset({"step_failed", "node_started"}),
    decide=decide,
    evolve={"step_failed": _count_failure, "moved": _apply_move},
    safety=True,
    moves_of=frozenset(),
)
