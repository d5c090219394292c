"""The mutants of the gate: each was tried and caught; that none is new since; that the machine itself works.

The run itself is an area of `python -m tests.torture`.
"""

from __future__ import annotations

import ast
import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.house import REPO
from tests.torture import gate_mutants, mutating
from tests.torture.gate_mutants import EQUIVALENT, MODULES, all_mutants, caught, numbered
from tests.torture.mutating import Mutant, mutants

RESULT = json.loads((REPO / "tests/torture/results/gate_mutants.json").read_text("utf-8"))


def changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> dict[str, str]:
    """Return what is changed in a module of this text, and its function afterwards."""
    monkeypatch.setattr(mutating, "REPO", tmp_path)
    (tmp_path / "module.py").write_text(text, "utf-8")
    made = mutants("module")
    assert {mutant.where for mutant in made} <= {"f", "C.f"}
    return {mutant.change: "; ".join(line.strip() for line in mutant.source.split("\n")[1:]) for mutant in made}


def test_every_check_was_tried_since_it_was_written() -> None:
    """If this fails: `python -m tests.torture gate_mutants` (ten minutes), and commit its result."""
    names = {mutant.name for mutant in all_mutants()}
    assert set(RESULT["caught_by"]) == names
    assert (RESULT["mutants"], RESULT["survived"]) == (len(names), 0)
    assert all(RESULT["caught_by"].values())


def test_what_is_said_to_change_nothing_is_a_mutant() -> None:
    every = {mutant.name for module, only in MODULES.items() for mutant in numbered(mutants(module, only))}
    assert set(EQUIVALENT) <= every
    assert RESULT["equivalent"] == EQUIVALENT


def test_every_place_that_drops_a_message_is_among_them() -> None:
    """A module that names a counter judges messages, so its checks are to be tried."""
    drops = [
        f"autopilot.trust.{path.stem}"
        for path in sorted((REPO / "autopilot/trust").glob("*.py"))
        if any(_is_drop(node) for node in ast.walk(ast.parse(path.read_text("utf-8"))))
    ]
    assert drops
    assert set(drops) <= set(MODULES)


def _is_drop(node: ast.AST) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id.strip("_") == "drop"


def test_a_condition_is_removed_negated_and_moved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "def f(a, b):\n    if a < b and not a:\n        drop('x')\n"
    assert changes(tmp_path, monkeypatch, text) == {
        "if a < b and (not a): never": "if False:; drop('x')",
        "if a < b and (not a): negated": "if not (a < b and (not a)):; drop('x')",
        "a < b and (not a): without a < b": "if not a:; drop('x')",
        "a < b and (not a): without not a": "if a < b:; drop('x')",
        "a < b: Lt 0 is LtE": "if a <= b and (not a):; drop('x')",
        "not a: without not": "if a < b and +a:; drop('x')",
    }


_STATEMENTS = ("check(a)", "self.a = a + 1", "del a[0]", "b = all(a)")


def test_a_statement_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = ("class C:", "    def f(self, a):", *(f"        {one}" for one in _STATEMENTS))
    text = "\n".join(lines) + "\n"
    assert set(changes(tmp_path, monkeypatch, text)) == {
        "check(a): removed",
        "self.a = a + 1: removed",
        "a + 1: Add turned",
        "del a[0]: removed",
        "all is any",
    }


def test_what_drops_in_a_handler_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "def f():\n    try:\n        x = 1\n    except E:\n        drop('x')\n"
    assert changes(tmp_path, monkeypatch, text) == {"drop('x'): removed": "try:; x = 1; except E:; pass"}


def test_the_same_change_twice_has_two_names() -> None:
    one = Mutant("m", "f", "x", "")
    assert [mutant.change for mutant in numbered([one, one])] == ["x", "x (2)"]


def check_caught(source: Sequence[str], expected: list[bool], monkeypatch: pytest.MonkeyPatch) -> None:
    """Check which of some faulty versions of `pae` the tests of the envelope find, beside the true one."""
    monkeypatch.setattr(gate_mutants, "TESTS", ("tests/autopilot/trust/test_envelope.py",))
    made = [Mutant("autopilot.trust.pae", "all", str(number), text) for number, text in enumerate(source)]
    assert [bool(by) for by in caught([None, *made], jobs=1)] == expected


def test_a_faulty_module_is_found_and_a_true_one_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """In children, so that nothing of it is left here; a module that can't be imported is found too."""
    true = (REPO / "autopilot/trust/pae.py").read_text("utf-8")
    assert "le64(len(parts))" in true
    faulty = true.replace("le64(len(parts))", "le64(len(parts) + 1)")
    check_caught([true, faulty, "raise ImportError"], [False, False, True, True], monkeypatch)


@pytest.mark.parametrize(("found", "words"), [("", "2 of 3 mutants survived"), ("tests/test_a.py::test_b", "")])
def test_a_survivor_ends_the_run(found: str, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def answered(asked: Sequence[Mutant | None]) -> list[str]:
        first = "" if asked == [None] else "tests/test_a.py::test_a"
        return [first, *(found for _ in asked[1:])]

    monkeypatch.setattr(gate_mutants, "caught", answered)
    told: list[str] = []
    if words:
        with pytest.raises(AssertionError, match=words):
            gate_mutants.run(3, 1, told.append)
        assert len([line for line in told if line.startswith("survived: ")]) == 2
    else:
        counts = gate_mutants.run(3, 1, told.append)
        assert (counts["mutants"], len(counts["caught_by"])) == (3, 3)


def test_tests_that_fail_without_a_mutant_prove_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gate_mutants, "caught", lambda asked: ["tests/test_a.py::test_b"] * len(asked))
    with pytest.raises(AssertionError, match="without a mutant"):
        gate_mutants.run(3, 1, print)
