"""What a flight comes to when it is run again, as a few digests: decisions, deadlines, states, bundle, verdict.

The loop here is its own and shares only the core with `replay.verify`: the verifier is not its own judge. It needs
none of the packages that the daemon needs.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, is_dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from google.protobuf.message import Message

from events import Record, Role, read_record
from events.records import Stored, encode
from events.store import SqliteReader
from projections.bundle import build
from projections.canonical import json_text
from replay.verify import verify
from statecharts import State, charts_digest, step
from statecharts.journal import Keyed, Single

NOT_STATE = ("journal",)


def rows_of(path: Path) -> tuple[list[Stored], str]:
    """Return the rows of a log and the words of its verdict. A copy is read: a reader may leave files beside a log."""
    with tempfile.TemporaryDirectory() as folder:
        reader = SqliteReader(Path(shutil.copy(path, Path(folder) / "flight.db")))
        rows, words = list(reader.stored()), verify(reader).words()
        reader.close()
    return rows, words


def replayed(rows: Iterable[Stored], state: State) -> Iterator[tuple[tuple[Record, ...], int | None]]:
    """Yield each step, decided again from its observation alone, and its deadline. The state goes on by itself."""
    for row in rows:
        record = read_record(row)
        if record.kind.role is Role.OBSERVATION:
            made = step(state, record)
            yield made.records, made.due


def digests(path: Path) -> dict[str, str]:
    """Return what a flight comes to; the whole state is taken in after every step."""
    rows, words = rows_of(path)
    state, decisions, dues, states = State(), sha256(), sha256(), sha256()
    for records, due in replayed(rows, state):
        for record in records[1:]:
            decisions.update(line_of(record).encode())
        dues.update(f"{due}\n".encode())
        states.update(text_of_state(state).encode())
    bundle = json_text(build([read_record(row) for row in rows]))
    return {
        "decisions": decisions.hexdigest(),
        "deadlines": dues.hexdigest(),
        "states": states.hexdigest(),
        "bundle": sha256(bundle.encode()).hexdigest(),
        "verdict": words,
    }


def charts() -> str:
    """Return the digest of the charts as text."""
    return charts_digest().hex()


def line_of(record: Record) -> str:
    """Return everything of a record as one line."""
    return f"{record.seq} {record.cause} {tuple(record.at)} {record.kind.number} {record.version} {record.body.hex()}\n"


def text_of_state(state: State) -> str:
    """Return the whole state as text, a line a row. Raises TypeError for what has no place in it, as a float."""
    return "".join(f"{name} {line}\n" for name in State.__slots__ for line in _lines(name, getattr(state, name)))


def _lines(name: str, table: object) -> Sequence[str]:
    if name in NOT_STATE:
        return ()
    if isinstance(table, Keyed):
        return [f"{text_of(key)}: {text_of(row)}" for key, row in table.items()]
    if isinstance(table, Single):
        return [text_of(table.value)]
    raise TypeError(f"{name} is no table of the state")


def text_of(value: Any) -> str:
    """Return a value of the state as ASCII; what is equal in all its parts, and nothing else, gives the same text."""
    match value:
        case None | bool() | int():
            return str(value)
        case str():
            return ascii(value)
        case bytes():
            return f"0x{value.hex()}"
        case Message():
            return f"{type(value).__name__}<{encode(value).hex()}>"
        case Record():
            return f"Record<{line_of(value).strip()}>"
        case dict():
            return f"{{{', '.join(f'{text_of(key)}: {text_of(row)}' for key, row in value.items())}}}"
        case tuple():
            return f"{type(value).__name__}({', '.join(map(text_of, value))})"
    if is_dataclass(value):
        return f"{type(value).__name__}({', '.join(text_of(getattr(value, one.name)) for one in fields(value))})"
    raise TypeError(f"{type(value).__name__} has no place in the state")
