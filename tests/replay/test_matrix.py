"""A sample of the matrix; and that it can fail: where an environment decides otherwise, or is not what it says."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.golden.table import DIGESTS
from tests.torture import interpreters, matrix
from tests.torture.interpreters import Interpreter, NoPackages, installed, present, requirements, with_packages
from tests.torture.matrix import Cell, Found, cells_of, counts, differing, fly, make_locales, sampled, take

EXPECTED: dict[str, Any] = json.loads(DIGESTS.read_text(encoding="utf-8"))
HERE = present()
OLD = 'echo \'[[3, 10, 9], "/somewhere", "GCC"]\''
NEW = OLD.replace("10, 9", "14, 0")
SAMPLE = (Cell(HERE, "1", "masked", "Pacific/Chatham"), Cell(HERE, "2", optimise=True))


def answer(cell: Cell, **changes: str) -> dict[str, Any]:
    """Return what a cell prints where all is well, with changes of what it saw."""
    zone = cell.zone
    seen = {
        "python": cell.interpreter.name,
        "protobuf": cell.protobuf,
        "asserts": str(not cell.optimise),
        "hash": cell.hash_seed,
        "zone": matrix.ZONES[zone],
        "half": matrix.HALF[matrix.PLACES[zone]],
        "sha256_us": {"all": "100", "masked": "300"}[cell.cpu],
    }
    return {"environment": seen | changes, "results": EXPECTED}


def check_found(found: Found, different: int, unlike: int) -> None:
    """Check how many differences and how many settings without effect were found."""
    assert (len(found.different), len(found.unlike)) == (different, unlike), found


@pytest.fixture(scope="module")
def locales(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the locale that has a comma."""
    return make_locales(tmp_path_factory.mktemp("locales"))


@pytest.mark.parametrize("cell", SAMPLE, ids=lambda cell: cell.name)
def test_a_cell_comes_to_what_is_written(cell: Cell, locales: Path) -> None:
    """Every decision, deadline, state, bundle and verdict, in a process of its own; and its settings bite."""
    found = Found()
    take(found, cell, fly(cell, locales))
    check_found(found, 0, 0)
    assert found.hashes[cell.hash_seed] != {str(hash("a golden flight"))}


@pytest.mark.parametrize(
    ("part", "name", "value"),
    [
        ("charts", "", "other"),
        ("flown", "story", "other"),
        ("flown", "seed 40", None),
        *(("replayed", "chance", {**EXPECTED["replayed"]["chance"], key: "other"}) for key in ("states", "deadlines")),
    ],
)
def test_whatever_differs_is_found(part: str, name: str, value: Any) -> None:
    """In any part, also where it is missing."""
    other = {**EXPECTED, part: {**EXPECTED[part], name: value} if name else value}
    assert differing(other, EXPECTED) == [f"{part} {name}"]
    found = Found()
    take(found, SAMPLE[0], answer(SAMPLE[0]) | {"results": other})
    check_found(found, 1, 0)


@pytest.mark.parametrize("seen", ["python", "protobuf", "asserts", "zone", "half"])
def test_a_setting_that_does_not_bite_is_found(seen: str) -> None:
    """A cell that is not what it is called proves nothing."""
    found = Found()
    take(found, SAMPLE[0], answer(SAMPLE[0], **{seen: "other"}))
    check_found(found, 0, 1)
    assert f"{seen} is other" in found.unlike[0]


@pytest.mark.parametrize(("second", "changes"), [("2", {"hash": "1"}), ("2", {"sha256_us": "120"})])
def test_seeds_and_masks_that_change_nothing_are_found(second: str, changes: dict[str, str]) -> None:
    """Two seeds with one hash; a masked CPU that is as quick as the whole."""
    honest, bad = Found(), Found()
    for found, seen in ((honest, {}), (bad, changes)):
        take(found, Cell(HERE, "1"), answer(Cell(HERE, "1")))
        take(found, Cell(HERE, second, "masked"), answer(Cell(HERE, second, "masked"), **seen))
    assert counts(honest)["cells"] == 2
    with pytest.raises(AssertionError):
        counts(bad)


def test_the_cells_are_the_whole_product() -> None:
    """Five seeds, two CPUs, two places, two protobufs; a sample follows from its seed."""
    cells = cells_of(HERE)
    assert len({cell.name for cell in cells}) == len(cells) == 5 * 2 * 2 * 2 + 2
    assert sampled(cells, 3, 1) == sampled(cells, 3, 1) != sampled(cells, 3, 2)
    assert len(sampled(cells, len(cells), 1)) == len(cells)
    assert cells[0].environ(Path("x"))["PATH"] != ""
    assert [line.split(">")[0] for line in requirements(("apsw", "h3"))] == ["apsw", "h3"]
    assert HERE.version in [one.version for one in installed()]


def test_a_run_stops_at_a_difference(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The first cell that comes to something else fails the run."""
    told: list[str] = []
    monkeypatch.setattr(matrix, "BUILD", tmp_path)
    monkeypatch.setattr(matrix, "installed", lambda: [HERE])
    monkeypatch.setattr(matrix, "with_packages", lambda one: one)
    monkeypatch.setattr(matrix, "fly", lambda cell, _: answer(cell))
    assert matrix.run(9, 1, told.append)["cells"] == len(told) == 9
    for wrong in ({"results": {**EXPECTED, "charts": ""}}, {"environment": answer(SAMPLE[0])["environment"]}):
        monkeypatch.setattr(matrix, "fly", lambda cell, _, wrong=wrong: answer(cell) | wrong)
        with pytest.raises(AssertionError):
            matrix.run(9, 1, told.append)


def test_an_interpreter_without_wheels_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Its cells are not run, which is said, and nothing half installed is left to be believed the next time."""
    newer = Interpreter((3, 99, 0), "none", "python3.99")
    ran: list[list[str]] = []

    def failing(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        ran.append(command)
        return subprocess.CompletedProcess(command, returncode=1)

    with monkeypatch.context() as patch:
        patch.setattr(interpreters, "BUILD", tmp_path)
        patch.setattr(subprocess, "run", failing)
        with pytest.raises(NoPackages, match=r"3\.99"):
            with_packages(newer)
    assert list(tmp_path.iterdir()) == []
    assert {"3.99", *requirements(interpreters.NEEDED)} < set(ran[0])
    monkeypatch.setattr(matrix, "BUILD", tmp_path)
    monkeypatch.setattr(matrix, "installed", lambda: [HERE, newer])
    monkeypatch.setattr(matrix, "with_packages", lambda one: one if one is HERE else failing_of(one))
    monkeypatch.setattr(matrix, "fly", lambda cell, _: answer(cell))
    counted = matrix.run(5, 1, lambda _: None)
    assert (counted["cells"], counted["interpreters_not_run"]) == (5, {newer.name: "none"})


def failing_of(interpreter: Interpreter) -> Interpreter:
    """Find no wheels."""
    raise NoPackages(interpreter.compiler)


def test_only_what_starts_is_an_interpreter(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A file that is called like one and does not start, says nothing, or is too old, is none."""
    for name, script in (("python3.11", "exit 1"), ("python3.12", "echo x"), ("python3.13", OLD), ("python3.x", NEW)):
        file = tmp_path / name
        file.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
        file.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path))
    assert installed() == []
    newest = tmp_path / "versions" / "3.14.0" / "bin"
    newest.mkdir(parents=True)
    (tmp_path / "python3.x").rename(newest / "python3.14")
    assert installed() == [Interpreter((3, 14, 0), "GCC", "/somewhere")]
