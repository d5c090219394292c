"""What a fold gives to whoever keeps its rows: tables that know which rows changed since they were last kept.

It knows nothing of databases; `projections.store` is the one place that does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from events.records import Record

K = TypeVar("K", int, str)
R = TypeVar("R")


class Table(Generic[K, R]):
    """Frozen rows by key, in the order in which they came."""

    __slots__ = ("_append_only", "_changed", "_rows", "key", "row_type")

    def __init__(self, row_type: type[R], key: str, append_only: bool = False) -> None:
        """Hold rows of the dataclass `row_type`; its field `key` is the primary key.

        Rows of a table that is append-only are never looked at again, so they are let go once they were kept.
        """
        self._append_only = append_only
        self.row_type = row_type
        self.key = key
        self._rows: dict[K, R] = {}
        self._changed: dict[K, None] = {}

    def __getitem__(self, key: K) -> R:
        return self._rows[key]

    def __contains__(self, key: K) -> bool:
        return key in self._rows

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[R]:
        return iter(self._rows.values())

    def get(self, key: K) -> R | None:
        """Return the row, or None."""
        return self._rows.get(key)

    def put(self, key: K, row: R) -> None:
        """Set the row of a key. No row is ever taken away: a flight forgets nothing."""
        self._rows[key] = row
        self._changed[key] = None

    def changed(self) -> list[R]:
        """Return the rows that changed since `settle`."""
        return [self._rows[key] for key in self._changed]

    def settle(self) -> None:
        """The changed rows have been kept."""
        self._changed.clear()
        if self._append_only:
            self._rows.clear()


@dataclass(frozen=True, slots=True)
class Projection:
    """A fold and the tables it fills. The version grows whenever the same log gives other rows than before."""

    name: str
    version: int
    start: Callable[[], Any]
    apply: Callable[[Any, Record], Any]
    tables: Callable[[Any], Mapping[str, Table[Any, Any]]]
