"""The long runs as a command: which areas there are, and what is written of one."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.checks import check_equal
from tests.house import REPO
from tests.torture import __main__ as torture

asked: list[tuple[str, int | None, int]] = []


def area(name: str) -> torture.Run:
    """Return an area that does nothing but say how it was asked."""

    def run(count: int | None, seed: int, report: Callable[[str], None]) -> dict[str, Any]:
        asked.append((name, count, seed))
        report("half-way")
        return {"held": name}

    return run


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Put two areas in the place of the real ones; return where their results go."""
    asked.clear()
    monkeypatch.setattr(torture, "AREAS", {name: area(name) for name in ("two", "one")})
    monkeypatch.setattr(torture, "RESULTS", tmp_path / "results")
    return torture.RESULTS


def test_without_a_name_all_of_them(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each writes date, commit, seconds and its counts."""
    check_equal(torture.main([]), 0)
    check_equal(asked, [("one", None, 1), ("two", None, 1)])
    found = {path.name: json.loads(path.read_text()) for path in results.iterdir()}
    check_equal({name: (list(one), one["held"]) for name, one in found.items()}, {
        f"{name}.json": (["date", "commit", "seconds", "held"], name) for name in ("one", "two")
    })  # fmt: skip
    said = capsys.readouterr().out
    assert "one: half-way" in said
    assert "one held; see " in said


@pytest.mark.parametrize(
    ("given", "expected"), [(["--count", "3"], ("two", 3, 1)), (["--seed", "0"], ("two", None, 0))]
)
def test_a_trial_is_printed_only(
    results: Path, capsys: pytest.CaptureFixture[str], given: list[str], expected: tuple[str, int | None, int]
) -> None:
    """Another count or seed is not the run whose result is kept."""
    torture.main(["two", *given])
    check_equal((asked, results.exists()), ([expected], False))
    assert '"held": "two"' in capsys.readouterr().out


def test_an_area_that_is_not_there(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It says which there are, and runs none."""
    with pytest.raises(SystemExit):
        torture.main(["one", "three"])
    assert "there is no area three: one, two" in capsys.readouterr().err
    check_equal(asked, [])


def test_every_result_that_is_kept_is_of_an_area() -> None:
    """And says when, of what, and that nothing was lost."""
    kept = {path.stem: json.loads(path.read_text()) for path in (REPO / "tests/torture/results").iterdir()}
    assert set(kept) <= set(torture.AREAS)
    assert all({"date", "commit"} <= set(one) for one in kept.values())
