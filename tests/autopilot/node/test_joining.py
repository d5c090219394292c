"""Flight time over outages: what bounds them, what does not, and that it never goes back whatever the clocks do."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.node.clock import FlightClock
from autopilot.node.joining import Outage, Reading, is_same_boot, outage
from events.records import Moment
from events.schema.flight_pb2 import CLOCK_BOUNDED, CLOCK_TRUSTED, CLOCK_UNSET
from tests.autopilot.node.histories import Begin, check_history
from tests.autopilot.node.nodes import FakeClock, heard_vehicle

S = 1_000_000_000
LAST = Moment(flight_ns=70 * S, mono_ns=1_000 * S, boot=3, wall_ns=50_000 * S, clock_quality=CLOCK_TRUSTED)


def check_outage(expected: Outage, *, quality: int = CLOCK_TRUSTED, before: int = CLOCK_TRUSTED, **now: int) -> None:
    """Check the outage of another boot; `now` has the seconds since LAST by the wall clock, and those of this boot."""
    reading = Reading(now["up_s"] * S, LAST.wall_ns + now["wall_s"] * S, quality)
    last = LAST._replace(clock_quality=before)
    assert outage(last, reading, same_boot=False, longest_ns=3_600 * S) == expected


@pytest.mark.parametrize(("wall_s", "up_s"), [(40, 30), (30, 30), (29, 30), (0, 0), (3_600, 5)])
def test_a_wall_clock_that_can_be_believed_bounds_it(wall_s: int, up_s: int) -> None:
    """Up to the longest that is believed, and to a second less than this boot has lasted."""
    check_outage(Outage(wall_s * S), wall_s=wall_s, up_s=up_s)


@pytest.mark.parametrize(
    ("wall_s", "up_s", "because"),
    [
        (-1, 0, "the wall clock went back"),
        (28, 30, "the wall clock says less than this boot has lasted"),
        (3_601, 5, "the wall clock says 3601 s, more than is believed"),
    ],
)
def test_a_wall_clock_that_contradicts_itself_does_not(wall_s: int, up_s: int, because: str) -> None:
    """No time passes, and it is said why."""
    check_outage(Outage(0, because), wall_s=wall_s, up_s=up_s)


@pytest.mark.parametrize("quality", [CLOCK_UNSET, CLOCK_BOUNDED])
def test_a_wall_clock_that_nobody_relies_on_does_not(quality: int) -> None:
    """At either end."""
    check_outage(Outage(0, "the wall clock is not to be relied on"), quality=quality, wall_s=40, up_s=30)
    check_outage(Outage(0, "the wall clock was not to be relied on before it"), before=quality, wall_s=40, up_s=30)


def test_within_a_boot_monotonic_time_tells() -> None:
    """However long it was, and whatever the wall clock says."""
    now = Reading(LAST.mono_ns + 90_000 * S, LAST.wall_ns - 5 * S, CLOCK_UNSET)
    assert outage(LAST, now, same_boot=True, longest_ns=S) == Outage(90_000 * S)


@pytest.mark.parametrize(
    ("same_id", "later_ns", "same"), [(True, 0, True), (True, -1, False), (False, 0, False), (False, 5, False)]
)
def test_one_boot_has_one_id_and_a_clock_that_goes_forward(same_id: bool, later_ns: int, same: bool) -> None:
    """A copied system may bring its boot id along."""
    assert is_same_boot(LAST, Reading(LAST.mono_ns + later_ns, 0, CLOCK_TRUSTED), same_id=same_id) is same


HOUR_NS = 3_600 * S
starts = st.lists(
    st.tuples(
        st.integers(0, 2),  # boot id: few, so that boots share one
        st.one_of(st.just(None), st.integers(0, 100 * S)),  # monotonic time begins anew there; None: it goes on
        st.integers(-HOUR_NS, HOUR_NS),  # the wall clock jumps
        st.integers(0, 30 * HOUR_NS),  # time passes
        st.sampled_from((CLOCK_UNSET, CLOCK_TRUSTED)),
    ),
    max_size=12,
)


@given(starts)
def test_flight_time_never_goes_back_over_many_boots(
    drawn: list[tuple[int, int | None, int, int, int]],
) -> None:
    """Jumps of an hour, boots that share an id, monotonic time that begins anew: joined, time and boots only grow."""
    host = FakeClock()
    flight, last_id = FlightClock(host, 1), 0
    last = flight.now()
    for boot_id, anew_ns, jump_ns, passed_ns, quality in drawn:
        host.wall += jump_ns + passed_ns
        host.mono = host.mono + passed_ns if anew_ns is None else anew_ns
        now = Reading(host.mono, host.wall, quality)
        same = is_same_boot(last, now, same_id=boot_id == last_id)
        gone = outage(last, now, same_boot=same, longest_ns=24 * HOUR_NS)
        assert 0 <= gone.ns <= 24 * HOUR_NS or same
        assert not (gone.unbounded and gone.ns)
        flight = FlightClock(host, last.boot + (not same), last.flight_ns + gone.ns)
        moments = [flight.now()]
        host.mono += jump_ns // 7  # also while it runs
        moments.append(flight.now())
        assert last.flight_ns + gone.ns == moments[0].flight_ns <= moments[1].flight_ns
        assert moments[0].boot in (last.boot, last.boot + 1)
        last, last_id = moments[1]._replace(clock_quality=quality), boot_id


def test_a_log_of_many_boots_goes_forward(begin: Begin, clock: FakeClock, tmp_path: Path) -> None:
    """Fifteen starts under three boot ids, killed each time: one flight, which replays."""
    random = Random(7)
    begin().start().kill()
    for _ in range(14):
        clock.mono = random.choice([clock.mono + 3 * S, random.randrange(100 * S)])
        clock.wall += random.randrange(-HOUR_NS, HOUR_NS)
        node = begin(boot_id=f"boot-{random.randrange(3)}").start()
        node.tell(*heard_vehicle(armed=False), after_ms=50)
        node.turn(after_ms=200)
        node.kill()
    check_history(tmp_path, (15, ""))
