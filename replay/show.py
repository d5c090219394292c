"""A flight's records as lines, in the order of the log. It decides nothing and follows no causes."""

from __future__ import annotations

from collections.abc import Iterator

from events import kind_named
from events.store import Reader
from projections.words import scaled
from replay.causes import Line, line


def show(reader: Reader, start: int = 0, stop: int | None = None, kind: str = "") -> Iterator[str]:
    """Yield a line for each record with start <= seq < stop, of one kind where it is named.

    Raises UnknownKind for a kind that is none, StoreFailed.
    """
    wanted = kind_named(kind).number if kind else None
    for stored in reader.stored(start, stop):
        if wanted in (None, stored.kind_number):
            yield f"{_time(stored.at.flight_ns)} {line_text(line(stored))}"


def line_text(shown: Line) -> str:
    """Return a line as text: seq, kind, words."""
    return f"{shown.seq:>7}  {shown.kind:<22} {shown.text}"


def _time(flight_ns: int) -> str:
    """Return seconds of the flight with milliseconds."""
    return f"{scaled(flight_ns // 1_000_000, 3):>11}"
