"""A readable copy of what holds of a damaged log. The log itself is only copied, never opened.

SQLite is let loose on the copy: it may cut a torn tail there. Every record whose chain holds from the first on goes
into a new log with the same leaves, as far as its last whole step: a step is decided and committed as one, so a part
of one would replay as a divergence. What lies behind the damage and holds together is named, not copied: nothing joins
it to the beginning, and another log under the same flight id would be a forgery.
"""

from __future__ import annotations

import itertools
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from events.chain import FIRST_LEAF_BEFORE, Chain, ChainBroken
from events.kinds import Kind, Role
from events.records import NO_CAUSE, Record, Stored
from events.schema.flight_pb2 import FlightOpened
from events.store.flights import DATABASE
from events.store.head import NAME as HEAD
from events.store.protocol import Head, StoreFailed, StoreMissing
from events.store.recovery import Action, Finding, KeptLog, Records, examine
from events.store.sqlite import SqliteReader, SqliteStore, sync_folder

ROWS_A_COMMIT = 4096
# A log that somebody records in changes while it is copied; so often it is tried.
_TRIES = 3

Range = tuple[int, int]  # first and last seq


@dataclass(frozen=True, slots=True)
class Recovered:
    """What was found and what became of it."""

    finding: Finding
    copied: Head  # end of the copy; seq -1 where nothing could be copied
    left_out: tuple[Range, ...]  # what can be read and holds within itself, but can't follow the copy
    lost: tuple[Range, ...]  # known to have been recorded; not to be read, or not to be believed

    @property
    def whole(self) -> bool:
        """Nothing is wrong: the copy is the log."""
        return self.finding.sound and not self.lost and self.copied == self.finding.end


def recover(folder: Path, out: Path, companions: Sequence[str]) -> Recovered:
    """Write what holds of the flight in `folder` to the new folder `out`, with those of its companions that are there.

    Raises StoreMissing where there is no log, FileExistsError where `out` is there, StoreFailed where the log can't be
    read at this moment or the copy can't be written. Nothing is left at `out` where it fails, or nothing holds.
    """
    if out.exists():
        raise FileExistsError(f"{out} is there already: a recovered flight is never written over another")
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".recover-", dir=out.parent) as work:
        there = _copied(folder, Path(work) / "there")
        finding = examine(there)
        if finding.action is Action.REFUSE:
            raise StoreFailed(f"{folder}: {finding.detail}")
        behind = list(_behind(there, finding))
        end = finding.end if _ends_whole(finding, behind) else _step_before(finding)
        if end.seq >= 0:
            made = Path(work) / "made"
            _write(finding, end, made)
            for name in companions:
                if (folder / name).is_file():
                    shutil.copyfile(folder / name, made / name)
            made.rename(out)
            sync_folder(out.parent)
        left_out = tuple(_left_out(there, finding, end, behind))
        return Recovered(finding, end, left_out, tuple(_gaps(end.seq, _newest(there, finding, behind), left_out)))


def _copied(folder: Path, there: Path) -> Path:
    """Copy a log as it lies. Raises StoreMissing by way of `examine`, and StoreFailed where it does not keep still."""
    there.mkdir()
    files = [folder / name for name in (HEAD, f"{DATABASE}-wal", DATABASE)]
    try:
        for _ in range(_TRIES):
            before = _looks(files)
            for file in files:
                if file.exists():
                    shutil.copyfile(file, there / file.name)
            if _looks(files) == before:
                return there
    except OSError as error:
        raise StoreFailed(f"{folder} can't be copied: {error}") from error
    raise StoreFailed(f"{folder} is being recorded in: it needs no recovery")


def _looks(files: Iterable[Path]) -> list[tuple[int, int]]:
    stats = [file.stat() for file in files if file.exists()]
    return [(stat.st_size, stat.st_mtime_ns) for stat in stats]


def _behind(there: Path, finding: Finding) -> Iterator[Stored]:
    """Yield the rows behind what holds, as far as SQLite gives them."""
    try:
        reader = SqliteReader(there / DATABASE)
        try:
            yield from reader.stored(finding.end.seq + 1)
        finally:
            reader.close()
    except StoreFailed:
        return


def _ends_whole(finding: Finding, behind: Sequence[Stored]) -> bool:
    """Say whether what holds ends with a whole step: at the end of a commit, or where the next step begins."""
    if finding.facts.records is Records.WHOLE:
        return not behind and not finding.detail
    return bool(behind) and behind[0].seq == finding.end.seq + 1 and behind[0].cause == NO_CAUSE


def _step_before(finding: Finding) -> Head:
    """Return the end of the last step that is surely whole."""
    if finding.end.seq < 0:
        return finding.end
    log = KeptLog(finding)
    try:
        end = before = Head(-1, FIRST_LEAF_BEFORE)
        for stored in log.stored():
            if stored.cause == NO_CAUSE:
                end = before
            before = Head(stored.seq, stored.leaf)
        return end
    finally:
        log.close()


def _write(finding: Finding, end: Head, made: Path) -> None:
    """Write the records up to `end` into a new log, and the checkpoints over them. Raises StoreFailed."""
    made.mkdir()
    log = KeptLog(finding)
    try:
        store = SqliteStore.create(made / DATABASE, log.flight_id, log.secret)
        try:
            for start in range(0, end.seq + 1, ROWS_A_COMMIT):
                store.append([_record(row) for row in log.stored(start, min(start + ROWS_A_COMMIT, end.seq + 1))])
            for size, note in log.checkpoints():
                if size <= end.seq + 1:
                    store.add_checkpoint(size, note)
            if store.head != end:
                raise StoreFailed(f"the copy ends at {store.head.seq}, not at {end.seq}")
        finally:
            store.close()
    finally:
        log.close()


def _record(row: Stored) -> Record:
    """Return a row as a store takes it: its bytes as they are, of a kind that this software need not know."""
    kind = Kind("", row.kind_number, Role.OBSERVATION, sync=True, version=row.version, port="", message=FlightOpened)
    return Record(row.seq, row.cause, row.at, kind, row.version, row.body, FlightOpened())


def _left_out(there: Path, finding: Finding, end: Head, behind: Sequence[Stored]) -> Iterator[Range]:
    """Yield what holds and was not copied: the rest of a step, and runs of records that follow from the one before."""
    if end.seq < finding.end.seq:
        yield end.seq + 1, finding.end.seq
    if not behind:
        return
    reader = SqliteReader(there / DATABASE)
    flight_id, secret = reader.flight_id, reader.secret
    reader.close()
    first: int | None = None
    for before, row in itertools.pairwise(behind):
        holds = row.seq == before.seq + 1 and _follows(Chain(flight_id, secret, before.leaf), row)
        if holds and first is None:
            first = row.seq
        if not holds and first is not None:
            yield first, before.seq
            first = None
    if first is not None:
        yield first, behind[-1].seq


def _follows(chain: Chain, row: Stored) -> bool:
    try:
        chain.check(row)
    except ChainBroken:
        return False
    return True


def _newest(there: Path, finding: Finding, behind: Sequence[Stored]) -> int:
    """Return the last record that anything knows of: the rows, the head file, or what was signed."""
    known = [finding.end.seq, *(row.seq for row in behind)]
    if finding.head_file is not None:
        known.append(finding.head_file.head.seq)
    with suppress(StoreFailed, StoreMissing):
        reader = SqliteReader(there / DATABASE)
        try:
            known += [size - 1 for size, _ in reader.checkpoints()]
        finally:
            reader.close()
    return max(known)


def _gaps(end: int, newest: int, left_out: Sequence[Range]) -> Iterator[Range]:
    """Yield what lies between the end of the copy and the newest record, and is not left out either."""
    expected = end + 1
    for first, last in left_out:
        if first > expected:
            yield expected, first - 1
        expected = last + 1
    if expected <= newest:
        yield expected, newest
