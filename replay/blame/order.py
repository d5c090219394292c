"""Whether inputs are in the order, and at the moments, at which the node acted on them.

Facts first: time of a flight never goes back, differs from the monotonic clock by the same amount for a whole boot,
and a decision has the moment of its observation. Then counterfactuals: two neighbours exchanged, one input moved in
time. An input at a wrong moment is counted here: it is another place in the order of time.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

from events import Moment, Record
from replay.blame.case import Case, Group
from replay.blame.findings import Cause, Finding, Weight
from replay.blame.search import Best, Idea

EXCHANGED = 24  # pairs of neighbours before the divergence that are exchanged
MOVED = 12  # inputs before the divergence that are moved in time


def reordered(case: Case) -> Finding:
    """Look for facts, then exchange neighbours, then move inputs in time."""
    fact = next(_facts(case), None)
    if fact is not None:
        return Finding(Cause.REORDERED, Weight.PROVED, fact)
    best = Best()
    if not best.take(case, _exchanges(case)):
        best.take(case, _moves(case))
    otherwise = f"no fact speaks for it; {best.tried} exchanges of neighbours and moves in time explain nothing"
    return best.finding(Cause.REORDERED, otherwise)


def _facts(case: Case) -> Iterator[str]:
    groups = case.groups[: case.place + 2]
    for before, after in pairwise(groups):
        one, other = before.observation, after.observation
        if other.at.flight_ns < one.at.flight_ns:
            yield f"time runs backwards from record {one.seq} to {other.seq}"
    yield from _foreign_moments(case, groups)
    yield from _clocks(groups)


def _foreign_moments(case: Case, groups: tuple[Group, ...]) -> Iterator[str]:
    """Yield decisions that were made at the moment of a neighbour."""
    moments = {group.observation.at: group.observation.seq for group in case.groups}
    for group in groups:
        for decision in group.decisions:
            if decision.at != group.observation.at and decision.at in moments:
                theirs = moments[decision.at]
                yield f"record {decision.seq} was decided at the moment of record {theirs}, not of its own observation"


def _clocks(groups: tuple[Group, ...]) -> Iterator[str]:
    """Yield an observation whose clocks do not fit together as those of the others of its boot do."""
    gaps = Counter((one.observation.at.boot, _gap(one.observation)) for one in groups)
    usual = {boot: gap for (boot, gap), _ in reversed(gaps.most_common())}
    for group in groups:
        at = group.observation.at
        if len(groups) > len(usual) + 1 and _gap(group.observation) != usual[at.boot]:
            off_ns = usual[at.boot] - _gap(group.observation)
            yield f"record {group.observation.seq} is {off_ns} ns off the monotonic clock that all others follow"


def _gap(record: Record) -> int:
    return record.at.mono_ns - record.at.flight_ns


def _exchanges(case: Case) -> Iterator[Idea]:
    last = min(case.place + 1, len(case.groups) - 1)
    for place in range(last, max(case.place - EXCHANGED, 0), -1):
        one, other = case.groups[place - 1], case.groups[place]
        words = f"records {one.observation.seq} and {other.observation.seq} exchanged"
        for times in (False, True) if one.observation.at != other.observation.at else (False,):
            pair = _in_place_of(one, other, times=times), _in_place_of(other, one, times=times)
            yield Idea(words, (*case.groups[: place - 1], *pair, *case.groups[place + 1 :]))


def _in_place_of(group: Group, other: Group, *, times: bool) -> Group:
    """Return a step with what the other observed; with its moment too where that went along."""
    seen, place = other.observation, group.observation
    return group._replace(observation=replace(seen, seq=place.seq, at=seen.at if times else place.at))


def _moves(case: Case) -> Iterator[Idea]:
    for place in range(case.place, max(case.place - MOVED, 0), -1):
        group, before = case.groups[place], case.groups[place - 1]
        after = case.groups[place + 1] if place + 1 < len(case.groups) else None
        for at_ns in _moments(case, place, before, after):
            moved = _at(group, at_ns)
            by_ms = (at_ns - group.observation.at.flight_ns) // 1_000_000
            words = f"record {group.observation.seq} moved in time by {by_ms} ms"
            yield Idea(words, (*case.groups[:place], moved, *case.groups[place + 1 :]), fitted=True)


def _moments(case: Case, place: int, before: Group, after: Group | None) -> list[int]:
    """Return the moments at which an input may have come: between its neighbours, or when the core asked for time."""
    now_ns, least_ns = case.groups[place].observation.at.flight_ns, before.observation.at.flight_ns
    most_ns = after.observation.at.flight_ns if after else now_ns + 60_000_000_000
    state = case.at(place=place)
    asked = [at_ns for _, at_ns in state.deadlines.items() if least_ns <= at_ns <= most_ns]
    found = [least_ns, *asked, (least_ns + now_ns) // 2, (now_ns + most_ns) // 2, most_ns]
    return [at_ns for at_ns in dict.fromkeys(found) if at_ns != now_ns]


def _at(group: Group, flight_ns: int) -> Group:
    """Return a step at another moment."""
    moment: Moment = group.observation.at._replace(flight_ns=flight_ns)
    decisions = tuple(replace(decision, at=moment) for decision in group.decisions)
    return group._replace(observation=replace(group.observation, at=moment), decisions=decisions)
