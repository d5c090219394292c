"""The drawn pages are what the source draws, and the reader of the schema misses nothing in it."""

from __future__ import annotations

from types import ModuleType

import pytest
from google.protobuf.descriptor import FieldDescriptor

from docs import catalogue, charts
from docs.generate import pages
from docs.schema import Block, SchemaUnread, blocks_of
from events.kinds import KINDS
from events.schema import (
    common_pb2,
    eyes_pb2,
    findings_pb2,
    flight_pb2,
    link_pb2,
    mission_pb2,
    options_pb2,
    orders_pb2,
    safety_pb2,
    state_pb2,
    trust_pb2,
    vehicle_pb2,
    waypoint_pb2,
)
from statecharts.table import Chart, Row, ignore, move, refuse
from tests.house import REPO

SCHEMAS = (
    *(common_pb2, eyes_pb2, findings_pb2, flight_pb2, link_pb2, mission_pb2, options_pb2),
    *(orders_pb2, safety_pb2, state_pb2, trust_pb2, vehicle_pb2, waypoint_pb2),
)
BY_NUMBER = {
    value: name.removeprefix("TYPE_").lower()
    for name, value in vars(FieldDescriptor).items()
    if name.startswith("TYPE_")
}


def read(schema: ModuleType) -> list[Block]:
    """Read the .proto text that a generated module was made from."""
    return list(blocks_of((REPO / schema.DESCRIPTOR.name).read_text(encoding="utf-8")))


def type_of(member: FieldDescriptor) -> str:
    """Return a field's type as the .proto text writes it."""
    named = member.message_type or member.enum_type
    return named.name if named else BY_NUMBER[member.type]


@pytest.mark.parametrize("path", sorted(pages()))
def test_drawn_pages_are_in_step(path: str) -> None:
    """If this fails: `make diagrams`, and commit what it writes."""
    assert (REPO / path).read_text(encoding="utf-8") == pages()[path]


@pytest.mark.parametrize("schema", SCHEMAS, ids=lambda schema: schema.DESCRIPTOR.name)
def test_the_reader_sees_what_the_compiler_sees(schema: ModuleType) -> None:
    """Messages, fields, types, values and their numbers are those of the compiled schema."""
    found = {block.name: block for block in read(schema) if block.keyword != "extend"}
    messages, enums = schema.DESCRIPTOR.message_types_by_name, schema.DESCRIPTOR.enum_types_by_name
    assert sorted(found) == sorted([*messages, *enums])
    for name, message in messages.items():
        expected = [(member.name, member.number, type_of(member), member.is_repeated) for member in message.fields]
        assert [(it.name, it.number, it.type, it.repeated) for it in found[name].members] == expected
    for name, enum in enums.items():
        assert [(it.name, it.number) for it in found[name].members] == [(it.name, it.number) for it in enum.values]


def test_the_catalogue_names_every_kind() -> None:
    """Each kind that can be recorded has its number, role and port on the page."""
    events = [block.event for schema in SCHEMAS for block in read(schema) if block.event]
    found = sorted((int(event["number"]), event["kind"], event["role"], event.get("port", "")) for event in events)
    assert found == [(kind.number, kind.name, kind.role.name, kind.port) for kind in KINDS]
    page = catalogue.page(REPO / "events" / "schema")
    assert [kind.name for kind in KINDS if f"### {kind.number} `{kind.name}`" not in page] == []


def test_comments_options_and_oneofs_are_read() -> None:
    """A comment of two lines is one sentence; a blank line ends it; a oneof marks its fields."""
    text = """
    // Not about it.

    // Two
    // lines.
    message Seen {
      option (event) = { kind: "seen" number: 7 role: EFFECT durability: SYNC version: 1 port: "mesh" };
      // How many.
      repeated uint32 counts = 1;
      oneof what {
        // A name.
        string name = 2;
      }
    }
    """
    (block,) = blocks_of(text)
    assert (block.comment, block.event["port"], block.event["number"]) == ("Two lines.", "mesh", "7")
    assert [(it.name, it.comment, it.repeated, it.oneof) for it in block.members] == [
        ("counts", "How many.", True, ""),
        ("name", "A name.", False, "what"),
    ]


def test_a_line_that_is_not_understood_is_an_error() -> None:
    """The reader never skips in silence."""
    with pytest.raises(SchemaUnread, match="line 2"):
        list(blocks_of("message A {\n  reserved 3;\n}"))


def door_open(facts: object) -> bool:
    """Stand for any guard."""
    return bool(facts)


def test_a_chart_is_drawn_from_its_rows() -> None:
    """Moves are arrows, terminal states end, every row is in the table."""
    rows: tuple[Row[object], ...] = (
        move("in progress", "time_passed", "done", "it is late", door_open, band=1),
        move("in progress", "asked", "done", "somebody asked"),
        move("in progress", "asked", "done", "somebody asked well", door_open),
        ignore("done", "time_passed", "it is over"),
        refuse("done", "asked", "too late | sorry"),
    )
    states, triggers = ("in progress", "done"), ("time_passed", "asked")
    page = charts.page([Chart("door", "in progress", states, ("done",), triggers, rows)])
    assert [line.strip() for line in page.splitlines() if "-->" in line] == [
        "[*] --> in_progress",
        "in_progress --> done: time passed, asked",
        "done --> [*]",
    ]
    assert page.splitlines()[-5:] == [
        "| in progress | time_passed | door open | 1 | move | done | it is late |",
        "| in progress | asked |  |  | move | done | somebody asked |",
        "| in progress | asked | door open | 0 | move | done | somebody asked well |",
        "| done | time_passed |  |  | ignore |  | it is over |",
        "| done | asked |  |  | refuse |  | too late \\| sorry |",
    ]
