"""What `autopilot replay check` does: the examination that each start makes, for a person. It changes nothing."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

from events.store import StoreMissing
from events.store.head import HeadSeen
from events.store.recovery import Action, Finding, examine

# A log that is recorded in at this moment may look torn once; two looks in a row tell.
_LOOKS = 4


def check(folder: Path, *, as_json: bool) -> int:
    """Print what is found in a flight's folder; return the exit code (sysexits: 65, 66 and 74)."""
    try:
        finding = _look(folder)
    except StoreMissing as error:
        print(f"autopilot: {error}; name the folder of a flight, like flights/000001-1a2b3c4d", file=sys.stderr)
        return os.EX_NOINPUT
    print(json.dumps(plain(finding), sort_keys=True) if as_json else words(finding))
    if finding.action is Action.REFUSE:
        return os.EX_IOERR
    return os.EX_OK if finding.sound else os.EX_DATAERR


def _look(folder: Path) -> Finding:
    finding = examine(folder)
    for _ in range(_LOOKS):
        if finding.action is Action.GO_ON or finding == (again := examine(folder)):
            break
        finding = again
    return finding


def words(finding: Finding) -> str:
    """Say what was found, in lines."""
    verdict = "sound" if finding.sound else "wrong"
    said = f"{verdict}: {finding.words()}\nhead: {_head(finding.head_file)}"
    return said if finding.action is Action.GO_ON else f"{said}\na start would: {finding.action.value}"


def _head(seen: HeadSeen | None) -> str:
    if seen is None:
        return "unknown"
    return f"record {seen.head.seq}, leaf {seen.head.leaf.hex()}, commit {seen.generation}"


def plain(finding: Finding) -> dict[str, Any]:
    """Return what was found as a JSON-able structure."""
    facts, seen = finding.facts, finding.head_file
    return {
        "sound": finding.sound,
        "action": finding.action.name.lower(),
        "words": finding.words(),
        "flight_id": finding.flight_id.hex(),
        "records": finding.end.seq + 1,
        "last_seq": finding.end.seq,
        "last_leaf": finding.end.leaf.hex(),
        "facts": {name: fact.value for name, fact in facts._asdict().items()},
        "wal": {
            "commits": finding.wal.commits,
            "frames": finding.wal.frames,
            "bad_frame": finding.wal.bad_frame,
            "later_commit": finding.wal.later_commit,
        },
        "head": None if seen is None else {"seq": seen.head.seq, "leaf": seen.head.leaf.hex(), "torn": seen.torn},
    }
