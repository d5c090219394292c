"""Makes faulty versions of a module, one fault each, and lets the tests look for them.

    python -m tests.torture.mutating        a worker: one JSON line in for each mutant, one out

The worker imports what is heavy and never mutated, then forks for each mutant, so that a child starts with the faulty
module in the place of the real one. Nothing is written to the source tree.
"""

from __future__ import annotations

import ast
import contextlib
import importlib.abc
import importlib.machinery
import importlib.util
import json
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

from tests.house import REPO

PATIENCE_S = 120  # a mutant that loops is caught by this
_PAIRS: tuple[tuple[type[ast.AST], type[ast.AST]], ...] = (
    *((ast.Lt, ast.LtE), (ast.Gt, ast.GtE), (ast.Eq, ast.NotEq), (ast.In, ast.NotIn), (ast.Is, ast.IsNot)),
    (ast.Add, ast.Sub),
)
SWAPS = {**dict(_PAIRS), **{other: one for one, other in _PAIRS}}
NAMES = {"all": "any", "any": "all", "min": "max", "max": "min"}


@dataclass(frozen=True, slots=True)
class Mutant:
    """One fault: where it is, what was changed into what, and the text of the module with it."""

    module: str
    where: str
    change: str
    source: str = field(repr=False)

    @property
    def name(self) -> str:
        """What it is called in results; stays the same while the check does."""
        return f"{self.module}.{self.where}: {self.change}"


def path_of(module: str) -> Path:
    """Return a module's file."""
    return REPO / (module.replace(".", "/") + ".py")


def mutants(module: str, only: frozenset[str] | None = None) -> list[Mutant]:
    """Return every mutant of a module, or of some of its functions, in the order of the source."""
    tree = ast.parse(path_of(module).read_text("utf-8"))
    made: list[Mutant] = []
    for where, function in _functions(tree, ""):
        if only is not None and where not in only:
            continue
        for change, undo in _faults(function):
            made.append(Mutant(module, where, change, ast.unparse(tree)))
            undo()
    return made


def _functions(node: ast.AST, prefix: str) -> Iterator[tuple[str, ast.FunctionDef]]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.ClassDef):
            yield from _functions(child, f"{child.name}.")
        elif isinstance(child, ast.FunctionDef):
            yield prefix + child.name, child


class _Undo:
    """Sets an attribute of a node, and puts it back."""

    def __init__(self, node: ast.AST, name: str, value: object) -> None:
        self._node, self._name, self._before = node, name, getattr(node, name)
        setattr(node, name, value)

    def __call__(self) -> None:
        setattr(self._node, self._name, self._before)


def _faults(function: ast.FunctionDef) -> Iterator[tuple[str, _Undo]]:
    """Put one fault after the other into a function; the caller undoes each before the next."""
    for node in ast.walk(function):
        if isinstance(node, ast.If | ast.While):
            text = ast.unparse(node.test)
            yield f"if {text}: never", _Undo(node, "test", ast.Constant(False))
            yield f"if {text}: negated", _Undo(node, "test", ast.UnaryOp(ast.Not(), node.test))
        yield from _faults_of_expressions(node)
        for name in ("body", "orelse", "finalbody"):
            yield from _removed(node, name)


def _faults_of_expressions(node: ast.AST) -> Iterator[tuple[str, _Undo]]:
    text = ast.unparse(node) if isinstance(node, ast.expr) else ""
    if isinstance(node, ast.Compare):
        for at, operator in enumerate(node.ops):
            if type(operator) in SWAPS:
                swapped: list[Any] = list(node.ops)
                swapped[at] = SWAPS[type(operator)]()
                yield (
                    f"{text}: {type(operator).__name__} {at} is {type(swapped[at]).__name__}",
                    _Undo(node, "ops", swapped),
                )
    elif isinstance(node, ast.BoolOp):
        for at, operand in enumerate(node.values):
            rest = node.values[:at] + node.values[at + 1 :]
            yield f"{text}: without {ast.unparse(operand)}", _Undo(node, "values", rest)
    elif isinstance(node, ast.BinOp) and type(node.op) in SWAPS:
        yield f"{text}: {type(node.op).__name__} turned", _Undo(node, "op", SWAPS[type(node.op)]())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield f"{text}: without not", _Undo(node, "op", ast.UAdd())
    elif isinstance(node, ast.Name) and node.id in NAMES:
        yield f"{text} is {NAMES[node.id]}", _Undo(node, "id", NAMES[node.id])


def _removed(node: ast.AST, name: str) -> Iterator[tuple[str, _Undo]]:
    """Take out every statement that is a call, an assignment to a part, or a deletion."""
    block = getattr(node, name, None)
    if not isinstance(block, list):
        return
    for at, statement in enumerate(block):
        is_call = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call)
        is_part = isinstance(statement, ast.Assign) and not isinstance(statement.targets[0], ast.Name | ast.Tuple)
        alone = isinstance(node, ast.If) and len(block) == 1  # the same as an `if` that never holds
        if (is_call or is_part or isinstance(statement, ast.Delete)) and not alone:
            rest = [*block[:at], ast.Pass(), *block[at + 1 :]]
            yield f"{ast.unparse(statement)}: removed", _Undo(node, name, rest)


class _Faulty(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds one module, and loads its faulty text."""

    def __init__(self, mutant: Mutant) -> None:
        self._mutant = mutant

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Find it."""
        return importlib.util.spec_from_loader(name, self) if name == self._mutant.module else None

    def exec_module(self, module: ModuleType) -> None:
        """Run its text."""
        exec(compile(self._mutant.source, f"mutant of {self._mutant.module}", "exec"), module.__dict__)


class _First:
    """Remembers the first test that failed."""

    def __init__(self) -> None:
        self.failed = ""

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Hear of a test."""
        if report.failed and not self.failed:
            self.failed = report.nodeid

    def pytest_collectreport(self, report: Any) -> None:
        """Hear of a file."""
        if report.failed and not self.failed:
            self.failed = report.nodeid


def caught_by(mutant: Mutant | None, tests: Sequence[str]) -> str:
    """Return the test that fails with this mutant, in a child of its own; "" where all pass."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        _run(mutant, tests, writing)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        told = pipe.read().decode()
    _, status = os.waitpid(child, 0)
    return told if os.WIFEXITED(status) else f"ended by signal {os.WTERMSIG(status)}"


def _run(mutant: Mutant | None, tests: Sequence[str], writing: int) -> None:
    import pytest

    signal.alarm(PATIENCE_S)
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.dup2(null, 2)
    if mutant is not None:
        sys.meta_path.insert(0, _Faulty(mutant))
    first = _First()
    with contextlib.suppress(SystemExit):
        code = pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-m", "not whole", *tests], plugins=[first])
        os.write(writing, (first.failed or ("" if code == 0 else f"pytest ended with {code!r}")).encode())
    os._exit(0)


def main() -> None:
    """Serve mutants from standard input until it ends."""
    import hypothesis  # noqa: F401
    import pytest  # noqa: F401
    from google.protobuf import message  # noqa: F401
    from nacl import bindings  # noqa: F401

    for line in sys.stdin:
        asked = json.loads(line)
        mutant = Mutant(**asked["mutant"]) if asked["mutant"] else None
        print(json.dumps({"number": asked["number"], "caught_by": caught_by(mutant, asked["tests"])}), flush=True)


if __name__ == "__main__":
    main()
