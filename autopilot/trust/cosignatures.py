"""Cosignatures of checkpoints (C2SP tlog-cosignature v1): a witness says when it saw a log, grown in order.

A cosignature is one more signature line under a checkpoint's note. It signs a line of its own, the time, and the text
of the note; so a key that signs notes and framed messages (`pae`) may sign these too: no text of ours begins with that
line, and no frame does. The name is only in the key's id, so a key stands under one name: that of its principal.
Whether the log did grow in order is for whoever cosigns to know.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass

from autopilot.trust.keys import SignatureInvalid, SignKey, verify
from autopilot.trust.limits import SIGNATURE_BYTES
from autopilot.trust.notes import NOTE_BYTES_MAX, NoteInvalid

_TYPE = b"\x04"
_KEY_ID_BYTES, _TIME_BYTES = 4, 8
_LINE = re.compile(r"— (\S+) ([A-Za-z0-9+/]+={0,2})")
COSIGNATURES_MAX = 16  # under one note; a flight has a few people on the ground


@dataclass(frozen=True, slots=True)
class Cosignature:
    """A witness's signature line, taken apart. Believe it after `check_cosignature`."""

    name: str  # waypoint/<deployment>/<principal>
    key_id: bytes
    time_s: int  # the witness's clock, seconds since 1970
    signature: bytes

    def line(self) -> str:
        """Return the line of the note, with its newline."""
        data = self.key_id + self.time_s.to_bytes(_TIME_BYTES, "big") + self.signature
        return f"— {self.name} {base64.b64encode(data).decode()}\n"


def cosigner_name(deployment_id: str, principal_id: str) -> str:
    """Return the name that a principal cosigns under."""
    return f"waypoint/{deployment_id}/{principal_id}"


def cosign(text: str, name: str, key: SignKey, time_s: int) -> Cosignature:
    """Sign the text of a checkpoint as a witness, at `time_s` (seconds since 1970)."""
    return Cosignature(name, _key_id(name, key.public), time_s, key.sign(_message(text, time_s)))


def check_cosignature(text: str, one: Cosignature, name: str, public_key: bytes) -> None:
    """Return when this key under this name cosigned the text. Raises NoteInvalid."""
    if one.name != name or one.key_id != _key_id(name, public_key):
        raise NoteInvalid(f"the cosignature is not by {name} and its key")
    try:
        verify(public_key, _message(text, one.time_s), one.signature)
    except SignatureInvalid as error:
        raise NoteInvalid(f"the cosignature is not what {name} signed") from error


def cosigned(note: str, cosignatures: Iterable[Cosignature]) -> str:
    """Return a note with these lines under its signature."""
    return note + "".join(one.line() for one in cosignatures)


def parted(note: str) -> tuple[str, str, tuple[Cosignature, ...]]:
    """Take a cosigned checkpoint apart: its text, the note as the log's key signed it, the lines of witnesses.

    Nothing is verified. Raises NoteInvalid for what is no note, or is longer than one may be.
    """
    if len(note.encode()) > NOTE_BYTES_MAX:
        raise NoteInvalid(f"a note has at most {NOTE_BYTES_MAX} bytes")
    text, gap, signed = note.rpartition("\n\n")
    first, *others = signed.removesuffix("\n").split("\n")
    if not gap or not signed.endswith("\n") or len(others) > COSIGNATURES_MAX:
        raise NoteInvalid("this is no note")
    return f"{text}\n", f"{text}\n\n{first}\n", tuple(_read(line) for line in others)


def _read(line: str) -> Cosignature:
    found = _LINE.fullmatch(line)
    if found is None:
        raise NoteInvalid("a line under the note is no signature")
    try:
        data = base64.b64decode(found[2], validate=True)
    except ValueError as error:
        raise NoteInvalid("a cosignature is not base64") from error
    if len(data) != _KEY_ID_BYTES + _TIME_BYTES + SIGNATURE_BYTES or base64.b64encode(data).decode() != found[2]:
        raise NoteInvalid("a cosignature has a key id, a time and a signature")
    time_s = int.from_bytes(data[_KEY_ID_BYTES : _KEY_ID_BYTES + _TIME_BYTES], "big")
    return Cosignature(found[1], data[:_KEY_ID_BYTES], time_s, data[_KEY_ID_BYTES + _TIME_BYTES :])


def _key_id(name: str, public_key: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\n" + _TYPE + public_key).digest()[:_KEY_ID_BYTES]


def _message(text: str, time_s: int) -> bytes:
    return f"cosignature/v1\ntime {time_s}\n{text}".encode()
