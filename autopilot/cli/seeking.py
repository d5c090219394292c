"""What `autopilot replay show --at` does: the state after one record, for a person or a program. It changes nothing."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

from google.protobuf.message import DecodeError

from autopilot.cli.bar import Bar
from autopilot.node.sealing import CERTIFICATE_FILE
from autopilot.trust.notes import NoteInvalid, signed_checkpoint
from events.schema.flight_pb2 import FlightOpened
from events.store import Reader
from replay.picture import lines, plain
from replay.seek import Signed, state_at


def show_at(reader: Reader, folder: Path, seq: int, *, as_json: bool) -> int:
    """Print the state after record `seq`; return the exit code. Raises LookupError where there is no such record."""
    bar = Bar("reading")
    try:
        seen = state_at(reader, folder, seq, signed_in(reader, folder), bar)
    finally:
        bar.end()
    for line in [json.dumps(plain(seen), sort_keys=True)] if as_json else lines(seen):
        print(line)
    for told in seen.refused:
        print(f"not used: {told}", file=sys.stderr)
    if seen.start == 0:
        print("there was no snapshot to start from: the log was read from its beginning", file=sys.stderr)
    return os.EX_OK


def signed_in(reader: Reader, folder: Path) -> Signed:
    """Return what tells what a checkpoint was signed with, by the log key that the manifest's node certified."""
    notes, opened = dict(reader.checkpoints()), _manifest(reader)
    signer = f"waypoint/{opened.deployment_id}/{opened.node}"

    def signed(size: int) -> tuple[bytes, bytes, bytes] | None:
        try:
            certificate = (folder / CERTIFICATE_FILE).read_text("utf-8")
            log_key, found = signed_checkpoint(certificate, notes.get(size, ""), signer, opened.node_public_key)
        except (OSError, UnicodeDecodeError, NoteInvalid):
            return None
        own = (log_key.flight_id, found.size) == (reader.flight_id, size)
        return None if found.state is None or not own else (found.root, *found.state)

    return signed


def _manifest(reader: Reader) -> FlightOpened:
    first = next(iter(reader.stored(0, 1)), None)
    try:
        return FlightOpened() if first is None else FlightOpened.FromString(first.body)
    except DecodeError:
        return FlightOpened()
