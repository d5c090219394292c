"""How flight time is joined over an outage: how long the node was off, as far as anything can tell.

Within one boot monotonic time tells. Across boots only the wall clock can, and it is believed where it was relied on
at both ends, did not go back, and does not contradict the monotonic time of the present boot; and at most
`outage_longest_h`: a clock that jumped a year forward is no year. Where it can't be believed no flight time passes, so
what must not be forgotten early (orders, nonces) is kept, and the start says why: the core then treats deadlines of
people as passed. A function of the two ends and a limit; it reads no clock.
"""

from __future__ import annotations

from typing import NamedTuple

from events.records import Moment
from events.schema.flight_pb2 import CLOCK_TRUSTED

NS_PER_S = 1_000_000_000
# The wall clock is set in small steps; a boot may seem to be older than the outage by so much.
_STEP_NS = NS_PER_S


class Reading(NamedTuple):
    """The clocks of this computer at one moment."""

    mono_ns: int
    wall_ns: int
    quality: int  # flight_pb2.ClockQuality of the wall clock


class Outage(NamedTuple):
    """Time between the last record and a start."""

    ns: int  # 0 where it can't be bounded
    unbounded: str = ""  # why it can't be bounded


NO_OUTAGE = Outage(0)


def is_same_boot(last: Moment, now: Reading, *, same_id: bool) -> bool:
    """Say whether the computer has run on since `last`.

    A boot id alone does not tell: copies of one system may share it, and then monotonic time has gone back.
    """
    return same_id and now.mono_ns >= last.mono_ns


def outage(last: Moment, now: Reading, *, same_boot: bool, longest_ns: int) -> Outage:
    """Return how long nothing was recorded."""
    if same_boot:
        return Outage(now.mono_ns - last.mono_ns)
    passed_ns = now.wall_ns - last.wall_ns
    because = _doubt(last, now, passed_ns, longest_ns)
    return Outage(0, because) if because else Outage(passed_ns)


def _doubt(last: Moment, now: Reading, passed_ns: int, longest_ns: int) -> str:
    """Return why the wall clock does not tell how long it was; "" where it does."""
    if last.clock_quality != CLOCK_TRUSTED:
        return "the wall clock was not to be relied on before it"
    if now.quality != CLOCK_TRUSTED:
        return "the wall clock is not to be relied on"
    if passed_ns < 0:
        return "the wall clock went back"
    if passed_ns + _STEP_NS < now.mono_ns:
        return "the wall clock says less than this boot has lasted"
    if passed_ns > longest_ns:
        return f"the wall clock says {passed_ns // NS_PER_S} s, more than is believed"
    return ""
