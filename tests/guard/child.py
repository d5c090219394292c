"""A process that runs all golden flights, and then planted sins, under the guard, and prints what was seen as JSON.

It is a process of its own because the core must not be imported before the guard is there.
"""

from __future__ import annotations

import json
from importlib import import_module

from tests.guard.findings import Seen
from tests.guard.loading import Guarding
from tests.guard.planting import HARMLESS, SINS, seen_of
from tests.guard.watching import Watch


def main() -> None:
    """Fly, plant, print. Importing has the hooks, too, but is not watched: it reads files."""
    guarding = Guarding(Seen())
    guarding.install()
    flying, watch = import_module("tests.guard.flying"), Watch(guarding.seen)
    with watch.on():
        flights = flying.fly_all()
    sins = [list(sin) for sin in guarding.seen.sins]
    import_module("statecharts.charts.transfer")  # executed at the edge: no flight loads it
    loaded = sorted(guarding.loaded)
    planted = {statement: seen_of(statement, guarding, watch) for statement in (*SINS, *HARMLESS)}
    print(json.dumps({"flights": flights, "loaded": loaded, "sins": sins, "planted": planted}))


if __name__ == "__main__":
    main()
