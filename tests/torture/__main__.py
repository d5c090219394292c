"""`python -m tests.torture [AREA ...]`: the long runs; without a name, all of them.

Each area writes what came of it to `results/AREA.json` beside this file: date, commit, seconds, counts. A run of
another count or seed than the full one is a trial, and is printed only. It ends at the first area that breaks.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tests.house import REPO
from tests.torture import (
    attacks,
    blame,
    faults,
    flights,
    fuzz,
    gate_mutants,
    kills,
    matrix,
    mavlink_fuzz,
    powercut,
    redact,
    rot,
    schedules,
    witness,
)

RESULTS = Path(__file__).with_name("results")
Report = Callable[[str], None]
Run = Callable[[int | None, int, Report], dict[str, Any]]
# Each is given how often (None: the full count), the first seed, and whom to tell how far it is.
AREAS: dict[str, Run] = {
    "attacks": attacks.run,
    "blame": blame.run,
    "faults": faults.run,
    "flights": flights.run,
    "fuzz": fuzz.run,
    "gate_mutants": gate_mutants.run,
    "kills": kills.run,
    "matrix": matrix.run,
    "mavlink_fuzz": mavlink_fuzz.run,
    "powercut": powercut.run,
    "redact": redact.run,
    "rot": rot.run,
    "schedules": schedules.run,
    "witness": witness.run,
}


def main(arguments: list[str] | None = None) -> int:
    """Run the areas; return 0 when everything held."""
    parser = argparse.ArgumentParser(prog="python -m tests.torture", description="The long runs.")
    parser.add_argument("areas", nargs="*", metavar="AREA", help=f"{', '.join(sorted(AREAS))} (default: all)")
    parser.add_argument("--count", type=int, help="how often (default: the area's full count); writes no result")
    parser.add_argument("--seed", type=int, help="the first seed (default: 1); writes no result")
    asked = parser.parse_args(arguments)
    if unknown := sorted(set(asked.areas) - set(AREAS)):
        parser.error(f"there is no area {', '.join(unknown)}: {', '.join(sorted(AREAS))}")
    for name in asked.areas or sorted(AREAS):
        _torture(name, asked.count, asked.seed)
    return 0


def _torture(name: str, count: int | None, seed: int | None) -> None:
    began, commit = time.monotonic(), _commit()
    counts = AREAS[name](count, 1 if seed is None else seed, lambda line: print(f"{name}: {line}", flush=True))
    seconds = round(time.monotonic() - began)
    result = {"date": datetime.now(tz=UTC).date().isoformat(), "commit": commit, "seconds": seconds, **counts}
    text = json.dumps(result, indent=2) + "\n"
    if count is not None or seed is not None:
        print(text, end="", flush=True)
        return
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{name}.json"
    path.write_text(text, encoding="utf-8")
    print(f"{name} held; see {path}", flush=True)


def _commit() -> str:
    run = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=REPO, capture_output=True, text=True, check=True
    )
    return run.stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
