"""What the guard saw: each place and each kind of sin once. It judges nothing; `escapes.py` says what is excused."""

from __future__ import annotations

from typing import NamedTuple

FLOAT = "makes a float"
ITERATES = "iterates over a set"
HANDS = "hands a set to"
ANY = "takes any element of a set"
SHOWS = "shows a set as text"
CALLS = "calls"
REACHES = "reaches out"


class Sin(NamedTuple):
    """Something that may differ from run to run, and the line of the core that it came from."""

    path: str
    line: int
    what: str


class Seen:
    """The sins so far."""

    def __init__(self) -> None:
        self.sins: dict[Sin, None] = {}

    def add(self, path: str, line: int, what: str) -> None:
        """Note a sin."""
        self.sins[Sin(path, line, what)] = None
