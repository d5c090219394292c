"""The Pythons of this machine from 3.11 on, and the packages that a replay needs, for each of them.

Packages are put into a folder below build/, not into an interpreter; only wheels are taken.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.house import REPO

OLDEST = (3, 11)
# By events, statecharts, projections' folds and replay.
NEEDED = ("apsw", "h3", "msgspec", "numpy", "protobuf", "transitions")
BUILD = REPO / "build" / "matrix"
_ASK = (
    "import json, os, platform, sys; print(json.dumps([list(sys.version_info[:3]), "
    "os.path.realpath(getattr(sys, '_base_executable', None) or sys.executable), platform.python_compiler()]))"
)


@dataclass(frozen=True, slots=True)
class Interpreter:
    """A Python, and where its packages are."""

    version: tuple[int, int, int]
    compiler: str
    executable: str
    packages: Path | None = None  # None: its own

    @property
    def name(self) -> str:
        """Version and build, as a person tells them apart."""
        return f"{'.'.join(map(str, self.version))} ({self.compiler})"

    @property
    def command(self) -> list[str]:
        """How it is started: with nothing but the packages that it was given."""
        return [self.executable] if self.packages is None else [self.executable, "-S"]


class NoPackages(RuntimeError):
    """There are no wheels of what a replay needs for this version."""


def present() -> Interpreter:
    """Return the Python that runs this, with its own packages."""
    found = _asked(sys.executable)
    assert found is not None
    return Interpreter(found.version, found.compiler, sys.executable)


def installed() -> list[Interpreter]:
    """Return every Python from 3.11 on that is found in PATH or below pyenv, each build once."""
    found = filter(None, map(_asked, _candidates()))
    builds = {one.executable: one for one in found if one.version[:2] >= OLDEST}
    return sorted(builds.values(), key=lambda one: (one.version, one.executable))


def _candidates() -> Iterator[str]:
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    folders = [*map(Path, os.get_exec_path()), *sorted(pyenv.glob("versions/*/bin"))]
    for folder in folders:
        if folder.is_dir():
            yield from (str(file) for file in sorted(folder.iterdir()) if re.fullmatch(r"python3\.\d+t?", file.name))


def _asked(executable: str) -> Interpreter | None:
    """Ask a Python what it is; None for one that does not start."""
    try:
        run = subprocess.run([executable, "-I", "-c", _ASK], capture_output=True, text=True, timeout=60, check=True)
        version, real, compiler = json.loads(run.stdout)
    except (OSError, subprocess.SubprocessError, ValueError):
        return None
    return Interpreter((version[0], version[1], version[2]), compiler, real)


def with_packages(interpreter: Interpreter) -> Interpreter:
    """Return the interpreter with the packages that a replay needs. Raises NoPackages."""
    minor = "{}.{}".format(*interpreter.version)
    folder = BUILD / f"packages-{minor}"
    if not folder.exists():
        _install(minor, folder, requirements(NEEDED))
    return Interpreter(interpreter.version, interpreter.compiler, interpreter.executable, folder)


def _install(minor: str, folder: Path, wanted: Iterable[str]) -> None:
    unfinished = folder.with_suffix(".unfinished")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--upgrade"]
    which = ["--only-binary", ":all:", "--implementation", "cp", "--python-version", minor, "--target", str(unfinished)]
    if subprocess.run([*pip, *which, *wanted], capture_output=True, check=False).returncode:
        raise NoPackages(f"no wheels of what a replay needs for {minor}")
    unfinished.rename(folder)


def requirements(names: Iterable[str]) -> list[str]:
    """Return what the project asks of these packages. Raises StopIteration for one that it does not ask for."""
    asked = tomllib.loads((REPO / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    return [next(line for line in asked if re.match(rf"{name}\b", line)) for name in names]
