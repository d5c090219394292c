"""Golden flights in every environment: interpreter x hash seed x CPU features x time zone and locale x protobuf.

A cell is one process that runs all golden flights and tells all of them anew; it must come to exactly what is written
in `tests/golden/digests.json`. Each cell says what its environment was, so that a setting that does not bite is a
failure of the matrix itself. Needs localedef (glibc) for the locale with a comma, builds below build/matrix.

    run(None, 1, report)    every cell of every installed Python
    run(6, 2, report)       six of them
"""

from __future__ import annotations

import json
import os
import subprocess
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from hashlib import sha256
from itertools import product
from pathlib import Path
from typing import Any

from tests.golden.table import DIGESTS
from tests.house import REPO
from tests.torture.interpreters import BUILD, Interpreter, NoPackages, installed, with_packages

AT_ONCE = 2
HASH_SEEDS = ("0", "1", "2", "3", "4242")
CPUS: Mapping[str, Mapping[str, str]] = {
    "all": {},
    "masked": {
        "OPENSSL_ia32cap": "0x0:0x0",  # no SSE4, AVX, AES, SHA in OpenSSL
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-AVX512F,-AVX512VL,-AVX512BW,-ERMS,-SSSE3,-SSE4_1,-SSE4_2,-BMI2",
    },
}
COMMA = "de_DE.UTF-8"
PLACES = {"UTC": "C", "Pacific/Chatham": COMMA}
HALF = {"C": "0.5", COMMA: "0,5"}
ZONES = {"UTC": "+0000", "Pacific/Chatham": "+1245"}
PROTOBUFS = ("upb", "python")
SLOWER = 1.5  # what masking does to SHA-256, at least: it was 3 to 4
LOADER = Path("/lib64/ld-linux-x86-64.so.2")


@dataclass(frozen=True, slots=True)
class Cell:
    """One environment."""

    interpreter: Interpreter
    hash_seed: str = "0"
    cpu: str = "all"
    zone: str = "UTC"
    protobuf: str = "upb"
    optimise: bool = False  # without asserts

    @property
    def name(self) -> str:
        """All its settings."""
        asserts = "no asserts" if self.optimise else "asserts"
        settings = (self.interpreter.name, f"seed {self.hash_seed}", self.cpu, self.zone, self.protobuf, asserts)
        return ", ".join(settings)

    def environ(self, locales: Path) -> dict[str, str]:
        """Return the whole environment of its process: nothing is taken over but PATH."""
        packages = self.interpreter.packages
        return {
            "PATH": os.defpath,
            "PYTHONPATH": os.pathsep.join(map(str, filter(None, (REPO, packages)))),
            "PYTHONDONTWRITEBYTECODE": "1",
            "PYTHONHASHSEED": self.hash_seed,
            "PYTHONCOERCECLOCALE": "0",
            "PYTHONUTF8": "0",
            "PROTOCOL_BUFFERS_PYTHON_IMPLEMENTATION": self.protobuf,
            "LOCPATH": str(locales),
            "LC_ALL": PLACES[self.zone],
            "TZ": self.zone,
            **CPUS[self.cpu],
        }

    def wrong(self, seen: Mapping[str, str]) -> list[str]:
        """Return which of its settings did not bite."""
        expected = {
            "python": self.interpreter.name,
            "protobuf": self.protobuf,
            "asserts": str(not self.optimise),
            "zone": ZONES[self.zone],
            "half": HALF[PLACES[self.zone]],
        }
        return [f"{name} is {seen[name]}, not {value}" for name, value in expected.items() if seen[name] != value]


@dataclass(slots=True)
class Found:
    """What the cells came to."""

    cells: int = 0
    different: list[str] = field(default_factory=list)  # cells that came to something else, and to what
    unlike: list[str] = field(default_factory=list)  # settings that did not bite
    not_run: dict[str, str] = field(default_factory=dict)  # interpreter: why
    versions: Counter[str] = field(default_factory=Counter)
    hashes: dict[str, set[str]] = field(default_factory=dict)  # by hash seed, over interpreters
    sha256_us: dict[str, list[int]] = field(default_factory=dict)  # by cpu


def cells_of(interpreter: Interpreter) -> list[Cell]:
    """Return every cell of an interpreter: the product, and one without asserts for each protobuf."""
    axes = product(HASH_SEEDS, CPUS, PLACES, PROTOBUFS)
    return [
        *(Cell(interpreter, *values) for values in axes),
        *(Cell(interpreter, protobuf=one, optimise=True) for one in PROTOBUFS),
    ]


def sampled(cells: Sequence[Cell], count: int, seed: int) -> list[Cell]:
    """Return so many of the cells, chosen by the seed."""
    return sorted(cells, key=lambda cell: sha256(f"{seed}/{cell.name}".encode()).digest())[:count]


def make_locales(folder: Path) -> Path:
    """Compile the locale with a comma into a folder. Raises OSError and CalledProcessError."""
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / COMMA).exists():
        subprocess.run(["localedef", "-i", "de_DE", "-f", "UTF-8", str(folder / COMMA)], check=True)
    return folder


def fly(cell: Cell, locales: Path) -> dict[str, Any]:
    """Run a cell; return what its process printed. Raises CalledProcessError, whose `stderr` says why."""
    command = [*cell.interpreter.command, *(["-O"] * cell.optimise), "-m", "tests.torture.matrix_child"]
    run = subprocess.run(command, cwd=REPO, env=cell.environ(locales), capture_output=True, text=True, check=True)
    answer: dict[str, Any] = json.loads(run.stdout)
    return answer


def differing(results: Mapping[str, Any], expected: Mapping[str, Any]) -> list[str]:
    """Return the names of what is not as it is written."""
    return [
        f"{part} {name}"
        for part, names in expected.items()
        for name in (names if isinstance(names, dict) else [""])
        if _at(results, part, name) != _at(expected, part, name)
    ]


def _at(results: Mapping[str, Any], part: str, name: str) -> Any:
    return results[part].get(name) if name else results[part]


def take(found: Found, cell: Cell, answer: Mapping[str, Any]) -> None:
    """Count a cell's answer."""
    expected = json.loads(DIGESTS.read_text(encoding="utf-8"))
    seen = answer["environment"]
    found.cells += 1
    found.versions[cell.interpreter.name] += 1
    found.different.extend(f"{cell.name}: {what}" for what in differing(answer["results"], expected))
    found.unlike.extend(f"{cell.name}: {what}" for what in cell.wrong(seen))
    found.hashes.setdefault(cell.hash_seed, set()).add(seen["hash"])
    found.sha256_us.setdefault(cell.cpu, []).append(int(seen["sha256_us"]))


def run(count: int | None, seed: int, report: Callable[[str], None]) -> dict[str, Any]:
    """Run so many cells, all of them for None; return the counts.

    Raises AssertionError: a cell differs, or a setting does not bite.
    """
    found, cells = Found(), list[Cell]()
    for interpreter in installed():
        try:
            cells.extend(cells_of(with_packages(interpreter)))
        except NoPackages as error:
            found.not_run[interpreter.name] = str(error)
    chosen, locales = sampled(cells, len(cells) if count is None else count, seed), make_locales(BUILD / "locale")
    with ThreadPoolExecutor(AT_ONCE) as pool:
        for cell, answer in zip(chosen, pool.map(lambda one: fly(one, locales), chosen), strict=True):
            take(found, cell, answer)
            report(f"{found.cells} of {len(chosen)}: {cell.name}")
    assert not found.different, found.different
    assert not found.unlike, found.unlike
    return counts(found)


def counts(found: Found) -> dict[str, Any]:
    """Return what was found, for the result file. Raises AssertionError where hash seeds or CPU settings don't bite."""
    hashes = [hashed for hashes in found.hashes.values() for hashed in hashes]
    assert len(set(hashes)) == len(hashes) >= len(found.hashes), found.hashes
    times = {cpu: min(times_us) for cpu, times_us in sorted(found.sha256_us.items())}
    assert set(times) != set(CPUS) or times["masked"] > SLOWER * times["all"], times
    digests = json.loads(DIGESTS.read_text(encoding="utf-8"))
    return {
        "cells": found.cells,
        "cells_that_differ": 0,
        "golden_flights_replayed_in_each": len(digests["replayed"]),
        "flights_told_anew_in_each": len(digests["flown"]),
        "interpreters": dict(sorted(found.versions.items())),
        "interpreters_not_run": found.not_run,
        "hash_seeds": sorted(found.hashes),
        "time_zones_and_locales": PLACES,
        "protobuf": PROTOBUFS,
        "cpu": {name: dict(settings) for name, settings in CPUS.items()},
        "sha256_of_8_MiB_us": times,
        "glibc_features_masked": masked_words(),
    }


def masked_words() -> int | None:
    """Return how many words of CPU features glibc reports otherwise where they are masked; None without its loader."""
    if not LOADER.exists():
        return None
    told = [_diagnostics(settings) for settings in CPUS.values()]
    return len(told[0] ^ told[1]) // 2


def _diagnostics(settings: Mapping[str, str]) -> set[str]:
    run = subprocess.run([LOADER, "--list-diagnostics"], env=settings, capture_output=True, text=True, check=True)
    return {line for line in run.stdout.splitlines() if ".active[" in line}
