"""What somebody who holds the disk can do to a log: read it, change it, chain it, sign it anew with the keys he has.

The secret of the chain lies in the file, so whoever can write can chain. Log keys can be read while their flight is
open; the device's key can't. Nothing here judges anything.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise
from pathlib import Path
from typing import Any

import apsw

from autopilot.node.sealing import CERTIFICATE_FILE
from autopilot.trust.keys import SignKey
from autopilot.trust.notes import StateMark, read_checkpoint, read_log_key, sign_note
from events import NO_CAUSE, Chain, Moment, encode, kind_of, make_record, read_record
from events.kinds import KINDS, Role
from events.records import Record, Stored
from events.schema.flight_pb2 import CLOSE_DISARMED, FlightClosed, FlightOpened, InputsDropped, LogKeyCertified
from events.store import Flight, Head, SqliteReader, flights_in
from events.store.flights import DATABASE
from events.store.head import HeadFile
from events.tree import Tree
from statecharts import State, restore, step, steps_of
from statecharts.codec import LAYOUT
from statecharts.digest import digest_of
from tests.autopilot.trust.world import people
from tests.flights import position

OBSERVATIONS = frozenset(kind.number for kind in KINDS if kind.role is Role.OBSERVATION)
CLOSED = kind_of(FlightClosed()).number
CERTIFIED = kind_of(LogKeyCertified()).number
SIGNER = "waypoint/coast-watch/wasp-01"


class Skill(Enum):
    """How far an attacker goes to hide a change, and with which key."""

    CRUDE = "the record alone"
    CHAINED = "leaves and head file made to fit"
    BARE = "and the checkpoints behind the change taken away"
    KEPT_SIGNATURES = "roots written anew under the old signatures"
    FRESH_KEY = "signed with a key of his own, and a certificate that the device did not sign"
    OTHER_KEY = "signed with the log key of another flight"
    LIVE_KEY = "signed with the flight's own log key, read while the flight was open"


@dataclass
class Log:
    """A flight's log, in hand."""

    flight: Flight
    flight_id: bytes
    secret: bytes
    rows: list[Stored]
    checkpoints: dict[int, str]

    @classmethod
    def read(cls, flight: Flight) -> Log:
        """Read all of it."""
        reader = SqliteReader(flight.database)
        try:
            notes = dict(reader.checkpoints())
            return cls(flight, reader.flight_id, reader.secret, list(reader.stored()), notes)
        finally:
            reader.close()

    @property
    def closed(self) -> bool:
        """Whether its end is recorded."""
        return any(row.kind_number == CLOSED for row in self.rows)

    def chain(self) -> None:
        """Make every leaf the hash of its record and the leaf before."""
        chain = Chain(self.flight_id, self.secret)
        self.rows = [row._replace(leaf=chain.extend(*row[:6])) for row in self.rows]

    def write(self, *, head: bool) -> None:
        """Put it back; with the head file to match, or not."""
        connection = apsw.Connection(str(self.flight.folder / DATABASE))
        connection.pragma("synchronous", 0)
        with connection:
            connection.execute("DELETE FROM record")
            rows = [(row.seq, row.cause, *row.at, *row[3:7]) for row in self.rows]
            connection.executemany("INSERT INTO record VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", rows)
            connection.execute("DELETE FROM checkpoint")
            connection.executemany("INSERT INTO checkpoint VALUES (?, ?)", list(self.checkpoints.items()))
        connection.close()
        if head:
            self.write_head()

    def write_head(self) -> None:
        """Let the head file name the end, in both slots."""
        file = HeadFile(self.flight.folder)
        last = Head(self.rows[-1].seq, self.rows[-1].leaf) if self.rows else Head(-1, bytes(32))
        for _ in range(2):
            file.write(last, max(self.checkpoints, default=0))
        file.close()


def sealed_anew(log: Log, skill: Skill, keys: dict[int, SignKey], first: int, before: Log | None = None) -> None:
    """Hide a change from record `first` on; `before` is the log as it was, `keys` the log keys by flight."""
    if skill is Skill.CRUDE:
        return
    if skill is Skill.FRESH_KEY:
        first = min(first, _certified_by_nobody(log))
    log.chain()
    count, sizes = len(log.rows), sorted(log.checkpoints)
    if skill is Skill.CHAINED:
        return
    if skill is Skill.BARE:
        log.checkpoints = {size: log.checkpoints[size] for size in sizes if size <= first}
        return
    if before is not None and len(before.rows) in log.checkpoints:
        sizes.append(count)  # what was signed to its end is so again
    tree, notes = Tree(row.leaf for row in log.rows), log.checkpoints
    log.checkpoints = {size: note for size, note in notes.items() if size <= first}
    for size in sorted({size for size in sizes if first < size <= count}):
        note = notes.get(size, notes[max(notes)])
        log.checkpoints[size] = _signed(log, skill, keys, note, size, tree.root(size))


def _signed(log: Log, skill: Skill, keys: dict[int, SignKey], note: str, size: int, root: bytes) -> str:
    text, _, signature = note.rpartition("\n\n")
    checkpoint = replace(read_checkpoint(f"{text}\n"), size=size, root=root, state=_state_after(log.rows[:size]))
    number = log.flight.number
    if skill is Skill.KEPT_SIGNATURES:
        return f"{checkpoint.text()}\n{signature}"
    if skill is Skill.FRESH_KEY:
        key = _own_key(number)
    else:
        others = [other for other in keys if other != number]
        key = keys[max(others) if skill is Skill.OTHER_KEY else number]
    return sign_note(checkpoint.text(), checkpoint.origin, key)


def _state_after(rows: Sequence[Stored]) -> StateMark | None:
    """Return what an honest checkpoint over these records would say of the state, where they can be followed."""
    state = State()
    try:
        for recorded in steps_of(map(read_record, rows)):
            restore(state, recorded)
    except Exception:  # noqa: BLE001 - a forged record may break any chart
        return None
    return StateMark(LAYOUT, digest_of(state))


def _own_key(number: int) -> SignKey:
    return SignKey.from_seed(bytes([number]) * 32)


def _certified_by_nobody(log: Log) -> int:
    """Put a certificate of a key of his own into the log and beside it, not signed by the node's device; say where."""
    seq = next((seq for seq, row in enumerate(log.rows) if row.kind_number == CERTIFIED), None)
    if seq is None:
        return 0  # it was in what he has taken away
    said = read_log_key(_text_of((log.flight.folder / CERTIFICATE_FILE).read_text("utf-8")))
    forged = replace(said, public_key=_own_key(log.flight.number).public)
    note = sign_note(forged.text(), SIGNER, people().hornet.sign_key)
    log.rows[seq] = log.rows[seq]._replace(body=encode(LogKeyCertified(certificate=note)))
    (log.flight.folder / CERTIFICATE_FILE).write_text(note, encoding="utf-8")
    return seq


def _text_of(note: str) -> str:
    return note.rpartition("\n\n")[0] + "\n"


def linked_anew(logs: Sequence[Log]) -> Iterable[Log]:
    """Let every manifest name the end of the log before it; yield those that had to be changed."""
    for before, after in pairwise(logs):
        manifest = FlightOpened.FromString(after.rows[0].body)
        manifest.previous_seq, manifest.previous_leaf = before.rows[-1].seq, before.rows[-1].leaf
        after.rows[0] = after.rows[0]._replace(body=encode(manifest))
        after.chain()
        yield after


def continued(rows: Sequence[Stored], length: int, east_mm: int, *, close: bool) -> list[Stored]:
    """Return rows that go on as the charts would have it, had the world been another one."""
    state = State()
    for recorded in steps_of(map(read_record, rows)):
        restore(state, recorded)
    made, at = list(rows), rows[-1].at
    while len(made) < length:
        at = _later(at)
        say = (position(east_mm, len(made)), InputsDropped(input_class="frame", count=1 + len(made) % 7))
        made += _step(state, at, say[len(made) % 2])
    if close:
        made += _step(state, _later(at), FlightClosed(reason=CLOSE_DISARMED))
    return made


def _later(at: Moment) -> Moment:
    by = 50_000_000
    return at._replace(flight_ns=at.flight_ns + by, mono_ns=at.mono_ns + by, wall_ns=at.wall_ns + by)


def _step(state: State, at: Moment, message: Any) -> list[Stored]:
    observation = make_record(state.next_seq.value, NO_CAUSE, at, message)
    return [_bare(record) for record in step(state, observation).records]


def _bare(record: Record) -> Stored:
    fields = (record.seq, record.cause, record.at, record.kind.number, record.version, record.body)
    return Stored(*fields, leaf=bytes(32))


def logs_in(root: Path) -> list[Log]:
    """Return every log below a folder that can be read, oldest first."""
    return [Log.read(flight) for flight in flights_in(root)]
