"""Whether it is an upcast.

Records that were lifted from an older version are read in other ways, and the flight run again.

Each kind that was lifted by itself: not lifted at all, then one field of it at a time taken from the body as it was
stored, left out, scaled, negated, or exchanged with another. Where none of that explains the step, but the step
changes with what was lifted, the upcast is suspected and no more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations
from typing import NamedTuple

from google.protobuf.message import Message

from events import Record
from replay.blame.again import said
from replay.blame.case import Case, Group, Lifting, Spent, copy_of, with_message
from replay.blame.findings import Cause, Finding, Weight
from replay.blame.search import Best
from statecharts import State

SCALES = ((10, 1), (1, 10), (100, 1), (1, 100), (1000, 1), (1, 1000), (-1, 1), (2, 1), (1, 2))
Path = tuple[str, ...]  # names of fields, from the message down to a scalar
Change = Callable[[Message, Message], None]  # changes the lifted message in place; the unlifted one is the second


class Reading(NamedTuple):
    """Another way to read a kind."""

    words: str
    change: Change


def upcast(case: Case) -> Finding:
    """Read what was lifted in other ways; return the way that explains most."""
    search = _Search(case)
    try:
        search.all()
    except Spent:
        search.best.stopped = True
    return search.finding()


class _Search:
    """Tries readings, one kind at a time."""

    def __init__(self, case: Case) -> None:
        self.case, self.best = case, Best()
        self.part: list[str] = []  # what the step changes with
        self.kinds: list[str] = []

    def finding(self) -> Finding:
        """Return what it came to."""
        best, kinds = self.best, ", ".join(self.kinds)
        if not self.kinds:
            return Finding(Cause.UPCAST, Weight.NOT_APPLICABLE, "nothing that the step can depend on was lifted")
        if best.weight is Weight.NOTHING and self.part:
            words = f"{kinds} was lifted and the step changes with {self.part[0]}, but no other reading explains it"
            return Finding(Cause.UPCAST, Weight.SUSPECTED, words, best.tried, best.stopped)
        return best.finding(Cause.UPCAST, f"{kinds} was lifted, but the step does not change with how it is read")

    def all(self) -> None:
        """Try everything. Raises Spent."""
        samples = _lifted(self.case)
        self.kinds = list(samples)
        ours, recorded = self.case.decided(), said(self.case.group.decisions)
        for kind, sample in samples.items():
            stored = self.case.lifting.unlifted(sample)
            assert stored is not None
            for reading in _readings(kind, sample, stored):
                change = _reader(self.case.lifting, kind, reading.change)
                self.best.tried += 1
                there = self.case.decided(change)
                if there != ours:
                    self.part.append(reading.words)
                if there == recorded and self._take(reading, change):
                    return

    def _take(self, reading: Reading, change: Callable[[Record], Record]) -> bool:
        groups = [changed(group, change) for group in (*self.case.prefix(self.case.start), *self.case.groups)]
        weight = self.case.weight(self.case.run(groups, State()))
        if weight > self.best.weight:
            words = f"with {reading.words} the step comes out as recorded, {self.case.held(weight)}"
            self.best.weight, self.best.words = weight, words
        return weight is Weight.WHOLE


def changed(group: Group, change: Callable[[Record], Record]) -> Group:
    """Return a step with every record read otherwise."""
    return group._replace(
        observation=change(group.observation), decisions=tuple(change(record) for record in group.decisions)
    )


def _lifted(case: Case) -> dict[str, Record]:
    """Return the newest lifted record of each kind up to the step."""
    found: dict[str, Record] = {}
    for group in (*case.prefix(case.seq), case.group):
        for record in (group.observation, *group.decisions):
            if case.lifting.unlifted(record) is not None:
                found[record.kind.name] = record
    return found


def _reader(lifting: Lifting, kind: str, change: Change) -> Callable[[Record], Record]:
    def read(record: Record) -> Record:
        unlifted = lifting.unlifted(record) if record.kind.name == kind else None
        if unlifted is None:
            return record
        message = copy_of(record.message)
        try:
            change(message, unlifted)
        except (ValueError, TypeError):  # out of the field's range: it can't have been read so
            return record
        return with_message(record, message)

    return read


def _readings(kind: str, sample: Record, stored: Message) -> Iterator[Reading]:
    yield Reading(f"{kind} as it was stored", lambda message, stored: message.CopyFrom(stored))
    paths = list(dict.fromkeys([*_paths(sample.message), *_paths(stored)]))
    for path in paths:
        name = f"{kind}.{'.'.join(path)}"
        yield Reading(f"{name} as it was stored", _restored(path))
        yield Reading(f"{name} left out", _left_out(path))
        if type(_value(sample.message, path)) is bool:
            yield Reading(f"{name} turned round", _turned(path))
            yield Reading(f"{name} as it was stored, turned round", _turned(path, stored=True))
        if _is_number(sample.message, path):
            for up, down in SCALES:
                scale = f"times {up}" + f"/{down}" * (down > 1)
                yield Reading(f"{name} {scale}", _scaled(path, up, down))
                yield Reading(f"{name} as it was stored, {scale}", _scaled(path, up, down, stored=True))
    for one, other in combinations([path for path in paths if _is_number(sample.message, path)], 2):
        if one[:-1] == other[:-1]:
            yield Reading(f"{kind}.{'.'.join(one)} and {other[-1]} exchanged", _exchanged(one, other))


def _paths(message: Message) -> Iterator[Path]:
    """Yield the paths of the scalars that are set; of lists of messages, those of the first entry."""
    for field, value in message.ListFields():
        first = value[0] if field.is_repeated else value
        if isinstance(first, Message):
            yield from ((field.name, *path) for path in _paths(first))
        elif not field.is_repeated:
            yield (field.name,)


def _parents(message: Message, path: Path) -> list[Message]:
    """Return the messages that hold the last field of a path: one for each entry of the lists on the way."""
    if len(path) == 1:
        return [message]
    below = getattr(message, path[0])
    entries = [below] if isinstance(below, Message) else list(below)
    return [parent for entry in entries for parent in _parents(entry, path[1:])]


def _value(message: Message, path: Path) -> object:
    return getattr(_parents(message, path)[0], path[-1])


def _is_number(message: Message, path: Path) -> bool:
    return type(_value(message, path)) is int


def _restored(path: Path) -> Change:
    def change(message: Message, stored: Message) -> None:
        for parent, old in zip(_parents(message, path), _parents(stored, path), strict=False):
            if old.HasField(path[-1]):
                setattr(parent, path[-1], getattr(old, path[-1]))
            else:
                parent.ClearField(path[-1])

    return change


def _left_out(path: Path) -> Change:
    def change(message: Message, _stored: Message) -> None:
        for parent in _parents(message, path):
            parent.ClearField(path[-1])

    return change


def _scaled(path: Path, up: int, down: int, *, stored: bool = False) -> Change:
    def change(message: Message, old: Message) -> None:
        if stored:
            _restored(path)(message, old)
        for parent in _parents(message, path):
            if parent.HasField(path[-1]):
                setattr(parent, path[-1], getattr(parent, path[-1]) * up // down)

    return change


def _turned(path: Path, *, stored: bool = False) -> Change:
    def change(message: Message, old: Message) -> None:
        if stored:
            _restored(path)(message, old)
        for parent in _parents(message, path):
            setattr(parent, path[-1], not getattr(parent, path[-1]))

    return change


def _exchanged(one: Path, other: Path) -> Change:
    def change(message: Message, _stored: Message) -> None:
        for parent in _parents(message, one):
            first, second = getattr(parent, one[-1]), getattr(parent, other[-1])
            setattr(parent, one[-1], second)
            setattr(parent, other[-1], first)

    return change
