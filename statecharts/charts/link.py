"""Chart `link`: whether any operator is still heard (seed 004, Lost link; 5 s degraded, 30 s lost).

Theory of operation. Every authentic word of an operator counts: what the edge says of them (`operator_heard`), and each
order. Silence leads from ok to degraded to lost; while a camera follows something it first leads to
`lost_following`, a last grace, and to lost when that is over or the following ends. One word leads back. Before anybody
was ever heard the link is `unheard`, which on the ground is normal; in the air somebody ought to listen, so silence
counts from arming. It is judged by how long the silence is, never by how often it was looked at: a shell that is late
skips a state.

It only judges; what follows from a lost link is the business of `safety`. It must never take a vehicle's silence for
an operator's, nor its own outage for a word: what the node missed while it was off counts as silence, and an outage of
which nobody knows how long it was, as a lost link. Where `operator_lost_ms` is 0, or the node has no say in the
flight, the link is not watched at all.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from google.protobuf.message import Message

from events.records import Record
from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import Limits, NodeStarted
from events.schema.vehicle_pb2 import VehicleStateReported
from statecharts.facts import Link, Scan
from statecharts.part import Part
from statecharts.state import State
from statecharts.table import Answer, Chart, Row, ignore, move, moved

NS_PER_MS = 1_000_000
OPERATORS = "operators"
FOLLOWING = "following"  # state of the chart `scan` while a camera keeps something in view
_WORDS = ("operator_heard", "order_received", "order_malformed")


@dataclass(frozen=True, slots=True)
class _Facts:
    silent_ns: int = -1  # below 0: it does not count
    following: bool = False
    heard: bool = False  # somebody was, in this flight
    degraded_ns: int = 0
    lost_ns: int = 0
    grace_ns: int = 0


def lost(facts: _Facts) -> bool:
    """The silence is too long, the grace of a following included."""
    return facts.silent_ns >= facts.lost_ns + (facts.grace_ns if facts.following else 0)


def in_grace(facts: _Facts) -> bool:
    """The silence would be too long if nothing were followed."""
    return facts.silent_ns >= facts.lost_ns


def degraded(facts: _Facts) -> bool:
    """The silence is longer than between two words of an operator who is there."""
    return facts.silent_ns >= facts.degraded_ns


def never_heard_on_ground(facts: _Facts) -> bool:
    """The vehicle is disarmed, and nobody was heard in this flight."""
    return not facts.heard and facts.silent_ns < 0


def counts(facts: _Facts) -> bool:
    """Somebody was heard, or the vehicle is armed."""
    return facts.silent_ns >= 0


_SILENCES = (
    ("lost", "nobody is heard any more", lost),
    ("lost_following", "nobody is heard any more; what is followed gets a grace", in_grace),
    ("degraded", "nobody is heard for a while", degraded),
)


def _looked(source: str, worse: int) -> tuple[Row[_Facts], ...]:
    """Return how silence is looked at in a state that so many of the silences are worse than."""
    back = () if source in ("unheard", "ok") else (_back(source),)
    silences = enumerate(_SILENCES[:worse], start=2)
    return (
        *back,
        *(move(source, "looked", target, because, guard, band) for band, (target, because, guard) in silences),
        ignore(source, "looked", "nothing new", band=5),
    )


def _back(source: str) -> Row[_Facts]:
    return move(source, "looked", "unheard", "disarmed, and nobody was ever heard", never_heard_on_ground, band=1)


CHART: Chart[_Facts] = Chart(
    name="link",
    initial="unheard",
    states=("unheard", "ok", "degraded", "lost_following", "lost"),
    terminal=(),
    triggers=("heard", "looked", "time_lost"),
    rows=(
        *(move(state, "heard", "ok", "an operator is heard") for state in ("unheard", "degraded")),
        *(move(state, "heard", "ok", "an operator is heard again") for state in ("lost_following", "lost")),
        ignore("ok", "heard", "heard already"),
        *_looked("unheard", 3),
        *_looked("ok", 3),
        *_looked("degraded", 2),
        *_looked("lost_following", 1),
        *_looked("lost", 0),
        move("unheard", "time_lost", "lost", "off for an unknown time while armed", counts, band=1),
        ignore("unheard", "time_lost", "nobody was heard before, and it is on the ground", band=2),
        *(
            move(state, "time_lost", "lost", "off for an unknown time: it counts as silence")
            for state in ("ok", "degraded", "lost_following")
        ),
        ignore("lost", "time_lost", "lost already"),
    ),
)


def decide(state: State, record: Record) -> tuple[Message, ...]:
    """Return the move of the operators' link, if any."""
    if not is_watched(state):
        return ()
    trigger, message = "looked", record.message
    if record.kind.name in _WORDS:
        trigger = "heard"
    elif isinstance(message, NodeStarted):
        if not message.HasField("outage_unbounded"):
            return ()
        trigger = "time_lost"
    link = _link(state)
    row = CHART.ask(link.state, trigger, _facts(state, link, record.at.flight_ns))
    return (moved(CHART, OPERATORS, row),) if row.answer is Answer.MOVE else ()


def is_watched(state: State) -> bool:
    """Whether anything is to be made of an operator's silence."""
    return state.commands_flight and state.flight.limits.operator_lost_ms > 0


def followings(state: State) -> Iterator[Scan]:
    """Yield what cameras do that keep a finding in view."""
    return (scan for scan in state.scans.values() if scan.state == FOLLOWING)


def _link(state: State) -> Link:
    return state.links.get(OPERATORS) or Link()


def _facts(state: State, link: Link, now_ns: int) -> _Facts:
    limits = state.flight.limits
    return _Facts(
        silent_ns=-1 if link.since_ns is None else now_ns - link.since_ns,
        following=any(followings(state)),
        heard=link.heard,
        degraded_ns=limits.operator_degraded_ms * NS_PER_MS,
        lost_ns=limits.operator_lost_ms * NS_PER_MS,
        grace_ns=limits.operator_lost_following_ms * NS_PER_MS,
    )


def _put(state: State, link: Link) -> None:
    """Set the link, and when it is to be looked at next."""
    state.links.put(OPERATORS, link)
    waits_ms = _next_ms(state.flight.limits, link.state)
    if link.since_ns is None or waits_ms is None:
        state.deadlines.drop(("link", OPERATORS))
    else:
        state.deadlines.put(("link", OPERATORS), link.since_ns + waits_ms * NS_PER_MS)


def _next_ms(limits: Limits, state: str) -> int | None:
    """Return how long a silence leads out of a state; None where none does."""
    return {
        "unheard": limits.operator_degraded_ms,
        "ok": limits.operator_degraded_ms,
        "degraded": limits.operator_lost_ms,
        "lost_following": limits.operator_lost_ms + limits.operator_lost_following_ms,
    }.get(state)


def _heard(state: State, record: Record) -> None:
    if is_watched(state):
        _put(state, _link(state)._replace(since_ns=record.at.flight_ns, heard=True))


def _armed(state: State, record: Record) -> None:
    """Let silence count from arming where nobody was ever heard, and not at all on the ground."""
    report = record.message
    assert isinstance(report, VehicleStateReported)
    link = _link(state)
    if not is_watched(state) or link.heard or report.armed == (link.since_ns is not None):
        return
    _put(state, link._replace(since_ns=record.at.flight_ns if report.armed else None))


def _apply_move(state: State, record: Record) -> None:
    change = record.message
    assert isinstance(change, Moved)
    if change.chart == CHART.name:
        _put(state, _link(state)._replace(state=change.to_state))


PART = Part(
    chart=CHART,
    alphabet=frozenset({*_WORDS, "vehicle_state_reported", "position_reported", "time_passed", "node_started"}),
    decide=decide,
    evolve={
        **dict.fromkeys(_WORDS, _heard),
        "vehicle_state_reported": _armed,
        "moved": _apply_move,
    },
    safety=True,
    moves_of=frozenset(),
)
