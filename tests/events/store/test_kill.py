"""kill -9 while a process appends: every record that was acknowledged is there, and the log goes on."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from random import Random

import pytest

from events.store import SqliteStore
from tests.events.store.test_contract import FLIGHT_ID, SECRET, batch, check_holds
from tests.house import REPO


def killed_after(path: Path, seed: int, acknowledged: int) -> int:
    """Let a process append, kill it after so many acknowledgements; return the last seq that it acknowledged."""
    arguments = [sys.executable, "-m", "tests.events.store.appender", str(path), str(seed)]
    process = subprocess.Popen(arguments, cwd=REPO, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    for _ in range(acknowledged):
        assert process.stdout.readline(), "the appender ended by itself"
    process.kill()
    rest = process.stdout.read().split("\n")[:-1]
    process.stdout.close()
    process.wait(timeout=30)
    return int(rest[-1]) if rest else -1


@pytest.mark.whole
def test_nothing_that_was_acknowledged_is_lost(tmp_path: Path) -> None:
    """At five seeded points of one log; the head may be one batch ahead, of which nobody was told."""
    chance, path = Random(2), tmp_path / "flight.db"
    SqliteStore.create(path, FLIGHT_ID, SECRET).close()
    for seed in range(5):
        told = killed_after(path, seed, chance.randint(1, 120))
        store = SqliteStore(path)
        assert store.head.seq >= told
        check_holds(store, batch(0, store.head.seq + 1))
        store.close()
