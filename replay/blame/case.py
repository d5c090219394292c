"""The case: the steps around the first divergence, the state before them, and one run of them with something changed.

A run decides again at each observation and compares, as `verify` does; where a step differs, it goes on from what was
recorded. What a hypothesis changes is the state at the beginning, the steps, or both; the log itself is never changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from google.protobuf.message import DecodeError, Message

from events import KINDS, BodyBroken, Record, Role, UnknownKind, read_record
from events.records import Stored
from events.schema.flight_pb2 import FlightOpened
from events.store import Reader
from replay.blame.again import Decisions, said
from replay.blame.findings import Weight
from replay.verdict import Divergence
from statecharts import State, restore, step
from statecharts.journal import Keyed

WINDOW_BEFORE = 400  # records before the divergence within which inputs are exchanged and put in
WINDOW_AFTER = 1_500  # records behind it that an explanation must hold for
RECORDS_MAX = 600_000  # records that the runs of one hypothesis may apply
RUNS_AT_LEAST = 4  # from the beginning of the flight, however long it is
_OBSERVATIONS = frozenset(kind.number for kind in KINDS if kind.role is Role.OBSERVATION)


class Spent(Exception):
    """The limit on work is reached."""


class Budget:
    """Counts the records that runs apply. Counted, not timed: the same log gets the same answer everywhere."""

    def __init__(self, records: int) -> None:
        self._left = records

    def spend(self, records: int) -> None:
        """Take so many. Raises Spent when there are none left."""
        self._left -= records
        if self._left < 0:
            raise Spent

    def give(self, length: int) -> None:
        """Grant another hypothesis its share, for a divergence so far from the beginning."""
        self._left = max(RECORDS_MAX, RUNS_AT_LEAST * (length + WINDOW_AFTER))


class Lifting:
    """How stored bodies are read, which of them were lifted from an older version, and how they would read unlifted."""

    def read(self, stored: Stored) -> Record:
        """Return the record as the charts see it. Raises UnknownKind, BodyBroken."""
        return read_record(stored)

    def unlifted(self, record: Record) -> Message | None:
        """Return the body of a lifted record as if it had not been lifted; None for one that was not, or can't be."""
        if record.version == record.kind.version:
            return None
        try:
            return record.kind.message.FromString(record.body)
        except DecodeError:
            return None


class Group(NamedTuple):
    """One step: an observation, and what was recorded behind it."""

    observation: Record
    decisions: tuple[Record, ...]
    logged: bool = True  # False: put in by a hypothesis; nothing is compared

    @property
    def size(self) -> int:
        """Records in it."""
        return 1 + len(self.decisions)


def grouped(rows: Iterable[Stored], lifting: Lifting) -> Iterator[Group]:
    """Group rows, which begin with an observation, into steps. It ends before what can't be read."""
    records: list[Record] = []
    for row in rows:
        try:
            record = lifting.read(row)
        except (UnknownKind, BodyBroken):
            break
        if row.kind_number in _OBSERVATIONS and records:
            yield Group(records[0], tuple(records[1:]))
            records = []
        records.append(record)
    if records:
        yield Group(records[0], tuple(records[1:]))


@dataclass(frozen=True, slots=True)
class Run:
    """Which steps differ."""

    differing: tuple[int, ...]  # seqs of the observations


class Case:
    """A divergence, ready to be looked into."""

    def __init__(self, reader: Reader, first: Divergence, lifting: Lifting) -> None:
        self.reader, self.first, self.lifting = reader, first, lifting
        self.budget = Budget(2 * (reader.head.seq + WINDOW_AFTER))  # the case itself is made in any case
        self.seq = _observation_of(reader, first.seq)  # the observation of the step that differs
        start = _begin_of(reader, max(self.seq - WINDOW_BEFORE, 0))
        self.start = start
        self.groups = self._window(start, self.seq + WINDOW_AFTER)
        self.place = next(place for place, group in enumerate(self.groups) if group.observation.seq == self.seq)
        self.manifest = _manifest(reader, lifting)
        self._base = self.before(start)
        self.baseline = Run(tuple(self._differing(self.groups, self.state())))
        self.ends = self._ends()

    @property
    def group(self) -> Group:
        """The step that differs."""
        return self.groups[self.place]

    def _window(self, start: int, stop: int) -> tuple[Group, ...]:
        """Return the steps from `start` on that end before `stop`; the step that differs in any case."""
        groups = tuple(grouped(self.reader.stored(start, stop), self.lifting))
        cut = stop <= self.reader.head.seq and groups[-1].observation.seq != self.seq
        return groups[:-1] if cut else groups

    def _ends(self) -> bool:
        """Whether the window holds the rest of the flight."""
        last = self.groups[-1]
        return last.observation.seq + last.size > self.reader.head.seq

    def prefix(self, stop: int) -> Iterator[Group]:
        """Yield the steps before the record `stop`."""
        self.budget.spend(stop)
        if self.start == 0:  # the window holds them all
            return (group for group in self.groups if group.observation.seq < stop)
        return grouped(self.reader.stored(0, stop), self.lifting)

    def before(self, stop: int, change: Callable[[Record], Record] | None = None) -> State:
        """Return the state before the record `stop`, evolved from what was recorded, with one record read otherwise."""
        state = State()
        for group in self.prefix(stop):
            records = (group.observation, *group.decisions)
            restore(state, tuple(map(change, records)) if change else records)
        return state

    def decided(self, change: Callable[[Record], Record] | None = None) -> Decisions | str:
        """Return what the step comes to with records read otherwise; the error's name where they make no sense so."""
        try:
            state = self.before(self.seq, change)
        except Spent:
            raise
        except Exception as error:  # noqa: BLE001 - the charts never met such records, and may break in any way
            return type(error).__name__
        observation = change(self.group.observation) if change else self.group.observation
        return said(step(state, observation).records[1:])

    def state(self) -> State:
        """Return a fresh copy of the state before the window."""
        return copied(self._base)

    def run(self, groups: Sequence[Group], state: State | None = None) -> Run | None:
        """Run steps and compare; None where the step in question, or one before it, differs. Raises Spent."""
        own, differing = self.state() if state is None else state, list[int]()
        for seq in self._differing(groups, own):
            if seq <= self.seq:
                return None
            differing.append(seq)
        return Run(tuple(differing))

    def _differing(self, groups: Sequence[Group], state: State) -> Iterator[int]:
        for group in groups:
            self.budget.spend(group.size)
            if not came_out(state, group):
                yield group.observation.seq

    def at(self, state: State | None = None, place: int | None = None) -> State:
        """Return the state before the step at `place` of the window, evolved from what was recorded."""
        stop = self.place if place is None else place
        self.budget.spend(sum(group.size for group in self.groups[:stop]))
        own = self.state() if state is None else state
        for group in self.groups[:stop]:
            restore(own, (group.observation, *group.decisions))
        return own

    def weight(self, run: Run | None) -> Weight:
        """Return what a run says for its hypothesis."""
        if run is None or 2 * len(run.differing) > len(self.baseline.differing) - 1:
            return Weight.NOTHING
        return Weight.STEP if run.differing else Weight.WHOLE

    def held(self, weight: Weight) -> str:
        """Return how far an explanation was seen to hold, in words."""
        if weight >= Weight.FITTED:
            return "the rest of the flight too" if self.ends else f"and the {len(self.groups)} steps around it"
        return "but not everything behind it"


def came_out(state: State, group: Group) -> bool:
    """Decide a step again; return whether it comes out as recorded, and go on from what was recorded."""
    made = step(state, group.observation).records
    if not group.logged or same(made[1:], group.decisions):
        return True
    state.journal.rollback()
    try:
        restore(state, (group.observation, *group.decisions))
    except Exception:  # noqa: BLE001 - a forged decision may break any chart; that it differs is known already
        state.journal.rollback()
        step(state, group.observation)
    return False


def same(made: Sequence[Record], recorded: Sequence[Record]) -> bool:
    """Whether decisions are the same, byte for byte."""
    return len(made) == len(recorded) and all(map(_equal, made, recorded))


def _equal(one: Record, other: Record) -> bool:
    return (
        one.body == other.body
        and one.kind.number == other.kind.number
        and one.seq == other.seq
        and one.cause == other.cause
        and one.at == other.at
        and one.version == other.version
    )


def copied(state: State) -> State:
    """Return a state of its own with the same rows, which are frozen."""
    fresh = State()
    for name in state.__slots__:
        if name == "journal":
            continue
        old, new = getattr(state, name), getattr(fresh, name)
        if isinstance(old, Keyed):
            for key, row in old.items():
                new.put(key, row)
        else:
            new.set(old.value)
    fresh.journal.clear()
    return fresh


def with_message(record: Record, message: Message) -> Record:
    """Return a record that says something else; its stored body stays what it was."""
    return replace(record, message=message)


def copy_of(message: Message) -> Message:
    """Return a message of its own."""
    fresh = type(message)()
    fresh.CopyFrom(message)
    return fresh


def _manifest(reader: Reader, lifting: Lifting) -> FlightOpened:
    opened = lifting.read(next(iter(reader.stored(0, 1)))).message
    assert isinstance(opened, FlightOpened)
    return opened


def _observation_of(reader: Reader, seq: int) -> int:
    """Return the observation whose step the decision `seq` lies in, or would lie in behind the last one."""
    return _begin_of(reader, max(seq - 1, 0))


def _begin_of(reader: Reader, seq: int) -> int:
    """Return the newest observation at or before a record; the first record where there is none."""
    size = 64
    while seq > 0:
        rows = list(reader.stored(max(seq - size + 1, 0), seq + 1))
        for row in reversed(rows):
            if row.kind_number in _OBSERVATIONS:
                return row.seq
        seq -= size
    return 0
