"""The daemon is killed at five seeded points of a 30 s flight and started again: nothing is lost or done twice.

`python -m tests.torture kills` does the same at 200 points.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.torture.holding import check
from tests.torture.killing import fly

pytestmark = pytest.mark.whole


KILLS, ACCEPTED = 5, 11


def test_a_node_that_is_killed_goes_on_with_its_flight(tmp_path: Path) -> None:
    """Five kills, each followed by a start; the aircraft lands, and the sixth start closes the flight."""
    flown = fly(tmp_path, seconds=30, seed=11, kills=KILLS, accepted=ACCEPTED)
    orders = check(flown, starts=KILLS + 1)
    assert orders["accepted"] > 10
    assert sum(answer.state == "final" for _, answer in flown.answers) > 10
