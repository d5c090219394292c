"""Folding a redacted copy: only steps that are whole are folded, and what is left out is named.

A step is an observation and the decisions on it; half of one would be read as something else than what happened. A
step that rests on a removed one may say nothing that a fold can place: its record is named, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from events.kinds import Role, kind_numbered
from events.records import Record, Stored, read_record


@dataclass(slots=True)
class Left:
    """Records that a fold of a redacted copy does without. It grows while the copy is read."""

    removed: list[int] = field(default_factory=list)  # their bodies are not there
    left_out: list[int] = field(default_factory=list)  # they are there, and can't be placed without those


def whole_steps(log: Iterable[Stored], left: Left) -> Iterator[Record]:
    """Yield the records of the steps of which nothing was removed, and note the others.

    Raises UnknownKind and BodyBroken for what can't be read for another reason.
    """
    step: list[Stored] = []
    for stored in log:
        if kind_numbered(stored.kind_number).role is Role.OBSERVATION:
            yield from _whole(step, left)
            step = []
        step.append(stored)
    yield from _whole(step, left)


def _whole(step: list[Stored], left: Left) -> Iterator[Record]:
    if any(stored.removed for stored in step):
        for stored in step:
            (left.removed if stored.removed else left.left_out).append(stored.seq)
    else:
        yield from map(read_record, step)
