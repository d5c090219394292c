"""Chart `selftest`: whether the node and its vehicle are fit to fly a mission (seed 004's system: BIT).

Theory of operation. The first plan of a mission starts the test; the shell looks at each item and reports what it found
in one record. All pass: passed, and that stays for the flight. Any fail: failed. Otherwise it is degraded, and a person
has to take that on, by a signed order that names this very report, within `selftest_acknowledge_ms`: who did stands in
the log. Nobody in time: failed. A failed test is run again when a person orders the mission to begin, or when another
plan comes. It must never pass by silence, and an acknowledgement of one report must never serve another.
"""

from __future__ import annotations

from dataclasses import dataclass

from google.protobuf.message import Message

from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import NodeStarted
from events.schema.mission_pb2 import SELFTEST_DEGRADED, SELFTEST_FAIL, RunSelftest, SelftestReported
from statecharts.facts import Selftest
from statecharts.part import Part
from statecharts.state import State
from statecharts.table import Answer, Chart, Row, ignore, move, moved

NS_PER_MS = 1_000_000
VEHICLE = 1


@dataclass(frozen=True, slots=True)
class Facts:
    """What the guards look at."""

    enabled: bool = False  # this node flies missions
    own: bool = True  # the report is of the newest run
    failed: bool = False
    degraded: bool = False
    time_lost: bool = False


def enabled(facts: Facts) -> bool:
    """Missions are flown by this node."""
    return facts.enabled


def of_another(facts: Facts) -> bool:
    """The report is of a run before this one."""
    return not facts.own


def any_failed(facts: Facts) -> bool:
    """An item failed, or there is none."""
    return facts.failed


def any_degraded(facts: Facts) -> bool:
    """An item is degraded."""
    return facts.degraded


def time_lost(facts: Facts) -> bool:
    """The node was off for a time that is not known."""
    return facts.time_lost


def _rest(source: str, because: str, *triggers: str) -> tuple[Row[Facts], ...]:
    return tuple(ignore(source, trigger, because) for trigger in triggers)


CHART: Chart[Facts] = Chart(
    name="selftest",
    initial="idle",
    states=("idle", "running", "awaiting", "passed", "failed"),
    terminal=("passed",),
    triggers=("planned", "reported", "acknowledged", "begin", "time_passed", "node_started"),
    rows=(
        move("idle", "planned", "running", "there is a mission: is this node fit to fly it?", enabled, band=1),
        ignore("idle", "planned", "this node flies no missions", band=2),
        *_rest("idle", "nothing is tested", "reported", "acknowledged", "begin", "time_passed", "node_started"),
        ignore("running", "reported", "a report of a run before", of_another, band=1),
        move("running", "reported", "failed", "an item failed", any_failed, band=2),
        move("running", "reported", "awaiting", "degraded: a person has to take it on", any_degraded, band=3),
        move("running", "reported", "passed", "all items pass", band=4),
        move("running", "time_passed", "failed", "no report came"),
        move("running", "node_started", "running", "started again: tested again"),
        *_rest("running", "the test runs", "planned", "acknowledged", "begin"),
        move("awaiting", "acknowledged", "passed", "a person took it on"),
        move("awaiting", "time_passed", "failed", "nobody took it on in time"),
        move(
            "awaiting",
            "node_started",
            "failed",
            "off for an unknown time: the time to take it on is over",
            time_lost,
            1,
        ),
        ignore("awaiting", "node_started", "it still waits", band=2),
        *_rest("awaiting", "it waits for a person's word on its report", "planned", "reported", "begin"),
        *_rest("passed", "passed, and that stays", "planned", "reported", "acknowledged", "begin"),
        *_rest("passed", "waits for nothing", "time_passed", "node_started"),
        move("failed", "planned", "running", "another plan: tested again"),
        move("failed", "begin", "running", "a person asks again: tested again"),
        *_rest("failed", "it failed", "reported", "acknowledged", "time_passed", "node_started"),
    ),
)


def decide(state: State, record: Record) -> tuple[Message, ...]:
    """Return the test's moves, and the effect that runs it."""
    message = record.message
    match message:
        case SelftestReported():
            return _fire(state, "reported", _verdict(state, message))
        case NodeStarted():
            return _fire(state, "node_started", Facts(time_lost=message.HasField("outage_unbounded")))
        case Moved():
            trigger = _asked(state, message)
            return _fire(state, trigger, Facts()) if trigger else ()
    if record.kind.name == "time_passed":
        passed = state.passed(CHART.name, record.at.flight_ns)
        return _fire(state, "time_passed", Facts()) if passed else ()
    return _fire(state, "planned", Facts(enabled=state.flight.limits.mission_enabled))


def _asked(state: State, change: Moved) -> str:
    """Return what an accepted order means here; "" for nothing."""
    if change.chart != "command" or change.to_state != "accepted":
        return ""
    order = state.orders[change.instance]
    if order.verb == "acknowledge":
        return "acknowledged"
    return "begin" if order.verb == "mission" and order.asked == "begin" else ""


def _verdict(state: State, report: SelftestReported) -> Facts:
    verdicts = [item.verdict for item in report.items]
    return Facts(
        own=report.effect_seq == selftest(state).effect_seq,
        failed=not verdicts or SELFTEST_FAIL in verdicts,
        degraded=SELFTEST_DEGRADED in verdicts,
    )


def selftest(state: State) -> Selftest:
    """Return how far the self-test of the vehicle got."""
    return state.selftests.get(VEHICLE) or Selftest()


def _fire(state: State, trigger: str, facts: Facts) -> tuple[Message, ...]:
    row = CHART.ask(selftest(state).state, trigger, facts)
    if row.answer is not Answer.MOVE:
        return ()
    change = moved(CHART, str(VEHICLE), row)
    return (change, RunSelftest(vehicle=VEHICLE)) if row.target == "running" else (change,)


def _run(state: State, record: Record) -> None:
    state.selftests.put(VEHICLE, selftest(state)._replace(effect_seq=record.seq))


def _apply_move(state: State, record: Record) -> None:
    change = record.message
    assert isinstance(change, Moved)
    if change.chart != CHART.name:
        return
    state.selftests.put(VEHICLE, selftest(state)._replace(state=change.to_state))
    limits = state.flight.limits
    waits_ms = {"running": limits.mission_step_ms, "awaiting": limits.selftest_acknowledge_ms}.get(change.to_state)
    if waits_ms is None:
        state.deadlines.drop((CHART.name, change.instance))
    else:
        state.deadlines.put((CHART.name, change.instance), record.at.flight_ns + waits_ms * NS_PER_MS)


PART = Part(
    chart=CHART,
    alphabet=frozenset({"mission_planned", "selftest_reported", "moved", "time_passed", "node_started"}),
    decide=decide,
    evolve={"run_selftest": _run, "moved": _apply_move},
    moves_of=frozenset({"command"}),
)
