"""docs/flights.md names the test of each way that a flight begins, goes on and ends; they are there."""

from __future__ import annotations

import ast
import re

from events.schema.flight_pb2 import CloseReason
from tests.house import REPO, sources

PAGE = (REPO / "docs" / "flights.md").read_text(encoding="utf-8")


def test_every_test_that_the_page_names_is_there() -> None:
    """A row without its test is a wish."""
    named = re.findall(r"`(test_\w+)`", PAGE)
    there = {
        node.name
        for source in sources("tests")
        for node in ast.walk(source.tree)
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    }
    assert [name for name in named if name not in there] == []
    rows = [line for line in PAGE.splitlines() if line.startswith("| ") and not line.startswith(("| when", "| reason"))]
    assert [row for row in rows if "`test_" not in row] == []


def test_the_page_has_every_reason() -> None:
    """And no other."""
    found = re.findall(r"^\| `(CLOSE_\w+)`", PAGE, re.MULTILINE)
    assert sorted(found) == sorted(set(CloseReason.keys()) - {"CLOSE_REASON_UNSPECIFIED"})
