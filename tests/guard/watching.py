"""Watches what is called while the core decides: clocks, chance, files, sockets, threads.

C functions are seen by the interpreter's profile hook, wherever they are called from; what is reached without a call
of one (a file that is opened, a module that is imported) by its audit hook. What is found is put down to the nearest
line of the core.
"""

from __future__ import annotations

import builtins
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import BuiltinFunctionType, FrameType, MethodDescriptorType, ModuleType
from typing import Any

from tests.guard.findings import CALLS, REACHES, Seen
from tests.guard.instrument import CORE
from tests.guard.loading import path_of

OUTER_WORLD = ("time", "posix", "random", "_random", "datetime", "_socket", "_thread", "_io", "select", "signal", "gc")
PLAIN = (dict, list, str, bytes, tuple, int, bool, set, frozenset)  # whose methods reach nothing
TALKING = ("open", "input", "print")
AUDITED = ("open", "import", "os.", "socket.", "subprocess.", "time.sleep", "tempfile.", "shutil.", "ctypes.")
_FOLDERS = tuple(f"{name}/" for name in CORE)
_OUTSIDE = ("events/store/", "projections/store.py")


class Watch:
    """Notes what the core calls while it is on, and what it reaches from then on: an audit hook stays for good."""

    def __init__(self, seen: Seen) -> None:
        self._seen = seen
        sys.addaudithook(self._audited)

    @contextmanager
    def on(self) -> Iterator[None]:
        """Watch for the length of a block."""
        sys.setprofile(self._profiled)
        try:
            yield
        finally:
            sys.setprofile(None)

    def _profiled(self, frame: FrameType, event: str, called: Any) -> None:
        if event == "c_call" and (name := _banned(called)):
            self._note(frame, f"{CALLS} {name}")

    def _audited(self, event: str, _given: tuple[Any, ...]) -> None:
        if event.startswith(AUDITED):
            self._note(sys._getframe(1), f"{REACHES}: {event}")

    def _note(self, frame: FrameType | None, what: str) -> None:
        while frame is not None and not is_core_file(frame.f_code.co_filename):
            frame = frame.f_back
        if frame is not None:
            self._seen.add(path_of(frame.f_code.co_filename), frame.f_lineno, what)


def is_core_file(file: str) -> bool:
    """Say whether a file belongs to the core."""
    path = path_of(file)
    return path.startswith(_FOLDERS) and not path.startswith(_OUTSIDE)


def _banned(called: Any) -> str:
    """Return the name of a C function that the core may not call, empty for any other."""
    if type(called) is BuiltinFunctionType and type(called.__self__) in PLAIN:
        return ""
    owner = called.__objclass__ if type(called) is MethodDescriptorType else called.__self__
    if owner is builtins:
        return called.__name__ if called.__name__ in TALKING else ""
    module, name = _name(owner, called)
    return f"{module}.{name}" if module in OUTER_WORLD else ""


def _name(owner: Any, called: Any) -> tuple[str, str]:
    """Return module and name of a function; for a method of an object, which are many, the name of its class."""
    if type(owner) is ModuleType:
        return owner.__name__, called.__name__
    if isinstance(owner, type):
        return owner.__module__, called.__qualname__
    return type(owner).__module__, type(owner).__qualname__
