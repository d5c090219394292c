"""A store in memory: for tests and for what-if. It forgets everything when it goes."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence

from events.chain import FIRST_LEAF_BEFORE, Chain
from events.records import Record, Stored
from events.store.protocol import Head, StoreFailed


class MemoryStore:
    """Holds one flight in a list."""

    def __init__(self, flight_id: bytes, secret: bytes) -> None:
        self._flight_id = flight_id
        self._secret = secret
        self._rows: list[Stored] = []
        self._chain = Chain(flight_id, secret)
        self._checkpoints: dict[int, str] = {}
        self._closed = False

    @property
    def flight_id(self) -> bytes:
        """The 16 bytes that identify the flight."""
        return self._flight_id

    @property
    def secret(self) -> bytes:
        """The 32 bytes that the salts derive from."""
        return self._secret

    @property
    def head(self) -> Head:
        """The last record's seq and leaf."""
        return Head(len(self._rows) - 1, self._rows[-1].leaf if self._rows else FIRST_LEAF_BEFORE)

    @property
    def reserve_spent(self) -> bool:
        """Memory has no disk that could be full."""
        return False

    def append(self, records: Sequence[Record]) -> Head:
        """Keep the records, all or none. Raises ValueError on a gap or a misfit, StoreFailed when closed."""
        if self._closed:
            raise StoreFailed("the store is closed")
        expected = range(len(self._rows), len(self._rows) + len(records))
        if [record.seq for record in records] != list(expected):
            raise ValueError(f"records must go on at seq {expected.start} without a gap")
        try:
            rows = [self._row(record) for record in records]
        except struct.error as error:
            self._chain.leaf = self.head.leaf
            raise ValueError(f"a record does not fit the header: {error}") from error
        self._rows.extend(rows)
        return self.head

    def _row(self, record: Record) -> Stored:
        fields = (record.seq, record.cause, record.at, record.kind.number, record.version, record.body)
        return Stored(*fields, leaf=self._chain.extend(*fields))

    def stored(self, start: int = 0, stop: int | None = None) -> Iterator[Stored]:
        """Yield the rows with start <= seq < stop."""
        if self._closed:
            raise StoreFailed("the store is closed")
        yield from self._rows[start:stop]

    def checkpoints(self) -> list[tuple[int, str]]:
        """Return size and signed note of every checkpoint, oldest first."""
        return sorted(self._checkpoints.items())

    def add_checkpoint(self, size: int, note: str) -> None:
        """Keep a signed checkpoint."""
        self._checkpoints[size] = note

    def idle(self) -> None:
        """Nothing waits in memory."""

    def close(self) -> None:
        """Take nothing more."""
        self._closed = True
