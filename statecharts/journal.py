"""State that can be rolled back: keyed rows and single values that note what they replace.

The state of the core is large (a map of a million objects) and changes a little with each record, so it is
changed in place by `evolve` and nobody else. The journal is what makes "a step that raises changes nothing"
true: everything since the last `clear` can be undone. Rows are frozen; iteration is in the order of keys,
so it does not depend on the order in which rows came.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Generic, TypeVar

K = TypeVar("K", bound=Any)
V = TypeVar("V")
_ABSENT: Any = object()


class Journal:
    """What to put back."""

    __slots__ = ("_undo",)

    def __init__(self) -> None:
        self._undo: list[tuple[Callable[[Any, Any], None], Any, Any]] = []

    def note(self, restore: Callable[[Any, Any], None], key: Any, old: Any) -> None:
        """Remember that `key` held `old`."""
        self._undo.append((restore, key, old))

    def clear(self) -> None:
        """Let what was done stand."""
        self._undo.clear()

    def rollback(self) -> None:
        """Undo everything since the last `clear`, newest first."""
        while self._undo:
            restore, key, old = self._undo.pop()
            restore(key, old)


class Keyed(Generic[K, V]):
    """Frozen rows by key."""

    __slots__ = ("_journal", "_rows", "get")

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
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
        self._journal.note(self._restore, key, self._rows.get(key, _ABSENT))
        self._rows[key] = row

    def drop(self, key: K) -> None:
        """Forget a key; one that is not there is no error."""
        if key in self._rows:
            self._journal.note(self._restore, key, self._rows.pop(key))

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

    def _restore(self, key: K, old: V) -> None:
        if old is _ABSENT:
            del self._rows[key]
        else:
            self._rows[key] = old


class Single(Generic[V]):
    """One value."""

    __slots__ = ("_journal", "_value")

    def __init__(self, journal: Journal, value: V) -> None:
        self._journal = journal
        self._value = value

    @property
    def value(self) -> V:
        """The value now."""
        return self._value

    def set(self, value: V) -> None:
        """Replace the value."""
        self._journal.note(self._restore, None, self._value)
        self._value = value

    def _restore(self, _key: None, old: V) -> None:
        self._value = old


def _key_of(item: tuple[Any, Any]) -> Any:
    return item[0]
