"""The page docs/security.md: every row is there, and every test that it names exists."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from tests.house import REPO

_TEST = re.compile(r"`(tests/[\w/]+\.py)::(\w+)`")
_ROW = re.compile(r"^\| (\d+) \|(.*)\|$", flags=re.MULTILINE)
_LINK = re.compile(r"\]\(([\w./-]+)\)")


def page() -> str:
    return (REPO / "docs/security.md").read_text("utf-8")


def rows(text: str) -> dict[int, list[str]]:
    """Return the cells of the threat table by its numbers."""
    return {int(number): [cell.strip() for cell in rest.split("|")] for number, rest in _ROW.findall(text)}


def missing(text: str) -> Iterator[str]:
    """Yield the tests that a page names and that do not exist."""
    for path, name in sorted(set(_TEST.findall(text))):
        file = REPO / path
        tree = ast.parse(file.read_text("utf-8")) if file.exists() else ast.Module([], [])
        tests = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        if name not in tests or not name.startswith("test_"):
            yield f"{path}::{name}"


def test_every_threat_has_its_row() -> None:
    found = rows(page())
    assert list(found) == list(range(1, 26))
    assert {len(cells) for cells in found.values()} == {5}


def test_every_row_names_a_test_or_says_that_there_is_none() -> None:
    for number, cells in rows(page()).items():
        assert bool(_TEST.search(cells[-1])) != (cells[-1] == "not yet"), number


def test_every_test_that_is_named_exists() -> None:
    assert list(missing(page())) == []


def test_a_test_that_is_not_there_is_found() -> None:
    assert list(
        missing("`tests/test_security.py::test_nothing` `tests/none.py::test_a` `tests/house.py::sources`")
    ) == [
        "tests/house.py::sources",
        "tests/none.py::test_a",
        "tests/test_security.py::test_nothing",
    ]


def test_what_it_links_to_is_there() -> None:
    assert [link for link in _LINK.findall(page()) if not (REPO / "docs" / link).exists()] == []
