"""A flight's records as lines, in the order of the log. It decides nothing and follows no causes."""

from __future__ import annotations

from collections.abc import Iterator

from events import Kind
from events.store import Reader
from projections.words import scaled
from replay.causes import Line, line


def show(reader: Reader, start: int = 0, stop: int | None = None, kind: Kind | None = None) -> Iterator[str]:
    """Yield a line for each record with start <= seq < stop, of one kind where it is given. Raises StoreFailed."""
    for stored in reader.stored(start, stop):
        if kind is None or stored.kind_number == kind.number:
            yield f"{_time(stored.at.flight_ns)} {line_text(line(stored))}"


def line_text(shown: Line) -> str:
    """Return a line as text: seq, kind, words."""
    return f"{shown.seq:>7}  {shown.kind:<22} {shown.text}"


def _time(flight_ns: int) -> str:
    """Return seconds of the flight with milliseconds."""
    return f"{scaled(flight_ns // 1_000_000, 3):>11}"
