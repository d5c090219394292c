"""Finds the line on which each key of a TOML text stands; tomllib keeps the values only.

It expects text that tomllib has read already, so it need not judge anything: where a value ends
is found by asking tomllib.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from typing import Any

Key = tuple[str, ...]

_PART = r"""(?:"(?:\\.|[^"\\])*"|'[^']*'|[A-Za-z0-9_-]+)"""
_NAME = rf"{_PART}(?:\s*\.\s*{_PART})*"
_HEADER = re.compile(rf"\s*\[\[?\s*({_NAME})\s*\]\]?\s*(?:#.*)?$")
_PAIR = re.compile(rf"\s*({_NAME})\s*=(.*)$")


def lines_of(text: str) -> dict[Key, int]:
    """Return the line, from 1, of every table and key; of a table that is never opened by name, that of its first key.

    Keys inside an inline table stand on the line where that table begins.
    """
    lines = text.split("\n")
    found: dict[Key, int] = {}
    table: Key = ()
    number = 0
    while number < len(lines):
        header, pair = _HEADER.match(lines[number]), _PAIR.match(lines[number])
        last = number
        if header:
            table = _key(header[1])
            _note(found, table, number + 1)
        elif pair:
            value, last = _value(pair[2], lines, number)
            for key in _keys(table + _key(pair[1]), value):
                _note(found, key, number + 1)
        number = last + 1
    return found


def _note(found: dict[Key, int], key: Key, line: int) -> None:
    """Remember a key's line, and that of the tables it opens on its way; the first one counts."""
    for depth in range(1, len(key) + 1):
        found.setdefault(key[:depth], line)


def _key(name: str) -> Key:
    """Return the parts of a dotted name."""
    parts: list[str] = []
    tables: Any = tomllib.loads(f"{name} = 0")
    while isinstance(tables, dict):
        ((part, tables),) = tables.items()
        parts.append(part)
    return tuple(parts)


def _value(first: str, lines: list[str], number: int) -> tuple[Any, int]:
    """Return the value that begins with `first` on line `number`, and the last line (from 0) it takes."""
    text = f"x = {first}"
    for last in range(number, len(lines)):
        if last > number:
            text += "\n" + lines[last]
        try:
            return tomllib.loads(text)["x"], last
        except tomllib.TOMLDecodeError:
            continue
    return None, number


def _keys(key: Key, value: Any) -> Iterator[Key]:
    """Yield a key and those of the tables inside its value."""
    yield key
    if isinstance(value, dict):
        for part, inner in value.items():
            yield from _keys((*key, part), inner)
