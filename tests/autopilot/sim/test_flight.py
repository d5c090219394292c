"""A body keeps to its limits, arrives where it is sent, and flies the same flight each time."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.sim.flight import (
    STEP_S,
    Body,
    Down,
    FixedWing,
    Fly,
    Frame,
    Multirotor,
    Rest,
    Rise,
    Stay,
    Wind,
    Wish,
)

METRES = st.floats(-300, 300)
HEIGHTS = st.floats(5, 120)
WISHES = st.one_of(
    st.just(Rest()),
    st.builds(lambda up: Rise(up_m=up), HEIGHTS),
    st.builds(lambda e, n: Down(east_m=e, north_m=n), METRES, METRES),
    st.builds(lambda e, n, u: Stay(east_m=e, north_m=n, up_m=u, speed_m_s=8.0), METRES, METRES, HEIGHTS),
    st.builds(
        lambda a, e, n, u, s: Fly(start_m=a, east_m=e, north_m=n, up_m=u, speed_m_s=15.0, stops=s),
        st.tuples(METRES, METRES),
        METRES,
        METRES,
        HEIGHTS,
        st.booleans(),
    ),
)


def flown(frame: Frame, body: Body, wish: Wish, seconds: float, wind: Wind | None = None) -> Body:
    for _ in range(round(seconds / STEP_S)):
        frame.step(body, wish, wind or Wind())
    return body


@given(st.lists(st.tuples(WISHES, st.integers(1, 200)), max_size=6), st.booleans())
@settings(max_examples=60, deadline=None, derandomize=True)
def test_a_multirotor_keeps_to_its_limits(story: list[tuple[Wish, int]], high: bool) -> None:
    frame, body = Multirotor(), Body(up_m=60.0 * high)
    for wish, steps in story:
        for _ in range(steps):
            before = (body.east_m, body.north_m, body.east_m_s, body.north_m_s, body.yaw_deg)
            frame.step(body, wish, Wind(9, -3))
            assert body.up_m >= 0
            assert math.hypot(body.east_m_s, body.north_m_s) <= 15.0 + 1e-6
            assert isinstance(wish, Rest) or body.up_m_s <= frame.climb_m_s + 1e-6
            moved_m = math.dist(before[:2], (body.east_m, body.north_m))
            assert moved_m <= 15.0 * STEP_S + 1e-6
            gained_m_s = math.dist(before[2:4], (body.east_m_s, body.north_m_s))
            assert isinstance(wish, Rest) or gained_m_s <= frame.acceleration_m_s2 * STEP_S + 1e-6
            assert abs((body.yaw_deg - before[4] + 180) % 360 - 180) <= frame.turn_deg_s * STEP_S + 1e-6


@given(st.lists(st.tuples(WISHES, st.integers(1, 200)), max_size=6))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_a_fixed_wing_keeps_to_its_limits(story: list[tuple[Wish, int]]) -> None:
    frame, body = FixedWing(), Body(up_m=60.0, air_m_s=18.0)
    for wish, steps in story:
        for _ in range(steps):
            yaw_deg = body.yaw_deg
            frame.step(body, wish, Wind(5, 0))
            assert body.up_m >= 0
            assert 0 <= body.air_m_s <= 18.0 + 1e-6
            assert abs((body.yaw_deg - yaw_deg + 180) % 360 - 180) <= frame.turn_deg_s * STEP_S + 1e-6
            assert isinstance(wish, Rest | Down) or body.grounded or body.air_m_s > 0


@pytest.mark.parametrize("wind", [Wind(), Wind(6, 0), Wind(-3, 4)])
@pytest.mark.parametrize("frame", [Multirotor(), FixedWing()])
def test_a_leg_is_followed_also_in_wind(frame: Frame, wind: Wind) -> None:
    """Two metres beside the line for a multirotor, eight for a fixed wing once it is on it."""
    body = Body(up_m=50, yaw_deg=90, air_m_s=18, east_m_s=1)
    leg = Fly(start_m=(0, 0), east_m=900, north_m=0, up_m=50, speed_m_s=frame.cruise_m_s)
    beside_m = []
    while body.east_m < 850:
        flown(frame, body, leg, STEP_S, wind)
        beside_m.append(abs(body.north_m))
    most_m = 0.5 if frame.hovers else 8.0
    assert max(beside_m) < most_m
    assert body.up_m == pytest.approx(50, abs=0.5)


def test_a_multirotor_stops_on_the_spot() -> None:
    body = flown(Multirotor(), Body(up_m=20), Stay(east_m=40, north_m=-30, up_m=25, speed_m_s=8), 30)
    assert (body.east_m, body.north_m, body.up_m) == pytest.approx((40, -30, 25), abs=0.1)
    assert math.hypot(body.east_m_s, body.north_m_s, body.up_m_s) < 0.1


def test_it_never_overshoots_a_place_by_much() -> None:
    frame, body = Multirotor(), Body(up_m=20)
    farthest_m = 0.0
    for _ in range(2_000):
        frame.step(body, Stay(east_m=100, north_m=0, up_m=20, speed_m_s=15), Wind())
        farthest_m = max(farthest_m, body.east_m)
    assert farthest_m < 101


def test_a_fixed_wing_circles_a_point() -> None:
    frame, body = FixedWing(), Body(up_m=80, air_m_s=18)
    wish = Stay(east_m=200, north_m=0, up_m=80, speed_m_s=18)
    flown(frame, body, wish, 60, Wind(4, 2))
    away_m = []
    for _ in range(800):
        frame.step(body, wish, Wind(4, 2))
        away_m.append(math.dist((body.east_m, body.north_m), (200, 0)))
    assert min(away_m) > 25
    assert max(away_m) < 110


@pytest.mark.parametrize("frame", [Multirotor(), FixedWing()])
def test_it_takes_off_and_comes_down(frame: Frame) -> None:
    body = Body()
    flown(frame, body, Rest(), 5)
    assert (body.up_m, body.east_m, body.north_m) == (0, 0, 0)
    flown(frame, body, Rise(up_m=30), 40)
    assert body.up_m == pytest.approx(30, abs=0.5)
    flown(frame, body, Down(east_m=body.east_m, north_m=body.north_m), 120)
    assert body.grounded
    assert math.hypot(body.east_m_s, body.north_m_s) < 0.1


def test_nothing_is_flown_from_the_ground() -> None:
    """A leg or a point doesn't drag a multirotor along; it has to rise first."""
    for wish in (Fly(start_m=(0, 0), east_m=50, north_m=0, up_m=0, speed_m_s=5), Down(east_m=50, north_m=0)):
        assert flown(Multirotor(), Body(), wish, 5) == Body()


def test_it_comes_down_over_its_point_only() -> None:
    frame, body = Multirotor(), Body(up_m=20)
    while body.up_m > 19:
        flown(frame, body, Down(east_m=50, north_m=0), STEP_S)
    assert body.east_m > 47


def test_the_last_metres_of_a_landing_are_slow() -> None:
    frame, body, sinking_m_s = Multirotor(), Body(up_m=20), 0.0
    while not body.grounded:
        sinking_m_s = body.up_m_s
        flown(frame, body, Down(east_m=0, north_m=0), STEP_S)
    assert -0.8 < sinking_m_s < -0.5


def test_wings_need_speed_to_leave_the_ground() -> None:
    frame, body = FixedWing(), Body()
    while body.grounded:
        flown(frame, body, Rise(up_m=30), STEP_S)
    assert body.air_m_s >= frame.lift_off_m_s
    assert body.north_m > 10


def test_without_thrust_it_falls() -> None:
    body = flown(Multirotor(), Body(up_m=50), Rest(), 2)
    assert 25 < body.up_m < 35
    assert flown(Multirotor(), body, Rest(), 3).up_m == 0


def test_the_nose_follows_a_leg_or_what_it_has_to_look_at() -> None:
    leg = Fly(start_m=(0, 0), east_m=100, north_m=0, up_m=20, speed_m_s=5)
    assert flown(Multirotor(), Body(up_m=20), leg, 5).yaw_deg == pytest.approx(90, abs=1)
    looking = Multirotor(nose_at_m=(0, -500))
    assert flown(looking, Body(up_m=20), leg, 5).yaw_deg == pytest.approx(180, abs=4)


def test_the_same_wishes_the_same_flight() -> None:
    leg = Fly(start_m=(0, 0), east_m=333, north_m=77, up_m=20, speed_m_s=5)
    assert flown(FixedWing(), Body(up_m=9), leg, 50) == flown(FixedWing(), Body(up_m=9), leg, 50)
