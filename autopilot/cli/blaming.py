"""Who is to blame for a divergence, told to a person: what was found, and in short what was tried in vain."""

from __future__ import annotations

import sys
import textwrap
from importlib.metadata import version

from events.store import Reader
from replay.blame import blame
from replay.blame.findings import Blame, Finding
from replay.verdict import Outcome, Verdict

WIDTH = 110


def blamed(reader: Reader, verdict: Verdict) -> Blame | None:
    """Look into a divergence; None where there is none. Raises StoreFailed."""
    if verdict.outcome is not Outcome.DIVERGES or verdict.first is None:
        return None
    try:
        return blame(reader, verdict.first, software=version("autopilot"), tell=_looking_into)
    finally:
        _looking_into("")


def tell_blame(found: Blame) -> None:
    """Tell on stderr what is to blame, and why nothing else is."""
    first, *others = found.findings
    print(f"to blame: {first.cause.value}, which {first.result}{_stopped(first)}", file=sys.stderr)
    print(_wrapped(first.words), file=sys.stderr)
    print("and the others:", file=sys.stderr)
    for other in others:
        print(_wrapped(f"{other.cause.value} {other.result}: {other.words}{_stopped(other)}"), file=sys.stderr)


def _stopped(finding: Finding) -> str:
    return f" (stopped looking after {finding.tried} runs)" if finding.stopped else ""


def _wrapped(text: str) -> str:
    return textwrap.fill(text, WIDTH, initial_indent="  ", subsequent_indent="    ")


def _looking_into(what: str) -> None:
    """Show what is being looked into, to those who look; nothing is left of it afterwards."""
    if sys.stderr.isatty():
        print(f"\r\x1b[Klooking into: {what}" if what else "\r\x1b[K", end="", file=sys.stderr, flush=True)
