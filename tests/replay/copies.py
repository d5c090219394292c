"""Redacted copies in memory, and the doors that tests of them go through. Reads and changes no file."""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence

from hypothesis import strategies as st

from events import Record
from events.records import Stored
from events.store.protocol import Reader
from events.store.redacted import redacted
from replay.verdict import Divergence, Outcome, Verdict
from replay.verify import verify
from tests.flights import resealed


class Copy:
    """A copy of a flight without the bodies of some records."""

    def __init__(self, source: Reader, remove: Container[int], rows: list[Stored] | None = None) -> None:
        self.flight_id, self.secret, self.head = source.flight_id, b"", source.head
        self._rows = list(redacted(source, remove, source.head.seq + 1)) if rows is None else rows
        self._checkpoints = source.checkpoints()

    def checkpoints(self) -> list[tuple[int, str]]:
        """Return what was signed."""
        return self._checkpoints

    def stored(self, start: int = 0, stop: int | None = None) -> Iterator[Stored]:
        """Yield the rows as they lie."""
        yield from self._rows[start:stop]

    def close(self) -> None:
        """Nothing is open."""


removals = st.lists(st.integers(1, 400), max_size=60).map(frozenset)


def check_incomplete(records: Sequence[Record], remove: Container[int]) -> Verdict:
    """Check that nothing differs in a copy of a flight that replays, and that every decision is accounted for."""
    verdict = verify(Copy(resealed(records), remove))
    gone = [one.seq for one in records if one.seq in remove]
    outcomes = {True: Outcome.INCOMPLETE, False: Outcome.IDENTICAL}
    assert verdict.outcome is outcomes[bool(gone)], verdict.words()
    assert verdict.gaps.removed == gone
    there = sum(one.cause >= 0 and one.seq not in remove for one in records)
    assert verdict.decisions + verdict.gaps.agreeing + verdict.gaps.uncompared == there
    return verdict


def check_open(records: Sequence[Record], remove: Container[int], decisions: int, agreeing: int, open_at: str) -> None:
    """Check how much of a copy can be compared, how much only agrees, and on what the rest was decided."""
    verdict = check_incomplete(records, remove)
    plain = verdict.plain()["gaps"]
    assert (verdict.decisions, plain["agreeing"], plain["uncompared_steps"]) == (decisions, agreeing, open_at)


def check_differs(records: Sequence[Record], remove: Container[int], seq: int, what: str) -> Divergence:
    """Check where a copy of a flight that was changed and sealed again diverges first."""
    verdict = verify(Copy(resealed(records), remove))
    assert verdict.outcome is Outcome.DIVERGES, verdict.words()
    assert verdict.first is not None
    assert (verdict.first.seq, verdict.first.what) == (seq, what)
    return verdict.first
