"""What goes wrong in a flight, one after the other in one flight of a simulated ArduPilot, and what is recorded of it.

`python -m tests.torture flights` does the same with PX4, at the real limits, and takes longer.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.whole import misfortunes
from tests.whole.flights import LONG, Mission

pytestmark = pytest.mark.whole


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mission]:
    """A mission in the air, attended by its operator."""
    mission = Mission(tmp_path_factory.mktemp("flight"), speed_up=4, flies=LONG)
    mission.configure("mesh", presence_period_s=1.0)  # twice into what is called degraded
    mission.configure("safety", operator_degraded_s=2, operator_lost_s=4)
    with mission:
        mission.take_off()
        yield mission


def test_an_answer_is_lost(flight: Mission) -> None:
    """Re-sent, then given up by name."""
    misfortunes.check_answer_lost(flight)


def test_an_answer_comes_twice(flight: Mission) -> None:
    """One outcome."""
    misfortunes.check_answer_twice(flight)


def test_a_stranger_answers(flight: Mission) -> None:
    """It is no answer."""
    misfortunes.check_answer_of_a_stranger(flight)


def test_in_progress_for_ever(flight: Mission) -> None:
    """Waited for, then given up by name."""
    misfortunes.check_in_progress_for_ever(flight)


def test_another_station_takes_the_gimbal(flight: Mission) -> None:
    """An event, and the operator is told."""
    misfortunes.check_gimbal_taken(flight)


def test_the_vehicles_clock_jumps(flight: Mission) -> None:
    """Nothing follows from it."""
    misfortunes.check_clock_jump(flight)


def test_the_autopilot_starts_again(flight: Mission) -> None:
    """Nothing is commanded against it; a person lets the mission go on."""
    misfortunes.check_reboot(flight)


@pytest.mark.parametrize(
    ("seconds", "deepest"), [(0.7, ""), (2.8, "degraded"), (4.8, "lost")], ids=["short", "some", "long"]
)
def test_no_operator_is_heard(flight: Mission, seconds: float, deepest: str) -> None:
    """Degraded from 2 s, lost from 4 s; 5 s and 30 s are the same thing."""
    misfortunes.check_silence(flight, seconds, deepest)


def test_the_place_jumps(flight: Mission, capsys: pytest.CaptureFixture[str]) -> None:
    """The return, and nothing but the return."""
    ms = misfortunes.check_gps_jump(flight)
    with capsys.disabled():
        print(f" [{ms} ms from the place to the bytes]", end="")


def test_over_a_fence_at_speed(flight: Mission, capsys: pytest.CaptureFixture[str]) -> None:
    """The return is commanded on the way, before the fence or at it."""
    ms, beyond_m = misfortunes.check_fence_at_speed(flight)
    with capsys.disabled():
        print(f" [{ms} ms from the place to the bytes, {beyond_m:.1f} m beyond the fence]", end="")


def test_the_battery_sags(flight: Mission) -> None:
    """Held off, returned, landed; the flight replays, and what was not believed was counted."""
    misfortunes.check_battery(flight)
    records = flight.ended()
    counted = misfortunes.rejected(records)
    assert counted["vehicle: foreign system"] > 0
    assert counted["vehicle: unmatched answer"] + counted["vehicle: late answer"] > 0
    assert [one for one in records if one.kind.name in ("property_broken", "step_failed")] == []
