"""Imports the modules of the core with their hooks, and, on request, with a sin planted in them.

It must be there before the first of them is imported. Nothing is written: no byte code either.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import CodeType, ModuleType
from typing import Any

from tests.guard.findings import Seen
from tests.guard.instrument import CORE, hooks, instrumented
from tests.house import REPO, is_generated

OUTSIDE = ("events.store", "projections.store")

Plants = Mapping[str, tuple[str, str]]  # module: what stands there, and what is put in its place


class Guarding(MetaPathFinder):
    """Finds core modules and loads them instrumented."""

    def __init__(self, seen: Seen, plants: Plants | None = None) -> None:
        self.seen = seen
        self.plants = plants or {}
        self.loaded: list[str] = []

    def install(self) -> None:
        """Begin. Raises RuntimeError where a core module is loaded already: it would not be watched."""
        early = [name for name in sys.modules if is_core(name)]
        if early:
            raise RuntimeError(f"loaded before the guard: {early}")
        sys.meta_path.insert(0, self)

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the spec of a core module; of others nothing is known here."""
        spec = PathFinder.find_spec(fullname, path, target) if is_core(fullname) else None
        if spec is None or spec.origin is None or is_generated(spec.origin):
            return None
        spec.loader = _Loader(fullname, spec.origin, self)
        return spec


def is_core(module: str) -> bool:
    """Say whether a module belongs to the core."""
    outside = any(f"{module}.".startswith(f"{name}.") for name in OUTSIDE)
    return module.split(".")[0] in CORE and not outside


def path_of(file: str) -> str:
    """Return a file's path inside the repository."""
    return file.removeprefix(f"{REPO}/")


class _Loader(SourceFileLoader):
    def __init__(self, fullname: str, path: str, guarding: Guarding) -> None:
        super().__init__(fullname, path)
        self._guarding = guarding

    def get_code(self, fullname: str) -> CodeType:
        """Compile from the source, whatever byte code lies beside it. Raises LookupError: no place for a plant."""
        text = self.get_data(self.path).decode("utf-8")
        if fullname in self._guarding.plants:
            old, new = self._guarding.plants[fullname]
            if text.count(old) != 1:
                raise LookupError(f"{fullname} holds {old!r} {text.count(old)} times")
            text = text.replace(old, new)
        return compile(instrumented(text, self.path), self.path, "exec", dont_inherit=True)

    def exec_module(self, module: ModuleType) -> None:
        """Give the module its hooks and run it."""
        names: dict[str, Any] = hooks(path_of(self.path), self._guarding.seen)
        module.__dict__.update(names)
        super().exec_module(module)
        self._guarding.loaded.append(module.__name__)
