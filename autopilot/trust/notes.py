"""Signed notes and checkpoints as text (C2SP signed-note, tlog-checkpoint): what is said of a log, by which key.

A note is lines of text, an empty line, and a signature line for each key: an em dash, the key's name, and base64 of
four bytes of key id with the signature of the text. Only Ed25519 (type 0x01) and only one signature are known here.
The device's key signs notes and framed messages (`pae`): a note begins with a letter, a frame with its count in
eight bytes, so neither passes for the other. Which key may say what is decided by whoever asks.
"""

from __future__ import annotations

import base64
import hashlib
import re
from dataclasses import dataclass
from typing import NamedTuple

from autopilot.trust.keys import SignatureInvalid, SignKey, verify
from autopilot.trust.limits import KEY_BYTES, SIGNATURE_BYTES

NOTE_BYTES_MAX = 4096  # a checkpoint has near 310 bytes, a certificate near 500
_ED25519 = b"\x01"
_NOTE_KEY_ID_BYTES = 4
_LOG_KEY = "waypoint/log-key/v1"
_SIGNATURE = re.compile(r"— (\S+) ([A-Za-z0-9+/]+={0,2})\n")
_STATE = re.compile(r"state ([0-9a-f]{8}) (\S+)", re.ASCII)
_NUMBER = re.compile(r"0|[1-9][0-9]{0,18}")


class NoteInvalid(ValueError):
    """A note is malformed, or not signed by the key that it should be signed by."""


def note_key_id(name: str, public_key: bytes) -> bytes:
    """Return the four bytes that point to a key: SHA-256(name, newline, type, public key), cut."""
    return hashlib.sha256(name.encode() + b"\n" + _ED25519 + public_key).digest()[:_NOTE_KEY_ID_BYTES]


def sign_note(text: str, name: str, key: SignKey) -> str:
    """Return `text`, which ends with a newline, as a note signed by `key` under `name`."""
    signature = note_key_id(name, key.public) + key.sign(text.encode())
    return f"{text}\n— {name} {base64.b64encode(signature).decode()}\n"


def open_note(note: str, name: str, public_key: bytes) -> str:
    """Return the text of a note that this key signed under this name, and nobody else. Raises NoteInvalid."""
    if len(note.encode()) > NOTE_BYTES_MAX:
        raise NoteInvalid(f"a note has at most {NOTE_BYTES_MAX} bytes")
    text, _, signed = note.rpartition("\n\n")
    found = _SIGNATURE.fullmatch(signed)
    if found is None or not text or found[1] != name:
        raise NoteInvalid(f"this is no note with one signature by {name}")
    signature = _from_base64(found[2], _NOTE_KEY_ID_BYTES + SIGNATURE_BYTES)
    if signature[:_NOTE_KEY_ID_BYTES] != note_key_id(name, public_key):
        raise NoteInvalid(f"the note is signed by another key than that of {name}")
    try:
        verify(public_key, f"{text}\n".encode(), signature[_NOTE_KEY_ID_BYTES:])
    except SignatureInvalid as error:
        raise NoteInvalid(f"the note is not what {name} signed") from error
    return f"{text}\n"


class StateMark(NamedTuple):
    """What a checkpoint says of the state that its records lead to."""

    layout: bytes  # 4 bytes: digests are comparable under the same one only
    digest: bytes


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """What a log's key says: so many records, under this root."""

    origin: str  # waypoint/<deployment>/<node>/<flight number>
    size: int
    root: bytes
    flight_ns: int  # time of the flight when it was signed, so that silence can be told from a node that is gone
    state: StateMark | None = None

    def text(self) -> str:
        """Return the text to sign: the three lines of the format, and time and state as extension lines."""
        root = base64.b64encode(self.root).decode()
        said = f"{self.origin}\n{self.size}\n{root}\nflight_ns {self.flight_ns}\n"
        if self.state is None:
            return said
        return f"{said}state {self.state.layout.hex()} {base64.b64encode(self.state.digest).decode()}\n"


def read_checkpoint(text: str) -> Checkpoint:
    """Read the text of a checkpoint. Raises NoteInvalid."""
    lines = text.split("\n")
    if len(lines) not in (5, 6) or lines[-1] or not lines[0] or not lines[3].startswith("flight_ns "):
        raise NoteInvalid("a checkpoint has an origin, a size, a root and the time of the flight")
    root = _from_base64(lines[2], KEY_BYTES)
    flight_ns = _number(lines[3].removeprefix("flight_ns "))
    state = _state(lines[4]) if len(lines) == 6 else None
    return Checkpoint(lines[0], _number(lines[1]), root, flight_ns, state)


def _state(line: str) -> StateMark:
    found = _STATE.fullmatch(line)
    if found is None:
        raise NoteInvalid("the line after the time is not that of the state")
    return StateMark(bytes.fromhex(found[1]), _from_base64(found[2], KEY_BYTES))


@dataclass(frozen=True, slots=True, kw_only=True)
class LogKey:
    """What a node says of a log key: it signs the log of this flight, from its opening, and no other."""

    deployment_id: str
    node: str
    flight_number: int
    flight_id: bytes
    public_key: bytes

    @property
    def signer(self) -> str:
        """The name that the node's own key signs notes under."""
        return f"waypoint/{self.deployment_id}/{self.node}"

    @property
    def origin(self) -> str:
        """The name of the log, and of its key."""
        return f"{self.signer}/{self.flight_number}"

    def text(self) -> str:
        """Return the text to sign."""
        key = base64.b64encode(self.public_key).decode()
        return f"{_LOG_KEY}\n{self.origin}\nflight {self.flight_id.hex()}\nkey {key}\n"


def read_log_key(text: str) -> LogKey:
    """Read the text of a log key's certificate. Raises NoteInvalid."""
    lines = text.split("\n")
    names = lines[1].split("/") if len(lines) == 5 else []
    if len(names) != 4 or lines[0] != _LOG_KEY or names[0] != "waypoint":
        raise NoteInvalid("this is no certificate of a log key")
    made = LogKey(
        deployment_id=names[1],
        node=names[2],
        flight_number=_number(names[3]),
        flight_id=_from_hex(lines[2].removeprefix("flight ")),
        public_key=_from_base64(lines[3].removeprefix("key "), KEY_BYTES),
    )
    if made.text() != text:
        raise NoteInvalid("the certificate of a log key is not written as it is to be")
    return made


def signed_checkpoint(certificate: str, note: str, signer: str, public_key: bytes) -> tuple[LogKey, Checkpoint]:
    """Return a checkpoint that is signed by the key that `signer` certified with this key of its own, and that key.

    Raises NoteInvalid.
    """
    log_key = read_log_key(open_note(certificate, signer, public_key))
    checkpoint = read_checkpoint(open_note(note, log_key.origin, log_key.public_key))
    if checkpoint.origin != log_key.origin:
        raise NoteInvalid("the checkpoint is of another log than its key may sign")
    return log_key, checkpoint


def _number(text: str) -> int:
    if _NUMBER.fullmatch(text) is None:
        raise NoteInvalid(f"{text[:32]!r} is no number")
    return int(text)


def _from_base64(text: str, length: int) -> bytes:
    """Decode text that stands for `length` bytes, and could be written in no other way."""
    try:
        data = base64.b64decode(text, validate=True)
    except ValueError as error:
        raise NoteInvalid("this is no base64") from error
    if len(data) != length or base64.b64encode(data).decode() != text:
        raise NoteInvalid(f"{length} bytes of base64 are needed")
    return data


def _from_hex(text: str) -> bytes:
    try:
        return bytes.fromhex(text)
    except ValueError as error:
        raise NoteInvalid("a flight is named by its id in hex") from error
