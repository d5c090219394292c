"""What to do with a log that is found at a start: facts, and a table that leads each combination to one action.

`examine` looks and changes nothing: the WAL and the head file are read before SQLite opens the database, and then it
is opened to read only. What the action means is done by the node.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import NamedTuple

import apsw
from google.protobuf.message import DecodeError

from events.chain import FIRST_LEAF_BEFORE, Chain, ChainBroken
from events.records import Record, Stored
from events.schema.flight_pb2 import FlightOpened
from events.store.flights import DATABASE
from events.store.head import HeadSeen, read_head_file
from events.store.protocol import Head, StoreFailed, StoreMissing
from events.store.sqlite import SqliteReader
from events.store.walscan import Wal, WalScan, scan_wal

_MANIFEST = 1  # kind number of `flight_opened`
_NOTHING = Head(-1, FIRST_LEAF_BEFORE)
# The last record that somebody vouches for, with all before it; seq -1 where nobody does. Called once.
Vouched = Callable[[SqliteReader], Head]
_NOT_THE_LOGS_FAULT = (
    *(apsw.IOError, apsw.CantOpenError, apsw.PermissionsError, apsw.ReadOnlyError),
    *(apsw.BusyError, apsw.LockedError, apsw.NoMemError, apsw.FullError),
)


class Database(Enum):
    """What SQLite says of the file."""

    READABLE = "readable"
    MALFORMED = "malformed"  # it is no database, or not the log of a flight, or its pages do not fit
    FAILING = "failing"  # the disk, the system or another process does not let it be read: nothing is known of it


class Records(Enum):
    """What the records say, as far as they can be read."""

    WHOLE = "whole"
    GAP = "gap"  # a seq is missing
    BROKEN = "broken"  # a leaf is not the hash of its record


class HeadFile(Enum):
    """How the head file stands to the log."""

    ABSENT = "absent"
    UNREADABLE = "unreadable"  # no slot of it is whole
    OLDER = "older"  # it names a record of this log that is not the last
    EQUAL = "equal"
    NEWER = "newer"  # it names a record that was durable and that the log does not hold
    FORKED = "forked"  # it names another leaf for a seq that the log holds
    SIGNED_MORE = "signed more"  # it knows of a checkpoint that the log does not hold


class Manifest(Enum):
    """What the log begins with."""

    OWN = "own"  # the manifest of this flight
    NONE = "none"  # nothing: the log is empty
    OTHER = "other"  # anything else


class Action(Enum):
    """What to do."""

    GO_ON = "go on"
    GO_ON_AND_SAY = "go on, and say that the end of the log has no second witness"
    CUT_AND_SAY = "cut the torn tail, and say so"
    PASS_OVER = "pass it over: a start was cut short before it recorded anything"
    KEEP_AND_BEGIN = "keep it as it was found, and begin another flight that names its head"
    REFUSE = "record nothing before it can be read"


class Facts(NamedTuple):
    """What was found."""

    database: Database
    wal: Wal
    records: Records
    head_file: HeadFile
    manifest: Manifest


class Row(NamedTuple):
    """One row: an action and the facts that lead to it."""

    action: Action
    database: tuple[Database, ...] = (Database.READABLE,)
    wal: tuple[Wal, ...] = tuple(Wal)
    records: tuple[Records, ...] = (Records.WHOLE,)
    head_file: tuple[HeadFile, ...] = tuple(HeadFile)
    manifest: tuple[Manifest, ...] = tuple(Manifest)

    def holds(self, facts: Facts) -> bool:
        """Say whether this is the row of these facts."""
        return all(fact in allowed for fact, allowed in zip(facts, self[1:], strict=True))


_WHOLE_WAL = (Wal.ABSENT, Wal.CLEAN)
_UNDAMAGED_WAL = (*_WHOLE_WAL, Wal.TORN)
_BEHIND = (HeadFile.OLDER, HeadFile.EQUAL)
_SILENT = (HeadFile.ABSENT, HeadFile.UNREADABLE)
_LOST = (HeadFile.NEWER, HeadFile.FORKED, HeadFile.SIGNED_MORE)
_OWN = (Manifest.OWN,)

# Every combination of facts is in exactly one row; a test asks them all.
TABLE: tuple[Row, ...] = (
    Row(Action.REFUSE, (Database.FAILING,), records=tuple(Records)),
    Row(Action.KEEP_AND_BEGIN, (Database.MALFORMED,), records=tuple(Records)),
    Row(Action.KEEP_AND_BEGIN, records=(Records.GAP, Records.BROKEN)),
    Row(Action.KEEP_AND_BEGIN, wal=(Wal.DAMAGED,)),
    Row(Action.KEEP_AND_BEGIN, wal=(*_UNDAMAGED_WAL, Wal.HEADER_DAMAGED), head_file=_LOST),
    Row(
        Action.KEEP_AND_BEGIN,
        wal=(*_UNDAMAGED_WAL, Wal.HEADER_DAMAGED),
        head_file=(*_SILENT, *_BEHIND),
        manifest=(Manifest.OTHER,),
    ),
    # SQLite drops every frame behind a header that does not check; only an equal head says that none was needed.
    Row(
        Action.KEEP_AND_BEGIN,
        wal=(Wal.HEADER_DAMAGED,),
        head_file=(*_SILENT, HeadFile.OLDER),
        manifest=(Manifest.OWN, Manifest.NONE),
    ),
    Row(Action.PASS_OVER, wal=(Wal.HEADER_DAMAGED,), head_file=(HeadFile.EQUAL,), manifest=(Manifest.NONE,)),
    Row(Action.PASS_OVER, wal=_UNDAMAGED_WAL, head_file=(*_SILENT, *_BEHIND), manifest=(Manifest.NONE,)),
    Row(Action.CUT_AND_SAY, wal=(Wal.HEADER_DAMAGED,), head_file=(HeadFile.EQUAL,), manifest=_OWN),
    Row(Action.CUT_AND_SAY, wal=(Wal.TORN,), head_file=(*_SILENT, *_BEHIND), manifest=_OWN),
    Row(Action.GO_ON_AND_SAY, wal=_WHOLE_WAL, head_file=_SILENT, manifest=_OWN),
    Row(Action.GO_ON, wal=_WHOLE_WAL, head_file=_BEHIND, manifest=_OWN),
)


def action_for(facts: Facts) -> Action:
    """Return what the table says."""
    return next(row.action for row in TABLE if row.holds(facts))


@dataclass(frozen=True, slots=True)
class Finding:
    """What an examination found, and what is to be done."""

    folder: Path
    facts: Facts
    action: Action
    flight_id: bytes  # empty where it can't be read
    end: Head  # of what can be read and holds, from the first record on
    wal: WalScan
    head_file: HeadSeen | None
    detail: str  # what SQLite or the chain said; "" where nothing is wrong with either

    @property
    def sound(self) -> bool:
        """Nothing is wrong: at most what a power cut or a start that was cut short leaves."""
        if self.action is Action.CUT_AND_SAY:
            return self.facts.wal is Wal.TORN and self.facts.head_file in _BEHIND
        return self.action in (Action.GO_ON, Action.PASS_OVER)

    def words(self) -> str:
        """Say what was found, in sentences."""
        end = f"records 0 to {self.end.seq} hold" if self.end.seq >= 0 else "no record can be read"
        said = [f"{end}, last leaf {self.end.leaf.hex()[:16]}", *self._of_wal(), *self._of_head_file()]
        if self.facts.manifest is Manifest.OTHER:
            said.append("it does not begin with the manifest of this flight")
        return "; ".join([*said, self.detail] if self.detail else said)

    def _of_wal(self) -> Iterator[str]:
        wal = self.wal
        match wal.verdict:
            case Wal.TORN:
                yield f"the WAL is torn after commit {wal.commits}, as a power cut leaves it"
            case Wal.DAMAGED:
                yield (
                    f"the WAL is damaged at frame {wal.bad_frame}, after commit {wal.commits}: "
                    f"a later commit is at frame {wal.later_commit}"
                )
            case Wal.HEADER_DAMAGED:
                yield "the header of the WAL is damaged, and something follows it"

    def _of_head_file(self) -> Iterator[str]:
        match self.facts.head_file:
            case HeadFile.ABSENT:
                yield "there is no head file: whether records are missing at the end can't be known"
            case HeadFile.UNREADABLE:
                yield "the head file is unreadable: whether records are missing at the end can't be known"
            case HeadFile.NEWER if self.head_file:
                yield f"the head file names record {self.head_file.head.seq}: what follows {self.end.seq} is lost"
            case HeadFile.FORKED if self.head_file:
                yield f"the head file names another leaf for record {self.head_file.head.seq}: the log was rewritten"
            case HeadFile.SIGNED_MORE if self.head_file:
                yield f"{self.head_file.signed} records were signed, and their checkpoint is lost"
            case _ if self.head_file and self.head_file.torn:
                yield "one slot of the head file is torn"


def examine(folder: Path, vouched: Vouched | None = None) -> Finding:
    """Return what is found in a flight's folder and what to do with it. Raises StoreMissing where there is no log.

    `vouched` is asked for the record up to which somebody vouches for the log: it is read from there on.
    """
    database = folder / DATABASE
    if not database.exists():
        raise StoreMissing(f"there is no log at {database}")
    try:
        wal = scan_wal(folder / f"{DATABASE}-wal")
        walk = _Walk(_head_file(folder), vouched or _nobody)
        walk.whole(database)
    except OSError as error:
        facts = Facts(Database.FAILING, Wal.ABSENT, Records.WHOLE, HeadFile.ABSENT, Manifest.NONE)
        return Finding(folder, facts, action_for(facts), b"", _NOTHING, WalScan(Wal.ABSENT), None, str(error))
    facts = Facts(walk.database, wal.verdict, walk.records, walk.head_stands(), walk.manifest)
    seen = walk.head_file if isinstance(walk.head_file, HeadSeen) else None
    return Finding(folder, facts, action_for(facts), walk.flight_id, walk.end, wal, seen, walk.detail)


def _nobody(_reader: SqliteReader) -> Head:
    return _NOTHING


def _head_file(folder: Path) -> HeadSeen | HeadFile:
    try:
        return read_head_file(folder) or HeadFile.UNREADABLE
    except FileNotFoundError:
        return HeadFile.ABSENT


class _Walk:
    """One pass over the records, up to the first that does not hold."""

    def __init__(self, head_file: HeadSeen | HeadFile, vouched: Vouched) -> None:
        self.head_file = head_file
        self._vouched = vouched
        self.database = Database.READABLE
        self.records = Records.WHOLE
        self.manifest = Manifest.NONE
        self.flight_id = b""
        self.end = _NOTHING
        self.detail = ""
        self._signed = 0
        self._leaf_at_head: bytes | None = FIRST_LEAF_BEFORE if self._head_seq() == -1 else None

    def whole(self, database: Path) -> None:
        """Open the log and read all of it. Raises StoreFailed where that says nothing about the log."""
        try:
            reader = SqliteReader(database)
            try:
                self.flight_id = reader.flight_id
                self._read(reader)
                if wrong := reader.misfit():
                    self.database, self.detail = Database.MALFORMED, wrong
                else:
                    self._signed = max((size for size, _ in reader.checkpoints()), default=0)
            finally:
                reader.close()
        except StoreFailed as error:
            self._fails(error)

    def _fails(self, error: StoreFailed) -> None:
        cause = error.__cause__
        if cause is None or isinstance(cause, _NOT_THE_LOGS_FAULT):
            raise error
        self.database, self.detail = Database.MALFORMED, str(error)

    def _read(self, reader: SqliteReader) -> None:
        after = self._vouched(reader)
        if after.seq >= 0:
            self._check(reader, Chain(reader.flight_id, reader.secret), 0, 1)
            if self.records is Records.WHOLE and self.end.seq < 0:
                self.records, self.detail = Records.GAP, "record 0 is missing"
        if self.records is Records.WHOLE:
            self._pass_over(reader, after)
            self._check(reader, Chain(reader.flight_id, reader.secret, after.leaf), after.seq + 1, None)

    def _pass_over(self, reader: SqliteReader, after: Head) -> None:
        """Take the records up to one for what they are; the head file may name one of them."""
        self.end, head_seq = after, self._head_seq()
        if head_seq is not None and 0 <= head_seq <= after.seq:
            self._leaf_at_head = next((stored.leaf for stored in reader.stored(head_seq, head_seq + 1)), None)

    def _check(self, reader: SqliteReader, chain: Chain, start: int, stop: int | None) -> None:
        for expected, stored in enumerate(reader.stored(start, stop), start):
            if stored.seq != expected:
                self.records, self.detail = Records.GAP, f"record {expected} is missing"
                return
            try:
                chain.check(stored)
            except ChainBroken as error:
                self.records, self.detail = Records.BROKEN, str(error)
                return
            if expected == 0:
                self.manifest = _manifest(stored, reader.flight_id)
            self.end = Head(expected, stored.leaf)
            if expected == self._head_seq():
                self._leaf_at_head = stored.leaf

    def _head_seq(self) -> int | None:
        return self.head_file.head.seq if isinstance(self.head_file, HeadSeen) else None

    def head_stands(self) -> HeadFile:
        """Return how the head file stands to what was read."""
        if isinstance(self.head_file, HeadFile):
            return self.head_file
        if self.head_file.head.seq > self.end.seq:
            return HeadFile.NEWER
        if self.head_file.head.leaf != self._leaf_at_head:
            return HeadFile.FORKED
        if self.head_file.signed > self._signed:
            return HeadFile.SIGNED_MORE
        return HeadFile.EQUAL if self.head_file.head.seq == self.end.seq else HeadFile.OLDER


class KeptLog:
    """The part of a damaged log that holds, for the flight that comes after it. It takes nothing."""

    def __init__(self, finding: Finding) -> None:
        """Open what an examination found, to read only. Raises StoreMissing and StoreFailed."""
        self._reader = SqliteReader(finding.folder / DATABASE)
        self.flight_id = self._reader.flight_id
        self.secret = self._reader.secret
        self.head = finding.end
        self.reserve_spent = False

    def stored(self, start: int = 0, stop: int | None = None) -> Iterator[Stored]:
        """Yield the rows with start <= seq < stop that hold."""
        end = self.head.seq + 1
        return self._reader.stored(start, end if stop is None else min(stop, end))

    def checkpoints(self) -> list[tuple[int, str]]:
        """Return size and signed note of every checkpoint, oldest first."""
        return self._reader.checkpoints()

    def append(self, records: Sequence[Record]) -> Head:
        """Raise StoreFailed: a damaged log is never written to."""
        raise StoreFailed(f"a damaged log takes no record ({len(records)} were offered)")

    def add_checkpoint(self, size: int, note: str) -> None:
        """Raise StoreFailed: a damaged log is never written to."""
        raise StoreFailed(f"a damaged log takes no checkpoint (of size {size}: {note[:40]!r})")

    def idle(self) -> None:
        """Nothing waits."""

    def close(self) -> None:
        """Close the connection."""
        self._reader.close()


def _manifest(first: Stored, flight_id: bytes) -> Manifest:
    try:
        own = first.kind_number == _MANIFEST and FlightOpened.FromString(first.body).flight_id == flight_id
    except DecodeError:
        own = False
    return Manifest.OWN if own else Manifest.OTHER
