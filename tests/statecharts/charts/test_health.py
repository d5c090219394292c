"""The chart `health` as tables: one strange input is forgiven, three within a minute are not."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.breaking import break_chart
from tests.checks import check_chart, check_equal
from tests.stories import Story

Break = Callable[[str, str], None]


def test_three_failures_within_a_minute_lead_to_safe_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    """Orders are refused, nothing is looked for, and only a start leads out."""
    break_chart(monkeypatch, "map", "frame_observed")
    story = check_chart(
        "health",
        """
        at_s | observe          | state          | say                              | why
        0    | frame person@0,0 | -              | failed map RuntimeError          | -
        30   | frame            | -              | failed map RuntimeError          | -
        60   | frame            | -              | failed map RuntimeError          | -
        70   | order a turn     | -              | -                                | -
        71   | order b release  | -              | -                                | -
        74   | time             | -              | -                                | -
        89   | frame            | node safe_mode | failed map RuntimeError          | too many failed steps
        89.1 | order c turn     | -              | c rejected                       | the node is in safe mode
        89.2 | frame            | -              | -                                | -
        89.3 | start            | node normal    | a timeout; b timeout; c rejected | started again
        89.4 | frame            | -              | failed map RuntimeError          | -
        """,
        Story(),
    )
    check_equal(story.flight.state.failures.value, (89_400_000_000,))


def test_safe_mode_stays_until_a_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """Failures in safe mode add nothing, and time does not heal."""
    break_chart(monkeypatch, "camera", "time_passed")
    break_chart(monkeypatch, "map", "frame_observed")
    check_chart(
        "health",
        """
        at_s | observe       | state          | say                     | why
        0    | frame         | -              | failed map RuntimeError | -
        1    | frame         | node safe_mode | failed map RuntimeError | too many failed steps
        2    | frame         | -              | -                       | -
        500  | frame         | -              | -                       | -
        501  | order a point | -              | a rejected              | the node is in safe mode
        """,
        Story(failures_to_safe_mode=2),
    )
