"""Run the benchmarks: `python -m tests.bench [NAME ...]` (make bench); a NAME is the start of one, as `append/raw`.

Prints the table on stdout, what it is doing on stderr, and writes build/bench.json. A budget that is not
met is a "no" in the table, not a failure: machines differ, and a person reads it.
"""

from __future__ import annotations

import sys

from tests.bench import append, flood, growth, latency, load, reading, seeking
from tests.bench.frame import RESULT, Bench, Row, save, table

BENCHES: tuple[Bench, ...] = (
    *append.BENCHES,
    *reading.BENCHES,
    *seeking.BENCHES,
    *growth.BENCHES,
    *latency.BENCHES,
    *load.BENCHES,
    *flood.BENCHES,
)


def main(names: list[str]) -> int:
    """Run the benches whose names begin with one of `names`, or all. Returns the exit code."""
    chosen = [bench for bench in BENCHES if not names or bench.name.startswith(tuple(names))]
    if not chosen:
        print(f"no benchmark begins with {' or '.join(names)}: {', '.join(b.name for b in BENCHES)}", file=sys.stderr)
        return 2
    rows: list[Row] = []
    for bench in chosen:
        print(f"{bench.name} ...", file=sys.stderr, flush=True)
        rows += bench.run()
    print(table(rows))
    save(rows)
    print(f"written to {RESULT}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
