"""The state of a flight after any record: from the newest snapshot before it, and the few records behind that.

A snapshot is used where it gives the state that a checkpoint of the same length was signed with. Without one the log is
read from its beginning: slower, and the same. It changes no log, writes nothing, and does not check the chain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from events import Record, read_record
from events.store import Reader
from events.store.snapshots import Snapshots, unhurried
from statecharts import LOGIC, State, restore, steps_of
from statecharts.codec import software_digest
from statecharts.digest import StateDigest
from statecharts.snapshot import Loaded, SnapshotUnfit, Vouched, chunks_of, restore_state

Progress = Callable[[int, int], None]  # records done, records in all
# What a checkpoint over so many records was signed with: root, layout and digest of the state; None: nothing.
Signed = Callable[[int], tuple[bytes, bytes, bytes] | None]

PROGRESS_EVERY = 2048


@dataclass(frozen=True, slots=True)
class Seen:
    """The state after a record."""

    seq: int
    record: Record
    state: State
    digest: bytes
    start: int  # the first record that was read for it
    refused: tuple[str, ...]  # why nearer snapshots were not used


def state_at(reader: Reader, folder: Path, seq: int, signed: Signed, progress: Progress) -> Seen:
    """Return the state after record `seq`; one in the middle of a step counts with what stands before it in the step.

    Raises LookupError where there is no such record, UnknownKind, BodyBroken and StoreFailed.
    """
    if not 0 <= seq <= reader.head.seq:
        raise LookupError(f"the flight has no record {seq}: its last one is {reader.head.seq}")
    refused: list[str] = []
    start, loaded = _nearest(reader, folder, seq, signed, refused)
    state, digest, last = loaded.state, loaded.digest, read_record(next(iter(reader.stored(seq, seq + 1))))
    for recorded in steps_of(_with_progress(reader, start, seq, progress)):
        _apply(state, recorded, seq)
    digest.advance()
    return Seen(seq, last, state, digest.value, start, tuple(refused))


def _nearest(reader: Reader, folder: Path, seq: int, signed: Signed, refused: list[str]) -> tuple[int, Loaded]:
    try:
        snapshots = Snapshots(folder)
    except OSError as error:
        refused.append(str(error))
        return 0, _nothing()
    for size in sorted((size for size in snapshots.places if size <= seq + 1), reverse=True):
        try:
            with unhurried():
                return size, _take(reader, snapshots, size, signed)
        except (SnapshotUnfit, OSError) as error:
            refused.append(f"snapshot of {size} records: {error}")
    return 0, _nothing()


def _nothing() -> Loaded:
    state = State()
    return Loaded(state, StateDigest(state))


def _take(reader: Reader, snapshots: Snapshots, size: int, signed: Signed) -> Loaded:
    last, mark = next(iter(reader.stored(size - 1, size)), None), signed(size)
    if last is None or mark is None:
        raise SnapshotUnfit("the log does not reach so far, or nothing vouches for it")
    chunks = chunks_of(size, snapshots.base_of(), snapshots.read, software_digest(LOGIC))
    return restore_state(chunks, Vouched(last.leaf, *mark))


def _with_progress(reader: Reader, start: int, seq: int, progress: Progress) -> Iterator[Record]:
    """Yield the records up to `seq` and one more: only what follows an observation tells whether its step failed."""
    for stored in reader.stored(start, seq + 2):
        if stored.seq % PROGRESS_EVERY == 0:
            progress(stored.seq - start, seq + 1 - start)
        yield read_record(stored)


def _apply(state: State, recorded: tuple[Record, ...], seq: int) -> None:
    """Apply what of a step is not behind record `seq`."""
    upto = tuple(record for record in recorded if record.seq <= seq)
    failed = len(recorded) > 1 and recorded[1].kind.name == "step_failed"
    if len(upto) > 1 or (upto and not failed):
        restore(state, upto)
