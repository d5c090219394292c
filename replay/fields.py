"""Where two messages of one kind differ: the path of the first field and both values. It judges nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message

ABSENT = "absent"


class FieldDifference(NamedTuple):
    """A field that differs, as "place.latitude_e7" or "sightings[2].diff"."""

    path: str
    recorded: str
    replayed: str


def first_difference(recorded: Message, replayed: Message) -> FieldDifference | None:
    """Return the first field, in the order of the schema, that differs; None where all are equal."""
    for field in cast(Sequence[FieldDescriptor], recorded.DESCRIPTOR.fields):
        found = _repeated(field, recorded, replayed) if field.is_repeated else _single(field, recorded, replayed)
        if found is not None:
            return found
    return None


def _single(field: FieldDescriptor, recorded: Message, replayed: Message) -> FieldDifference | None:
    has = recorded.HasField(field.name), replayed.HasField(field.name)
    if has == (True, True):
        return _values(field, field.name, getattr(recorded, field.name), getattr(replayed, field.name))
    if has == (False, False):
        return None
    if has[0]:
        return FieldDifference(field.name, _shown(field, getattr(recorded, field.name)), ABSENT)
    return FieldDifference(field.name, ABSENT, _shown(field, getattr(replayed, field.name)))


def _repeated(field: FieldDescriptor, recorded: Message, replayed: Message) -> FieldDifference | None:
    one, other = getattr(recorded, field.name), getattr(replayed, field.name)
    for index, (mine, theirs) in enumerate(zip(one, other, strict=False)):
        found = _values(field, f"{field.name}[{index}]", mine, theirs)
        if found is not None:
            return found
    if len(one) != len(other):
        return FieldDifference(field.name, f"{len(one)} entries", f"{len(other)} entries")
    return None


def _values(field: FieldDescriptor, path: str, recorded: object, replayed: object) -> FieldDifference | None:
    if isinstance(recorded, Message) and isinstance(replayed, Message):
        found = first_difference(recorded, replayed)
        return None if found is None else found._replace(path=f"{path}.{found.path}")
    if recorded == replayed:
        return None
    return FieldDifference(path, _shown(field, recorded), _shown(field, replayed))


def _shown(field: FieldDescriptor, value: object) -> str:
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, Message):
        return " ".join(str(value).split()) or "empty"
    if field.enum_type is not None and isinstance(value, int):
        named = field.enum_type.values_by_number.get(value)
        return str(value) if named is None else named.name
    return repr(value) if isinstance(value, str) else str(value)
