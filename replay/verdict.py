"""What a replay found, as values."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any

from replay.causes import Line


class Outcome(Enum):
    """The ends of a verification."""

    IDENTICAL = "identical"
    INTENDED = "intended difference"  # what differs is what a later logic decides otherwise, and nothing else
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

    @property
    def holds(self) -> bool:
        """Whether the log replays identically, or differs only where a later logic decides otherwise."""
        return self.outcome in (Outcome.IDENTICAL, Outcome.INTENDED)

    def words(self) -> str:
        """Return the verdict in one line."""
        counted = f"{self.records} records, {self.decisions} decisions compared"
        match self.outcome:
            case Outcome.IDENTICAL:
                return f"identical: {counted}"
            case Outcome.INTENDED if self.since and self.first:
                since = f"intended difference since logic {self.since.logic} ({self.since.says})"
                return f"{since}: {self.first.words()}; further steps that differ: {self.further} ({counted})"
            case Outcome.DIVERGES if self.first:
                return f"diverges: {self.first.words()}; further steps that diverge: {self.further} ({counted})"
        differs = f"; {self.first.words()}" if self.first else ""
        return f"{self.outcome.value}: {self.detail}{differs} ({counted})"

    def plain(self) -> dict[str, Any]:
        """Return the verdict as a JSON-able structure."""
        return asdict(self) | {"outcome": self.outcome.value}
