"""The core under the guard: nothing but what is excused, and every planted sin is seen."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from tests.golden.table import GOLDEN
from tests.guard.escapes import AT_RUN_TIME
from tests.guard.findings import Seen
from tests.guard.loading import Guarding, is_core
from tests.guard.planting import HARMLESS, MODULE, PLACE, SINS
from tests.guard.watching import is_core_file
from tests.house import REPO
from tests.test_floors import core


@pytest.fixture(scope="module")
def guarded() -> dict[str, Any]:
    """Return what a process under the guard saw: of golden flights, and of planted sins."""
    environ = {**os.environ, "PYTHONPATH": str(REPO)}
    command = [sys.executable, "-m", "tests.guard.child"]
    run = subprocess.run(command, cwd=REPO, env=environ, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    answer: dict[str, Any] = json.loads(run.stdout)
    return answer


def test_the_core_does_only_what_is_excused(guarded: dict[str, Any]) -> None:
    """All golden flights; each escape is counted, and each is needed."""
    places = Counter((path, what) for path, _line, what in guarded["sins"])
    assert places == {(one.path, one.what): one.places for one in AT_RUN_TIME}, guarded["sins"]
    assert sum(one.places for one in AT_RUN_TIME) == 1
    assert guarded["flights"] == len(GOLDEN)


def test_the_whole_core_is_watched(guarded: dict[str, Any]) -> None:
    """Every module that the allow-list calls core was loaded with its hooks."""
    assert guarded["loaded"] == sorted(source.module for source in core())


@pytest.mark.parametrize("statement", SINS)
def test_a_planted_sin_is_seen(guarded: dict[str, Any], statement: str) -> None:
    """For each class of sin one or more ways to commit it, in a chart, while it judges an order."""
    assert SINS[statement] in guarded["planted"][statement]


@pytest.mark.parametrize("statement", HARMLESS)
def test_what_is_harmless_is_not_seen(guarded: dict[str, Any], statement: str) -> None:
    """Sets may be made, asked, counted and sorted."""
    assert guarded["planted"][statement] == []


@pytest.mark.parametrize(
    ("module", "expected"),
    [
        ("events", True),
        ("events.chain", True),
        ("events.store", False),
        ("events.store.sqlite", False),
        ("events.storehouse", True),
        ("projections.store", False),
        ("projections.status", True),
        ("replay.verify", False),
        ("eventsourcing", False),
    ],
)
def test_what_the_core_is(module: str, expected: bool) -> None:
    """The same modules by name and by file."""
    file = REPO / f"{module.replace('.', '/')}.py"
    assert is_core(module) is expected
    assert module in ("events", "events.store") or is_core_file(str(file)) is expected


def test_the_guard_comes_first_and_plants_where_there_is_a_place(tmp_path: Path) -> None:
    """A core that is imported already would not be watched; a plant without its place would prove nothing."""
    with pytest.raises(RuntimeError, match="loaded before the guard"):
        Guarding(Seen()).install()
    text = (REPO / "statecharts/charts/command_part.py").read_text(encoding="utf-8")
    assert text.count(PLACE) == 1
    planting = Guarding(Seen(), {MODULE: ("no such text", "")})
    spec = planting.find_spec(MODULE, [str(REPO / "statecharts/charts")])
    assert spec is not None
    loader: Any = spec.loader
    with pytest.raises(LookupError, match="0 times"):
        loader.get_code(MODULE)
