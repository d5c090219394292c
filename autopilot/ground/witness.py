"""The ground as a witness: it keeps the newest checkpoint of every node, and finds out one that goes back behind it.

Kept in the operator's folder, a file a node, so that it outlives the process and the drone. A checkpoint is believed
when the log's key signed it and the node's key certified that one. What a size lower than a kept one proves is that
records are gone; whether a longer log goes on from the kept one is told by a proof over the log itself, not here.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from autopilot.trust.keys import write_file
from autopilot.trust.notes import Checkpoint, LogKey, NoteInvalid, open_note, read_checkpoint, read_log_key
from events.schema.waypoint_pb2 import NodeStatus

FOLDER = "witness"
# A status may arrive this much after a newer one (the longest life of an envelope): late, and no lie.
LATE_MS = 30_000


@dataclass(frozen=True, slots=True)
class Kept:
    """The newest checkpoint of a node, and the notes that show it."""

    log_key: LogKey
    checkpoint: Checkpoint
    at_ms: int  # the node's clock when it published it, milliseconds since 1970


class Witness:
    """Remembers what nodes have signed."""

    def __init__(self, folder: Path) -> None:
        """Keep notes below the operator's `folder`."""
        self._folder = folder / FOLDER
        self._seen: dict[str, tuple[str, str]] = {}  # what each node said last, so that a repeat costs nothing

    def see(self, deployment_id: str, node: str, public_key: bytes, status: NodeStatus) -> str:
        """Judge and keep what `node` publishes in an authentic status; return what is wrong, "" where it fits.

        What is kept is never replaced by what contradicts it: that is laid beside it, as evidence. Raises OSError.
        """
        certificate, note, at_ms = status.log_key, status.log_checkpoint, status.at_ms
        if not note or self._seen.get(node) == (certificate, note):
            return ""
        try:
            fresh = opened(deployment_id, node, public_key, (certificate, note, at_ms))
            kept = self.kept(deployment_id, node, public_key)
        except NoteInvalid as error:
            return str(error)
        wrong = ""
        if kept is not None:
            if kept.at_ms - LATE_MS <= at_ms < kept.at_ms:
                return ""
            wrong = _contradiction(kept, fresh)
        self._keep(f"{node}.json{'.contradiction' if wrong else ''}", certificate, note, at_ms)
        if not wrong:
            self._seen[node] = (certificate, note)
        return wrong

    def kept(self, deployment_id: str, node: str, public_key: bytes) -> Kept | None:
        """Return the newest checkpoint that is kept of a node. Raises NoteInvalid where the file was damaged."""
        path = self._folder / f"{node}.json"
        if not path.exists():
            return None
        try:
            was = json.loads(path.read_text("utf-8"))
            notes = (str(was["log_key"]), str(was["checkpoint"]), int(was["at_ms"]))
            return opened(deployment_id, node, public_key, notes)
        except (ValueError, KeyError, TypeError) as error:
            raise NoteInvalid(f"{path}: what was kept can't be read: {error}") from error

    def _keep(self, name: str, certificate: str, note: str, at_ms: int) -> None:
        self._folder.mkdir(exist_ok=True)
        kept = {"log_key": certificate, "checkpoint": note, "at_ms": at_ms}
        write_file(self._folder / name, json.dumps(kept, ensure_ascii=False, indent=1).encode())


def opened(deployment_id: str, node: str, public_key: bytes, said: tuple[str, str, int]) -> Kept:
    """Return what certificate and checkpoint say, where the node's key stands behind them. Raises NoteInvalid."""
    certificate, note, at_ms = said
    log_key = read_log_key(open_note(certificate, f"waypoint/{deployment_id}/{node}", public_key))
    if (log_key.deployment_id, log_key.node) != (deployment_id, node):
        raise NoteInvalid("the certificate is about another node's log")
    checkpoint = read_checkpoint(open_note(note, log_key.origin, log_key.public_key))
    if checkpoint.origin != log_key.origin:
        raise NoteInvalid("the checkpoint is about another log than its key may sign")
    return Kept(log_key, checkpoint, at_ms)


def _contradiction(kept: Kept, fresh: Kept) -> str:
    """Return why `fresh` can't be said by the node that said `kept`, "" where it can."""
    was, now = kept.checkpoint, fresh.checkpoint
    before, after = kept.log_key, fresh.log_key
    if after.flight_number != before.flight_number:
        back = after.flight_number < before.flight_number
        return f"went back from flight {before.flight_number} to flight {after.flight_number}" if back else ""
    if after.flight_id != before.flight_id:
        return f"there are two flights {before.flight_number}: {before.flight_id.hex()} and {after.flight_id.hex()}"
    if now.size < was.size:
        return (
            f"signed {was.size} records of flight {before.flight_number}, and now only {now.size}: it was rolled back"
        )
    if now.size == was.size and now.root != was.root:
        return f"signed two logs of {was.size} records in flight {before.flight_number}"
    return ""
