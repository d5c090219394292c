"""Where the node meets its disk: an apsw VFS for SQLite, and the calls of `os` and `io` that everything else uses.

`meeting` puts both in place for a while, for one folder, on this thread's process; the code under test has no part in
it. Each operation is shown to a `Watch` before it is done. A watch that raises OSError refuses it: SQLite is told an
I/O error (or a full disk for ENOSPC), everybody else gets the OSError. SQLite keeps its own files in the system's
VFS below, shared memory and locks included, so its behaviour is its own.
"""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, wraps
from pathlib import Path
from typing import Any
from unittest.mock import patch

import apsw

from tests.disk.model import Do, Op, folder_of

Watch = Callable[[Op], None]
_SYSTEM = "unix"
_NEW_JOURNALS = apsw.SQLITE_OPEN_WAL | apsw.SQLITE_OPEN_MAIN_JOURNAL


@contextmanager
def meeting(root: Path, watch: Watch) -> Iterator[None]:
    """Show every operation below `root` to `watch`."""
    seam = _Seam(root, watch)
    vfs = _vfs()
    calls = {name: getattr(_Calls(seam), name) for name in _PATCHED}
    vfs.seam = seam
    apsw.set_default_vfs(vfs.name)
    try:
        with patch.multiple(os, **calls), patch.object(io, "open", _opener(seam)):
            yield
    finally:
        seam.over = True
        apsw.set_default_vfs(_SYSTEM)


class _Seam:
    """Names paths as the watch knows them, and lets what is elsewhere pass."""

    def __init__(self, root: Path, watch: Watch) -> None:
        self._root = f"{root.resolve()}{os.sep}"
        self._watch = watch
        self.written: set[str] = set()  # through Python's own files, which are seen when they are synced
        self.over = False

    def ours(self, path: Any) -> str | None:
        """Return a path below the root, relative to it; the root itself is ""."""
        full = os.fspath(path) if not isinstance(path, int) else os.readlink(f"/proc/self/fd/{path}")
        if self.over or full.endswith("-shm") or not f"{full}{os.sep}".startswith(self._root):
            return None
        return full[len(self._root) :]

    def see(self, do: Do, path: Any, offset: int = 0, data: bytes = b"", target: Any = "") -> None:
        """Show one operation. Raises OSError where it is refused."""
        if (ours := self.ours(path)) is not None:
            self._watch(Op(do, ours, offset, data, (self.ours(target) or "") if target else ""))

    def catch_up(self, path: Any) -> None:
        """Show what Python's own files have written since they were opened: all of it, as one write."""
        ours = self.ours(path)
        if ours in self.written:
            content = os.pread(path, os.fstat(path).st_size, 0) if _readable(path) else self._content(ours)
            self.see(Do.SIZE, path, len(content))
            self.see(Do.WRITE, path, 0, content)

    def _content(self, ours: str) -> bytes:
        return Path(self._root, ours).read_bytes()


def _readable(descriptor: int) -> bool:
    try:
        os.pread(descriptor, 1, 0)
    except OSError:
        return False
    return True


class _Calls:
    """The calls of `os` that change a disk, each seen before it is done."""

    def __init__(self, seam: _Seam) -> None:
        self._seam = seam

    def open(self, path: Any, flags: int, mode: int = 0o777, **more: Any) -> int:
        made = flags & os.O_CREAT and not os.path.exists(path)
        self._seam.see(Do.CREATE if made else Do.OPEN, path)
        return int(_REAL["open"](path, flags, mode, **more))

    def pwrite(self, descriptor: int, data: bytes, offset: int) -> int:
        self._seam.see(Do.WRITE, descriptor, offset, bytes(data))
        return int(_REAL["pwrite"](descriptor, data, offset))

    def ftruncate(self, descriptor: int, length: int) -> None:
        self._seam.see(Do.SIZE, descriptor, length)
        _REAL["ftruncate"](descriptor, length)

    def posix_fallocate(self, descriptor: int, offset: int, length: int) -> None:
        self._seam.see(Do.GROW, descriptor, offset + length)
        _REAL["posix_fallocate"](descriptor, offset, length)

    def fsync(self, descriptor: int) -> None:
        self._seam.catch_up(descriptor)
        folder = os.path.isdir(f"/proc/self/fd/{descriptor}")
        self._seam.see(Do.SYNC_FOLDER if folder else Do.SYNC, descriptor)
        _REAL["fsync"](descriptor)

    def mkdir(self, path: Any, *arguments: Any, **more: Any) -> None:
        if not os.path.isdir(path):
            self._seam.see(Do.FOLDER, path)
        _REAL["mkdir"](path, *arguments, **more)

    def unlink(self, path: Any, **more: Any) -> None:
        if os.path.lexists(path):
            self._seam.see(Do.DELETE, path)
        _REAL["unlink"](path, **more)

    def rename(self, path: Any, target: Any, **more: Any) -> None:
        self._seam.see(Do.RENAME, path, target=target)
        _REAL["rename"](path, target, **more)

    def replace(self, path: Any, target: Any, **more: Any) -> None:
        self._seam.see(Do.RENAME, path, target=target)
        _REAL["replace"](path, target, **more)


_PATCHED = ("open", "pwrite", "ftruncate", "posix_fallocate", "fsync", "mkdir", "unlink", "rename", "replace")
_REAL: dict[str, Any] = {name: getattr(os, name) for name in _PATCHED}


def _opener(seam: _Seam) -> Callable[..., Any]:
    real = io.open

    @wraps(real)
    def opened(file: Any, mode: str = "r", *arguments: Any, **more: Any) -> Any:
        ours = seam.ours(file)
        if ours is not None and not isinstance(file, int):
            assert set(mode).isdisjoint("wax"), "what makes a file makes it through os.open"
            seam.see(Do.OPEN, file)
        if ours is not None and not set(mode).isdisjoint("wax+"):
            seam.written.add(ours)
        return real(file, mode, *arguments, **more)

    return opened


class _Vfs(apsw.VFS):
    """SQLite's way to the disk while it is the default. It outlives every connection that began with it."""

    name = "watched"
    seam: _Seam

    def __init__(self) -> None:
        super().__init__(self.name, _SYSTEM)

    def xOpen(self, name: Any, flags: list[int]) -> Any:  # noqa: N802 - SQLite's name
        path = name.filename() if isinstance(name, apsw.URIFilename) else name
        return super().xOpen(name, flags) if path is None else _VfsFile(self.seam, path, name, flags)

    def xDelete(self, name: str, sync: bool) -> None:  # noqa: N802
        if os.path.lexists(name):
            _told(self.seam, Do.DELETE, name)
        super().xDelete(name, sync)
        if sync:
            _told(self.seam, Do.SYNC_FOLDER, folder_of(name))


@cache
def _vfs() -> _Vfs:
    return _Vfs()


class _VfsFile(apsw.VFSFile):
    """One file of SQLite's."""

    def __init__(self, seam: _Seam, path: str, name: Any, flags: list[int]) -> None:
        self._seam, self._path = seam, path
        creates = flags[0] & apsw.SQLITE_OPEN_CREATE
        # The system's VFS syncs the folder with the first sync of a journal that it may have made.
        self._folder_too = bool(creates and flags[0] & _NEW_JOURNALS)
        _told(seam, Do.CREATE if creates and not os.path.exists(path) else Do.OPEN, path)
        super().__init__(_SYSTEM, name, flags)

    def xLock(self, level: int) -> None:  # noqa: N802
        """Lock; a reader that closes asks for a lock that its descriptor can't give, which apsw would raise."""
        try:
            super().xLock(level)
        except apsw.IOError as error:
            raise apsw.BusyError("this lock is not given") from error

    def xRead(self, amount: int, offset: int) -> bytes:  # noqa: N802
        _told(self._seam, Do.READ, self._path, offset)
        read: bytes = super().xRead(amount, offset)
        return read

    def xWrite(self, data: bytes, offset: int) -> None:  # noqa: N802
        _told(self._seam, Do.WRITE, self._path, offset, bytes(data))
        super().xWrite(data, offset)

    def xTruncate(self, size: int) -> None:  # noqa: N802
        _told(self._seam, Do.SIZE, self._path, size)
        super().xTruncate(size)

    def xSync(self, flags: int) -> None:  # noqa: N802
        _told(self._seam, Do.SYNC, self._path)
        super().xSync(flags)
        if self._folder_too:
            _told(self._seam, Do.SYNC_FOLDER, folder_of(self._path))
            self._folder_too = False


def _told(seam: _Seam, do: Do, path: str, offset: int = 0, data: bytes = b"") -> None:
    """Show an operation of SQLite's, and refuse it in SQLite's words."""
    try:
        seam.see(do, path, offset, data)
    except OSError as error:
        if error.errno == errno.ENOSPC:
            raise apsw.FullError("no space, for a test") from error
        raise apsw.IOError(f"{do.value} failed, for a test") from error
