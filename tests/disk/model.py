"""What a disk holds, what of it is durable, and what a power cut may leave of the rest.

A file has durable content and writes on their way; `fsync` makes them durable. A folder's names become durable by an
`fsync` of the folder and of nothing else. What is on its way may arrive in any order or not at all, sector by sector:
of each sector a cut leaves what was durable, or any later version. Two things are taken from file systems as they are:
a rename happens whole, and nothing that was written after a file was cut short arrives before that it was.
An `fsync` that returns is believed: a disk that lies about it is not modelled.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum
from hashlib import blake2b
from pathlib import Path
from typing import NamedTuple, Protocol


class Do(Enum):
    """What is done to a disk."""

    CREATE = "create"
    FOLDER = "make folder"
    WRITE = "write"
    SIZE = "set size"
    GROW = "reserve"  # the size, if it is smaller
    SYNC = "sync"
    SYNC_FOLDER = "sync folder"
    RENAME = "rename"
    DELETE = "delete"
    OPEN = "open"  # this and reading change nothing, and can fail
    READ = "read"


class Op(NamedTuple):
    """One operation. Paths are relative to the disk's root, which is ""."""

    do: Do
    path: str
    offset: int = 0  # or the size
    data: bytes = b""
    target: str = ""  # of a rename


class Cut(Protocol):
    """What a power cut chooses. Numbers are those of operations, in the order in which they were done."""

    sector: int
    """Bytes that arrive together."""
    zeros: bool
    """Whether a file may have grown for data that did not arrive."""

    def version(self, file: int, sector: int, numbers: list[int]) -> int:
        """Return the number of the last operation of which this sector has something."""

    def has(self, number: int) -> bool:
        """Say whether a change of a name or a size arrived."""

    def torn(self, number: int) -> int | None:
        """Return how many bytes of a write arrived, where that is no matter of sectors."""


Image = dict[str, bytes | None]
"""Every name with its content; None for a folder."""


@dataclass(eq=False, slots=True)
class File:
    """A file's content, whatever its name."""

    number: int
    durable: bytes = b""
    current: bytearray = field(default_factory=bytearray)
    pending: list[tuple[int, Op]] = field(default_factory=list)

    def do(self, number: int, op: Op) -> None:
        """Write or set the size, not durable yet."""
        if op.do is Do.GROW:
            op = Op(Do.SIZE, op.path, max(op.offset, len(self.current)))
        if op.do is Do.SIZE and op.offset == len(self.current):
            return
        self.pending.append((number, op))
        _apply(self.current, op)

    def sync(self) -> None:
        """Make all of it durable."""
        content = bytearray(self.durable)
        for _, op in self.pending:
            _apply(content, op)
        self.durable = bytes(content)
        self.pending.clear()

    def forget(self) -> None:
        """Fail to make it durable: the system drops what it could not write, and the next sync knows nothing of it."""
        self.pending.clear()

    def after(self, cut: Cut) -> bytes:
        """Return what a power cut leaves."""
        content, cut_short_at = bytearray(self.durable), None
        versions = self._versions(cut)
        for number, op in self.pending:
            if op.do is Do.SIZE:
                if cut_short_at is None and cut.has(number):
                    _apply(content, op)
                elif cut_short_at is None or op.offset < cut_short_at:
                    cut_short_at = op.offset
                continue
            for piece in _pieces(op, cut.sector):
                if cut_short_at is not None and piece.offset + len(piece.data) > cut_short_at:
                    continue
                if number <= versions[piece.offset // cut.sector]:
                    _apply(content, piece)
            if (arrived := cut.torn(number)) is not None:
                _apply(content, op._replace(data=op.data[:arrived]))
            end = op.offset + len(op.data)
            if cut.zeros and cut_short_at is None and end > len(content):
                _apply(content, Op(Do.SIZE, op.path, end))
        return bytes(content)

    def _versions(self, cut: Cut) -> dict[int, int]:
        touching: dict[int, list[int]] = {}
        for number, op in self.pending:
            if op.do is Do.WRITE:
                for piece in _pieces(op, cut.sector):
                    touching.setdefault(piece.offset // cut.sector, []).append(number)
        return {sector: cut.version(self.number, sector, numbers) for sector, numbers in touching.items()}


def _apply(content: bytearray, op: Op) -> None:
    if op.do is Do.SIZE:
        del content[op.offset :]
        content.extend(bytes(op.offset - len(content)))
        return
    content.extend(bytes(max(op.offset - len(content), 0)))
    content[op.offset : op.offset + len(op.data)] = op.data


def _pieces(op: Op, sector: int) -> Iterator[Op]:
    """Yield a write in parts that lie in one sector each."""
    start, end = op.offset, op.offset + len(op.data)
    while start < end:
        stop = min(end, (start // sector + 1) * sector)
        yield op._replace(offset=start, data=op.data[start - op.offset : stop - op.offset])
        start = stop


Names = dict[str, File | None]
"""What a name stands for; None for a folder."""


@dataclass(slots=True)
class _Change:
    """A change of names in one folder."""

    number: int
    folder: str
    gone: str | None = None
    made: str | None = None
    file: File | None = None

    def apply(self, names: Names) -> None:
        if self.gone is not None:
            names.pop(self.gone, None)
        if self.made is not None:
            names[self.made] = self.file


class Disk:
    """A folder on a disk. `do` follows what a process does to it."""

    def __init__(self, image: Image | None = None) -> None:
        """Begin with what is durable."""
        self.done = 0
        self.files = 0
        self._names: Names = {}
        for path, content in (image or {}).items():
            self._names[path] = None if content is None else self._file(content)
        self._durable = dict(self._names)
        self._changes: list[_Change] = []

    def do(self, op: Op) -> None:
        """Do one operation; it is the one that `done` numbers then."""
        self.done += 1
        match op.do:
            case Do.CREATE | Do.FOLDER:
                if op.path not in self._names:
                    self._change(_Change(self.done, folder_of(op.path), made=op.path, file=self._new(op)))
            case Do.DELETE:
                self._change(_Change(self.done, folder_of(op.path), gone=op.path))
            case Do.RENAME:
                file = self._names[op.path]
                self._change(_Change(self.done, folder_of(op.path), gone=op.path, made=op.target, file=file))
            case Do.SYNC_FOLDER:
                self._sync_folder(op.path)
            case Do.SYNC:
                self._content(op).sync()
            case Do.WRITE | Do.SIZE | Do.GROW:
                self._content(op).do(self.done, op)

    def fail(self, op: Op) -> None:
        """Follow an operation that failed: nothing was done, and what a sync could not write is never tried again."""
        if op.do is Do.SYNC:
            self._content(op).forget()

    def pending(self) -> list[int]:
        """Return the numbers of what is on its way, in order."""
        files = {file for names in (self._names, self._durable) for file in names.values() if file is not None}
        numbers = [number for file in files for number, _ in file.pending]
        return sorted({*numbers, *(change.number for change in self._changes)})

    def write(self, number: int) -> Op | None:
        """Return the operation of this number, where it is a write that is on its way."""
        pending = (one for file in self._names.values() if file is not None for one in file.pending)
        return next((op for at, op in pending if at == number and op.do is Do.WRITE), None)

    def after(self, cut: Cut) -> Image:
        """Return what a power cut leaves."""
        names = dict(self._durable)
        for change in self._changes:
            if cut.has(change.number):
                change.apply(names)
        image: Image = {}
        for path in sorted(names):  # a folder comes before what is in it
            file, folder = names[path], folder_of(path)
            if not folder or folder in image:
                image[path] = None if file is None else file.after(cut)
        return image

    def _file(self, content: bytes) -> File:
        self.files += 1
        return File(self.files, content, bytearray(content))

    def _new(self, op: Op) -> File | None:
        return self._file(b"") if op.do is Do.CREATE else None

    def _content(self, op: Op) -> File:
        file = self._names[op.path]
        assert file is not None, f"{op.path} is a folder"
        return file

    def _change(self, change: _Change) -> None:
        change.apply(self._names)
        self._changes.append(change)

    def _sync_folder(self, folder: str) -> None:
        for change in self._changes:
            if change.folder == folder:
                change.apply(self._durable)
        self._changes = [change for change in self._changes if change.folder != folder]


def folder_of(path: str) -> str:
    """Return the folder that a name is in."""
    return path.rpartition("/")[0]


def digest(image: Image) -> bytes:
    """Return what tells two images apart."""
    told = blake2b(digest_size=16)
    for path in sorted(image):
        content = image[path]
        kind = b"d" if content is None else b"f"
        told.update(b"%s %d %s\n%d\n" % (kind, len(path), path.encode(), len(content or b"")))
        told.update(content or b"")
    return told.digest()


def write_out(image: Image, root: Path) -> None:
    """Lay an image out in an empty folder."""
    for path in sorted(image):
        content = image[path]
        if content is None:
            (root / path).mkdir(mode=0o700)
        else:
            (root / path).write_bytes(content)
            (root / path).chmod(0o600)


def read_in(root: Path) -> Image:
    """Return what lies in a folder as an image, shared memory left out."""
    return {
        path.relative_to(root).as_posix(): None if path.is_dir() else path.read_bytes()
        for path in sorted(root.rglob("*"))
        if not path.name.endswith("-shm")
    }
