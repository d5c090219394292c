"""What every test shares: tests that start processes form one group, so that they never run beside each other."""

from __future__ import annotations

import pytest


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put what is marked `whole` on one worker of `pytest -n 2 --dist loadgroup`."""
    for item in items:
        if item.get_closest_marker("whole"):
            item.add_marker(pytest.mark.xdist_group("whole"))
