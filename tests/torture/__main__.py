"""`python -m tests.torture`: kills the node at 200 seeded points of its life and writes what came of it.

Ten flights, twenty kills each; a quarter of the kills comes before the node has said its first word. The result lies
beside this file: date, commit, counts. It ends at the first flight that breaks a promise.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path

from tests.house import REPO
from tests.torture.holding import check
from tests.torture.killing import fly

RESULTS = Path(__file__).with_name("RESULTS.json")
KILLS, KILLS_A_FLIGHT = 200, 20
SECONDS = 120.0  # longer than twenty kills take: every one of them happens in the air or before take-off
STARTING = 0.25


def main() -> int:
    """Kill; return 0 when everything held."""
    parser = argparse.ArgumentParser(prog="python -m tests.torture", description="Kill the node, again and again.")
    parser.add_argument("--kills", type=int, default=KILLS, help=f"how often (default: {KILLS})")
    parser.add_argument("--seed", type=int, default=1, help="seed of the first flight (default: 1)")
    arguments = parser.parse_args()
    orders, answers, copies, killed, seed = Counter[str](), 0, 0, 0, arguments.seed
    while killed < arguments.kills:
        kills = min(KILLS_A_FLIGHT, arguments.kills - killed)
        folder = Path(tempfile.mkdtemp(prefix="torture-"))
        print(f"seed {seed} flies in {folder}", flush=True)  # where something breaks, it is still there to look at
        flown = fly(folder, seconds=SECONDS, seed=seed, kills=kills, starting=STARTING, land=False)
        orders += check(flown, ends=0)
        shutil.rmtree(folder)
        answers += sum(answer.state == "final" for _, answer in flown.answers)
        copies += sum(flown.at_aircraft.values())
        killed += kills
        seed += 1
        print(f"{killed} kills, {sum(orders.values())} orders: {dict(sorted(orders.items()))}", flush=True)
    result = {
        "date": datetime.now(tz=UTC).date().isoformat(),
        "commit": _commit(),
        "kills": killed,
        "flights": seed - arguments.seed,
        "first_seed": arguments.seed,
        "orders_in_the_logs": dict(sorted(orders.items())),
        "final_answers_seen": answers,
        "commands_at_the_aircraft": copies,
        "events_lost": 0,
        "orders_performed_twice": 0,
        "logs_that_replay_identically": seed - arguments.seed,
    }
    RESULTS.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    print(f"held; see {RESULTS.relative_to(REPO)}")
    return 0


def _commit() -> str:
    run = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=REPO, capture_output=True, text=True, check=True
    )
    return run.stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
