"""Records the golden flights anew: `python -m tests.golden.make`.

Only for a change of the charts that is meant; the new files are then part of that change. Each flight is a log as the
daemon writes it, made from the same observations every time; `digests.json` holds what each comes to.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from events import Record
from events.store import SqliteStore
from tests.flights import FLIGHT_ID, SECRET, resealed
from tests.golden.chance import by_chance
from tests.golden.digest import charts, digests
from tests.golden.table import DIGESTS, GOLDEN, SEEDS


def write(path: Path, records: Sequence[Record]) -> None:
    """Write a flight's log, sealed from its first record on; only the log, not what a store keeps beside it."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "flight.db"
        store = SqliteStore.create(log, FLIGHT_ID, SECRET)
        store.append(records)
        store.close()
        shutil.copyfile(log, path)


def head_leaf(records: Sequence[Record]) -> str:
    """Return the leaf that a log of these records ends with: equal leaves are equal logs."""
    return resealed(records).head.leaf.hex()


def flown() -> dict[str, str]:
    """Return the head of every golden flight and of every flight by chance, all of them told anew."""
    told = {one.name: head_leaf(one.records()) for one in GOLDEN}
    return told | {f"seed {seed}": head_leaf(by_chance(seed).records) for seed in SEEDS}


def everything() -> dict[str, Any]:
    """Return what all golden flights come to, here and now: what `digests.json` must say."""
    return {"charts": charts(), "flown": flown(), "replayed": {one.name: digests(one.path) for one in GOLDEN}}


def main() -> None:
    """Write them all."""
    for one in GOLDEN:
        write(one.path, one.records())
    DIGESTS.write_text(json.dumps(everything(), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
