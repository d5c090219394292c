"""What `autopilot replay check` does: the examination that each start makes, and what the seals say. It only reads."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from autopilot.ground.examiner import anchor_of, judge
from autopilot.ground.kept import Kept
from autopilot.ground.sealed import Anchor, Found, judge_flight, look
from autopilot.ground.witness import Witness
from autopilot.trust.documents import DocumentError, verify_trust_root
from autopilot.trust.identity import ROOT_FILE
from autopilot.trust.notes import NoteInvalid
from events.store import Flight, StoreMissing, flights_in
from events.store.flights import DATABASE
from events.store.head import HeadSeen
from events.store.recovery import Action, Finding


def check(folder: Path, *, as_json: bool, witness: Path | None = None) -> int:
    """Print what is found in the folder of a flight, or of all flights; return the exit code (sysexits)."""
    if not (folder / DATABASE).exists() and flights_in(folder):
        return _check_all(folder, as_json=as_json, witness=witness)
    if witness is not None:
        return _told("--witness needs the folder of all flights: each is held against the one after it", os.EX_USAGE)
    try:
        finding = look(folder)
    except StoreMissing as error:
        return _told(f"{error}; name the folder of a flight, like flights/000001-1a2b3c4d", os.EX_NOINPUT)
    found = judge_flight(Flight(0, folder), None, finding).found[not finding.sound :]
    sound = finding.sound and not any(one.wrong for one in found)
    told = plain(finding) | {"sound": sound, "found": [one._asdict() for one in found]}
    print(json.dumps(told, sort_keys=True) if as_json else words(finding, found, sound=sound))
    if finding.action is Action.REFUSE:
        return os.EX_IOERR
    return os.EX_OK if sound else os.EX_DATAERR


def _check_all(root: Path, *, as_json: bool, witness: Path | None) -> int:
    """Judge all flights of a node, against what the witness in an operator's folder has kept of it."""
    try:
        anchor, kept = (None, None) if witness is None else _witnessed(root, witness)
    except (DocumentError, NoteInvalid) as error:
        return _told(str(error), os.EX_DATAERR)
    except OSError as error:
        return _told(str(error), os.EX_NOINPUT)
    found, count = judge(root, anchor, kept), len(flights_in(root))
    sound = not any(one.wrong for one in found)
    said = None if kept is None else f"flight {kept.log_key.flight_number}, {kept.checkpoint.size} records"
    if as_json:
        plain = {"sound": sound, "flights": count, "witnessed": said, "found": [one._asdict() for one in found]}
        print(json.dumps(plain, sort_keys=True))
    else:
        print(f"{'sound' if sound else 'wrong'}: {count} flights, witnessed up to {said or 'nothing'}")
        for one in found:
            print(f"flight {one.flight}, {one.words()}")
    return os.EX_OK if sound else os.EX_DATAERR


def _witnessed(root: Path, witness: Path) -> tuple[Anchor, Kept | None]:
    trust = verify_trust_root((witness / ROOT_FILE).read_bytes())
    anchor = anchor_of(root, trust)
    deployment_id, node, public_key = anchor
    chain = Witness(witness, deployment_id).newest(node, public_key)
    return anchor, None if chain is None else chain.newest


def _told(text: str, code: int) -> int:
    print(f"autopilot: {text}", file=sys.stderr)
    return code


def words(finding: Finding, found: Sequence[Found] = (), *, sound: bool | None = None) -> str:
    """Say what was found, in lines; `sound` where more was judged than the finding."""
    sound = finding.sound if sound is None else sound
    verdict = "sound" if sound else "wrong"
    said = f"{verdict}: {finding.words()}\nhead: {_head(finding.head_file)}"
    said = "\n".join([said, *(one.words() for one in found)])
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
