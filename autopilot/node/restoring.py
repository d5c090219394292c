"""Snapshots of an open flight, and starting from one: the state as it was, and then only the tail of the log.

At a checkpoint, once enough was recorded, what has changed since the snapshot before is appended to a file beside the
log (`events.store.snapshots`). At a start the newest snapshot is taken that is of this software, of this log, and gives
the state that a checkpoint of the same length was signed with; an older one where that fails; and where none is left
the log is read from its beginning, as if there had never been any. What this start does not read again is read by the
self-replay when the flight is over. All calls are on the node's thread.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from autopilot.node.arming import Arming
from autopilot.node.sealing import Known, Sealed, Sealer
from events.chain import FIRST_LEAF_BEFORE
from events.records import Stored, read_record
from events.schema.flight_pb2 import FlightOpened, NodeStarted
from events.store import Flight, Head, Reader
from events.store.snapshots import Snapshots, SnapshotWriter, unhurried
from projections import packed
from projections.picture import Status
from statecharts import LOGIC
from statecharts.codec import software_digest
from statecharts.digest import Rows
from statecharts.snapshot import (
    Chunk,
    Loaded,
    SnapshotUnfit,
    Vouched,
    chunks_of,
    merge_into,
    pack,
    restore_state,
    tables_of,
)

if TYPE_CHECKING:
    from autopilot.node.flights import Session

# A snapshot is due after so many records: a start evolves at most these, and those since the last checkpoint.
EVERY_RECORDS = 10_000
# Each so-manieth chunk rests on the one as many before it, so that a start has few to merge.
LONG = 8
_NOTHING = Head(-1, FIRST_LEAF_BEFORE)


class Side(NamedTuple):
    """What a session and its board know beside the state."""

    software: str
    started: bytes  # newest NodeStarted
    due: int | None
    closed: bool
    flown: bool
    abandoned: bool
    armed_in: dict[int, int]
    status: bytes  # as `packed` writes it


_ENCODER = msgspec.msgpack.Encoder()
_SIDE = msgspec.msgpack.Decoder(Side)


class Keeper:
    """Keeps snapshots of a node's flights, and finds them again."""

    def __init__(
        self, sealer: Sealer, software: str, status: Callable[[], Status], recall: Callable[[Status], None]
    ) -> None:
        """`status` is what the board shows after everything that is durable; `recall` lets it show that again."""
        self._sealer = sealer
        self._software = software
        self.status = status
        self.recall = recall

    def resuming(self, flight: Flight) -> Resuming:
        """Return what looks for a snapshot of a flight."""
        return Resuming(self, self._sealer, self._software, flight)

    def keep(self, session: Session) -> None:
        """Keep snapshots of a session from now on, at its checkpoints."""
        if session.sealing is not None:
            session.sealing.on_sealed = Keeping(self, self._software, session).sealed


class Resuming:
    """One start's search for a snapshot of a flight."""

    def __init__(self, keeper: Keeper, sealer: Sealer, software: str, flight: Flight) -> None:
        self._keeper = keeper
        self._sealer = sealer
        self._software = software
        self._flight = flight
        self._found: tuple[Chunk, Loaded, Side, Status] | None = None
        self.refused: list[str] = []  # why newer snapshots were not taken

    def vouched(self, reader: Reader) -> Head:
        """Find the newest snapshot that can be used; return the record that it ends with. Raises StoreFailed."""
        try:
            snapshots = Snapshots(self._flight.folder)
        except OSError as error:
            self.refused.append(str(error))
            return _NOTHING
        for size in sorted(snapshots.places, reverse=True):
            try:
                with unhurried():
                    self._found = self._take(reader, snapshots, size)
                return Head(size - 1, self._found[0].leaf)
            except (SnapshotUnfit, packed.StatusBroken, msgspec.DecodeError, OSError) as error:
                self.refused.append(f"snapshot of {size} records: {error}")
        return _NOTHING

    def _take(self, reader: Reader, snapshots: Snapshots, size: int) -> tuple[Chunk, Loaded, Side, Status]:
        last = next(iter(reader.stored(size - 1, size)), None)
        signed = self._sealer.signed(self._flight, reader, size)
        if last is None or signed is None or signed.state is None:
            raise SnapshotUnfit("the log does not reach so far, or nothing vouches for it")
        chunks = chunks_of(size, snapshots.base_of(), snapshots.read, software_digest(LOGIC))
        side = _SIDE.decode(chunks[-1].side)
        if side.software != self._software:
            raise SnapshotUnfit(f"it was written by version {side.software}")
        status = packed.unpack(side.status)
        loaded = restore_state(chunks, Vouched(last.leaf, signed.root, *signed.state))
        return chunks[-1], loaded, side, status

    def resume(self, session: Session) -> int:
        """Put what was found into a session that has nothing yet; return the first record that is left to read.

        Raises StoreFailed, and UnknownKind or BodyBroken for a manifest of a newer version.
        """
        if self.refused:
            told = "; ".join(self.refused)
            print(f"autopilot: {self._flight.folder}: not started from: {told}", file=sys.stderr, flush=True)
        if self._found is None:
            return 0
        chunk, loaded, side, status = self._found
        session.state, session.due = loaded.state, side.due
        session.known = Known(chunk.size, chunk.peaks, loaded.digest)
        session.started = NodeStarted.FromString(side.started)
        session.closed, session.arming = side.closed, Arming(side.flown, side.abandoned, side.armed_in)
        opened = read_record(_record(session.store, 0)).message
        session.logic = session.started.logic or (opened.logic if isinstance(opened, FlightOpened) else LOGIC)
        session.last = _record(session.store, chunk.size - 1).at
        self._keeper.recall(status)
        gc.freeze()  # what was loaded stays; looking through a large map again and again costs pauses
        return chunk.size


def _record(reader: Reader, seq: int) -> Stored:
    return next(iter(reader.stored(seq, seq + 1)))


class Keeping:
    """Keeps the snapshots of one open flight."""

    def __init__(self, keeper: Keeper, software: str, session: Session) -> None:
        self._keeper = keeper
        self._software = software
        self._session = session
        self._newest = self._long = session.known.size if session.known else 0  # sizes of chunks; 0: none
        self._since_newest: Rows = {}
        self._since_long: Rows = {}
        self._written = 0
        self._writer = self._open()

    def sealed(self, sealed: Sealed) -> None:
        """Take in what a checkpoint was signed over, and keep a snapshot of it where it is time to."""
        if self._writer is None:
            return
        merge_into(self._since_newest, sealed.rows)
        if sealed.size - self._newest >= EVERY_RECORDS or self._session.closed:
            self._keep(self._writer, sealed)

    def _open(self) -> SnapshotWriter | None:
        try:
            return SnapshotWriter(self._session.flight.folder, self._newest)
        except OSError as error:
            self._say(str(error))
            return None

    def _keep(self, writer: SnapshotWriter, sealed: Sealed) -> None:
        if self._session.store.reserve_spent:
            self._give_up("the disk is full", writer)
            return
        try:
            side = self._side(sealed.size)
            merge_into(self._since_long, self._since_newest)
            self._written += 1
            is_long = self._written % LONG == 0
            base, rows = (self._long, self._since_long) if is_long else (self._newest, self._since_newest)
            tables = tables_of(rows)
            chunk = Chunk(sealed.size, base, software_digest(LOGIC), sealed.leaf, sealed.peaks, side, tables)
            writer.append(sealed.size, base, pack(chunk))
        except (OSError, packed.StatusBroken) as error:
            self._give_up(str(error), writer)
            return
        self._newest, self._since_newest = sealed.size, {}
        if is_long:
            self._long, self._since_long = sealed.size, {}

    def _side(self, size: int) -> bytes:
        session, status = self._session, self._keeper.status()
        if status.head_seq != size - 1:
            raise packed.StatusBroken(f"the status is that after record {status.head_seq}, not {size - 1}")
        started = session.started.SerializeToString(deterministic=True)
        shown = packed.pack(status)
        arming = session.arming
        flown = (arming.flown, arming.abandoned, arming.armed_in)
        return _ENCODER.encode(Side(self._software, started, session.due, session.closed, *flown, shown))

    def _give_up(self, because: str, writer: SnapshotWriter) -> None:
        """Keep none any more, and leave the room to the log: the next start reads all of it, and nothing is worse."""
        self._say(because)
        self._writer, self._since_newest, self._since_long = None, {}, {}
        try:
            writer.discard()
        except OSError as error:
            self._say(str(error))

    def _say(self, because: str) -> None:
        print(f"autopilot: no snapshots are kept: {because}", file=sys.stderr, flush=True)
