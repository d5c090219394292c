"""A catalogue with a past, for tests: two kinds that have two older versions each, and logs as those would have been.

No kind has an older version yet, so the machinery is shown on versions that never were: a gimbal's pitch once in
milli-degrees and once counted downwards, a point of interest whose object was once numbered from 0 and whose
confidence was once in millionths.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import Message

from events import Record, encode, kind_named, kinds, upcasts
from events.schema.findings_pb2 import PoiOpened
from events.schema.vehicle_pb2 import GimbalReported
from events.upcasts import Upcast

VERSIONS = (1, 2, 3)
Change = Callable[[Any], None]


def _past(message: type[Message], version: int) -> type[Message]:
    """Return a class of the same fields under another name, as an old message is kept in the schema."""
    descriptor = message.DESCRIPTOR
    name = f"{descriptor.name}V{version}"
    file = descriptor_pb2.FileDescriptorProto(
        name=f"tests/{name}.proto",
        package="tests",
        dependency=[descriptor.file.name],
        syntax="editions",
        edition=descriptor_pb2.EDITION_2023,
    )
    shape = file.message_type.add()
    descriptor.CopyToProto(shape)
    shape.name = name
    shape.ClearField("options")
    pool = descriptor_pool.Default()
    pool.Add(file)
    found: type[Message] = message_factory.GetMessageClass(pool.FindMessageTypeByName(f"tests.{name}"))
    return found


def as_shape(shape: type[Message], message: Message, change: Change) -> Message:
    """Return the message in another shape of the same fields, changed."""
    made = shape.FromString(encode(message))
    change(made)
    return made


def _counted_up(gimbal: Any) -> None:
    gimbal.pitch_cdeg = -gimbal.pitch_cdeg


def _to_centidegrees(gimbal: Any) -> None:
    gimbal.pitch_cdeg = gimbal.pitch_cdeg // 10


def _to_millidegrees(gimbal: Any) -> None:
    gimbal.pitch_cdeg = gimbal.pitch_cdeg * 10


def _from_one(poi: Any) -> None:
    poi.object += 1


def _from_zero(poi: Any) -> None:
    poi.object -= 1


def _to_e4(poi: Any) -> None:
    poi.confidence_e4 //= 100


def _to_e6(poi: Any) -> None:
    poi.confidence_e4 *= 100


_SHAPES: dict[str, tuple[type[Message], ...]] = {
    "gimbal_reported": (_past(GimbalReported, 1), _past(GimbalReported, 2), GimbalReported),
    "poi_opened": (_past(PoiOpened, 1), _past(PoiOpened, 2), PoiOpened),
}
_LIFTS: dict[str, tuple[Change, ...]] = {
    "gimbal_reported": (_to_centidegrees, _counted_up),
    "poi_opened": (_to_e4, _from_one),
}
_LOWERS: dict[str, tuple[Change, ...]] = {
    "gimbal_reported": (_to_millidegrees, _counted_up),
    "poi_opened": (_to_e6, _from_zero),
}


def steps() -> tuple[Upcast, ...]:
    """Return the upcasts of both kinds."""
    return tuple(_step(kind, version) for kind in _SHAPES for version in VERSIONS[:-1])


def _step(kind: str, version: int) -> Upcast:
    following, change = _SHAPES[kind][version], _LIFTS[kind][version - 1]
    return Upcast(kind, version, _SHAPES[kind][version - 1], lambda message: as_shape(following, message, change))


def give_a_past(monkeypatch: pytest.MonkeyPatch, upcasts_of: Iterable[Upcast] | None = None) -> None:
    """Let both kinds be of version 3 from here on, with these upcasts."""
    for name in _SHAPES:
        kind = replace(kind_named(name), version=VERSIONS[-1])
        monkeypatch.setitem(kinds._BY_NUMBER, kind.number, kind)
        monkeypatch.setitem(kinds._BY_NAME, kind.name, kind)
        monkeypatch.setitem(kinds._BY_MESSAGE, kind.message, kind)
    for upcast in steps() if upcasts_of is None else upcasts_of:
        monkeypatch.setitem(upcasts.LADDER, (upcast.kind, upcast.version), upcast)


def as_recorded_by(version: int, record: Record) -> Record:
    """Return the record as a node would have written it that knew both kinds in this version."""
    name = record.kind.name
    if name not in _SHAPES:
        return record
    message = record.message
    for below in range(VERSIONS[-1] - 1, version - 1, -1):
        message = as_shape(_SHAPES[name][below - 1], message, _LOWERS[name][below - 1])
    return replace(record, version=version, body=encode(message))
