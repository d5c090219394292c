"""The text of a .proto file as values, with its comments, which compiled descriptors do not keep.

It reads the plain style of this repository (one statement a line, comments above) and nothing more;
tests compare what it finds with the descriptors, so that a form it can't read is noticed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

_BLOCK = re.compile(r"(message|enum|oneof|extend) ([\w.]+) \{$")
_FIELD = re.compile(r"(?:(repeated) )?([\w.]+|map<.+>) (\w+) = (\d+);$")
_VALUE = re.compile(r"(\w+) = (\d+);$")
_OPTION = re.compile(r"option \(event\) = \{(.*)\};$")
_ENTRY = re.compile(r'(\w+): (?:"([^"]*)"|(\w+))')


@dataclass(frozen=True, slots=True)
class Member:
    """A field of a message or a value of an enumeration."""

    name: str
    number: int
    comment: str
    line: int
    type: str = ""  # empty for the value of an enumeration
    repeated: bool = False
    oneof: str = ""


@dataclass(frozen=True, slots=True)
class Block:
    """A message or an enumeration."""

    keyword: str  # "message", "enum", "extend"
    name: str
    comment: str
    line: int
    event: dict[str, str] = field(default_factory=dict)  # the catalogue entry; empty for a part of others
    members: list[Member] = field(default_factory=list)


class SchemaUnread(ValueError):
    """A line in a form that this reader does not know; names the line."""


def blocks_of(text: str) -> Iterator[Block]:
    """Yield the messages and enumerations of a .proto file. Raises SchemaUnread."""
    block: Block | None = None
    oneof = ""
    comment: list[str] = []
    for number, line in enumerate(map(str.strip, text.splitlines()), start=1):
        if line.startswith("//"):
            comment.append(line.removeprefix("//").strip())
            continue
        if opened := _BLOCK.fullmatch(line):
            if opened[1] == "oneof" and block is not None:
                oneof = opened[2]
            else:
                block = Block(opened[1], opened[2], " ".join(comment), number)
        elif line == "}" and oneof:
            oneof = ""
        elif line == "}" and block is not None:
            yield block
            block = None
        elif block is not None and line:
            _read_inside(block, line, number, " ".join(comment), oneof)
        comment = []


def _read_inside(block: Block, line: str, number: int, comment: str, oneof: str) -> None:
    """Put one line of a block into it. Raises SchemaUnread."""
    if option := _OPTION.fullmatch(line):
        block.event.update({name: text or word for name, text, word in _ENTRY.findall(option[1])})
    elif block.keyword == "enum" and (value := _VALUE.fullmatch(line)):
        block.members.append(Member(value[1], int(value[2]), comment, number))
    elif found := _FIELD.fullmatch(line):
        repeated, kind, name, tag = found.groups()
        block.members.append(Member(name, int(tag), comment, number, kind, bool(repeated), oneof))
    else:
        raise SchemaUnread(f"line {number}: {line!r} is neither a field, a value nor an event option")
