"""The page of the event catalogue: every kind with its fields and their sentences, from the text of the schema."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from docs.schema import Block, Member, blocks_of
from docs.text import table

NOT_RECORDED = ("waypoint.proto",)  # spoken with others; no part of the log

HEAD = """# The event catalogue

Drawn from `events/schema/*.proto` by `make diagrams`; do not edit it here. Kinds and numbers are never reused or
renamed. *Observation*: something that happened to the node. *Decision*: what a chart concluded from it. *Effect*: a
decision that a port of the shell performs once it is durable. `SYNC` records are committed at once, `GROUP` records
with their neighbours. Fields are integers in fixed point: the name ends with the scale (`_e7`, `_mm`, `_cdeg`, `_ms`).
"""


def _member(member: Member) -> tuple[str, ...]:
    kind = "repeated " * member.repeated + member.type
    name = f"{member.oneof}.{member.name}".removeprefix(".")
    return str(member.number), f"`{name}`", kind, member.comment


def _fields(block: Block) -> list[str]:
    if not block.members:
        return ["No fields: that it happened says it all.", ""]
    return table(("number", "field", "type", "meaning"), map(_member, block.members))


def _kind(block: Block) -> Iterator[str]:
    event = block.event
    said = [event["role"].capitalize(), f"`{event['durability']}`", f"version {event['version']}", f"`{block.name}`"]
    if "port" in event:
        said.insert(1, f"performed by `{event['port']}`")
    yield from (f"### {event['number']} `{event['kind']}`", "", ", ".join(said) + ".", "", block.comment, "")
    yield from _fields(block)


def _part(block: Block) -> Iterator[str]:
    yield from (f"### `{block.name}`", "", block.comment, "")
    if block.keyword == "enum":
        values = ((str(value.number), f"`{value.name}`", value.comment) for value in block.members)
        yield from table(("number", "value", "meaning"), values)
    else:
        yield from _fields(block)


def _overview(block: Block) -> tuple[str, ...]:
    event = block.event
    return event["number"], f"`{event['kind']}`", event["role"].lower(), event.get("port", ""), block.comment


def catalogue(schema: Path) -> list[Block]:
    """Return every message and enumeration of the event schema below `schema`, file by file. Raises SchemaUnread."""
    files = sorted(file for file in schema.glob("*.proto") if file.name not in NOT_RECORDED)
    blocks = (block for file in files for block in blocks_of(file.read_text(encoding="utf-8")))
    return [block for block in blocks if block.keyword != "extend"]


def page(schema: Path) -> str:
    """Return docs/events.md for the schema in folder `schema`. Raises SchemaUnread."""
    blocks = catalogue(schema)
    kinds = sorted((block for block in blocks if block.event), key=lambda block: int(block.event["number"]))
    lines = [HEAD, "## Kinds", ""]
    lines += table(("number", "kind", "role", "port", "meaning"), map(_overview, kinds))
    for block in kinds:
        lines += _kind(block)
    lines += ["## Parts", ""]
    for block in sorted((block for block in blocks if not block.event), key=lambda block: block.name):
        lines += _part(block)
    return "\n".join(lines).rstrip() + "\n"
