"""Looks through counterfactuals for the one that explains most, within the case's limit on work."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from google.protobuf.message import Message

from replay.blame.case import Case, Group, Spent
from replay.blame.findings import Cause, Finding, Weight
from statecharts import State


class Idea(NamedTuple):
    """One counterfactual: these steps, from this state."""

    words: str
    groups: Sequence[Group]
    state: State | None = None  # None: the state before the window
    put_in: Message | None = None  # what the idea adds
    fitted: bool = False  # it has a number that was chosen to fit


@dataclass
class Best:
    """The best idea so far, and how many were tried."""

    weight: Weight = Weight.NOTHING
    words: str = ""
    tried: int = 0
    stopped: bool = False
    partly: list[Idea] = field(default_factory=list)  # those that make the step come out, but not all behind it

    def take(self, case: Case, ideas: Iterable[Idea]) -> bool:
        """Try ideas until one explains everything; return whether one did."""
        try:
            for idea in ideas:
                self.tried += 1
                run = case.run(idea.groups, idea.state)
                weight = case.weight(run)
                if run is not None and weight is not Weight.WHOLE:
                    self.partly.append(idea)
                if weight is Weight.WHOLE and idea.fitted:
                    weight = Weight.FITTED
                if weight > self.weight:
                    self.weight, self.words = weight, f"{idea.words}: comes out as recorded, {case.held(weight)}"
                if weight >= Weight.FITTED:
                    return True
        except Spent:
            self.stopped = True
        return self.stopped

    def finding(self, cause: Cause, otherwise: str) -> Finding:
        """Return what the search came to; `otherwise` says what was tried in vain."""
        return Finding(cause, self.weight, self.words or otherwise, self.tried, self.stopped)
