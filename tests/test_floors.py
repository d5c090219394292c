"""The core's allow-list, read from its syntax trees: what may be imported, and what may not be written.

import-linter sees which module reaches which; this sees what stands in a file. The core is events without
its store, statecharts, and the folds of projections (design, section 2).
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from typing import NamedTuple

import pytest

from tests.house import Source, source_of, sources

STANDARD = {
    *("__future__", "array", "bisect", "collections", "dataclasses", "enum", "functools", "hashlib", "heapq"),
    *("itertools", "operator", "struct", "types", "typing", "google.protobuf"),
    "msgspec",  # rows of the state as bytes: pure, the same bytes everywhere, ten times as fast as in Python
}
FLOORS = {
    "events": {"events"},
    "statecharts": {"events", "statecharts"},
    "projections": {"events", "projections"},
}
OUTSIDE_THE_CORE = ("events/store/", "projections/store.py")
EXECUTOR = "statecharts/table.py"

SAME_EVERYWHERE = "floats, and what is made of them, differ between processors and Python versions"
CALLS = {
    "open": "the core does no I/O",
    "print": "the core does not talk; its records do",
    "input": "the core does no I/O",
    "float": SAME_EVERYWHERE,
    "complex": SAME_EVERYWHERE,
    "set": "the order of a set differs from run to run: use a dict or a sorted tuple",
    "hash": "hashes of text differ from run to run: use hashlib",
    "id": "addresses differ from run to run",
    "eval": "what is decided must stand in the source",
    "exec": "what is decided must stand in the source",
    "__import__": "imports stand at the top, where the allow-list sees them",
}
NODES: dict[type[ast.AST], str] = {
    ast.Global: "state is an argument and a result, never a module's variable",
    ast.Nonlocal: "state is an argument and a result, never a closure's variable",
    ast.Set: CALLS["set"],
    ast.SetComp: CALLS["set"],
    ast.AsyncFunctionDef: "the core cannot wait",
    ast.Await: "the core cannot wait",
}


class Finding(NamedTuple):
    """A line that breaks a rule, and why the rule is there."""

    path: str
    line: int
    what: str
    because: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.what}: {self.because}"


def imported(node: ast.AST) -> tuple[str, ...]:
    """Return the modules that an import statement names; a relative import as dots."""
    if isinstance(node, ast.Import):
        return tuple(alias.name for alias in node.names)
    if isinstance(node, ast.ImportFrom):
        base = "." * node.level + (node.module or "")
        return tuple(f"{base}.{alias.name}" for alias in node.names)
    return ()


def may_import(path: str, module: str) -> bool:
    """Say whether a core file may import this module."""
    if module.split(".")[0] == "transitions":
        return path == EXECUTOR
    if f"{module}.".startswith("events.store."):
        return False
    allowed = STANDARD | FLOORS[path.split("/")[0]] | {"h3"}
    return any(module == name or module.startswith(f"{name}.") for name in allowed)


def _imports(source: Source) -> Iterator[Finding]:
    because = f"the core may import its own floors, h3 in one file, transitions in {EXECUTOR}, and a short list"
    for node in ast.walk(source.tree):
        for module in imported(node):
            if not may_import(source.path, module):
                yield Finding(source.path, getattr(node, "lineno", 0), f"imports {module}", because)


def _harmless_sets(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield the sets whose order nobody sees: frozensets made at import, and what is sorted or counted at once."""
    for node in _made_at_import(tree):
        if isinstance(node, ast.Call) and called(node) == "frozenset":
            yield from (node, *node.args)
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and called(node) in ("sorted", "len"):
            yield from node.args[:1]


def _made_at_import(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what is evaluated once, when the module is imported."""
    yield node
    if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
        for child in ast.iter_child_nodes(node):
            yield from _made_at_import(child)


def called(node: ast.Call) -> str:
    """Return the plain name that is called, empty for a method."""
    return node.func.id if isinstance(node.func, ast.Name) else ""


def _broken(node: ast.AST) -> tuple[str, str] | None:
    """Return what is wrong with one node and why, or None."""
    if isinstance(node, ast.Constant) and isinstance(node.value, (float, complex)):
        return f"{node.value} is a float", SAME_EVERYWHERE
    if isinstance(node, (ast.BinOp, ast.AugAssign)) and isinstance(node.op, ast.Div):
        return "true division", SAME_EVERYWHERE
    if isinstance(node, ast.Attribute) and node.attr in ("truediv", "itruediv"):
        return "true division", SAME_EVERYWHERE
    if isinstance(node, ast.Call) and called(node) in CALLS:
        return f"{called(node)}(...)", CALLS[called(node)]
    if isinstance(node, ast.Call) and called(node) == "frozenset":
        return "frozenset(...) that is no constant of the module", CALLS["set"]
    if type(node) in NODES:
        return type(node).__name__.lower(), NODES[type(node)]
    return None


def _statements(source: Source) -> Iterator[Finding]:
    allowed = tuple(_harmless_sets(source.tree))
    for node in ast.walk(source.tree):
        broken = _broken(node)
        if broken is not None and not any(node is harmless for harmless in allowed):
            yield Finding(source.path, getattr(node, "lineno", 0), *broken)


def findings(source: Source) -> list[Finding]:
    """Return every line of a core file that breaks the allow-list, in the order of lines."""
    return sorted([*_imports(source), *_statements(source)])


def core() -> list[Source]:
    """Return the files of the core."""
    return [source for source in sources(*FLOORS) if not source.path.startswith(OUTSIDE_THE_CORE)]


def check_found(text: str, what: str, path: str = "statecharts/charts/bad.py") -> None:
    """Check that exactly one line of `text` is found, and that it is found as `what`."""
    found = findings(source_of(path, text))
    assert [what in finding.what for finding in found] == [True], [str(finding) for finding in found]


def check_silent(text: str, path: str = "statecharts/charts/good.py") -> None:
    """Check that nothing is found in `text`."""
    assert [str(finding) for finding in findings(source_of(path, text))] == []


def test_the_core_keeps_its_allow_list() -> None:
    """No clock, chance, file, socket, thread, coroutine, logger or float in the core."""
    assert [str(finding) for source in core() for finding in findings(source)] == []


def test_the_core_is_not_empty() -> None:
    """The rule above is about files that exist."""
    paths = {source.path for source in core()}
    assert {"events/chain.py", "events/records.py"} <= paths
    assert not [path for path in paths if "store" in path]


def test_h3_stays_in_one_file() -> None:
    """Grid arithmetic has one home."""
    users = [
        source.path
        for source in core()
        if any(module.split(".")[0] == "h3" for node in ast.walk(source.tree) for module in imported(node))
    ]
    assert len(users) <= 1, users


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("import time", "imports time"),
        ("import random as chance", "imports random"),
        ("from datetime import datetime", "imports datetime.datetime"),
        ("from . import sibling", "imports ..sibling"),
        ("from google import auth", "imports google.auth"),
        ("def f():\n    import os", "imports os"),
        ("from transitions import Machine", "imports transitions.Machine"),
        ("from events.store import sqlite", "imports events.store.sqlite"),
        ("import events.store.sqlite", "imports events.store.sqlite"),
        ("from events import store", "imports events.store"),
        ("import projections.status", "imports projections.status"),
        ("import replay", "imports replay"),
        ("half = 0.5", "0.5 is a float"),
        ("a = 1e7", "is a float"),
        ("a = 2j", "is a float"),
        ("mean = a / b", "true division"),
        ("a /= 2", "true division"),
        ("import operator\nf = operator.truediv", "true division"),
        ("a = float(b)", "float(...)"),
        ("a = {1, 2}", "set"),
        ("a = {b for b in c}", "setcomp"),
        ("a = set(b)", "set(...)"),
        ("a = list({b for b in c})", "setcomp"),
        ("def f(a):\n    return tuple(frozenset(a))", "frozenset(...)"),
        ("def f(b):\n    return frozenset(b)", "frozenset(...)"),
        ("a = hash('x')", "hash(...)"),
        ("a = id(b)", "id(...)"),
        ("f = open('x')", "open(...)"),
        ("print('x')", "print(...)"),
        ("a = eval('1')", "eval(...)"),
        ("def f():\n    global a", "global"),
        ("def f():\n    a = 1\n    def g():\n        nonlocal a", "nonlocal"),
        ("async def f(): ...", "asyncfunctiondef"),
    ],
)
def test_each_rule_finds_its_breach(text: str, what: str) -> None:
    """A rule that can't fail guards nothing."""
    check_found(text, what)


@pytest.mark.parametrize(
    "text",
    [
        "from dataclasses import dataclass\nfrom google.protobuf.message import Message",
        "from events.records import Record\nfrom statecharts.state import State",
        "NAMES = frozenset({'a', 'b'})\nGROUPS: frozenset[str] = frozenset(('a',))",
        "def f(seen: frozenset[str], a: int) -> int:\n    return a // 2 if 'x' in seen else ~a",
        "from hashlib import sha256\nimport h3",
        "PART = Part(alphabet=frozenset({'a'}))\ndef f(a):\n    return sorted(set(a)), len({b for b in a})",
    ],
)
def test_what_is_allowed_is_silent(text: str) -> None:
    """The rules leave honest code alone."""
    check_silent(text)


def test_only_the_table_executes() -> None:
    """`transitions` has one home, and a finding names line and reason."""
    check_silent("from transitions import Machine", path=EXECUTOR)
    found = findings(source_of("events/bad.py", "\nimport statecharts"))
    assert str(found[0]).startswith("events/bad.py:2: imports statecharts: the core may import")
