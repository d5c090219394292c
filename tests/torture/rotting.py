"""A flight's folder in memory, spoiled byte by byte, and what is said of it then. Nothing here is drawn by chance.

The flight is a real one: sealed, some of it in the database and the rest in a live WAL, or all of it in the database.
Every case is laid into a scratch folder and goes the way that a start goes: `examine`, and where that goes on, the
log is opened and read whole, and held against its seals.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp
from typing import NamedTuple

import apsw

from autopilot.ground.sealed import judge_flight
from events.records import Stored
from events.store import Flight, SqliteReader, SqliteStore
from events.store.flights import DATABASE
from events.store.head import NAME as HEAD
from events.store.recovery import Action, Finding, examine
from tests.torture.flying import Drone

WAL = f"{DATABASE}-wal"
MEMORY = Path("/dev/shm")
# What happens before the database is settled, and after that in the live WAL.
SETTLED_STEPS, LIVE_STEPS = 24, 4
Files = Mapping[str, bytes]


class Content(NamedTuple):
    """Everything that a log says to whoever reads it."""

    flight_id: bytes
    secret: bytes
    records: tuple[Stored, ...]
    checkpoints: tuple[tuple[int, str], ...]

    def begins(self, other: Content) -> bool:
        """Say whether `other` goes on from this, or is the same."""
        return (
            (self.flight_id, self.secret) == (other.flight_id, other.secret)
            and self.records == other.records[: len(self.records)]
            and self.checkpoints == other.checkpoints[: len(self.checkpoints)]
        )


@dataclass(frozen=True)
class Whole:
    """A flight that nothing is wrong with."""

    name: str
    files: Files
    content: Content
    heads: tuple[bytes, ...] = ()  # the head file after each commit, for a power cut leaves an older one
    ends: tuple[int, ...] = ()  # size of the WAL after each commit


class Said(NamedTuple):
    """What came of a case: the class that it is counted in, and why."""

    kind: str
    because: str


def scratch(name: str) -> Path:
    """Make an empty folder, in memory where the system has some; whoever asked removes it."""
    return Path(mkdtemp(prefix=f"{name}-", dir=MEMORY if MEMORY.is_dir() else None))


def recorded(work: Path, seed: int = 1) -> tuple[Whole, Whole]:
    """Return a sealed flight with a live WAL, and the same with everything in its database."""
    heads: list[bytes] = []
    ends: list[int] = []

    def committed() -> None:
        heads.append((work / drone.session.flight.folder.name / HEAD).read_bytes())
        ends.append((work / drone.session.flight.folder.name / WAL).stat().st_size)

    drone = Drone(work, seed)
    drone.fly(SETTLED_STEPS)
    store = drone.session.store
    assert isinstance(store, SqliteStore)
    store._connection.wal_checkpoint(mode=apsw.SQLITE_CHECKPOINT_TRUNCATE)
    committed()
    drone.committed = committed
    drone.fly(LIVE_STEPS)
    folder = drone.session.flight.folder
    live = Whole(folder.name, _files(folder), _read(folder), tuple(heads), tuple(ends))
    store.close()
    return live, Whole(folder.name, _files(folder), _read(folder))


def _files(folder: Path) -> Files:
    kept = (path for path in folder.iterdir() if path.name != "reserve" and not path.name.endswith("-shm"))
    return {path.name: path.read_bytes() for path in kept}


def _read(folder: Path) -> Content:
    reader = SqliteReader(folder / DATABASE)
    try:
        return Content(reader.flight_id, reader.secret, tuple(reader.stored()), tuple(reader.checkpoints()))
    finally:
        reader.close()


class Bench:
    """Lays one case after the other into a scratch folder; only what differs is written."""

    def __init__(self, folder: Path, whole: Whole) -> None:
        self.folder, self.whole = folder / whole.name, whole
        self.folder.mkdir()
        self._there: dict[str, bytes] = {}

    def said(self, change: Mapping[str, bytes | None], *, expected: bool = False) -> Said:
        """Return what is said of the flight with other content in some files (None: without that file).

        `expected`: a power cut may leave it so, and what is left may be shorter than the whole, without an alarm.
        """
        if all(content == self.whole.files.get(name) for name, content in change.items()):
            return Said("unchanged", "the case changes nothing")
        self._lay(change)
        try:
            return self._judged(expected)
        except Exception as error:  # noqa: BLE001 - whatever lies on a disk must be answered, never raised about
            return Said("RAISED", f"{type(error).__name__}: {error}")

    def _judged(self, expected: bool) -> Said:
        finding = examine(self.folder)
        facts = ", ".join(f"{name} {fact.value}" for name, fact in finding.facts._asdict().items())
        if finding.action in (Action.KEEP_AND_BEGIN, Action.REFUSE):
            return Said("ALARM" if expected else "found", facts)
        content = _read(self.folder)
        if content == self.whole.content and finding.action is Action.GO_ON:
            return Said("harmless", "one slot of the head file is told of" if _torn(finding) else "the same content")
        if not content.begins(self.whole.content):
            return self._held_against_seals(facts)
        if finding.action is Action.GO_ON and not expected:
            return Said("SILENT", facts)
        if expected and not finding.sound:
            return Said("ALARM", facts)
        return Said(finding.action.name.lower(), facts)

    def _lay(self, change: Mapping[str, bytes | None]) -> None:
        (self.folder / f"{DATABASE}-shm").unlink(missing_ok=True)
        for name in {*self.whole.files, *change}:
            wanted = change.get(name, self.whole.files.get(name))
            if wanted is None:
                (self.folder / name).unlink(missing_ok=True)
                self._there.pop(name, None)
            elif self._there.get(name) is not wanted or not (self.folder / name).exists():
                (self.folder / name).write_bytes(wanted)
                self._there[name] = wanted

    def _held_against_seals(self, facts: str) -> Said:
        wrong = [one for one in judge_flight(Flight(1, self.folder)).found if one.wrong]
        return Said("found", f"its seals: {_short(wrong[0].because)}") if wrong else Said("SILENT", f"changed: {facts}")


def _torn(finding: Finding) -> bool:
    return finding.head_file is not None and finding.head_file.torn


def _short(because: str) -> str:
    """Return a reason without the numbers of one case."""
    return re.sub(r"\d+", "N", because.partition(":")[0])
