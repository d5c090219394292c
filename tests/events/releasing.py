"""`python -m tests.events.releasing`: write down what this version of the schema says, for every version after it.

Beside this file, in `released/`: `schema.json`, every field and enumeration value that an event may hold, and one file
for every version of every kind with sample bodies, what they say, and their leaves. It only adds: what is there
already was released, is on disks, and is never written again. The samples come from a seed, all fields set.
"""

from __future__ import annotations

import json
import random
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.json_format import MessageToDict
from google.protobuf.message import Message

from events import KINDS, NO_CAUSE, Chain, Kind, Moment, encode
from events.kinds import FAMILIES

RELEASED = Path(__file__).with_name("released")
SCHEMA = RELEASED / "schema.json"
# Every leaf of a sample is the first of this flight, so that a leaf depends on nothing but its sample.
FLIGHT_ID, SECRET, AT = bytes(range(16)), bytes(range(32)), Moment(1, 2, 3, 4, 2)
BITS = {
    FieldDescriptor.CPPTYPE_INT32: (-(2**31), 2**31 - 1),
    FieldDescriptor.CPPTYPE_INT64: (-(2**63), 2**63 - 1),
    FieldDescriptor.CPPTYPE_UINT32: (1, 2**32 - 1),
    FieldDescriptor.CPPTYPE_UINT64: (1, 2**64 - 1),
    FieldDescriptor.CPPTYPE_BOOL: (1, 1),
}


def fixture_of(kind: Kind) -> Path:
    """Return where the samples of a kind's present version lie."""
    return RELEASED / f"{kind.name}.v{kind.version}.json"


def leaf_of(number: int, version: int, body: bytes) -> bytes:
    """Return the leaf of a sample."""
    return Chain(FLIGHT_ID, SECRET).extend(0, NO_CAUSE, AT, number, version, body)


def said(message: Message) -> dict[str, Any]:
    """Return what a message says, readable without this schema."""
    return MessageToDict(message, preserving_proto_field_name=True)


def samples_of(kind: Kind) -> list[dict[str, Any]]:
    """Return samples of a kind: all fields set, one sample for each arm of its oneof."""
    found = []
    for arm in range(_arms(kind.message.DESCRIPTOR)):
        message = kind.message()
        _fill(message, random.Random(f"{kind.name} {kind.version} {arm}"), arm)
        body = encode(message)
        leaf = leaf_of(kind.number, kind.version, body)
        found.append({"body": body.hex(), "leaf": leaf.hex(), "says": said(message)})
    return found


def schema() -> dict[str, dict[str, Any]]:
    """Return every message and enumeration that events are made of: fields and values by number."""
    found: dict[str, dict[str, Any]] = {}
    for kind in KINDS:
        _note(kind.message.DESCRIPTOR, found)
    return dict(sorted(found.items()))


def main() -> int:
    """Add what is not released yet; return 1 where something that was released is not the same any more."""
    RELEASED.mkdir(exist_ok=True)
    for kind in KINDS:
        if not fixture_of(kind).exists():
            made = {"kind": kind.name, "number": kind.number, "version": kind.version, "samples": samples_of(kind)}
            fixture_of(kind).write_text(json.dumps(made, indent=1, ensure_ascii=False) + "\n", "utf-8")
            print(f"released {kind.name} version {kind.version}")
    released = json.loads(SCHEMA.read_text("utf-8")) if SCHEMA.exists() else {}
    if broken := breaks(released, schema()):
        print("\n".join(broken), file=sys.stderr)
        return 1
    SCHEMA.write_text(json.dumps(schema(), indent=1) + "\n", "utf-8")
    return 0


def breaks(released: dict[str, dict[str, Any]], present: dict[str, dict[str, Any]]) -> list[str]:
    """Return what was released and is not there any more, or is something else."""
    return [
        f"{name} {number}: was {was}, is {present.get(name, {}).get(number, 'gone')}"
        for name, members in released.items()
        for number, was in members.items()
        if present.get(name, {}).get(number) != was
    ]


def families() -> set[str]:
    """Return the names of the schema files that hold kinds."""
    return {family.DESCRIPTOR.name for family in FAMILIES}


def _note(message: Any, found: dict[str, dict[str, Any]]) -> None:
    if message.full_name in found:
        return
    fields = found[message.full_name] = {}
    for field in _fields(message):
        parts = ["repeated"] * field.is_repeated + [_type_of(field), field.name]
        fields[str(field.number)] = " ".join(parts)
        if field.message_type is not None:
            _note(field.message_type, found)
        if field.enum_type is not None:
            _note_enum(field.enum_type, found)


def _note_enum(enum: Any, found: dict[str, dict[str, Any]]) -> None:
    found[enum.full_name] = {str(value.number): value.name for value in enum.values}


def _type_of(field: FieldDescriptor) -> str:
    named = field.message_type or field.enum_type
    return str(named.full_name) if named is not None else f"type {field.type}"


def _fields(message: Any) -> Sequence[FieldDescriptor]:
    fields: Sequence[FieldDescriptor] = message.fields
    return fields


def _arms(message: Any) -> int:
    return max([len(oneof.fields) for oneof in message.oneofs], default=1)


def _fill(message: Message, chance: random.Random, arm: int) -> None:
    for field in _chosen(message.DESCRIPTOR, arm):
        if field.is_repeated:
            for _ in range(2):
                _add(message, field, chance)
        elif field.message_type is not None:
            _fill(getattr(message, field.name), chance, 0)
        else:
            setattr(message, field.name, _value(field, chance))


def _chosen(message: Any, arm: int) -> Iterator[FieldDescriptor]:
    for field in _fields(message):
        if field.containing_oneof is None or field.containing_oneof.fields.index(field) == arm:
            yield field


def _add(message: Message, field: FieldDescriptor, chance: random.Random) -> None:
    entries = getattr(message, field.name)
    if field.message_type is not None:
        _fill(entries.add(), chance, 0)
    else:
        entries.append(_value(field, chance))


def _value(field: FieldDescriptor, chance: random.Random) -> Any:
    if field.enum_type is not None:
        return chance.choice([value.number for value in field.enum_type.values if value.number])
    if field.type == FieldDescriptor.TYPE_STRING:
        return "".join(chance.choices("abcXYZ09 -_/äß中✓", k=8))
    if field.type == FieldDescriptor.TYPE_BYTES:
        return chance.randbytes(6)
    low, high = BITS[field.cpp_type]
    return chance.choice((low, high, chance.randint(low, high)))


if __name__ == "__main__":
    sys.exit(main())
