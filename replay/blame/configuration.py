"""Whether it is the configuration: one limit changed, the flight decided again from its beginning.

For each limit a few far values first: a limit with which the step does not change has no part in it. For those that
have, values that the records imply (numbers in the decisions, spans of time between records), a ladder of multiples,
and the middle between neighbours of the ladder that lead to different decisions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from typing import Any

from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message

from events import Record
from events.schema.flight_pb2 import FlightOpened, Limits, TimePassed
from events.schema.orders_pb2 import OrderReceived
from replay.blame.again import Decisions, said
from replay.blame.case import Case, Spent, copy_of, with_message
from replay.blame.findings import Cause, Finding, Weight
from replay.blame.search import Best
from statecharts import State

NS_PER_MS = 1_000_000
LADDER = (
    (0, 1),
    (1, 100),
    (1, 10),
    (1, 4),
    (1, 2),
    (3, 4),
    (9, 10),
    (11, 10),
    (5, 4),
    (3, 2),
    (2, 1),
    (4, 1),
    (100, 1),
)
FAR = ((0, 1), (1, 2), (2, 1), (1000, 1))
HALVINGS = 8  # of the gap between two neighbours that lead to different decisions
FITS = 16  # values of one limit with which the step comes out, and the whole flight is run
LATE_NS = 100_000_000  # time is told within a commit of when it is asked for; later, it was not asked for so
SPANS = 24  # spans of time that the records imply, for one limit
_FIELDS = {field.name: field for field in Limits.DESCRIPTOR.fields}
_MOST = {FieldDescriptor.TYPE_UINT32: 2**32 - 1, FieldDescriptor.TYPE_SINT32: 2**31 - 1}


def configuration(case: Case) -> Finding:
    """Try every limit; return the one that explains most."""
    search = _Search(case)
    try:
        search.all()
    except Spent:
        search.best.stopped = True
    return search.best.finding(Cause.CONFIGURATION, search.otherwise())


class _Search:
    """Tries limits, one at a time."""

    def __init__(self, case: Case) -> None:
        self.case, self.best = case, Best()
        self.limits = case.manifest.configuration.limits
        self.recorded = said(case.group.decisions)
        self.ours = case.decided()
        self.part: list[str] = []

    def otherwise(self) -> str:
        """Return what was tried in vain."""
        has = f"; {', '.join(self.part)} has a part in the step" if self.part else ": none has a part in the step"
        return f"{len(_FIELDS)} limits, each changed alone, {self.best.tried} values{has}"

    def all(self) -> None:
        """Try every limit until one explains everything. Raises Spent."""
        for name, field in _FIELDS.items():
            values = self._far(name, field)
            answers = [(value, self._answer(name, value)) for value in values]
            if all(answer == self.ours for _, answer in answers):
                continue
            self.part.append(name)
            if self._whole(name, field):
                return

    def _far(self, name: str, field: FieldDescriptor) -> list[Any]:
        value = getattr(self.limits, name)
        if field.type == FieldDescriptor.TYPE_BOOL:
            return [not value]
        if field.is_repeated:
            return list(self._lists(value))
        return _fitting(field, [value * up // down for up, down in FAR] + [1])

    def _lists(self, value: Iterable[str]) -> Iterator[list[str]]:
        asked = self.case.group.observation.message
        roles = list(asked.issuer.roles) if isinstance(asked, OrderReceived) else []
        yield sorted(dict.fromkeys([*value, *roles]))
        yield [role for role in value if role not in roles]

    def _whole(self, name: str, field: FieldDescriptor) -> bool:
        """Return whether some value of a limit makes everything come out."""
        fits = [value for value in self._values(name, field) if self._answer(name, value) == self.recorded]
        for value in fits[:FITS]:
            weight = self._take(name, value)
            near = _rounded(value) if weight is Weight.FITTED and not _round(value) else ()
            if weight is Weight.WHOLE or any(self._take(name, one) is Weight.WHOLE for one in near):
                return True
        return False

    def _values(self, name: str, field: FieldDescriptor) -> Iterator[Any]:
        """Yield values for a limit that has a part in the step, the likeliest first."""
        value = getattr(self.limits, name)
        if field.is_repeated or field.type == FieldDescriptor.TYPE_BOOL:
            yield from self._far(name, field)
            return
        small = range(12) if value <= 12 else ()
        spans = self._spans() if name.endswith("_ms") else ()
        yield from _fitting(field, [*self._implied(), *small, *spans, value - 1, value + 1])
        ladder = sorted(_fitting(field, [value * up // down for up, down in LADDER]))
        yield from ladder
        for low, high in pairwise(ladder):
            yield from self._between(name, low, high)

    def _between(self, name: str, low: int, high: int) -> Iterator[int]:
        """Yield values between two that lead to different decisions, towards where it changes."""
        below, above = self._answer(name, low), self._answer(name, high)
        for _ in range(HALVINGS):
            if below == above or high - low < 2:
                return
            middle = (low + high) // 2
            yield middle
            found = self._answer(name, middle)
            if found == below:
                low = middle
            else:
                high, above = middle, found

    def _implied(self) -> Iterator[int]:
        for decision in self.case.group.decisions:
            yield from _numbers(decision.message)

    def _spans(self) -> list[int]:
        """Return spans of time between the step and records before it, in milliseconds, the nearest first."""
        now_ns = self.case.group.observation.at.flight_ns
        before = [group.observation.at.flight_ns for group in self.case.groups[: self.case.place] if group.decisions]
        spans = dict.fromkeys((now_ns - at_ns) // NS_PER_MS for at_ns in reversed(before))
        return list(spans)[:SPANS]

    def _answer(self, name: str, value: Any) -> Decisions | str:
        """Return what the step comes to with one limit changed."""
        self.best.tried += 1
        return self.case.decided(_under(_with(self.limits, name, value)))

    def _take(self, name: str, value: Any) -> Weight:
        """Take a value in that makes the step come out; return what it says."""
        change = _under(_with(self.limits, name, value))
        groups = (*self.case.prefix(self.case.start), *self.case.groups)
        changed = [group._replace(observation=change(group.observation)) for group in groups]
        weight = self.case.weight(self.case.run(changed, State()))
        if weight is Weight.WHOLE and not (_round(value) and self._in_time(change)):
            weight = Weight.FITTED
        if weight > self.best.weight:
            words = f"{name} {_shown(value)} instead of {_shown(getattr(self.limits, name))}"
            self.best.weight, self.best.words = weight, f"{words}: comes out as recorded, {self.case.held(weight)}"
        return weight

    def _in_time(self, change: Callable[[Record], Record]) -> bool:
        """Whether time passed when the core would have asked for it, where the step is one of time."""
        observation = self.case.group.observation
        if not isinstance(observation.message, TimePassed):
            return True
        now_ns = observation.at.flight_ns
        passed = [at_ns for _, at_ns in self.case.before(self.case.seq, change).deadlines.items() if at_ns <= now_ns]
        return now_ns - max(passed, default=0) < LATE_NS


def _under(limits: Limits) -> Callable[[Record], Record]:
    """Return the change that puts other limits into the manifest."""

    def change(record: Record) -> Record:
        if not isinstance(record.message, FlightOpened):
            return record
        opened = copy_of(record.message)
        assert isinstance(opened, FlightOpened)
        opened.configuration.limits.CopyFrom(limits)
        return with_message(record, opened)

    return change


def _with(limits: Limits, name: str, value: Any) -> Limits:
    changed = Limits()
    changed.CopyFrom(limits)
    if isinstance(value, list):
        changed.ClearField(name)  # type: ignore[arg-type]
        getattr(changed, name).extend(value)
    else:
        setattr(changed, name, value)
    return changed


def _numbers(message: Message) -> Iterator[int]:
    """Yield the whole numbers in a message."""
    for field, value in message.ListFields():
        values = value if field.is_repeated else (value,)
        for one in values:
            if isinstance(one, Message):
                yield from _numbers(one)
            elif isinstance(one, int) and not isinstance(one, bool):
                yield one


def _fitting(field: FieldDescriptor, values: Iterable[int]) -> list[int]:
    """Return the values that fit the field, each once."""
    if field.enum_type is not None:
        return [number for number in dict.fromkeys(values) if number in field.enum_type.values_by_number]
    most = _MOST.get(field.type, 2**63 - 1)
    least = -most if field.type == FieldDescriptor.TYPE_SINT32 else 0
    return [value for value in dict.fromkeys(values) if least <= value <= most]


def _round(value: Any) -> bool:
    """Whether a person would write such a limit: two digits and zeros, or halves of thousands."""
    if not isinstance(value, int) or isinstance(value, bool):
        return True
    return value % 500 == 0 or len(str(abs(value)).rstrip("0")) <= 2


def _rounded(value: Any) -> Iterator[int]:
    """Yield round values beside one."""
    for digits in (1, 2):
        unit = 10 ** max(len(str(abs(value))) - digits, 0)
        yield from (value // unit * unit, value // unit * unit + unit)


def _shown(value: Any) -> str:
    return ", ".join(value) or "none" if not isinstance(value, (int, str)) else str(value)
