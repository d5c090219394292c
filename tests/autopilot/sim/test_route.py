"""The route is a pure function of time: it begins and ends at home, on the ground, and never jumps."""

from __future__ import annotations

import itertools
import math

import pytest

from autopilot.sim.route import AUTO, RTL, STABILIZE, Route

SECONDS = (15.0, 25.0, 60.0, 600.0)


def check_flight(seed: int, seconds: float) -> None:
    """Fly it in steps of 20 ms and look at every one."""
    route = Route(seed, seconds)
    steps = [route.at(number * 0.02) for number in range(int(seconds / 0.02) + 50)]
    for one, other in itertools.pairwise(steps):
        moved_m = math.dist((one.east_m, one.north_m, one.up_m), (other.east_m, other.north_m, other.up_m))
        assert moved_m < 0.02 * 8
        assert abs((other.yaw_deg - one.yaw_deg + 180) % 360 - 180) < 0.02 * 90
        assert other.east_m - one.east_m == pytest.approx(one.east_m_s * 0.02, abs=0.005)
        assert other.up_m - one.up_m == pytest.approx(one.up_m_s * 0.02, abs=0.005)
    for end in (steps[0], steps[-1]):
        assert math.hypot(end.east_m, end.north_m, end.up_m) < 1e-6
        assert not end.armed
    assert max(step.up_m for step in steps) == pytest.approx(route.height_m)
    modes = [step.mode for step in steps]
    assert [mode for mode, before in zip(modes, [-1, *modes], strict=False) if mode != before] == [
        STABILIZE,
        AUTO,
        RTL,
        STABILIZE,
    ]


@pytest.mark.parametrize("seconds", SECONDS)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_flight(seed: int, seconds: float) -> None:
    check_flight(seed, seconds)


def test_it_is_armed_whenever_it_is_off_the_ground() -> None:
    route = Route(3, 40)
    for tenth in range(500):
        motion = route.at(tenth / 10)
        assert motion.armed or motion.up_m == 0


def test_the_same_seed_the_same_route() -> None:
    assert Route(4, 30).at(12.3) == Route(4, 30).at(12.3)
    assert Route(4, 30).at(12.3) != Route(5, 30).at(12.3)


def test_it_looks_ahead() -> None:
    motion = Route(6, 60).at(30)
    course_deg = math.degrees(math.atan2(motion.east_m_s, motion.north_m_s)) % 360
    assert motion.yaw_deg == pytest.approx(course_deg, abs=0.5)


def test_too_short_a_flight() -> None:
    with pytest.raises(ValueError, match="at least 15 s"):
        Route(1, 14.9)
