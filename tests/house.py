"""The house as text: which files there are, for the tests that read source instead of running it.

It knows folders, not rules; those are in test_tidy.py and test_floors.py.
"""

from __future__ import annotations

import ast
import fnmatch
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

REPO = Path(__file__).resolve().parent.parent
PACKAGES = ("events", "statecharts", "projections", "replay", "autopilot")
CODE = (*PACKAGES, "tests", "docs")


@dataclass(frozen=True, slots=True)
class Source:
    """A Python file: its path inside the repository, its text and its tree."""

    path: str
    text: str
    tree: ast.Module

    @property
    def module(self) -> str:
        """Dotted name under which it is imported."""
        return self.path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def source_of(path: str, text: str) -> Source:
    """Parse `text` as the file `path`. Raises SyntaxError."""
    return Source(path, text, ast.parse(text, path))


def is_generated(path: str) -> bool:
    """Say whether a compiler wrote this file, so that no style applies to it."""
    return path.endswith(("_pb2.py", "_pb2.pyi"))


def sources(*folders: str) -> Iterator[Source]:
    """Yield the Python files in these folders that people write, in a fixed order."""
    for folder in folders:
        for file in sorted((REPO / folder).rglob("*.py")):
            path = file.relative_to(REPO).as_posix()
            if not is_generated(path):
                yield source_of(path, file.read_text(encoding="utf-8"))


def ignored_names() -> tuple[str, ...]:
    """Return the patterns of .gitignore, as far as they name things at the top."""
    lines = (REPO / ".gitignore").read_text(encoding="utf-8").splitlines()
    return tuple(line.strip("/") for line in lines if line.strip() and not line.startswith("#"))


def is_ignored(name: str) -> bool:
    """Say whether git is told to leave a file or folder of this name alone."""
    return any(fnmatch.fnmatch(name, pattern) for pattern in ignored_names())


def text_files() -> Iterator[tuple[str, str]]:
    """Yield path and text of every file that belongs to the project and is text."""
    for file in sorted(REPO.rglob("*")):
        parts = file.relative_to(REPO).parts
        if file.is_dir() or parts[0] == ".git" or any(is_ignored(part) for part in parts):
            continue
        try:
            yield "/".join(parts), file.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
