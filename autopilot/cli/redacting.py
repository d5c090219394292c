"""What `autopilot export redacted` does: chooses records, and writes the flight's folder without their bodies.

Only files that are known to say nothing of a record are carried over: the papers of a proof, the verdict, the head.
Whatever else lies in the folder stays behind and is named; the log's key and the secret always do.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from autopilot.cli.redactions import FILE, redactions_of
from autopilot.node.sealing import CERTIFICATE_FILE, KEY_FILE
from autopilot.trust.identity import ROOT_FILE, TOKEN_FILE
from autopilot.trust.keys import write_file
from autopilot.trust.replayed import VERDICT_FILE
from events import Kind
from events.records import Stored
from events.store import Reader
from events.store.flights import DATABASE
from events.store.head import NAME as HEAD_FILE
from events.store.head import HeadFile
from events.store.redacted import write_redacted
from events.store.reserve import NAME as RESERVE_FILE
from projections.words import ranges

if TYPE_CHECKING:  # it needs numpy, which the other commands do not wait for
    from events.store.recovery import Finding

FORMAT = "autopilot-redaction/1"
_PAPERS = (CERTIFICATE_FILE, TOKEN_FILE, ROOT_FILE, VERDICT_FILE)
_OWN = {DATABASE, f"{DATABASE}-wal", f"{DATABASE}-shm", HEAD_FILE, RESERVE_FILE, KEY_FILE, FILE, *_PAPERS}
_LOOKS = 4  # a log that is recorded in at this moment may look torn once
_NS_PER_S = 1_000_000_000


class NotToRedact(ValueError):
    """The flight, or what was chosen of it, is nothing that a copy can be made of; the text says why."""


@dataclass(frozen=True, slots=True)
class Choice:
    """Which records: named by number or by kind, within a stretch of the flight."""

    seqs: frozenset[int] = frozenset()
    kinds: tuple[Kind, ...] = ()
    after_s: float = 0.0
    before_s: float = float("inf")

    def chosen(self, log: Iterable[Stored]) -> set[int]:
        """Return the seqs; with neither number nor kind it is the whole stretch but the manifest.

        Raises NotToRedact where it names the manifest, a record that is not there, or nothing.
        """
        numbers, whole = {kind.number for kind in self.kinds}, not self.seqs and not self.kinds
        last, found = -1, set[int]()
        for stored in log:
            last = stored.seq
            named = stored.seq in self.seqs or stored.kind_number in numbers or (whole and stored.seq > 0)
            if named and self.after_s * _NS_PER_S <= stored.at.flight_ns < self.before_s * _NS_PER_S:
                found.add(stored.seq)
        if max(self.seqs, default=-1) > last:
            raise NotToRedact(f"there is no record {max(self.seqs)}: the last one is {last}")
        if 0 in found:
            raise NotToRedact("record 0 is the manifest: without it nothing of the flight can be judged")
        if not found:
            raise NotToRedact("no record of the flight is chosen by this")
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Statement:
    """Who made the copy, when, why: what they say, which nothing proves."""

    by: str
    at: str
    because: str
    software: str


def check_sound(folder: Path) -> Finding:
    """Return what an examination of the flight finds. Raises NotToRedact for a damaged log: a copy would hide it."""
    from events.store.recovery import Action, examine

    taken = (Action.GO_ON, Action.GO_ON_AND_SAY, Action.CUT_AND_SAY)
    for _ in range(_LOOKS):
        finding = examine(folder)
        if finding.action in taken:
            return finding
    raise NotToRedact(f"the log is damaged, and a copy would hide that: {finding.words()}")


def write_copy(reader: Reader, finding: Finding, out: Path, remove: set[int], said: Statement) -> None:
    """Write the folder of the copy, as a whole or not at all. Raises StoreFailed, ChainBroken and OSError."""
    if out.exists():
        raise FileExistsError(17, "it is there already", str(out))
    unfinished = Path(tempfile.mkdtemp(dir=out.parent, prefix=f".{out.name}."))
    try:
        head = write_redacted(reader, unfinished / DATABASE, remove)
        if finding.head_file is not None:  # where the flight has none, its end has no second witness in the copy either
            head_file = HeadFile(unfinished)
            head_file.write(head)
            head_file.close()
        for name in _PAPERS:
            if (finding.folder / name).exists():
                write_file(unfinished / name, (finding.folder / name).read_bytes())
        now = {"seq": head.seq, "leaf": head.leaf.hex()}
        write_file(unfinished / FILE, _redaction(finding, now, remove, said).encode())
        unfinished.rename(out)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


def _redaction(finding: Finding, head: dict[str, Any], remove: set[int], said: Statement) -> str:
    one = {"by": said.by, "at": said.at, "because": said.because, "software": said.software, "removed": ranges(remove)}
    whole = {
        "format": FORMAT,
        "flight_id": finding.flight_id.hex(),
        "head": head,
        "redactions": [*redactions_of(finding.folder), one],
    }
    return json.dumps(whole, sort_keys=True, indent=1, ensure_ascii=False) + "\n"


def left_behind(folder: Path) -> list[str]:
    """Return what lies in a flight's folder and is not carried over, but for the log's own files."""
    return sorted(path.name for path in folder.iterdir() if path.name not in _OWN)
