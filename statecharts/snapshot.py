"""Snapshots of the state: a chunk holds the rows that changed since the one that it rests on, as bytes.

A snapshot is a chunk and all that it rests on, merged. It is a cache and nothing else: `load` takes the digest of what
it loaded, and whoever uses it holds that against what was signed of the state when the log was so long. So a row that
was changed, left out or never written makes a snapshot useless, not wrong. Nothing is read or written here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import msgspec

from events.tree import Peaks
from statecharts.charts.mapping import grid_of
from statecharts.codec import COLUMNS, LAYOUT, RowBroken, read_rows, table_of
from statecharts.digest import Rows, StateDigest, sums_of
from statecharts.state import State


class SnapshotUnfit(ValueError):
    """A snapshot can't be used; the text says why."""


class Chunk(NamedTuple):
    """What is written at once."""

    size: int  # the state is that after so many records
    base: int  # size of the chunk that this one rests on; 0: on none
    software: bytes  # `codec.software_digest` of whoever wrote it
    leaf: bytes  # of the last of these records
    peaks: tuple[bytes, ...]  # of the tree over their leaves
    side: bytes  # what the shell wants to know again; nothing that decides reads it
    tables: dict[str, tuple[list[bytes], list[bytes]]]  # keys, and rows; an empty row is gone


class Loaded(NamedTuple):
    """A state as it was, and its digest."""

    state: State
    digest: StateDigest


class Vouched(NamedTuple):
    """What log and checkpoint say of so many records."""

    leaf: bytes  # of the last of them, as it lies in the log
    root: bytes  # of the tree over them, as it was signed
    layout: bytes  # of the state's digest
    digest: bytes  # of the state, as it was signed


_ENCODER = msgspec.msgpack.Encoder()
_DECODER = msgspec.msgpack.Decoder(Chunk)


def pack(chunk: Chunk) -> bytes:
    """Return a chunk as bytes."""
    return _ENCODER.encode(chunk)


def unpack(data: bytes) -> Chunk:
    """Read a chunk. Raises SnapshotUnfit."""
    try:
        return _DECODER.decode(data)
    except msgspec.DecodeError as error:
        raise SnapshotUnfit(f"this is no chunk of a snapshot: {error}") from error


def tables_of(rows: Rows) -> dict[str, tuple[list[bytes], list[bytes]]]:
    """Return rows as a chunk holds them."""
    return {name: (list(table), list(table.values())) for name, table in rows.items() if table}


def merge_into(rows: Rows, newer: Rows) -> None:
    """Let newer rows take the place of older ones; those that are gone stay, as empty ones."""
    for name, table in newer.items():
        rows.setdefault(name, {}).update(table)


def merged(chunks: Sequence[Chunk]) -> Rows:
    """Return the rows of a snapshot from its chunks, the one that rests on nothing first. Raises SnapshotUnfit."""
    rows: Rows = {column.name: {} for column in COLUMNS}
    for chunk in chunks:
        for name, (keys, table) in chunk.tables.items():
            if name not in rows or len(keys) != len(table):
                raise SnapshotUnfit(f"there is no such table as {name}, or its keys and rows do not pair")
            rows[name].update(zip(keys, table, strict=True))
    return {name: _present(table) for name, table in rows.items()}


def _present(table: dict[bytes, bytes]) -> dict[bytes, bytes]:
    return table if all(table.values()) else {key: row for key, row in table.items() if row}


def load(chunks: Sequence[Chunk]) -> Loaded:
    """Return the state of a snapshot. Raises SnapshotUnfit."""
    rows = merged(chunks)
    state = State()
    try:
        for column in COLUMNS:
            table_of(state, column.name).load(read_rows(column.name, rows[column.name]))
        _derive(state)
    except (RowBroken, LookupError) as error:
        raise SnapshotUnfit(str(error)) from error
    if state.next_seq.value != chunks[-1].size:
        raise SnapshotUnfit(f"the state is that after {state.next_seq.value} records, not {chunks[-1].size}")
    return Loaded(state, StateDigest(state, sums_of(rows)))


def _derive(state: State) -> None:
    """Make the tables that follow from others."""
    if len(state.objects):
        size_mm = state.flight.limits.same_object_mm
        state.grid.load(grid_of(state.objects.values(), size_mm).items())


def chunks_of(size: int, base_of: Mapping[int, int], read: Callable[[int], bytes], software: bytes) -> list[Chunk]:
    """Return the chunks that a snapshot of `size` records consists of, the one that rests on nothing first.

    Raises SnapshotUnfit where one is not there or was written by other software, and whatever `read` raises.
    """
    chunks: list[Chunk] = []
    while size:
        if size not in base_of or base_of[size] >= size:
            raise SnapshotUnfit(f"the chunk of {size} records is not there, or rests on a later one")
        chunk = unpack(read(size))
        if (chunk.size, chunk.base) != (size, base_of[size]):
            raise SnapshotUnfit(f"the chunk of {size} records is another one")
        if chunk.software != software:
            raise SnapshotUnfit("it was written by software of another logic, layout or schema")
        chunks.append(chunk)
        size = chunk.base
    return chunks[::-1]


def restore_state(chunks: Sequence[Chunk], vouched: Vouched) -> Loaded:
    """Return the state of a snapshot that is what log and checkpoint say. Raises SnapshotUnfit."""
    top = chunks[-1]
    if top.leaf != vouched.leaf:
        raise SnapshotUnfit(f"it is of another log: record {top.size - 1} has another leaf")
    if vouched.layout != LAYOUT:
        raise SnapshotUnfit("the state was signed in another layout")
    try:
        root = Peaks(top.size, top.peaks).root()
    except ValueError as error:
        raise SnapshotUnfit(str(error)) from error
    if root != vouched.root:
        raise SnapshotUnfit(f"it is of another log: the first {top.size} records have another root")
    loaded = load(chunks)
    if loaded.digest.value != vouched.digest:
        raise SnapshotUnfit(f"the state that it holds is not the one that was signed after {top.size} records")
    return loaded
