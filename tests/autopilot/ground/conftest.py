"""Fixtures of the tests of judged flights: some that were flown, and a copy of them to spoil."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from autopilot.ground.kept import Kept
from tests.flights import position
from tests.torture.attacks import kept_by_a_witness
from tests.torture.flying import Drone


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Kept]]:
    """Two flights that are over, and an open one, longer than what may stay unsigned."""
    work = tmp_path_factory.mktemp("flown")
    drone = Drone(work / "flights", 5)
    for _ in range(2):
        drone.fly(6)
        drone.end()
    drone.fly(6)
    drone.tell(position(1, 1), after_ms=30_000)
    drone.tell(position(2, 1), after_ms=100)
    drone.tell(position(3, 1), after_ms=12_000)
    drone.tell(position(4, 1), after_ms=100)
    drone.session.store.close()
    return work / "flights", kept_by_a_witness(work, drone)


@pytest.fixture
def root(flown: tuple[Path, list[Kept]], tmp_path: Path) -> Path:
    """Return a copy of the flights to spoil."""
    return shutil.copytree(flown[0], tmp_path / "flights", ignore=shutil.ignore_patterns("reserve"))
