"""What the open flight's checkpoints were cosigned by: which cosignatures are believed, and where they are kept.

A witness sends back a checkpoint with its own line under it. It is taken when the log's key signed that checkpoint,
the sender's own key the line, and it is newer than what this witness cosigned before. One over more records than were
signed here says that this log was rolled back behind it, one over another root that it was forked: both are told by
name. What is taken is an observation; once that is durable, the line is kept under the checkpoint beside the log.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

from autopilot.adapters.mesh.orders import issuer_of
from autopilot.ports.edges import Clock
from autopilot.trust.cosignatures import (
    COSIGNATURES_MAX,
    Cosignature,
    check_cosignature,
    cosigned,
    cosigner_name,
    parted,
)
from autopilot.trust.limits import SKEW_MS, TTL_MS_MAX
from autopilot.trust.notes import Checkpoint, NoteInvalid, open_note, read_checkpoint
from autopilot.trust.verdict import Sealed
from events.records import Record
from events.schema.flight_pb2 import CheckpointCosigned
from events.schema.waypoint_pb2 import AuthEnvelope
from events.store import Appender

# Checkpoints that may still be cosigned: ten minutes of them, where one is made every 10 s.
RECENT_MAX = 64


class Newest(NamedTuple):
    """The newest checkpoint that a witness cosigned."""

    size: int
    principal_id: str


class Cosigned:
    """Remembers one open flight's checkpoints. `judge` may be called from any thread, the rest on the node's."""

    def __init__(self, origin: str, public_key: bytes, store: Appender, clock: Clock) -> None:
        self._origin = origin
        self._public_key = public_key
        self._store = store
        self._clock = clock
        self._roots: dict[int, bytes] = {}  # of the newest checkpoints, by size
        self._notes: dict[int, str] = {}  # of the cosigned ones among them, as they are kept
        self._sizes: dict[str, int] = {}  # newest size by witness
        self.newest: Newest | None = None

    def resume(self, size: int, root: bytes, note: str) -> None:
        """Begin with the newest checkpoint that is kept. Raises NoteInvalid."""
        self.signed(size, root)
        _, _, lines = parted(note)
        if lines:
            self._notes[size] = note
        for line in lines:
            self._sizes[line.name] = size
            self.newest = Newest(size, line.name.rpartition("/")[2])

    def signed(self, size: int, root: bytes) -> None:
        """Take in a checkpoint that was signed."""
        self._roots[size] = root
        while len(self._roots) > RECENT_MAX:
            oldest = next(iter(self._roots))
            del self._roots[oldest]
            self._notes.pop(oldest, None)

    def judge(self, message: Sealed, note: str) -> CheckpointCosigned | str:
        """Return the observation of a cosignature, or the name of what is wrong with it."""
        try:
            text, bare, lines = parted(note)
            said = read_checkpoint(text)
            wrong = self._wrong(message, said, text, bare, lines)
        except NoteInvalid:
            return "unreadable"
        return wrong or CheckpointCosigned(
            witness=issuer_of(message),
            origin=said.origin,
            size=said.size,
            root=said.root,
            cosigned_at_s=lines[0].time_s,
            checkpoint=note,
            token=AuthEnvelope.FromString(message.envelope).token,
        )

    def hear(self, records: Iterable[Record]) -> None:
        """Keep beside the log what is durable now. Raises StoreFailed."""
        for record in records:
            if isinstance(record.message, CheckpointCosigned) and record.message.origin == self._origin:
                self._keep(record.message)

    def _keep(self, said: CheckpointCosigned) -> None:
        _, bare, lines = parted(said.checkpoint)
        before = self._notes.get(said.size)
        if before is not None:
            _, kept_bare, kept = parted(before)
            if kept_bare != bare or len(kept) == COSIGNATURES_MAX or lines[0].name in {one.name for one in kept}:
                return  # the same records under another text, or enough lines: the log itself holds this one
            lines = (*kept, *lines)
        note = cosigned(bare, lines)
        self._store.add_checkpoint(said.size, note)
        self._notes[said.size] = note
        self._sizes[lines[-1].name] = said.size
        if self.newest is None or said.size >= self.newest.size:
            self.newest = Newest(said.size, said.witness.principal_id)

    def _wrong(self, message: Sealed, said: Checkpoint, text: str, bare: str, lines: tuple[Cosignature, ...]) -> str:
        """Name what is wrong, "" where nothing is. Raises NoteInvalid."""
        if len(lines) != 1:
            return "unreadable"
        if not message.sender.roles:
            return "no role"
        if said.origin != self._origin:
            return "another log"
        name = cosigner_name(self._origin.split("/")[1], message.sender.principal_id)
        if not _holds(lambda: open_note(bare, self._origin, self._public_key)):
            return "not signed here"
        if not _holds(lambda: check_cosignature(text, lines[0], name, message.sender.public_key)):
            return "signature"
        return self._untimely(lines[0]) or self._misplaced(said, name)

    def _untimely(self, line: Cosignature) -> str:
        now_ms = self._clock.wall_ns() // 1_000_000
        return "" if -TTL_MS_MAX - SKEW_MS <= line.time_s * 1000 - now_ms <= SKEW_MS else "time"

    def _misplaced(self, said: Checkpoint, name: str) -> str:
        roots = dict(self._roots)
        if said.size > max(roots, default=0):
            return "beyond this log"
        if said.size in roots and roots[said.size] != said.root:
            return "another root"
        return "" if said.size in roots and said.size > self._sizes.get(name, 0) else "old"


def _holds(check: Callable[[], object]) -> bool:
    try:
        check()
    except NoteInvalid:
        return False
    return True
