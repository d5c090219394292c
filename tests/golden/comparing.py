"""Holds two logs, or a log and what it is decided to again, against each other: field by field, then the bytes.

Written apart from `replay.verify` and `replay.fields`, which it is there to judge. Nothing is left out and nothing is
nearly equal.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from google.protobuf.message import Message

from events import Record, read_record
from events.records import Stored

COLUMNS = ("seq", "cause", "at", "kind_number", "version", "body", "leaf")
DECIDED = COLUMNS[:-1]  # what is decided again has no leaf yet


def differences(mine: Sequence[Stored], theirs: Sequence[Stored]) -> Iterator[str]:
    """Yield every difference between two logs, leaves included."""
    yield from _different_rows(mine, theirs, COLUMNS)


def undecided(recorded: Sequence[Stored], replayed: Sequence[Record]) -> Iterator[str]:
    """Yield every difference between a log and the records of its steps decided again."""
    again = [Stored(one.seq, one.cause, one.at, one.kind.number, one.version, one.body, b"") for one in replayed]
    yield from _different_rows(recorded, again, DECIDED)


def _different_rows(mine: Sequence[Stored], theirs: Sequence[Stored], columns: Sequence[str]) -> Iterator[str]:
    if len(mine) != len(theirs):
        yield f"{len(mine)} records, not {len(theirs)}"
    for one, other in zip(mine, theirs, strict=False):
        if (one.kind_number, one.version) == (other.kind_number, other.version):
            for path, left, right in _different_fields(read_record(one).message, read_record(other).message):
                yield f"{one.seq} {path}: {left!r}, not {right!r}"
        for column in columns:
            left, right = getattr(one, column), getattr(other, column)
            if left != right:
                yield f"{one.seq} {column}: {left!r}, not {right!r}"


def _different_fields(mine: Any, theirs: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    if isinstance(mine, Message):
        for field in mine.DESCRIPTOR.fields:
            name = f"{path}.{field.name}".lstrip(".")
            if field.has_presence and mine.HasField(field.name) != theirs.HasField(field.name):
                yield f"{name} (presence)", mine.HasField(field.name), theirs.HasField(field.name)
            yield from _different_fields(getattr(mine, field.name), getattr(theirs, field.name), name)
    elif hasattr(mine, "__len__") and not isinstance(mine, str | bytes):
        if len(mine) != len(theirs):
            yield f"{path} (length)", len(mine), len(theirs)
        for index, (one, other) in enumerate(zip(mine, theirs, strict=False)):
            yield from _different_fields(one, other, f"{path}[{index}]")
    elif mine != theirs:
        yield path, mine, theirs
