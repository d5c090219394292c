"""JSON that comes out as the same bytes everywhere: sorted keys, no spaces, no floats.

A number with decimals is a `Decimal`, whose digits integer arithmetic has written already. It reads nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from projections.words import scaled

_ESCAPES = str.maketrans(
    {chr(code): f"\\u{code:04x}" for code in range(32)}
    | {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\r": "\\r", "\t": "\\t"}
)


class Decimal(str):
    """The text of a JSON number."""

    __slots__ = ()


def decimal(value: int | None, digits: int) -> Decimal | None:
    """Return value / 10**digits as a JSON number with all its digits; None for None."""
    return None if value is None else Decimal(scaled(value, digits))


def json_text(value: Any) -> str:
    """Return a structure of mappings, sequences, text, integers, `Decimal`, truth values and None as JSON text.

    Raises TypeError for anything else, a float among them.
    """
    match value:
        case None:
            return "null"
        case bool():
            return "true" if value else "false"
        case Decimal():
            return str(value)
        case str():
            return f'"{value.translate(_ESCAPES)}"'
        case int():
            return str(value)
        case Mapping():
            pairs = (f"{json_text(str(key))}:{json_text(value[key])}" for key in sorted(value))
            return f"{{{','.join(pairs)}}}"
        case Sequence() if not isinstance(value, bytes | bytearray):
            return f"[{','.join(map(json_text, value))}]"
    raise TypeError(f"{type(value).__name__} has no place in canonical JSON")
