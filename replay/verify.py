"""Runs a flight again: every recorded observation through the same charts, every decision compared.

One pass over the log checks the chain and replays it, a step (an observation and the decisions that follow it) at a
time. A decision is the same when number, cause, moment, kind, version and body are, byte for byte: equal bytes are
equal fields, so fields are only looked at where bytes differ. Where a step differs, the state goes on from the
recorded decisions, so that a divergence stays local and the next one is a finding of its own. It changes no log.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from contextlib import suppress

from events import (
    KINDS,
    BodyBroken,
    Chain,
    ChainBroken,
    Record,
    Role,
    UnknownKind,
    read_record,
)
from events.records import Stored
from events.schema.flight_pb2 import FlightOpened, NodeStarted
from events.store import Reader
from events.tree import Peaks
from projections.describe import describe
from replay.causes import Line, chain, line
from replay.fields import first_difference
from replay.incomplete import Partial
from replay.properties import Properties
from replay.same import meant, said, same
from replay.states import SignedStates
from replay.verdict import Divergence, Gaps, Outcome, Since, Verdict
from statecharts import State, logic, restore, step
from statecharts.logic import Change

Progress = Callable[[int, int], None]  # records done, records in all

PROGRESS_EVERY = 2048
_OBSERVATIONS = frozenset(kind.number for kind in KINDS if kind.role is Role.OBSERVATION)
_HEADER = ("seq", "cause", "at", "kind", "version")
NOTHING = "no such decision"


class _Ended(Exception):
    """The log can't be followed any further."""

    def __init__(self, outcome: Outcome, seq: int, detail: str) -> None:
        super().__init__(detail)
        self.outcome, self.seq, self.detail = outcome, seq, detail


def verify(reader: Reader, progress: Progress | None = None) -> Verdict:
    """Return whether a flight replays identically. A flight that is still open is verified up to its head now.

    Raises StoreFailed where the store can't be read.
    """
    run = _Run(reader)
    try:
        run.whole(progress or _silent)
    except _Ended as end:
        return run.verdict(end.outcome, end.seq, end.detail)
    return run.verdict(run.outcome())


def _silent(_done: int, _of: int) -> None:
    pass


class _Run:
    """One verification."""

    def __init__(self, reader: Reader) -> None:
        self.reader = reader
        self.partial = None if reader.secret else Partial(_read, same)  # a redacted copy has no secret
        self.state = State() if self.partial is None else self.partial.state
        self.gaps = Gaps()
        self.records = 0
        self.decisions = 0
        self.first: Divergence | None = None
        self.diverged = 0
        self.logic = 0  # that the steps were decided by
        self.since: Change | None = None
        self.intended: Divergence | None = None  # the first difference that a change of logic explains
        self.intentions = 0
        self.sealed = Chain(reader.flight_id, reader.secret)
        self.properties = Properties()
        self.states = SignedStates(reader.checkpoints() if self.partial is None else (), self.state)

    def whole(self, progress: Progress) -> None:
        """Check and replay everything. Raises _Ended."""
        head = self.reader.head
        if head.seq < 0:
            raise _Ended(Outcome.UNREADABLE, 0, "the log is empty")
        check, observations = self.sealed.check, _OBSERVATIONS
        signed = _Signed(self.reader)
        recorded: list[Stored] = []
        for expected, stored in enumerate(self.reader.stored(0, head.seq + 1)):
            if stored.seq != expected:
                raise _Ended(Outcome.BROKEN, expected, f"record {expected} is missing")
            try:
                check(stored)
            except ChainBroken as error:
                self._look_closer(recorded, stored)
                raise _Ended(Outcome.BROKEN, expected, str(error)) from error
            if stored.kind_number in observations and recorded:
                self._step(recorded)
                recorded = []
            recorded.append(stored)
            self.records += 1
            signed.check(stored)
            if expected % PROGRESS_EVERY == 0:
                progress(expected, head.seq + 1)
        if self.records != head.seq + 1 or self.sealed.leaf != head.leaf:
            raise _Ended(Outcome.BROKEN, self.records, f"the log ends at {self.records - 1}, its head is {head.seq}")
        signed.end(head.seq + 1)
        self._step(recorded)
        progress(head.seq + 1, head.seq + 1)

    def outcome(self) -> Outcome:
        """Return the outcome of a flight that was followed to its end."""
        if self.first is not None:
            return Outcome.DIVERGES
        if self.gaps.removed:
            return Outcome.INCOMPLETE
        return Outcome.INTENDED if self.intended is not None else Outcome.IDENTICAL

    def verdict(self, outcome: Outcome, seq: int | None = None, detail: str = "") -> Verdict:
        """Return what was found."""
        return Verdict(
            outcome=outcome,
            flight_id=self.reader.flight_id.hex(),
            records=self.records,
            decisions=self.decisions,
            first=self.first or self.intended,
            further=max((self.diverged or self.intentions) - 1, 0),
            since=None if self.since is None else Since(self.since.logic, self.since.says),
            seq=seq,
            detail=detail,
            leaf=self.sealed.leaf.hex(),
            gaps=self.gaps,
            broken=tuple(self.properties.broken.values()),
        )

    def _look_closer(self, recorded: list[Stored], broken: Stored) -> None:
        """Replay the step that a broken record lies in, so that the verdict can say what the record should have said.

        What can't be replayed says nothing more than that its chain is broken.
        """
        decisions = self.decisions
        step_of = [] if broken.kind_number in _OBSERVATIONS else recorded
        if not step_of and recorded:
            self._step(recorded)
        rows = [*step_of, broken]
        for stored in self.reader.stored(broken.seq + 1):
            if stored.kind_number in _OBSERVATIONS:
                break
            rows.append(stored)
        with suppress(_Ended, Exception):
            self._step(rows)
        self.decisions = decisions

    def _step(self, recorded: Sequence[Stored]) -> None:
        """Replay one step and compare it. Raises _Ended where it can't be read."""
        if self.partial is not None and recorded[0].seq > 0:
            self._step_in_part(self.partial, recorded)
            return
        observation = _read(recorded[0])
        if observation.seq == 0:
            _check_manifest(observation, self.reader.flight_id)
        self._note_logic(observation)
        replayed = step(self.state, observation).records
        self.decisions += len(recorded) - 1
        if len(replayed) != len(recorded) or not all(map(same, recorded, replayed)):
            self._differs(recorded, replayed)
            replayed = self._follow(recorded, observation)
        self.properties.see(replayed)
        if (other := self.states.after(recorded[-1].seq)) is not None:
            self.diverged += 1
            self.first = self.first or other

    def _note_logic(self, observation: Record) -> None:
        start = observation.message
        if not isinstance(start, FlightOpened | NodeStarted):
            return
        self.logic = start.logic or self.logic
        if self.logic > logic.LOGIC:
            known = f"it was decided by logic {self.logic}, and this software knows none above {logic.LOGIC}"
            because = f"{known}: replay it with software {start.software} or later"
            raise _Ended(Outcome.UNREADABLE, observation.seq, because)

    def _differs(self, recorded: Sequence[Stored], replayed: Sequence[Record]) -> None:
        """Take down a step that came out otherwise."""
        change = meant(self.logic, recorded, replayed)
        if change is None:
            self.diverged += 1
            self.first = self.first or _divergence(self.reader, recorded, replayed)
            return
        self.intentions += 1
        if self.since is None or change.logic < self.since.logic:
            self.since = change
        self.intended = self.intended or _divergence(self.reader, recorded, replayed)

    def _step_in_part(self, partial: Partial, recorded: Sequence[Stored]) -> None:
        """Replay one step of a redacted copy and compare what can be compared. Raises _Ended."""
        if not recorded[0].removed:
            self._note_logic(_read(recorded[0]))
        found = partial.step(recorded)
        self.decisions += found.decisions
        self.gaps.add(recorded, found.agreeing, found.uncompared)
        if found.replayed is not None:
            self._differs(recorded, found.replayed)

    def _follow(self, recorded: Sequence[Stored], observation: Record) -> tuple[Record, ...]:
        """Go on from what was recorded, and return it; where it can't be applied, from what was replayed."""
        self.state.journal.rollback()
        try:
            records = tuple(_read(stored) for stored in recorded)
            restore(self.state, records)
        except _Ended:
            raise
        except Exception:  # noqa: BLE001 - a forged decision may break any chart; that it differs is reported already
            self.state.journal.rollback()
            return step(self.state, observation).records
        return records


class _Signed:
    """Holds the checkpoints that lie beside the records against the tree over them. Who signed is judged elsewhere."""

    def __init__(self, reader: Reader) -> None:
        self._notes = dict(reader.checkpoints())
        self._peaks = Peaks()

    def check(self, stored: Stored) -> None:
        """Take the next record in. Raises _Ended where a checkpoint says otherwise."""
        if not self._notes:
            return
        self._peaks.append(stored.leaf)
        size = self._peaks.size
        note = self._notes.get(size)
        if note is None:
            return
        if note.split("\n")[1:3] != [str(size), base64.b64encode(self._peaks.root()).decode()]:
            raise _Ended(Outcome.BROKEN, stored.seq, f"the first {size} records are not those that were signed")

    def end(self, size: int) -> None:
        """Raise _Ended where more was signed than there is."""
        newest = max(self._notes, default=0)
        if newest > size:
            raise _Ended(Outcome.BROKEN, size, f"{newest} records were signed, and the log holds {size}: it was cut")


def _read(stored: Stored) -> Record:
    try:
        return read_record(stored)
    except (UnknownKind, BodyBroken) as error:
        raise _Ended(Outcome.UNREADABLE, stored.seq, str(error)) from error


def _check_manifest(first: Record, flight_id: bytes) -> None:
    if not isinstance(first.message, FlightOpened):
        raise _Ended(Outcome.UNREADABLE, 0, f"the log begins with {first.kind.name}, not with a manifest")
    if first.message.flight_id != flight_id:
        raise _Ended(Outcome.BROKEN, 0, f"the manifest is that of flight {first.message.flight_id.hex()}")


def _divergence(reader: Reader, recorded: Sequence[Stored], replayed: Sequence[Record]) -> Divergence:
    """Return the first difference of a step; its observation is the same in both."""
    index = 1
    while index < min(len(recorded), len(replayed)) and same(recorded[index], replayed[index]):
        index += 1
    rest, other = recorded[index:], replayed[index:]
    if not rest:
        return _lacking(reader, recorded[-1].seq + 1, other[0])
    if not other:
        return _needless(reader, rest[0])
    mine, theirs = [said(one) for one in rest], [said(one) for one in other]
    if mine[0] == theirs[0] or (rest[0].removed and mine[0][0] == theirs[0][0]):
        return _header(reader, rest[0], other[0])
    if len(mine) == len(theirs) and sorted(mine) == sorted(theirs):
        return _both(reader, "order", rest[0], other[0])
    if len(mine) < len(theirs) and mine[0] in theirs:
        return _lacking(reader, rest[0].seq, other[0])
    if len(mine) > len(theirs) and theirs[0] in mine:
        return _needless(reader, rest[0])
    if rest[0].kind_number != other[0].kind.number:
        return _both(reader, "kind", rest[0], other[0])
    return _body(reader, rest[0], other[0])


def _lacking(reader: Reader, seq: int, replayed: Record) -> Divergence:
    name, text = replayed.kind.name, describe(replayed)
    causes = (Line(seq, name, f"replayed only: {text}"), *chain(reader, replayed.cause))
    return Divergence(seq, name, "missing in the log", "", NOTHING, text, causes)


def _needless(reader: Reader, recorded: Stored) -> Divergence:
    shown = line(recorded)
    return Divergence(shown.seq, shown.kind, "only in the log", "", shown.text, NOTHING, chain(reader, shown.seq))


def _both(reader: Reader, what: str, recorded: Stored, replayed: Record) -> Divergence:
    shown = line(recorded)
    told = f"{replayed.kind.name}: {describe(replayed)}"
    return Divergence(shown.seq, shown.kind, what, "", f"{shown.kind}: {shown.text}", told, chain(reader, shown.seq))


def _header(reader: Reader, recorded: Stored, replayed: Record) -> Divergence:
    mine = (recorded.seq, recorded.cause, recorded.at, recorded.kind_number, recorded.version)
    theirs = (replayed.seq, replayed.cause, replayed.at, replayed.kind.number, replayed.version)
    name, one, other = next(three for three in zip(_HEADER, mine, theirs, strict=True) if three[1] != three[2])
    if name == "at":
        moment = zip(recorded.at._fields, recorded.at, replayed.at, strict=True)
        name, one, other = next(three for three in moment if three[1] != three[2])
    causes = chain(reader, recorded.seq)
    return Divergence(recorded.seq, replayed.kind.name, "header", name, str(one), str(other), causes)


def _body(reader: Reader, recorded: Stored, replayed: Record) -> Divergence:
    seq, name, causes = recorded.seq, replayed.kind.name, chain(reader, recorded.seq)
    try:
        message = read_record(recorded).message
    except BodyBroken:
        return Divergence(seq, name, "encoding", "", f"{len(recorded.body)} bytes that are no {name}", "", causes)
    found = first_difference(message, replayed.message)
    if found is None:
        return Divergence(seq, name, "encoding", "", recorded.body.hex(), replayed.body.hex(), causes)
    return Divergence(seq, name, "field", *found, causes)
