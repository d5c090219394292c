"""A process that appends until it is killed, and says which record it was told to be durable.

python -m tests.events.store.appender PATH SEED
"""

from __future__ import annotations

import sys
from pathlib import Path
from random import Random

from events.store import SqliteStore
from tests.events.store.test_contract import batch


def main(path: Path, seed: int) -> None:
    """Append batches of random sizes for ever; after each say the head on stdout."""
    store, chance = SqliteStore(path), Random(seed)
    while True:
        start = store.head.seq + 1
        head = store.append(batch(start, start + chance.randint(1, 20)))
        sys.stdout.write(f"{head.seq}\n")
        sys.stdout.flush()
        if chance.random() < 0.1:
            store.idle()


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
