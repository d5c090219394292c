"""State that can be rolled back: keyed rows and single values that note what they replace.

The state of the core is large (a map of a million objects) and changes a little with each record, so it is
changed in place by `evolve` and nobody else. The journal is what makes "a step that raises changes nothing"
true: everything since the last `clear` can be undone. Rows are frozen; iteration is in the order of keys,
so it does not depend on the order in which rows came.

The same notes tell which rows changed since they were last asked for, and what these held then: that is what
a digest of the whole state has to look at (`digest`). Nobody pays for that before `watch` was called.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Generic, Protocol, TypeVar

K = TypeVar("K", bound=Any)
V = TypeVar("V")
ABSENT: Any = object()  # what a key holds that is not there

# Notes that stand are kept as they came up to this many, and then sorted by table: a note costs one append.
SORT_AT = 8192


class Table(Protocol):
    """What notes are about."""

    def put_back(self, key: Any, old: Any, /) -> None:
        """Let `key` hold `old` again, and note nothing."""


Before = dict[Table, dict[Any, Any]]  # by table and key: what it held, ABSENT where it was not there


class Journal:
    """What to put back, and what has changed."""

    __slots__ = ("_before", "_stands", "_undo", "_watched", "note")

    def __init__(self) -> None:
        self._undo: list[tuple[Table, Any, Any]] = []
        self._stands = 0  # so many of them are not to be undone any more
        self._watched = False
        self._before: Before = {}
        # Called with (table, key, what it held): the list's own, for it is asked most.
        self.note: Callable[[tuple[Table, Any, Any]], None] = self._undo.append

    def clear(self) -> None:
        """Let what was done stand."""
        if not self._watched:
            self._undo.clear()
        elif len(self._undo) >= SORT_AT:
            self._sort()
        self._stands = len(self._undo)

    def rollback(self) -> None:
        """Undo everything since the last `clear`, newest first."""
        undo, stands = self._undo, self._stands
        while len(undo) > stands:
            table, key, old = undo.pop()
            table.put_back(key, old)

    def watch(self) -> None:
        """Remember from now on, beyond `clear`, what changed."""
        self.clear()
        self._watched = True

    def take(self) -> Before:
        """Return what every row that was written to since `watch` or the last `take` held then; let it stand."""
        self._sort()
        taken, self._before = self._before, {}
        return taken

    def _sort(self) -> None:
        before = self._before
        for table, key, old in self._undo:
            rows = before.get(table)
            if rows is None:
                rows = before[table] = {}
            if key not in rows:
                rows[key] = old
        self._undo.clear()
        self._stands = 0


class Keyed(Generic[K, V]):
    """Frozen rows by key."""

    __slots__ = ("_note", "_rows", "get")

    def __init__(self, journal: Journal) -> None:
        self._note = journal.note
        self._rows: dict[K, V] = {}
        self.get: Callable[[K], V | None] = self._rows.get  # the row or None; the dict's own, for it is asked most

    def __getitem__(self, key: K) -> V:
        return self._rows[key]

    def __contains__(self, key: K) -> bool:
        return key in self._rows

    def __len__(self) -> int:
        return len(self._rows)

    def put(self, key: K, row: V) -> None:
        """Set the row of a key."""
        self._note((self, key, self._rows.get(key, ABSENT)))
        self._rows[key] = row

    def drop(self, key: K) -> None:
        """Forget a key; one that is not there is no error."""
        if key in self._rows:
            self._note((self, key, self._rows.pop(key)))

    def drop_where(self, test: Callable[[V], bool]) -> None:
        """Forget every row that the test is true of."""
        for key in [key for key, row in self._rows.items() if test(row)]:
            self.drop(key)

    def items(self) -> Iterator[tuple[K, V]]:
        """Yield keys and rows in the order of the keys."""
        yield from sorted(self._rows.items(), key=_key_of)

    def values(self) -> Iterator[V]:
        """Yield rows in the order of their keys."""
        yield from (row for _, row in self.items())

    def least(self) -> V | None:
        """Return the smallest row, or None: for rows that are numbers."""
        return min(self._rows.values(), default=None)  # type: ignore[type-var]

    def whole(self) -> dict[Any, Any]:
        """Return all rows by key, in no order that means anything."""
        return dict(self._rows)

    def load(self, rows: Iterable[tuple[K, V]]) -> None:
        """Put rows into a table that is new, and note nothing."""
        self._rows.update(rows)

    def held(self, key: K) -> Any:
        """Return the row of a key, ABSENT where it is not there."""
        return self._rows.get(key, ABSENT)

    def put_back(self, key: K, old: Any, /) -> None:
        """Let `key` hold `old`, which may be ABSENT, and note nothing: for the journal alone."""
        if old is ABSENT:
            del self._rows[key]
        else:
            self._rows[key] = old


class Single(Generic[V]):
    """One value: a table with one row, whose key is None."""

    __slots__ = ("_note", "_value")

    def __init__(self, journal: Journal, value: V) -> None:
        self._note = journal.note
        self._value = value

    @property
    def value(self) -> V:
        """The value now."""
        return self._value

    def set(self, value: V) -> None:
        """Replace the value."""
        self._note((self, None, self._value))
        self._value = value

    def whole(self) -> dict[Any, Any]:
        """Return the value as the row of key None."""
        return {None: self._value}

    def load(self, rows: Iterable[tuple[None, V]]) -> None:
        """Let it be the row of key None, where there is one, and note nothing."""
        for _, self._value in rows:
            pass

    def held(self, _key: None) -> Any:
        """Return the value."""
        return self._value

    def put_back(self, _key: None, old: Any, /) -> None:
        """Let it be `old`, and note nothing: for the journal alone."""
        self._value = old


def _key_of(item: tuple[Any, Any]) -> Any:
    return item[0]
