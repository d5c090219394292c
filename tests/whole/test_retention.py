"""A daemon that deletes what was pushed: by the commands that a person would use, and told in its log."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from autopilot.cli.demonstration.cast import make_cast
from events.schema.flight_pb2 import FlightDeleted
from events.store import flights_in
from tests.whole import daemons

pytestmark = pytest.mark.whole


def autopilot(*words: str) -> str:
    """Run a command and return what it prints. Raises CalledProcessError."""
    command = [sys.executable, "-m", "autopilot.cli.main", *words]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout


def test_what_was_pushed_goes_at_the_next_start(tmp_path: Path) -> None:
    """Of two closed flights the older; before it was pushed it stayed through every start."""
    make_cast(tmp_path)
    settings: dict[str, Any] = {"keep_days": 1e-9, "keep_newest": 1, "min_free_mib": 0}
    config = daemons.write_config(tmp_path, tmp_path / "node" / "keys", retention=settings)
    for _ in range(3):
        assert daemons.ended(daemons.started(config))[0] == 0
    first = flights_in(tmp_path / "flights")[0]
    listed = json.loads(autopilot("flights", "list", "--config", str(config), "--json"))
    assert [one["number"] for one in listed] == [1, 2, 3]
    autopilot("flights", "pushed", str(first.folder), "--to", "archive", "--head", listed[0]["last_leaf"])
    assert "flight 1 would be deleted" in autopilot("flights", "prune", "--config", str(config), "--dry-run")
    child = daemons.started(config)

    def told() -> list[FlightDeleted]:
        return [record.message for record in daemons.log(tmp_path) if isinstance(record.message, FlightDeleted)]

    daemons.wait_for(lambda: bool(told()), "a record of what was deleted")
    assert daemons.ended(child)[0] == 0
    (gone,) = told()
    assert (gone.flight_number, gone.flight_id.hex(), gone.pushed_to) == (1, listed[0]["flight_id"], "archive")
    assert not first.folder.exists()
    assert [flight.number for flight in flights_in(tmp_path / "flights")] == [2, 3, 4]
