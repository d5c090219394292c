"""A tenth of the flood of the benchmarks, for a few seconds: behind a relay no order is lost and nothing grows.

The whole of it needs two cores that nobody else uses: `make bench`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.bench.flood import CASES, Case, run
from tests.bench.load import OPERATORS, load

pytestmark = pytest.mark.whole
MIB = 1 << 20


@pytest.mark.parametrize("case", [case for case in CASES if case.guard != "bare"], ids=lambda case: case.guard)
def test_behind_a_relay_no_order_is_lost_in_a_flood(case: Case, tmp_path: Path) -> None:
    """Each reaches the vehicle; node and relay hold no more than before."""
    quiet, flooded = run(replace(case, per_s=case.per_s // 10), tmp_path, seconds=3.0, quiet_s=1.0)
    assert (quiet.lost, flooded.lost) == (0, 0)
    assert flooded.given >= 10
    assert flooded.forged > 1000
    assert max(flooded.rss_bytes.values()) < 16 * MIB


def test_orders_that_are_answered_are_in_the_log(tmp_path: Path) -> None:
    """As fast as eight people can give them."""
    _, recorded = load(tmp_path, each=10)
    assert recorded >= 10 * OPERATORS
