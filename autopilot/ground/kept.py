"""What a witness keeps of nodes: a file a flight in the operator's folder, so that it outlives process and drone.

`witness/<node>/<flight>.json` holds the checkpoint up to which the log is proven to have grown in order, and those
that were heard since and are not proven yet. What contradicts lies beside it, and replaces nothing. Everything is
verified again when it is read. What is to be kept is decided in `witness`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from autopilot.trust.keys import write_file
from autopilot.trust.notes import Checkpoint, LogKey, NoteInvalid, open_note, read_checkpoint, read_log_key

FOLDER = "witness"
EVIDENCE = "contradiction-"
# A node that contradicts itself goes on doing so, every 10 s: the first ones are enough.
EVIDENCE_MAX = 16


@dataclass(frozen=True, slots=True)
class Kept:
    """A checkpoint of a node that its keys stand behind, and the notes that show it."""

    log_key: LogKey
    checkpoint: Checkpoint
    at_ms: int  # the node's clock when it published it, milliseconds since 1970
    certificate: str
    note: str

    def plain(self) -> dict[str, Any]:
        """Return what is written."""
        return {"log_key": self.certificate, "checkpoint": self.note, "at_ms": self.at_ms}


@dataclass(frozen=True, slots=True)
class Chain:
    """One flight of a node as a witness knows it."""

    proven: Kept  # the log grew in order up to here, from the first checkpoint that was heard of the flight
    waiting: tuple[Kept, ...] = ()  # heard since, by size: not proven yet

    @property
    def newest(self) -> Kept:
        """The newest checkpoint that was heard."""
        return self.waiting[-1] if self.waiting else self.proven

    @property
    def flight_number(self) -> int:
        """Which flight it is."""
        return self.proven.log_key.flight_number


class Memory:
    """What is kept of one node."""

    def __init__(self, folder: Path, deployment_id: str, node: str, public_key: bytes) -> None:
        """Keep files below the operator's `folder`; notes count when `public_key` (32 bytes) stands behind them."""
        self.folder = folder / FOLDER / node
        self._names = (deployment_id, node)
        self._public_key = public_key

    def opened(self, said: dict[str, Any]) -> Kept:
        """Return what certificate and checkpoint say, where the node's key stands behind them. Raises NoteInvalid."""
        deployment_id, node = self._names
        certificate, note = str(said["log_key"]), str(said["checkpoint"])
        log_key = read_log_key(open_note(certificate, f"waypoint/{deployment_id}/{node}", self._public_key))
        if (log_key.deployment_id, log_key.node) != self._names:
            raise NoteInvalid("the certificate is about another node's log")
        checkpoint = read_checkpoint(open_note(note, log_key.origin, log_key.public_key))
        if checkpoint.origin != log_key.origin:
            raise NoteInvalid("the checkpoint is about another log than its key may sign")
        return Kept(log_key, checkpoint, int(said["at_ms"]), certificate, note)

    def newest(self) -> Chain | None:
        """Return the newest flight that is kept. Raises NoteInvalid where the file was damaged."""
        return next(self.chains(), None)

    def chains(self) -> Iterator[Chain]:
        """Yield the flights that are kept, newest first.

        Raises NoteInvalid where the newest was damaged; an older one that can't be read is left out.
        """
        paths = sorted(self.folder.glob("[0-9]*.json"), reverse=True)
        for newest in paths[:1]:
            yield self._read(newest)
        for older in paths[1:]:
            with suppress(NoteInvalid):
                yield self._read(older)

    def keep(self, chain: Chain) -> None:
        """Write a flight's file. Raises OSError."""
        written = chain.proven.plain() | {"waiting": [one.plain() for one in chain.waiting]}
        self._write(f"{chain.flight_number:06d}.json", written)

    def keep_evidence(self, kept: Kept, said: Kept, because: str, proof: dict[str, Any] | None = None) -> None:
        """Lay both notes aside, with the path that shows that they contradict each other. Raises OSError."""
        name = f"{EVIDENCE}{hashlib.sha256(said.note.encode()).hexdigest()[:16]}.json"
        if (self.folder / name).exists() or len(list(self.folder.glob(f"{EVIDENCE}*"))) >= EVIDENCE_MAX:
            return
        self._write(name, {"because": because, "kept": kept.plain(), "said": said.plain(), "proof": proof})

    def _read(self, path: Path) -> Chain:
        try:
            was = json.loads(path.read_text("utf-8"))
            return Chain(self.opened(was), tuple(self.opened(one) for one in was["waiting"]))
        except (ValueError, KeyError, TypeError) as error:
            raise NoteInvalid(f"{path}: what was kept can't be read: {error}") from error

    def _write(self, name: str, value: dict[str, Any]) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        write_file(self.folder / name, json.dumps(value, ensure_ascii=False, indent=1).encode())
