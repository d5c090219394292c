"""The node itself fails while it flies a mission: killed between record and bytes, and a disk that is full."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from autopilot.cli.demonstration.stage import Process
from tests.whole import misfortunes
from tests.whole.flights import LONG, Mission

pytestmark = pytest.mark.whole

DISK = "size=40m"


def test_killed_between_record_and_bytes(tmp_path: Path) -> None:
    """Nothing left; the next start commands the level again, not sooner than it may, and nothing is sent twice."""
    flight = Mission(tmp_path, speed_up=5, flies=LONG)
    well = flight.stage.node
    words = [sys.executable, "-m", "tests.whole.dying", "run", "--config", str(flight.stage.config)]
    flight.stage.node = Process("node", words, tmp_path / "logs" / "node.log")
    with flight:
        flight.take_off()
        misfortunes.check_killed_before_the_bytes(flight, well)
        flight.ended()


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own for the flights; only who may mount one has it."""
    flights = tmp_path / "node" / "flights"
    flights.mkdir(parents=True)
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", DISK, "tmpfs", flights], capture_output=True, check=False)
    if mounted.returncode:
        pytest.skip("mounting a small disk needs privileges")
    yield flights
    subprocess.run(["umount", "-l", flights], check=True)


def test_the_disk_is_full_in_flight(tmp_path: Path, small_disk: Path) -> None:
    """It ends with 74, comes up again, and where there is room it records and commands as before."""
    flight = Mission(tmp_path, speed_up=5, flies=LONG)
    flight.configure("retention", min_free_mib=0)
    flight.configure("vehicle", raw_min_free_mib=0)
    flight.configure("limits", store_retry_s=1)
    with flight:
        flight.take_off()
        misfortunes.check_disk_full(flight, small_disk / "ballast")
        flight.ended()
