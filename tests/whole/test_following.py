"""Operators go away while a camera follows something: the return waits for its grace, in a flight of real processes.

`python -m tests.torture flights` does the same at the real limits.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.whole.flights import LONG, Mission
from tests.whole.following import check_silence_while_following

pytestmark = pytest.mark.whole


def test_nobody_is_heard_while_something_is_followed(tmp_path: Path) -> None:
    """Degraded from 2 s, told as lost from 4 s, and home after 3 s more; 5, 30 and 30 s are the same thing."""
    mission = Mission(tmp_path, speed_up=4, flies=LONG)
    mission.configure("mesh", presence_period_s=1.0)  # twice into what is called degraded
    mission.configure("safety", operator_degraded_s=2, operator_lost_s=4, operator_lost_following_s=3)
    with mission:
        mission.take_off()
        check_silence_while_following(mission, 4, 3)
        records = mission.ended()
    assert [one for one in records if one.kind.name in ("property_broken", "step_failed")] == []
