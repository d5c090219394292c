"""What a search for the cause of a divergence found, as values. It searches nothing.

Every hypothesis is tried, and each says what was tried and what that showed. The strongest finding wins:

1. `PROVED`: a fact that only this cause leaves behind (the same step comes out in two ways; time runs backwards).
2. `DIFFERS`: the manifest says that the rows or the logic that decided then are not those that decide now.
3. `WHOLE`: with one thing changed, everything that was looked at comes out as it was recorded.
4. `OLDER`: the manifest names another version of the software, and no more than that.
5. `FITTED`: as `WHOLE`, with a number that was fitted: a moment, or a limit that nobody would write so.
6. `STEP`: with one thing changed this step comes out as recorded, and at least half of those that differ behind it.
7. `SUSPECTED`: it had a part in the step, and nothing more is known.
8. `LEFT`: what remains when nothing else explains it.

Between equals the order of `Cause` decides: the hypothesis that could have been right in fewer ways comes first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import Enum, IntEnum
from typing import Any


class Cause(Enum):
    """What can be to blame."""

    ENVIRONMENT = "environment"
    REORDERED = "reordered input"  # an input at another place or another moment than where the node acted on it
    UPCAST = "upcast"
    CONFIGURATION = "configuration"
    MISSING = "missing input"
    CODE = "code"


class Weight(IntEnum):
    """How much a finding says for its cause."""

    NOT_APPLICABLE = -1
    NOTHING = 0
    LEFT = 1
    SUSPECTED = 2
    STEP = 3
    FITTED = 4
    OLDER = 5
    WHOLE = 6
    DIFFERS = 7
    PROVED = 8


@dataclass(frozen=True, slots=True)
class Finding:
    """One hypothesis, and what came of it."""

    cause: Cause
    weight: Weight
    words: str  # what was tried and what it showed
    tried: int = 0  # counterfactual runs
    stopped: bool = False  # the limit on runs was reached before everything was tried

    @property
    def result(self) -> str:
        """The weight in words."""
        if self.weight is Weight.NOT_APPLICABLE:
            return "not applicable"
        if self.weight is Weight.NOTHING:
            return "does not explain it"
        return "explains it" if self.weight >= Weight.STEP else "may explain it"

    def plain(self) -> dict[str, Any]:
        """Return the finding as a JSON-able structure."""
        return asdict(self) | {"cause": self.cause.value, "weight": self.weight.name.lower(), "result": self.result}


@dataclass(frozen=True, slots=True)
class Blame:
    """All findings, the one that is believed first."""

    findings: tuple[Finding, ...]

    @property
    def cause(self) -> Cause:
        """What is to blame."""
        return self.findings[0].cause

    def plain(self) -> dict[str, Any]:
        """Return the result as a JSON-able structure."""
        return {"cause": self.cause.value, "findings": [finding.plain() for finding in self.findings]}


def chosen(findings: Sequence[Finding]) -> Blame:
    """Order findings by the stated rule."""
    ranks = {cause: rank for rank, cause in enumerate(Cause)}
    return Blame(tuple(sorted(findings, key=lambda one: (-one.weight, ranks[one.cause]))))
