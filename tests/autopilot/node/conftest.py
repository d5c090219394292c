"""Fixtures of the tests of flights: a clock that the test moves, and starts of the daemon on one folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.autopilot.node.histories import Begin
from tests.autopilot.node.nodes import FakeClock, Node, chance


@pytest.fixture
def clock() -> FakeClock:
    return FakeClock()


@pytest.fixture
def begin(tmp_path: Path, clock: FakeClock, monkeypatch: pytest.MonkeyPatch) -> Begin:
    """Return what makes the next start of the daemon; all starts share folder, clock and source of chance."""
    random = chance()

    def start(**values: object) -> Node:
        return Node(tmp_path, clock, monkeypatch, random=random, **values)  # type: ignore[arg-type]

    return start
