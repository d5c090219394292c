"""What a store of one flight promises; the contract suite in the tests holds every store to it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol

from events.records import Record, Stored


class StoreFailed(OSError):
    """The store could not write or read. Not retried: a retried fsync can report success for lost pages."""


class StoreMissing(FileNotFoundError):
    """There is no flight at this path."""


class Head(NamedTuple):
    """The end of a flight's log."""

    seq: int  # -1 for an empty log
    leaf: bytes


class Reader(Protocol):
    """Reads a flight. A reader never changes it."""

    @property
    def flight_id(self) -> bytes:
        """The 16 bytes that identify the flight."""

    @property
    def secret(self) -> bytes:
        """The 32 bytes that the salts derive from; b"" for a redacted copy, whose records carry their own."""

    @property
    def head(self) -> Head:
        """The last durable record's seq and leaf."""

    def stored(self, start: int = 0, stop: int | None = None) -> Iterator[Stored]:
        """Yield the rows with start <= seq < stop in order, as they lie. Raises StoreFailed."""

    def checkpoints(self) -> list[tuple[int, str]]:
        """Return size and signed note of every checkpoint, oldest first. They lie outside the chain."""

    def close(self) -> None:
        """Let go of the file. Closing twice is harmless."""


class Appender(Reader, Protocol):
    """The one writer of a flight."""

    @property
    def reserve_spent(self) -> bool:
        """The disk was full, and the space that was reserved for the end has been given up."""

    def append(self, records: Sequence[Record]) -> Head:
        """Make the records durable in one transaction and return the new head.

        They must follow the head without a gap and fit their columns (ValueError: nothing was taken, and the
        store goes on). After StoreFailed nothing of them counts and the store takes nothing more.
        """

    def add_checkpoint(self, size: int, note: str) -> None:
        """Make a signed checkpoint over the first `size` records durable; a newer one of a size replaces the older."""

    def idle(self) -> None:
        """Do what is better done while nothing is waiting (moving the WAL into the database)."""
