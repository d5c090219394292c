"""One flight's log held against everything that was signed of it. It reads only, and believes no key but the node's.

The records say which log keys the node has certified; each checkpoint must be signed by one of them and hold what the
records give; no more may lie behind the newest than a node leaves unsigned; and the papers beside the log must be
those of this flight. What a witness and the flights around it know is judged in `examiner`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from google.protobuf.message import DecodeError

from autopilot.node.sealing import CERTIFICATE_FILE, EVERY_NS, EVERY_RECORDS
from autopilot.trust.notes import Checkpoint, LogKey, NoteInvalid, open_note, read_checkpoint, read_log_key
from autopilot.trust.replayed import read_verdict
from events.kinds import kind_of
from events.records import Stored
from events.schema.flight_pb2 import FlightClosed, FlightOpened, LogKeyCertified, SealRefused
from events.store import Flight, SqliteReader, StoreFailed
from events.store.recovery import Action, Facts, Finding, HeadFile, Manifest, examine
from events.tree import Peaks

# A checkpoint is due after EVERY_RECORDS or EVERY_NS; the batch that was being committed then may be as long again.
UNSIGNED_RECORDS, UNSIGNED_NS = 2 * EVERY_RECORDS, 2 * EVERY_NS
_LOOKS = 4
_OPENED, _CLOSED = kind_of(FlightOpened()).number, kind_of(FlightClosed()).number
_CERTIFIED, _REFUSED = kind_of(LogKeyCertified()).number, kind_of(SealRefused()).number


class Found(NamedTuple):
    """Something about a flight: the first record that is not as it was lies between `first` and `last`."""

    flight: int  # number
    first: int
    last: int
    because: str
    wrong: bool = True  # False: told, for a node or a person may have left it so without a lie

    def words(self) -> str:
        """Say it in one line."""
        where = f"record {self.first}" if self.first == self.last else f"records {self.first} to {self.last}"
        return f"{where}: {self.because}"


class Anchor(NamedTuple):
    """Whose log it has to be: what is believed before anything of the folder is."""

    deployment_id: str
    node: str
    public_key: bytes

    @property
    def signer(self) -> str:
        """The name that the node's key signs notes under."""
        return f"waypoint/{self.deployment_id}/{self.node}"


@dataclass(slots=True)
class Judged:
    """A flight as far as it can be read, and what was found."""

    number: int
    folder: Path
    flight_id: bytes = b""
    manifest: FlightOpened | None = None
    leaves: list[bytes] = field(default_factory=list)
    signed: dict[int, Checkpoint] = field(default_factory=dict)  # those that hold, by size
    found: list[Found] = field(default_factory=list)

    def say(self, first: int, last: int, because: str, *, wrong: bool = True) -> None:
        """Keep a finding."""
        self.found.append(Found(self.number, first, max(first, last), because, wrong))

    @property
    def holds(self) -> int:
        """How many of the first records a checkpoint vouches for."""
        return max(self.signed, default=0)

    def root(self, size: int) -> bytes:
        """Return the root over the first records."""
        peaks = Peaks()
        for leaf in self.leaves[:size]:
            peaks.append(leaf)
        return peaks.root()


def look(folder: Path) -> Finding:
    """Examine a log that may be recorded in at this moment: it may look torn once. Raises StoreMissing."""
    finding = examine(folder)
    for _ in range(_LOOKS):
        if finding.action is Action.GO_ON or finding == (again := examine(folder)):
            break
        finding = again
    return finding


def judge_flight(flight: Flight, anchor: Anchor | None = None, finding: Finding | None = None) -> Judged:
    """Judge one flight, of which `finding` may be known already. Raises StoreMissing.

    Without an anchor the node is the one that its manifest names: then all that is signed may be forged together.
    """
    finding = finding or look(flight.folder)
    judged = Judged(flight.number, flight.folder, finding.flight_id)
    if finding.action is not Action.REFUSE:
        try:
            _Judgement(flight, judged).read(None if finding.sound else finding.end.seq + 1, anchor)
        except StoreFailed as error:
            if finding.sound:
                judged.say(finding.end.seq + 1, finding.end.seq + 1, str(error))
    if not finding.sound:
        judged.found.insert(0, _of_examination(finding, judged))
    return judged


def _of_examination(finding: Finding, judged: Judged) -> Found:
    facts: Facts = finding.facts
    end = finding.end.seq + 1
    seen = finding.head_file
    if facts.manifest is Manifest.OTHER:
        return Found(judged.number, 0, 0, finding.words())
    if facts.head_file is HeadFile.FORKED and seen is not None:
        return Found(judged.number, 0, seen.head.seq, finding.words())
    return Found(judged.number, end, end, finding.words())


class _Judgement:
    """One pass over a log, then over its seals and papers."""

    def __init__(self, flight: Flight, judged: Judged) -> None:
        self._flight = flight
        self._judged = judged
        self._certificates: dict[int, str] = {}  # by the record that holds it
        self._times: list[int] = []
        self._refused = self._closed = False
        self._sealed = False  # whoever asks knows a node that signs

    def read(self, stop: int | None, anchor: Anchor | None) -> None:
        """Judge everything before record `stop`. Raises StoreFailed."""
        reader = SqliteReader(self._flight.database)
        try:
            notes = reader.checkpoints()  # first: while the flight is open, both grow
            for stored in reader.stored(0, stop):
                self._take(stored)
        finally:
            reader.close()
        manifest = self._judged.manifest
        if manifest is None:
            return
        named = Anchor(manifest.deployment_id, manifest.node, manifest.node_public_key)
        if anchor is not None and named != anchor:
            self._judged.say(0, 0, f"its manifest names another node: {named.signer}")
        keys = list(self._keys(anchor or named))
        self._check_checkpoints(keys, notes)
        if stop is None:
            self._check_sizes(notes)
        self._sealed = anchor is not None
        self._check_end(keys)
        self._check_papers(anchor or named)

    def _take(self, stored: Stored) -> None:
        self._judged.leaves.append(stored.leaf)
        self._times.append(stored.at.flight_ns)
        try:
            if stored.kind_number == _CERTIFIED:
                self._certificates[stored.seq] = LogKeyCertified.FromString(stored.body).certificate
            elif stored.kind_number == _OPENED and stored.seq == 0:
                self._judged.manifest = FlightOpened.FromString(stored.body)
        except DecodeError as error:
            self._judged.say(stored.seq, stored.seq, f"it can't be read: {error}")
        self._refused = self._refused or stored.kind_number == _REFUSED
        self._closed = self._closed or stored.kind_number == _CLOSED

    def _keys(self, anchor: Anchor) -> Iterator[tuple[int, LogKey]]:
        """Yield the log keys that the node has certified for this flight, each with the record that says so."""
        for seq, certificate in self._certificates.items():
            try:
                log_key = read_log_key(open_note(certificate, anchor.signer, anchor.public_key))
            except NoteInvalid as error:
                self._judged.say(seq, seq, f"it certifies a log key, and not for {anchor.node}: {error}")
                continue
            if (log_key.flight_number, log_key.flight_id) == (self._number, self._judged.flight_id):
                yield seq, log_key
            else:
                self._judged.say(seq, seq, f"it certifies the log key of flight {log_key.flight_number}")

    def _check_checkpoints(self, keys: list[tuple[int, LogKey]], notes: list[tuple[int, str]]) -> None:
        peaks, wanted = Peaks(), dict(notes)
        for leaf in self._judged.leaves:
            peaks.append(leaf)
            if peaks.size in wanted:
                self._check_checkpoint(keys, peaks.size, wanted[peaks.size], peaks.root())

    def _check_sizes(self, notes: list[tuple[int, str]]) -> None:
        count = len(self._judged.leaves)
        for size in (size for size, _ in notes if not 0 < size <= count):
            because = f"{size} records were signed, and the log holds {count}: it was cut"
            self._judged.say(self._judged.holds, count, because)

    def _check_checkpoint(self, keys: list[tuple[int, LogKey]], size: int, note: str, root: bytes) -> None:
        try:
            checkpoint = _signed_by([log_key for seq, log_key in keys if seq < size], note)
        except NoteInvalid as error:
            because = f"the checkpoint over {size} records is not the node's: {error}"
            self._judged.say(self._judged.holds, size - 1, because)
            return
        if (checkpoint.size, checkpoint.root) == (size, root):
            self._judged.signed[size] = checkpoint
        else:
            because = f"the first {size} records are not those that were signed"
            self._judged.say(self._judged.holds, size - 1, because)

    def _check_end(self, keys: list[tuple[int, LogKey]]) -> None:
        """Judge what lies behind the newest checkpoint."""
        holds, last = self._judged.holds, len(self._judged.leaves) - 1
        if not keys:
            because = "no key that the node vouches for has signed any of it"
            self._judged.say(0, last + 1, because, wrong=self._sealed or bool(self._certificates))
        elif not self._refused and last >= holds:
            # Before the first checkpoint nothing could be signed: the time counts from the key.
            since = self._times[holds - 1] if holds else self._times[keys[0][0]]
            late = self._times[last] - since > UNSIGNED_NS or last + 1 - holds > UNSIGNED_RECORDS
            if late:
                self._judged.say(holds, last, "more follows the newest checkpoint than a node leaves unsigned")
            elif self._closed:
                self._judged.say(holds, last, "the flight was closed, and its end was not signed", wrong=False)

    @property
    def _number(self) -> int:
        return 0 if self._judged.manifest is None else self._judged.manifest.flight_number

    def _check_papers(self, anchor: Anchor) -> None:
        last = len(self._judged.leaves) - 1
        if self._certificates:
            try:
                note = (self._flight.folder / CERTIFICATE_FILE).read_text("utf-8")
            except (OSError, UnicodeDecodeError):
                note = ""
            if note not in self._certificates.values():
                self._judged.say(0, last, f"{CERTIFICATE_FILE} is not the certificate that the log holds")
        try:
            verdict = read_verdict(self._flight.folder, anchor.public_key, anchor.signer)
        except NoteInvalid as error:
            self._judged.say(0, last, f"the verdict is not to be believed: {error}")
            return
        if verdict is None:
            return
        of_log = (f"{anchor.signer}/{self._number}", self._judged.flight_id.hex())
        leaf = self._judged.leaves[verdict.seq].hex() if 0 <= verdict.seq <= last else ""
        if (verdict.origin, verdict.flight_id) != of_log or verdict.leaf != leaf:
            self._judged.say(0, max(verdict.seq, 0), "the verdict is about another log than this")


def _signed_by(keys: list[LogKey], note: str) -> Checkpoint:
    """Return what a checkpoint says, where one of the keys has signed it. Raises NoteInvalid."""
    for log_key in reversed(keys):
        try:
            checkpoint = read_checkpoint(open_note(note, log_key.origin, log_key.public_key))
        except NoteInvalid as error:
            refused = error
            continue
        if checkpoint.origin == log_key.origin:
            return checkpoint
        refused = NoteInvalid("it is about another log than its key may sign")
    raise refused if keys else NoteInvalid("no key was certified before it")
