"""The page docs/security.md: every row is there, and every test that it names exists."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from tests.house import REPO

_TEST = re.compile(r"(to come: )?`(tests/[\w/]+\.py)::(\w+)`")
_ROW = re.compile(r"^\| (\d+) \|(.*)\|$", flags=re.MULTILINE)
_LINK = re.compile(r"\]\(([\w./-]+)\)")


def page() -> str:
    return (REPO / "docs/security.md").read_text("utf-8")


def rows(text: str) -> dict[int, list[str]]:
    """Return the cells of the threat table by its numbers."""
    return {int(number): [cell.strip() for cell in rest.split("|")] for number, rest in _ROW.findall(text)}


def is_there(path: str, name: str) -> bool:
    """Say whether a file of the repository has a test of this name."""
    file = REPO / path
    tree = ast.parse(file.read_text("utf-8")) if file.exists() else ast.Module([], [])
    tests = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    return name in tests and name.startswith("test_")


def wrong(text: str) -> Iterator[str]:
    """Yield the tests that a page names and that do not exist, and those that it says are to come and that do."""
    for to_come, path, name in sorted(set(_TEST.findall(text))):
        if is_there(path, name) == bool(to_come):
            yield f"{path}::{name}"


def test_every_threat_has_its_row() -> None:
    found = rows(page())
    assert list(found) == list(range(1, 30))
    assert {len(cells) for cells in found.values()} == {5}


def test_every_row_names_tests_and_what_remains() -> None:
    for number, (attacker, tries, stopped, remains, tests) in rows(page()).items():
        assert all((attacker, tries, stopped, remains)), number
        assert _TEST.search(tests), number


def test_every_test_that_is_named_exists_and_none_that_is_to_come() -> None:
    """If one that was to come is there now: take the words "to come:" away before it and before what it shows."""
    assert list(wrong(page())) == []


def test_a_name_that_is_wrong_is_found() -> None:
    names = ("tests/test_security.py::test_nothing", "tests/none.py::test_a", "tests/house.py::sources")
    assert list(wrong(" ".join(f"`{name}`" for name in names))) == sorted(names)
    assert list(wrong("to come: `tests/none.py::test_a`")) == []
    here = "tests/test_security.py::test_a_name_that_is_wrong_is_found"
    assert list(wrong(f"to come: `{here}`")) == [here]
    assert list(wrong(f"`{here}`")) == []


def test_what_it_links_to_is_there() -> None:
    assert [link for link in _LINK.findall(page()) if not (REPO / "docs" / link).exists()] == []
