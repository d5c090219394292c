"""Who is to blame for a divergence: code, configuration, upcast, environment, missing or reordered input.

Every answer is a test: a counterfactual that was run, or a fact that was found. `findings` has the rule of choice.
"""

from __future__ import annotations

from collections.abc import Callable

from events.store import Reader
from replay.blame.again import Again
from replay.blame.case import Case, Lifting, Spent
from replay.blame.code import code
from replay.blame.configuration import configuration
from replay.blame.environment import environment
from replay.blame.findings import Blame, Cause, Finding, Weight, chosen
from replay.blame.lifting import upcast
from replay.blame.missing import missing
from replay.blame.order import reordered
from replay.verdict import Divergence

Tell = Callable[[str], None]  # what is being looked into


def blame(
    reader: Reader,
    first: Divergence,
    *,
    lifting: Lifting | None = None,
    again: Again | None = None,
    software: str | None = None,
    tell: Tell | None = None,
) -> Blame:
    """Look into the first divergence of a flight whose chain holds; return every hypothesis and the one to believe.

    `software` is the version of this software. Raises StoreFailed.
    """
    case = Case(reader, first, lifting or Lifting())
    elsewhere = again or Again()
    findings: list[Finding] = []
    tests: dict[Cause, Callable[[], Finding]] = {
        Cause.ENVIRONMENT: lambda: environment(case, elsewhere),
        Cause.REORDERED: lambda: reordered(case),
        Cause.MISSING: lambda: missing(case),
        Cause.UPCAST: lambda: upcast(case),
        Cause.CONFIGURATION: lambda: configuration(case),
        Cause.CODE: lambda: code(case, software, lifted=_was_lifted(findings)),
    }
    try:
        for cause, test in tests.items():
            proved = any(finding.weight is Weight.PROVED for finding in findings)
            findings.append(_not_asked(cause) if proved else _tried(case, cause, test, tell))
    finally:
        if again is None:
            elsewhere.close()
    return chosen(findings)


def _was_lifted(findings: list[Finding]) -> bool:
    return any(one.cause is Cause.UPCAST and one.weight is not Weight.NOT_APPLICABLE for one in findings)


def _not_asked(cause: Cause) -> Finding:
    return Finding(cause, Weight.NOT_APPLICABLE, "not looked into: there is proof of another cause")


def _tried(case: Case, cause: Cause, test: Callable[[], Finding], tell: Tell | None) -> Finding:
    if tell is not None:
        tell(cause.value)
    case.budget.give(case.seq)
    try:
        return test()
    except Spent:
        return Finding(cause, Weight.NOTHING, "the flight is too long to look into it", stopped=True)
