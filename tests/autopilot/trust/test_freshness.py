"""What a node knows of the time: three states, a floor that only signatures move, beacons, challenges."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.trust.freshness import FAR_MS, TrustClock, known_time
from autopilot.trust.limits import BUILD_MS
from events.schema.flight_pb2 import CLOCK_BOUNDED, CLOCK_TRUSTED, CLOCK_UNSET
from tests.autopilot.trust.papers import HOUR_MS, HostClocks
from tests.autopilot.trust.world import NOW_MS, FakeClock, seeded

MINUTE_MS = 60_000
YEARS_MS = 10 * 365 * 24 * HOUR_MS


def clock_of(host: HostClocks, *, trusted: bool = False, floor_ms: int = BUILD_MS) -> TrustClock:
    return TrustClock(host, host_trusted=trusted, floor_ms=floor_ms, random=seeded(3))


def check_time(clock: TrustClock, quality: int, earliest_ms: int, latest_ms: int) -> None:
    """What is known, and that the working time lies in it."""
    time = clock.time()
    assert (time.quality, time.earliest_ms, time.latest_ms) == (quality, earliest_ms, latest_ms)
    assert earliest_ms <= time.now_ms <= latest_ms
    assert clock.wall_ns() == time.now_ms * 1_000_000


def beacon(clock: TrustClock, host: HostClocks, time_ms: int, journey_ms: int = 100) -> str:
    challenge = clock.ask()
    assert challenge is not None
    host.pass_ms(journey_ms)
    return clock.hear_beacon(challenge, time_ms)


def test_without_anything_it_is_not_before_the_floor() -> None:
    host = HostClocks()
    clock = clock_of(host, floor_ms=NOW_MS - HOUR_MS)
    check_time(clock, CLOCK_UNSET, NOW_MS - HOUR_MS, FAR_MS)
    host.pass_ms(5_000)
    check_time(clock, CLOCK_UNSET, NOW_MS - HOUR_MS + 5_000, FAR_MS)
    assert clock.mono_ns() == host.mono_ns()
    assert clock.news() == []


def test_a_host_that_is_configured_as_kept_is_believed_while_it_contradicts_nothing() -> None:
    clock = clock_of(HostClocks(), trusted=True)
    check_time(clock, CLOCK_TRUSTED, NOW_MS, NOW_MS)
    (told,) = clock.news()
    assert (told.source, told.from_quality, told.to_quality, told.latest_ms) == ("host", 0, 2, NOW_MS)
    assert clock.news() == []


@pytest.mark.parametrize(("behind_ms", "quality"), [(5_000, CLOCK_TRUSTED), (5_001, CLOCK_UNSET)])
def test_a_host_that_lags_behind_the_floor_is_wrong(behind_ms: int, quality: int) -> None:
    host = HostClocks()
    assert clock_of(host, trusted=True, floor_ms=NOW_MS + behind_ms).time().quality == quality
    late = clock_of(host, trusted=True)
    late.raise_floor(NOW_MS + behind_ms, "document")
    assert late.time().quality == quality
    assert [one.to_quality for one in late.news()] == [CLOCK_TRUSTED, quality]


def test_a_host_that_was_set_right_after_the_start_is_believed_then() -> None:
    host = HostClocks(wall_ms=0)
    clock = clock_of(host, trusted=True)
    check_time(clock, CLOCK_UNSET, BUILD_MS, FAR_MS)
    host.wall_ms = NOW_MS
    check_time(clock, CLOCK_TRUSTED, NOW_MS, NOW_MS)


@pytest.mark.parametrize(
    ("step_ms", "quality"),
    [
        (600_000, CLOCK_TRUSTED),
        (600_001, CLOCK_BOUNDED),
        (11 * MINUTE_MS, CLOCK_BOUNDED),
        (YEARS_MS, CLOCK_BOUNDED),
        (-5_000, CLOCK_TRUSTED),
        (-5_001, CLOCK_BOUNDED),
        (-11 * MINUTE_MS, CLOCK_BOUNDED),
        (-YEARS_MS, CLOCK_BOUNDED),
    ],
)
def test_a_host_clock_that_jumps_is_believed_no_more(step_ms: int, quality: int) -> None:
    host = HostClocks()
    clock = clock_of(host, trusted=True, floor_ms=NOW_MS - HOUR_MS)
    clock.news()
    host.wall_ms += step_ms
    assert clock.time().quality == quality
    assert clock.floor_ms == NOW_MS - HOUR_MS
    assert [one.source for one in clock.news()] == ["host"] * (quality == CLOCK_BOUNDED)


def test_a_host_clock_that_comes_back_is_not_believed_again() -> None:
    host = HostClocks()
    clock = clock_of(host, trusted=True, floor_ms=NOW_MS - HOUR_MS)
    host.wall_ms += YEARS_MS
    clock.time()
    host.wall_ms = NOW_MS + 1_000
    host.mono_ms += 1_000
    assert (clock.time().quality, clock.time().now_ms) == (CLOCK_BOUNDED, NOW_MS + 1_000)


def test_a_host_clock_does_not_go_back_step_by_step() -> None:
    host = HostClocks()
    clock = clock_of(host, trusted=True)
    host.wall_ms -= 4_000
    assert clock.time().trusted
    host.wall_ms -= 4_000
    assert not clock.time().trusted


@pytest.mark.parametrize("spoof_ms", [YEARS_MS, -YEARS_MS, 11 * MINUTE_MS, -11 * MINUTE_MS, 10])
def test_gps_never_moves_the_floor_nor_a_time_that_is_believed(spoof_ms: int) -> None:
    trusted, host = clock_of(HostClocks(), trusted=True), HostClocks()
    trusted.hear_gps(NOW_MS + spoof_ms)
    check_time(trusted, CLOCK_TRUSTED, NOW_MS, NOW_MS)
    unset = clock_of(host, floor_ms=NOW_MS - MINUTE_MS)
    unset.hear_gps(NOW_MS)
    unset.hear_gps(NOW_MS + spoof_ms)
    check_time(unset, CLOCK_BOUNDED, NOW_MS - MINUTE_MS, FAR_MS)
    assert unset.floor_ms == NOW_MS - MINUTE_MS
    assert unset.time().now_ms in (NOW_MS, NOW_MS + 10)
    off = abs(spoof_ms) > 600_000
    learned = [(one.source, one.from_quality, one.to_quality, one.jump_ms) for one in unset.news()]
    assert learned == [("gps", 0, 1, 0), ("gps", 1, 1, spoof_ms)][: 1 + off]
    told = [(one.source, one.from_quality, one.to_quality, one.jump_ms) for one in trusted.news()]
    assert told == [("host", 0, 2, 0), ("gps", 2, 2, spoof_ms)][: 1 + off]


def test_a_gps_that_is_off_is_told_once_until_it_is_back_and_every_10_s_at_most() -> None:
    host = HostClocks()
    clock = clock_of(host, trusted=True)
    clock.news()
    far, told = 11 * MINUTE_MS, 0
    for second, off_ms in enumerate([far, far, 0, far, 0, *[far] * 21, 600_000, far]):
        clock.hear_gps(NOW_MS + 1_000 * second + off_ms)
        told += len(clock.news())
        assert told == 1 + (second >= 10) + (second >= 27)
        host.pass_ms(1_000)


def test_a_host_that_is_set_right_after_gps_spoke_is_believed_then() -> None:
    """A spoofed GPS is no reason not to believe a clock that is configured as kept."""
    host = HostClocks(wall_ms=0)
    clock = clock_of(host, trusted=True)
    clock.hear_gps(NOW_MS + YEARS_MS)
    assert clock.time().quality == CLOCK_BOUNDED
    host.wall_ms = NOW_MS
    check_time(clock, CLOCK_TRUSTED, NOW_MS, NOW_MS)
    assert [one.source for one in clock.news()] == ["gps", "host"]


def test_gps_may_advance_an_uncertain_time_but_not_turn_it_back() -> None:
    clock = clock_of(HostClocks(), floor_ms=NOW_MS)
    clock.hear_gps(NOW_MS - 1)
    assert clock.time().quality == CLOCK_UNSET
    clock.hear_gps(NOW_MS + MINUTE_MS)
    clock.hear_gps(NOW_MS + 2 * MINUTE_MS)
    clock.hear_gps(NOW_MS + 2 * MINUTE_MS - 1)
    assert clock.time().now_ms == NOW_MS + 2 * MINUTE_MS
    clock.hear_gps(NOW_MS + 2 * MINUTE_MS + 600_000)
    assert clock.time().now_ms == NOW_MS + 2 * MINUTE_MS + 600_000


def test_a_beacon_makes_time_trusted_and_alone_steps_it_back() -> None:
    host = HostClocks()
    clock = clock_of(host, floor_ms=NOW_MS - HOUR_MS)
    clock.hear_gps(NOW_MS + YEARS_MS)
    assert beacon(clock, host, NOW_MS, journey_ms=1_000) == ""
    check_time(clock, CLOCK_TRUSTED, NOW_MS + 500, NOW_MS + 500)
    clock.hear_gps(NOW_MS + 10_000)
    check_time(clock, CLOCK_TRUSTED, NOW_MS + 500, NOW_MS + 500)
    assert clock.floor_ms == NOW_MS
    assert [one.source for one in clock.news()] == ["gps", "beacon"]


def test_a_host_that_jumped_is_not_followed_after_a_beacon() -> None:
    host = HostClocks()
    clock = clock_of(host, trusted=True)
    host.wall_ms += YEARS_MS
    clock.time()
    assert beacon(clock, host, NOW_MS, journey_ms=0) == ""
    host.pass_ms(1_000)
    check_time(clock, CLOCK_TRUSTED, NOW_MS + 1_000, NOW_MS + 1_000)


def test_a_beacon_must_answer_the_last_question_and_in_time() -> None:
    host = HostClocks()
    clock = clock_of(host)
    assert clock.hear_beacon(bytes(16), NOW_MS) == "unasked"
    assert clock.hear_beacon(b"", NOW_MS) == "unasked"
    first = clock.ask()
    assert first is not None
    assert clock.ask() is None
    host.pass_ms(9_999)
    assert clock.ask() is None
    host.pass_ms(1)
    second = clock.ask()
    assert second not in (None, first)
    assert clock.hear_beacon(first, NOW_MS) == "unasked"
    host.pass_ms(5_001)
    assert second is not None
    assert clock.hear_beacon(second, NOW_MS) == "late"
    assert clock.hear_beacon(second, NOW_MS) == "unasked"
    host.pass_ms(5_000)
    assert beacon(clock, host, NOW_MS, journey_ms=5_000) == ""
    assert clock.ask() is None


@pytest.mark.parametrize(("before_ms", "said"), [(5_000, ""), (5_001, "rollback")])
def test_a_beacon_from_before_what_was_signed_contradicts_it(before_ms: int, said: str) -> None:
    host = HostClocks()
    clock = clock_of(host, floor_ms=NOW_MS)
    assert beacon(clock, host, NOW_MS - before_ms, journey_ms=0) == said
    assert clock.floor_ms == NOW_MS


def test_a_beacon_from_before_the_one_before_contradicts_it() -> None:
    host = HostClocks()
    clock = clock_of(host, floor_ms=NOW_MS - HOUR_MS)
    assert beacon(clock, host, NOW_MS, journey_ms=0) == ""
    host.pass_ms(HOUR_MS)
    assert beacon(clock, host, NOW_MS + HOUR_MS - 5_001, journey_ms=0) == "rollback"


def test_time_by_a_beacon_is_asked_for_again_every_hour() -> None:
    host = HostClocks()
    clock = clock_of(host)
    assert beacon(clock, host, NOW_MS) == ""
    host.pass_ms(HOUR_MS - 1)
    assert clock.ask() is None
    host.pass_ms(1)
    assert beacon(clock, host, NOW_MS + HOUR_MS) == ""
    assert [one.floor_ms - NOW_MS for one in clock.news()] == [0, HOUR_MS]
    kept = clock_of(HostClocks(), trusted=True)
    assert kept.ask() is None


def test_the_floor_only_rises_and_is_told_by_the_minute() -> None:
    clock = clock_of(HostClocks(), floor_ms=NOW_MS)
    for signed_ms in (NOW_MS - 1, NOW_MS + 59_999, NOW_MS + 60_000, NOW_MS + 60_001):
        clock.raise_floor(signed_ms, "token")
    assert clock.floor_ms == NOW_MS + 60_001
    assert [(one.source, one.floor_ms - NOW_MS, one.to_quality) for one in clock.news()] == [("token", 60_000, 0)]
    clock.restore_floor(NOW_MS + HOUR_MS)
    assert (clock.floor_ms, clock.news()) == (NOW_MS + HOUR_MS, [])


def test_a_challenge_counts_for_a_minute_at_most() -> None:
    host = HostClocks()
    clock = clock_of(host)
    first = clock.challenge()
    assert len(first) == 16
    assert not clock.echoes(b"")
    assert not clock.echoes(bytes(16))
    host.pass_ms(29_999)
    assert clock.challenge() == first
    host.pass_ms(1)
    second = clock.challenge()
    assert second != first
    assert clock.echoes(first)
    assert clock.echoes(second)
    host.pass_ms(30_000)
    assert not clock.echoes(first)
    assert clock.echoes(second)
    host.pass_ms(10 * HOUR_MS)
    assert not clock.echoes(second)


def test_a_clock_that_does_not_judge_itself_is_right() -> None:
    assert known_time(FakeClock()) == (NOW_MS, NOW_MS, NOW_MS, CLOCK_TRUSTED)
    assert known_time(clock_of(HostClocks())).quality == CLOCK_UNSET


EVENTS = st.lists(
    st.tuples(st.sampled_from(("pass", "host", "gps", "signed", "beacon")), st.integers(-YEARS_MS, YEARS_MS)),
    max_size=12,
)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(EVENTS, st.booleans())
def test_only_what_is_signed_moves_the_floor(events: list[tuple[str, int]], trusted: bool) -> None:
    """Whatever host and GPS say, in any order."""
    host = HostClocks()
    clock = clock_of(host, trusted=trusted)
    for what, amount_ms in events:
        before_ms = clock.floor_ms
        if what == "pass":
            host.pass_ms(abs(amount_ms) % HOUR_MS)
        elif what == "host":
            host.wall_ms += amount_ms
        elif what == "gps":
            clock.hear_gps(NOW_MS + amount_ms)
        elif what == "signed":
            clock.raise_floor(NOW_MS + amount_ms, "document")
        elif (challenge := clock.ask()) is not None:
            clock.hear_beacon(challenge, NOW_MS + amount_ms)
        time = clock.time()
        assert time.earliest_ms <= time.now_ms <= time.latest_ms
        assert clock.floor_ms >= before_ms
        assert clock.floor_ms == before_ms or what in ("signed", "beacon")
