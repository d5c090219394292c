"""What is expected of the operators' link where nobody is heard for a while, judged by the log's own times.

How long a silence really was is what the log says: on a machine that is held up, a short one becomes longer, and the
node is right to call it degraded then.
"""

from __future__ import annotations

from itertools import pairwise

from events import Record
from events.schema.common_pb2 import Moved
from events.schema.flight_pb2 import FlightOpened, Limits

WORDS = ("operator_heard", "order_received", "order_malformed")  # of an operator who is there
LATE_S = 0.5  # a moment is looked at up to so much later
Moves = tuple[str, ...]


def check_silences(records: list[Record], since: int) -> frozenset[str]:
    """Hold the link's moves to every silence that ended after `since`; return the states that they led to."""
    limits = next(one.message.configuration.limits for one in records if isinstance(one.message, FlightOpened))
    moves = [(one, one.message) for one in records if isinstance(one.message, Moved) and one.message.chart == "link"]
    seen: set[str] = set()
    for before, word in pairwise(one for one in records if one.kind.name in WORDS):
        if word.seq < since:
            continue
        lasted_s = (word.at.flight_ns - before.at.flight_ns) / 1e9
        states = tuple(
            move.to_state
            for one, move in moves
            if one.cause == word.seq or (before.seq < one.seq < word.seq and one.cause != before.seq)
        )
        assert states in _allowed(lasted_s, limits), (lasted_s, states)
        seen.update(states)
    return frozenset(seen)


def _allowed(lasted_s: float, limits: Limits) -> set[Moves]:
    """Return the moves that a silence may lead to; near a limit, with and without what follows from it."""
    degraded_s, lost_s = limits.operator_degraded_ms / 1000, limits.operator_lost_ms / 1000
    allowed: set[Moves] = set()
    if lasted_s < degraded_s + LATE_S:
        allowed.add(())
    if degraded_s <= lasted_s < lost_s + LATE_S:
        allowed.add(("degraded", "ok"))
    if lasted_s >= lost_s:
        allowed |= {("degraded", "lost", "ok"), ("lost", "ok")}
    return allowed
