"""Replays a redacted copy: compares what can still be compared, and keeps account of what can't.

Each table of the state has a level. KNOWN: it follows from records that are there. ASSUMED: a removed decision wrote to
it, in a step that is otherwise the same; what the charts decide now stands for it. UNKNOWN: it may lack what a removed
record wrote. Reading takes the level over to the step, writing to what is written, also to what might have been.

A step that reads only what is known is compared, and differing is a divergence. One that reads what is assumed is
compared, too, but where it differs nobody can say whether the flight or the assumption does: then it is not counted as
compared. One that reads what is unknown proves nothing even where it agrees, and is counted apart. docs/redaction.md
says it for people.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from events.records import Record, Stored
from events.schema.common_pb2 import Moved
from replay.reach import may_write
from statecharts import State, evolve, step
from statecharts.journal import Keyed, Single

_STEP_FAILED = 7  # kind number


class Level(IntEnum):
    """How far what is read can be believed."""

    KNOWN = 0
    ASSUMED = 1
    UNKNOWN = 2


class Watch:
    """The levels of the tables, and that of the step so far."""

    def __init__(self) -> None:
        self.tables: dict[str, Level] = {}
        self.step = Level.KNOWN
        self.written: set[str] = set()

    def read(self, table: str) -> None:
        """The step has looked at a table."""
        self.step = max(self.step, self.tables.get(table, Level.KNOWN))

    def wrote(self, table: str, *, whole: bool) -> None:
        """The step has written to a table; one that was written as a whole is as good as the step."""
        self.written.add(table)
        before = Level.KNOWN if whole else self.tables.get(table, Level.KNOWN)
        self.tables[table] = max(before, self.step)

    def doubt(self, tables: Sequence[str], level: Level) -> None:
        """Believe these tables no further than this."""
        for table in tables:
            self.tables[table] = max(level, self.tables.get(table, Level.KNOWN))


class WatchedSingle(Single[Any]):
    """A value that tells who looks at it."""

    __slots__ = ("_name", "_watch")

    def __init__(self, name: str, watch: Watch, before: Single[Any], state: State) -> None:
        super().__init__(state.journal, before.value)
        self._name, self._watch = name, watch

    @property
    def value(self) -> Any:
        """The value now."""
        self._watch.read(self._name)
        return self._value

    def set(self, value: Any) -> None:
        """Replace the value."""
        self._watch.wrote(self._name, whole=True)
        super().set(value)


class WatchedKeyed(Keyed[Any, Any]):
    """Rows that tell who looks at them."""

    __slots__ = ("_name", "_watch")

    def __init__(self, name: str, watch: Watch, state: State) -> None:
        super().__init__(state.journal)
        self._name, self._watch = name, watch
        self.get = self._get

    def _table(self, _key: Any) -> str:
        return self._name

    def _get(self, key: Any) -> Any:
        self._watch.read(self._table(key))
        return self._rows.get(key)

    def __getitem__(self, key: Any) -> Any:
        self._watch.read(self._table(key))
        return self._rows[key]

    def __contains__(self, key: Any) -> bool:
        self._watch.read(self._table(key))
        return key in self._rows

    def __len__(self) -> int:
        self._watch.read(self._name)
        return len(self._rows)

    def put(self, key: Any, row: Any) -> None:
        """Set the row of a key."""
        self._watch.wrote(self._table(key), whole=False)
        super().put(key, row)

    def drop(self, key: Any) -> None:
        """Forget a key."""
        self._watch.wrote(self._table(key), whole=False)
        super().drop(key)

    def drop_where(self, test: Callable[[Any], bool]) -> None:
        """Forget every row that the test is true of."""
        self._watch.read(self._name)
        super().drop_where(test)

    def items(self) -> Any:
        """Yield keys and rows."""
        self._watch.read(self._name)
        return super().items()


class WatchedDeadlines(WatchedKeyed):
    """Deadlines, which count by chart. When the next one is due is asked of all, but decides nothing here."""

    __slots__ = ()

    def _table(self, key: Any) -> str:
        return f"deadlines/{key[0]}"


class WatchedState(State):
    """A state that tells which of its tables a step looks at and writes to."""

    __slots__ = ("watch",)

    def __init__(self) -> None:
        super().__init__()
        self.watch = Watch()
        for name in State.__slots__:
            before = getattr(self, name)
            if name == "deadlines":
                setattr(self, name, WatchedDeadlines(name, self.watch, self))
            elif isinstance(before, Keyed):
                setattr(self, name, WatchedKeyed(name, self.watch, self))
            elif isinstance(before, Single) and name != "next_seq":
                setattr(self, name, WatchedSingle(name, self.watch, before, self))

    def passed(self, chart: str, now_ns: int) -> tuple[str, ...]:
        """Return the instances of a chart whose deadline has passed, in order."""
        self.watch.read(f"deadlines/{chart}")
        return super().passed(chart, now_ns)


@dataclass(frozen=True, slots=True)
class Compared:
    """What came of one step."""

    decisions: int = 0  # compared, and the same
    agreeing: int = 0  # the same, but what they rest on is not all known
    uncompared: int = 0
    replayed: tuple[Record, ...] | None = None  # where the step diverges


class Partial:
    """The replay of a redacted copy, a step at a time."""

    def __init__(self, read: Callable[[Stored], Record], same: Callable[[Stored, Record], bool]) -> None:
        """`read` raises for what can't be read; `same` is true of a record that was replayed, whatever was removed."""
        self.state = WatchedState()
        self._watch = self.state.watch
        self._read = read
        self._same = same

    def step(self, recorded: Sequence[Stored]) -> Compared:
        """Replay one step as far as it is there. Raises whatever `read` raises."""
        there = sum(not stored.removed for stored in recorded[1:])
        if recorded[0].removed:
            self.state.journal.clear()
            self._follow(recorded)
            return Compared(uncompared=there)
        before, self._watch.step = dict(self._watch.tables), Level.KNOWN
        replayed = step(self.state, self._read(recorded[0])).records
        level = self._watch.step
        if len(replayed) == len(recorded) and all(map(self._same, recorded, replayed)):
            self._believe(recorded, replayed, level)
            return Compared(agreeing=there) if level is Level.UNKNOWN else Compared(decisions=there)
        self.state.journal.rollback()
        self._watch.tables = before
        self._follow(recorded)
        if level is Level.KNOWN:
            return Compared(decisions=there, replayed=replayed)
        return Compared(uncompared=there)

    def _believe(self, recorded: Sequence[Stored], replayed: Sequence[Record], level: Level) -> None:
        """Go on from a step that agrees: what rests on a doubt is doubted, and so is what only replay knows."""
        for stored, record in zip(recorded, replayed, strict=True):
            doubt = max(level, Level.ASSUMED) if stored.removed else level
            if doubt:
                self._watch.doubt(may_write(stored, _chart(record), recorded), doubt)

    def _follow(self, recorded: Sequence[Stored]) -> None:
        """Apply what is there of a recorded step without deciding anything, as a restart does."""
        failed = len(recorded) > 1 and recorded[1].kind_number == _STEP_FAILED
        for stored in recorded[1:] if failed else recorded:
            self._watch.step = Level.KNOWN
            if stored.removed:
                self._watch.doubt(may_write(stored, "", recorded), Level.UNKNOWN)
                continue
            record = self._read(stored)
            try:
                evolve(self.state, record)
            except Exception:  # noqa: BLE001 - on a state that lacks something any handler may raise
                self._watch.step = Level.UNKNOWN
            if self._watch.step:
                self._watch.doubt(may_write(stored, _chart(record), recorded), self._watch.step)


def _chart(record: Record) -> str:
    return record.message.chart if isinstance(record.message, Moved) else ""
