"""Kills the node at seeded points of its life and holds what was seen against the log.

Ten flights, twenty kills each; a quarter of the kills comes before the node has said its first word. It ends at the
first flight that breaks a promise.
"""

from __future__ import annotations

import shutil
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.torture.holding import check
from tests.torture.killing import fly

KILLS, KILLS_A_FLIGHT = 200, 20
SECONDS = 120.0  # longer than twenty kills take: every one of them happens in the air or before take-off
STARTING = 0.25


def run(count: int | None, seed: int, report: Callable[[str], None]) -> dict[str, Any]:
    """Kill `count` times (None: 200), beginning with the flight of this seed. Raises AssertionError."""
    kills_wanted, first_seed = count or KILLS, seed
    orders, answers, copies, killed = Counter[str](), 0, 0, 0
    while killed < kills_wanted:
        kills = min(KILLS_A_FLIGHT, kills_wanted - killed)
        folder = Path(tempfile.mkdtemp(prefix="torture-"))
        report(f"seed {seed} flies in {folder}")  # where something breaks, it is still there to look at
        flown = fly(folder, seconds=SECONDS, seed=seed, kills=kills, starting=STARTING, land=False)
        orders += check(flown, ends=0)
        shutil.rmtree(folder)
        answers += sum(answer.state == "final" for _, answer in flown.answers)
        copies += sum(flown.at_aircraft.values())
        killed += kills
        seed += 1
        report(f"{killed} kills, {sum(orders.values())} orders: {dict(sorted(orders.items()))}")
    return {
        "kills": killed,
        "flights": seed - first_seed,
        "first_seed": first_seed,
        "orders_in_the_logs": dict(sorted(orders.items())),
        "final_answers_seen": answers,
        "commands_at_the_aircraft": copies,
        "events_lost": 0,
        "orders_performed_twice": 0,
        "logs_that_replay_identically": seed - first_seed,
    }
