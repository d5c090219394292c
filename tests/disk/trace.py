"""A life on a disk, written down: its operations and its promises, in the order in which they were made.

The script is the same for every seed in outline (two flights, a restart, a reboot) and differs in what comes when.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from unittest.mock import patch

from autopilot.node.loop import NodeLoop
from events.store import sqlite
from tests.autopilot.node.nodes import FakeClock
from tests.disk.lives import ORDERS, Life, folder, land, live, order, small, witnessed
from tests.disk.model import Do, Image, Op, write_out
from tests.disk.promises import Promise, Promised
from tests.disk.seams import meeting

FULL, NORMAL = 2, 1


@dataclass(frozen=True, slots=True)
class Trace:
    """What was durable before, what was promised before, and what happened."""

    base: Image
    before: Promised
    entries: list[Op | Promise]


@dataclass(slots=True)
class Setting:
    """How the node that is watched differs from the one that flies: not at all, but where a test must fail."""

    synchronous: int = FULL
    loop_of: type[NodeLoop] = NodeLoop


@dataclass(slots=True)
class _Script:
    root: Path
    entries: list[Op | Promise]
    chance: Random
    setting: Setting
    clock: FakeClock = field(default_factory=FakeClock)

    def process(self, boot_id: str) -> Life:
        """Return the next process on the folder, not started yet."""
        return Life(self.root, self.clock, self.chance, self.entries.append, boot_id, self.setting.loop_of)


def record(
    seed: int, setting: Setting | None = None, base: Image | None = None, before: Promised | None = None
) -> Trace:
    """Live a life on what is there, and write it down."""
    trace = Trace(base or {}, before or Promised(), [])
    setting = setting or Setting()
    chance = Random(f"life {seed}")
    lives: list[Life] = []
    with folder() as root, small(), _synchronous(setting.synchronous):
        write_out(trace.base, root)
        with witnessed(trace.entries.append), meeting(root, lambda op: _write_down(trace, op)):
            lives.extend(_lives(_Script(root, trace.entries, chance, setting), f"{seed}"))
        for life in lives:
            life.let_go()
    return trace


def _write_down(trace: Trace, op: Op) -> None:
    """Keep what changes the disk: a cut before a read leaves what one after it does."""
    if op.do not in (Do.OPEN, Do.READ):
        trace.entries.append(op)


def _lives(script: _Script, name: str) -> Iterator[Life]:
    chance, orders = script.chance, range(1, ORDERS + 1)
    cut = chance.randrange(1, ORDERS - 1)
    first = script.process(f"{name}-one")
    yield first
    first.start()
    live(first, chance, orders[:cut])
    if chance.random() < 0.7:
        land(first, chance)
    live(first, chance, orders[cut:-1])
    first.stop()
    second = script.process(f"{name}-one")
    yield second
    second.start()
    second.tell(order(cut, send=2), after_ms=100)
    live(second, chance, orders[-1:])
    second.stop()
    third = script.process(f"{name}-two")
    yield third
    third.start()
    third.tell(order(ORDERS, send=2), after_ms=100)


@contextmanager
def _synchronous(level: int) -> Iterator[None]:
    with patch.dict(sqlite._PRAGMAS, {"synchronous": level}):
        yield
