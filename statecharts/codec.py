"""The state as bytes: every row of every table in one canonical form, and back.

A row and its key are MessagePack, written in the shortest form that there is, tuples as arrays in the order of their
fields; a message inside a row is its protobuf encoding. Equal rows are equal bytes on every machine, which is what the
state's digest is made of (`digest`) and what a snapshot keeps (`snapshot`). What a table holds is said here once more,
so that bytes are only ever read as what they should be; a test holds it against the slots of `State`.

The grid is left out: it follows from the objects. So are the journal and everything that is only quicker.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from hashlib import sha256
from types import UnionType
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

import msgspec
from google.protobuf.message import DecodeError, Message

from events.kinds import FAMILIES, UnknownKind
from events.records import BodyBroken, Moment, Record, Stored, read_record
from events.schema import state_pb2
from events.schema.mission_pb2 import MissionPlanned
from statecharts.charts import CHARTS
from statecharts.facts import (
    Aim,
    Arrival,
    Camera,
    Control,
    Effect,
    Gimbal,
    Ignored,
    Lens,
    Manifest,
    MapObject,
    Mission,
    Order,
    Poi,
    Scan,
    Selftest,
    Spot,
    Trusted,
    Vehicle,
)
from statecharts.state import State
from statecharts.table import rows_text

LAYOUT_BYTES = 4
# Begins what MessagePack has no form for (no value of it begins so): integers beyond 64 bits, written as text.
_WIDE = b"\xc1"
_NARROWEST, _WIDEST = -(1 << 63), (1 << 64) - 1


class RowBroken(ValueError):
    """These bytes are no row of this table."""


class _Frame(NamedTuple):
    """A record as a row: its message is read from the body again."""

    seq: int
    cause: int
    at: Moment
    kind_number: int
    version: int
    body: bytes


@dataclass(frozen=True, slots=True)
class Column:
    """What one table of the state holds, as types to read it by. A single value has the key None."""

    name: str
    key: Any
    row: Any


def _single(name: str, row: Any) -> Column:
    return Column(name, None, row)


# In the order of their names, as all that is made of them.
COLUMNS: tuple[Column, ...] = (
    Column("aims", str, Aim),
    _single("arrival", Arrival | None),
    Column("cameras", str, Camera),
    Column("controls", str, Control),
    Column("deadlines", tuple[str, str], int),
    Column("effects", int, Effect),
    _single("failures", tuple[int, ...]),
    _single("forgot_ns", int),
    _single("frame", _Frame | None),
    Column("gimbals", str, Gimbal),
    _single("health", str),
    Column("ignored", str, Ignored),
    Column("lenses", str, Lens),
    Column("lists", bytes, tuple[int, bytes]),
    _single("manifest", Manifest | None),
    Column("missions", int, Mission),
    _single("next_seq", int),
    Column("nonces", tuple[bytes, bytes], int),
    Column("objects", int, MapObject),
    Column("open_pois", str, None),
    Column("order_seqs", bytes, int),
    Column("orders", str, Order),
    _single("origin", Spot | None),
    Column("owed_acks", int, str),
    Column("plans", int, MissionPlanned),
    Column("pois", str, Poi),
    Column("scans", str, Scan),
    Column("selftests", int, Selftest),
    _single("surfacings", tuple[int, ...]),
    _single("trusted", Trusted),
    Column("vehicles", int, Vehicle),
)
DERIVED = ("grid",)


def _plain(value: Any) -> Any:
    if isinstance(value, Message):
        return value.SerializeToString(deterministic=True)
    raise NotImplementedError(f"no row holds a {type(value).__name__}")


def _message(kind: Any, data: Any) -> Any:
    if not isinstance(data, bytes):
        raise ValueError(f"a {kind.__name__} is bytes")
    return kind.FromString(data)


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_plain, order="deterministic")


def encode(value: Any) -> bytes:
    """Return the canonical bytes of a key or a row."""
    if isinstance(value, Record):
        value = _Frame(value.seq, value.cause, value.at, value.kind.number, value.version, value.body)
    try:
        return _ENCODER.encode(value)
    except OverflowError:  # only what somebody forged holds such numbers; there must be bytes for it all the same
        return _WIDE + _ENCODER.encode(_narrow(value))


def _narrow(value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(map(_narrow, value))
    wide = isinstance(value, int) and not _NARROWEST <= value <= _WIDEST
    return str(value) if wide else value


def _reader(kind: Any) -> Callable[[bytes], Any]:
    return msgspec.msgpack.Decoder(kind, dec_hook=_message).decode


_READERS = {column.name: (_reader(column.key), _reader(column.row)) for column in COLUMNS}


def read_rows(name: str, rows: dict[bytes, bytes]) -> list[tuple[Any, Any]]:
    """Return the keys and rows of a table from their bytes. Raises RowBroken."""
    read_key, read_row = _READERS[name]
    try:
        values = map(read_row, rows.values())
        return list(zip(map(read_key, rows), map(_record, values) if name == "frame" else values, strict=True))
    except (msgspec.DecodeError, msgspec.ValidationError, DecodeError, UnknownKind, BodyBroken) as error:
        raise RowBroken(f"{name}: {error}") from error


def _record(frame: _Frame | None) -> Record | None:
    return None if frame is None else read_record(Stored(*frame, leaf=b""))


def table_of(state: State, name: str) -> Any:
    """Return a table of the state by its name."""
    return getattr(state, name)


def _shape(kind: Any) -> str:
    """Return a type as text: names of fields and what they hold, down to what every language knows."""
    if kind is None or kind is type(None):
        return "none"
    if isinstance(kind, UnionType):
        return " or ".join(map(_shape, get_args(kind)))
    if (origin := get_origin(kind)) is not None:
        return f"{origin.__name__}[{', '.join('...' if one is ... else _shape(one) for one in get_args(kind))}]"
    if is_dataclass(kind) or (issubclass(kind, tuple) and hasattr(kind, "_fields")):
        hints = get_type_hints(kind)
        names = [field.name for field in fields(kind)] if is_dataclass(kind) else list(kind._fields)
        return f"{kind.__name__}({', '.join(f'{name} {_shape(hints[name])}' for name in names)})"
    return str(kind.__name__)


def layout_text() -> str:
    """Return what the tables hold, one a line: what `LAYOUT` is the name of."""
    return "".join(f"{column.name}: {_shape(column.key)} to {_shape(column.row)}\n" for column in COLUMNS)


# Digests of states are comparable where their layouts are the same.
LAYOUT: bytes = sha256(layout_text().encode()).digest()[:LAYOUT_BYTES]


def software_digest(logic: int) -> bytes:
    """Return what must be the same for a snapshot to be used: layout, schema, rows of the charts, logic number."""
    digest = sha256(f"{layout_text()}logic {logic}\n{rows_text(CHARTS)}".encode())
    for family in (*FAMILIES, state_pb2):
        digest.update(family.DESCRIPTOR.serialized_pb)
    return digest.digest()
