"""Whether it is the environment.

The same step from the same state must come out the same, here and in another process.
"""

from __future__ import annotations

import platform

from replay.blame.again import Again, ChildFailed, Decisions, said
from replay.blame.case import Case, copied
from replay.blame.findings import Cause, Finding, Weight
from statecharts import step

REPEATS = 3
RECORDS_MAX = 100_000  # records that are handed to another process


def environment(case: Case, again: Again) -> Finding:
    """Decide the step again, here and under other hash seeds, and compare the answers among themselves."""
    state = case.at()
    here = [said(step(copied(state), case.group.observation).records[1:]) for _ in range(REPEATS)]
    if len(dict.fromkeys(here)) > 1:
        words = f"decided {REPEATS} times from the same state in this process, the step came out in different ways"
        return Finding(Cause.ENVIRONMENT, Weight.PROVED, words, REPEATS)
    if case.seq > RECORDS_MAX:
        return _interpreter(case, f"decided {REPEATS} times here alike; too long a log for another process", REPEATS)
    return _elsewhere(case, again, here[0])


def _elsewhere(case: Case, again: Again, here: Decisions) -> Finding:
    steps = [(group.observation, *group.decisions) for group in case.prefix(case.seq)]
    steps.append((case.group.observation,))
    recorded = said(case.group.decisions)
    for tried, seed in enumerate(again.seeds, start=1):
        try:
            there = again.decide(seed, steps)
        except ChildFailed as error:
            return _interpreter(case, str(error), REPEATS + tried)
        if there != here:
            as_then = ": as it was recorded" if there == recorded else ""
            words = f"in a process with hash seed {seed} the step comes out otherwise than in this one{as_then}"
            return Finding(Cause.ENVIRONMENT, Weight.PROVED, words, REPEATS + tried)
    words = f"decided {REPEATS} times here and under {len(again.seeds)} other hash seeds: always alike"
    return _interpreter(case, words, REPEATS + len(again.seeds))


def _interpreter(case: Case, words: str, tried: int) -> Finding:
    """Say where the recording interpreter or machine was another one: it can't be asked again."""
    others = [
        f"{name} {recorded}, here {ours}" for name, recorded, ours in _machines(case) if recorded and recorded != ours
    ]
    if not others:
        return Finding(Cause.ENVIRONMENT, Weight.NOTHING, words, tried)
    return Finding(Cause.ENVIRONMENT, Weight.SUSPECTED, f"recorded with {', '.join(others)}; {words}", tried)


def _machines(case: Case) -> tuple[tuple[str, str, str], ...]:
    opened = case.manifest
    return (
        ("Python", opened.python, platform.python_version()),
        ("platform", opened.platform, f"{platform.system()} {platform.machine()}"),
    )
