"""A bad link is bad at the rates that it says, by its seed, and never invents anything."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.sim.lossy import OVERTAKEN_S, Lossy, Weather


def arrivals(weather: Weather, count: int = 1_000, seed: str = "1", every_s: float = 0.1) -> list[tuple[float, int]]:
    """Send numbers at a rate; return when each arrives, to a hundredth of a second."""
    link: Lossy[int] = Lossy(seed, weather)
    came: list[tuple[float, int]] = []
    for number in range(count):
        link.put(number * every_s, number)
    hundredth = 0
    while (next_s := link.next_s()) is not None:
        hundredth = max(hundredth, int(next_s * 100))
        came += [(hundredth / 100, number) for number in link.due(hundredth / 100)]
        hundredth += 1
    return came


def test_a_good_link_changes_nothing() -> None:
    assert [number for _, number in arrivals(Weather())] == list(range(1_000))


@pytest.mark.parametrize(("lost", "twice", "expected"), [(0.3, 0, 700), (0, 0.3, 1_300), (1, 0, 0), (0, 1, 2_000)])
def test_it_loses_and_repeats_at_its_rates(lost: float, twice: float, expected: int) -> None:
    assert len(arrivals(Weather(lost=lost, twice=twice))) == pytest.approx(expected, abs=60 * (expected % 1_000 != 0))


def test_late_things_keep_their_order() -> None:
    came = arrivals(Weather(late_s=2, least_s=0.5))
    assert [number for _, number in came] == list(range(1_000))
    delays_s = [at_s - number * 0.1 for at_s, number in came]
    assert min(delays_s) >= 0.49
    assert 2.0 < max(delays_s) <= 2.52


def test_what_is_overtaken_comes_out_of_order() -> None:
    numbers = [number for _, number in arrivals(Weather(overtaken=0.3))]
    assert sorted(numbers) == list(range(1_000))
    assert sum(one > other for one, other in itertools.pairwise(numbers)) > 100


def test_the_same_seed_the_same_misfortunes() -> None:
    weather = Weather(lost=0.3, twice=0.2, overtaken=0.2, late_s=1)
    assert arrivals(weather) == arrivals(weather)
    assert arrivals(weather) != arrivals(weather, seed="2")


@given(
    st.floats(0, 1),
    st.floats(0, 1),
    st.floats(0, 1),
    st.floats(0, 3),
    st.floats(0, 1),
    st.integers(0, 9),
    st.integers(0, 30),
)
@settings(max_examples=60, deadline=None, derandomize=True)
def test_nothing_arrives_that_was_not_sent_or_more_than_twice(
    lost: float, twice: float, overtaken: float, late_s: float, least_s: float, seed: int, count: int
) -> None:
    came = arrivals(Weather(lost, twice, overtaken, late_s, least_s), count, str(seed))
    for at_s, number in came:
        assert 0 <= number < count
        assert number * 0.1 + least_s - 0.02 <= at_s
        assert at_s <= count * 0.1 + least_s + late_s + OVERTAKEN_S + 0.02
    assert all(sum(one == number for _, one in came) <= 2 for number in range(count))
