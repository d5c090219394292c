"""What a replay found, as values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from enum import Enum
from typing import Any

from events.records import Stored
from projections.words import ranges
from replay.causes import Line


class Outcome(Enum):
    """The ends of a verification."""

    IDENTICAL = "identical"
    INTENDED = "intended difference"  # what differs is what a later logic decides otherwise, and nothing else
    INCOMPLETE = "incomplete"  # a redacted copy, in which nothing that can be compared differs
    DIVERGES = "diverges"
    BROKEN = "broken chain"
    UNREADABLE = "unreadable"


@dataclass(frozen=True, slots=True)
class Divergence:
    """The first decision that comes out otherwise."""

    seq: int  # record of the log; one behind the step's last where the log lacks a decision
    kind: str  # kind of the recorded decision; of the replayed one where the log lacks it
    what: str  # "field", "encoding", "header", "kind", "order", "missing in the log", "only in the log"
    field: str  # path of the field; "" where the whole decision differs
    recorded: str
    replayed: str
    causes: tuple[Line, ...]  # the decision, and what led to it, back to the first observation

    def words(self) -> str:
        """Return what differs, in one line."""
        where = f"{self.kind} {self.field}".rstrip()
        return f"record {self.seq} ({where}), {self.what}: recorded {self.recorded}, replayed {self.replayed}"


@dataclass(frozen=True, slots=True)
class Broken:
    """A property that recorded decisions broke; the first time."""

    name: str
    seq: int  # the observation that they follow from
    words: str


@dataclass(slots=True)
class Gaps:
    """What a redacted copy leaves open. It grows while the copy is replayed."""

    removed: list[int] = field(default_factory=list)  # seqs whose body is not there
    agreeing: int = 0  # decisions that come out the same, from a state that may lack what was removed
    uncompared: int = 0  # decisions that are there and could not be compared
    open: list[int] = field(default_factory=list)  # the observations on which those were made

    def add(self, recorded: Sequence[Stored], agreeing: int, uncompared: int) -> None:
        """Count one step."""
        self.removed.extend(stored.seq for stored in recorded if stored.removed)
        self.agreeing += agreeing
        self.uncompared += uncompared
        if uncompared:
            self.open.append(recorded[0].seq)

    def words(self) -> str:
        """Return what is open, in a clause; "" where nothing was removed."""
        if not self.removed:
            return ""
        said = f"records {ranges(self.removed)} were removed from this copy"
        if self.agreeing:
            said += f"; {self.agreeing} more decisions agree, though what they rest on is not all there"
        if self.uncompared:
            said += f"; {self.uncompared} can't be compared, those on {ranges(self.open)}"
        return said

    def plain(self) -> dict[str, Any]:
        """Return it as a JSON-able structure."""
        return {
            "removed": ranges(self.removed),
            "agreeing": self.agreeing,
            "uncompared": self.uncompared,
            "uncompared_steps": ranges(self.open),
        }


@dataclass(frozen=True, slots=True)
class Since:
    """A logic that decides otherwise than the flight's."""

    logic: int
    says: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result of a verification."""

    outcome: Outcome
    flight_id: str  # hex
    records: int  # records whose chain held
    decisions: int  # decisions that were compared
    first: Divergence | None = (
        None  # for a broken chain: what the broken record should have said, where replay can tell
    )
    further: int = 0  # further steps that diverge, or that differ as intended where nothing diverges
    since: Since | None = None  # the first later logic that explains a difference
    seq: int | None = None  # where the chain breaks or reading ends
    detail: str = ""  # why, for a broken chain or an unreadable log
    leaf: str = ""  # hex: leaf of the last record whose chain held
    gaps: Gaps = field(default_factory=Gaps)
    broken: tuple[Broken, ...] = ()  # properties that the recorded decisions broke; a redacted copy is not asked

    @property
    def holds(self) -> bool:
        """Whether the log replays identically, or differs only where a later logic decides otherwise."""
        return self.outcome in (Outcome.IDENTICAL, Outcome.INTENDED)

    def words(self) -> str:
        """Return the verdict in one line."""
        counted = f"{self.records} records, {self.decisions} decisions compared"
        if gaps := self.gaps.words():
            counted = f"{counted}; {gaps}"
        for one in self.broken:
            counted = f"{counted}; BROKEN PROPERTY {one.name} at record {one.seq}: {one.words}"
        match self.outcome:
            case Outcome.IDENTICAL:
                return f"identical: {counted}"
            case Outcome.INTENDED if self.since and self.first:
                since = f"intended difference since logic {self.since.logic} ({self.since.says})"
                return f"{since}: {self.first.words()}; further steps that differ: {self.further} ({counted})"
            case Outcome.DIVERGES if self.first:
                return f"diverges: {self.first.words()}; further steps that diverge: {self.further} ({counted})"
            case Outcome.INCOMPLETE:
                return f"INCOMPLETE({ranges(self.gaps.removed)}): nothing differs ({counted})"
        differs = f"; {self.first.words()}" if self.first else ""
        return f"{self.outcome.value}: {self.detail}{differs} ({counted})"

    def plain(self) -> dict[str, Any]:
        """Return the verdict as a JSON-able structure."""
        return asdict(self) | {"outcome": self.outcome.value, "gaps": self.gaps.plain()}
