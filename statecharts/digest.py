r"""A digest of the whole state that costs what has changed, not what there is.

Each row is an element: SHAKE128("<table>\0" || length of the key, u32 big-endian || key || row), 512 bytes read as
one big-endian number (`codec` says how keys and rows are written). A table is the sum of its elements modulo 2^4096,
and the state is SHA-256 over the names of all tables, in order, each with a zero byte and its sum in 512 bytes. A row
that changes takes its old element out and puts its new one in; what was there is known from the journal.

Sums of hashes of 256 bits could be forged from rows that somebody chooses, by a birthday over many of them (Wagner,
"A generalized birthday problem", 2002), in 2^32 steps; at 4096 bits that takes 2^128.
"""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import sha256, shake_128
from typing import Any

from statecharts.codec import COLUMNS, DERIVED, encode, table_of
from statecharts.journal import ABSENT
from statecharts.state import State

ELEMENT_BYTES = 512
_MASK = (1 << 8 * ELEMENT_BYTES) - 1

Rows = dict[str, dict[bytes, bytes]]  # by table and key, as `codec` writes them; a row that is gone is empty
Sums = dict[str, int]


def sums_of(rows: Rows) -> Sums:
    """Return the sum of every table that these rows are the whole of."""
    return {column.name: total(column.name, rows.get(column.name, {}).items()) for column in COLUMNS}


def total(name: str, rows: Iterable[tuple[bytes, bytes]]) -> int:
    """Return the sum of what keys and rows of one table add to it."""
    before, found, shake, number = name.encode() + b"\0", 0, shake_128, int.from_bytes
    for key, row in rows:
        found += number(
            shake(b"%b%b%b%b" % (before, len(key).to_bytes(4, "big"), key, row)).digest(ELEMENT_BYTES), "big"
        )
    return found & _MASK


def combined(sums: Sums) -> bytes:
    """Return the digest of a state from the sums of its tables."""
    digest = sha256()
    for column in COLUMNS:
        digest.update(column.name.encode() + b"\0" + sums[column.name].to_bytes(ELEMENT_BYTES, "big"))
    return digest.digest()


def rows_of(state: State) -> Rows:
    """Return the whole state as bytes."""
    return {
        column.name: {encode(key): encode(row) for key, row in table_of(state, column.name).whole().items()}
        for column in COLUMNS
    }


class StateDigest:
    """Follows one state, which nobody else may ask for what has changed."""

    def __init__(self, state: State, sums: Sums | None = None) -> None:
        """Begin with a state, whose sums are these where they are known already."""
        state.journal.watch()
        state.journal.take()
        self._names = {table_of(state, column.name): column.name for column in COLUMNS}
        self._derived = [table_of(state, name) for name in DERIVED]
        self._begun: Rows = {}
        if sums is None:
            self._begun = rows_of(state)
            sums = sums_of(self._begun)
        self.sums = dict(sums)
        self._journal = state.journal

    def advance(self) -> Rows:
        """Take in what has changed and return it; the first time also everything that was there from the start.

        What was done since the last `clear` of the journal stands from now on.
        """
        changed, self._begun = self._begun, {}
        for table, before in self._journal.take().items():
            if table not in self._derived:
                name = self._names[table]
                self._take_in(name, table, before, changed.setdefault(name, {}))
        return changed

    def _take_in(self, name: str, table: Any, before: dict[Any, Any], changed: dict[bytes, bytes]) -> None:
        gone, come = [], []
        for key, old in before.items():
            now = table.held(key)
            if now is old:
                continue
            written = encode(key)
            changed[written] = b"" if now is ABSENT else encode(now)
            if old is not ABSENT:
                gone.append((written, encode(old)))
            if now is not ABSENT:
                come.append((written, changed[written]))
        self.sums[name] = (self.sums[name] - total(name, gone) + total(name, come)) & _MASK

    @property
    def value(self) -> bytes:
        """The digest as of the last `advance`."""
        return combined(self.sums)


def digest_of(state: State) -> bytes:
    """Return the digest of a state, from scratch."""
    return combined(sums_of(rows_of(state)))
