"""What growth is measured on: the days are what they claim to be, and thinning is what makes the difference."""

from __future__ import annotations

from collections import Counter

from replay.verify import verify
from tests.bench.days import Day, config, recorded
from tests.bench.growth import DAYS
from tests.flights import resealed

FLYING, IDLE, DARK = (
    Day(flying=flying, camera=camera) for flying, camera in ((True, True), (False, True), (False, False))
)


def check_day(day: Day, thinned: bool, least: dict[str, int], most: dict[str, int]) -> None:
    """Check how many records of some kinds a minute of a day has."""
    found = Counter(record.kind.name for record in recorded(day, config(thinned), minutes=1))
    assert {kind: found[kind] for kind in least if found[kind] < least[kind]} == {}
    assert {kind: found[kind] for kind in most if found[kind] > most[kind]} == {}


def test_a_minute_in_the_air() -> None:
    """All that a flight has: frames, orders that are performed and answered, a vehicle that moves."""
    least = {
        "frame_observed": 200,
        "position_reported": 90,
        "gimbal_reported": 100,
        "command_answered": 3,
        "send_ack": 3,
    }
    check_day(FLYING, True, least, {"step_failed": 0, "command_unanswered": 0})


def test_a_minute_on_the_ground() -> None:
    """A frame a second at most with a camera, next to nothing without; and much more where nothing is thinned."""
    check_day(IDLE, True, {"frame_observed": 55}, {"frame_observed": 61, "position_reported": 3, "gimbal_reported": 3})
    check_day(DARK, True, {"position_reported": 1}, {"frame_observed": 0, "position_reported": 3, "gimbal_reported": 3})
    check_day(IDLE, False, {"frame_observed": 600, "position_reported": 90, "gimbal_reported": 500}, {})


def test_a_measured_day_is_a_flight() -> None:
    """It replays, so what is measured is what the charts decide."""
    assert verify(resealed(recorded(FLYING, minutes=1))).holds
    assert {day for day, *_ in DAYS.values()} == {FLYING, IDLE, DARK}
