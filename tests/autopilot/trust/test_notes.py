"""Signed notes and checkpoints: the published example, the two texts there and back, and what is refused."""

from __future__ import annotations

import base64
from dataclasses import replace

import pytest

from autopilot.trust.keys import SignKey
from autopilot.trust.notes import (
    Checkpoint,
    LogKey,
    NoteInvalid,
    StateMark,
    note_key_id,
    open_note,
    read_checkpoint,
    read_log_key,
    sign_note,
    signed_checkpoint,
)

KEY = SignKey.from_seed(bytes(range(32)))
NAME = "waypoint/coast-watch/wasp-01"
TEXT = "one\n\ntwo\n"
CHECKPOINT = Checkpoint(f"{NAME}/7", 15, bytes(range(32)), 9)
LOG_KEY = LogKey(
    deployment_id="coast-watch", node="wasp-01", flight_number=7, flight_id=bytes(16), public_key=KEY.public
)


def check_refused(note: str, name: str = NAME, key: SignKey = KEY) -> None:
    """Check that a note is not believed."""
    with pytest.raises(NoteInvalid):
        open_note(note, name, key.public)


def test_the_published_example() -> None:
    """The verifier key of the checksum database of Go: its name and key give its id."""
    encoded = base64.b64decode("Ac4zctda0e5eza+HJyk9SxEdh+s3Ux18htTTAD8OuAn8")
    assert note_key_id("sum.golang.org", encoded[1:]).hex() == "033de0ae"


def test_a_note_is_text_and_a_signature() -> None:
    """Opened by its name and key it gives its text; the text may have empty lines."""
    note = sign_note(TEXT, NAME, KEY)
    assert note.startswith(f"{TEXT}\n— {NAME} ")
    assert open_note(note, NAME, KEY.public) == TEXT


def test_notes_that_are_not_believed() -> None:
    """Another text, name, key or form."""
    note, other = sign_note(TEXT, NAME, KEY), SignKey.from_seed(bytes(32))
    check_refused(note.replace("two", "too"))
    check_refused(note, name=f"{NAME}/7")
    check_refused(note, key=other)
    check_refused(sign_note(TEXT, NAME, other))
    check_refused(note + note.rpartition("\n\n")[2])
    check_refused(note[:-1])
    check_refused(note.replace("\n— ", "\n- "))
    check_refused(note.replace(f"— {NAME} ", "— somebody "))
    last = note[-3]
    check_refused(f"{note[:-3]}{chr(ord(last) + 1)}=\n")  # the same bytes, written in another way
    check_refused(TEXT)
    check_refused("")
    check_refused(sign_note("x" * 5000 + "\n", NAME, KEY))
    for bad in ("AAAA", "A" * 91 + "B", "!" * 92):
        check_refused(f"{TEXT}\n— {NAME} {bad}\n")


def test_a_checkpoint_there_and_back() -> None:
    """Three lines and the time."""
    root = base64.b64encode(bytes(range(32))).decode()
    assert CHECKPOINT.text() == f"{NAME}/7\n15\n{root}\nflight_ns 9\n"
    assert read_checkpoint(CHECKPOINT.text()) == CHECKPOINT


@pytest.mark.parametrize(
    ("part", "other"),
    [("15", "015"), ("15", "-1"), ("15", "1e3"), ("flight_ns 9", "at 9"), ("AAEC", "AAE"), (NAME, "\n")],
)
def test_a_malformed_checkpoint_is_refused(part: str, other: str) -> None:
    """One way to write it."""
    with pytest.raises(NoteInvalid):
        read_checkpoint(CHECKPOINT.text().replace(part, other))


STATE = StateMark(bytes.fromhex("00c0ffee"), bytes(range(1, 33)))


def test_a_checkpoint_may_name_the_state() -> None:
    """In a line of its own; without it an old checkpoint is what it was."""
    stated = replace(CHECKPOINT, state=STATE)
    digest = base64.b64encode(bytes(range(1, 33))).decode()
    assert stated.text() == f"{CHECKPOINT.text()}state 00c0ffee {digest}\n"
    assert read_checkpoint(stated.text()) == stated
    assert read_checkpoint(CHECKPOINT.text()).state is None


@pytest.mark.parametrize(
    ("part", "other"),
    [
        ("state 00", "state  00"),
        ("00c0ffee", "00C0FFEE"),
        ("00c0ffee", "c0ffee"),
        ("state", "stage"),
        ("AQID", "AQI"),
        ("AQID", "AQI*"),
        ("=\n", "=\nmore\n"),
        ("=\n", "=\n\n"),
    ],
)
def test_a_malformed_state_is_refused(part: str, other: str) -> None:
    """One way to write it, and nothing behind it."""
    text = replace(CHECKPOINT, state=STATE).text()
    changed = other.join(text.rsplit(part, 1))
    assert changed != text
    with pytest.raises(NoteInvalid):
        read_checkpoint(changed)


def test_a_checkpoint_by_a_certified_key() -> None:
    """Both signatures, and the one log that the key is for."""
    device, log = KEY, SignKey.from_seed(bytes(32))
    certified = replace(LOG_KEY, public_key=log.public)
    certificate = sign_note(certified.text(), NAME, device)
    note = sign_note(CHECKPOINT.text(), certified.origin, log)
    assert signed_checkpoint(certificate, note, NAME, device.public) == (certified, CHECKPOINT)
    other = replace(CHECKPOINT, origin=f"{NAME}/8")
    for bad in (
        (certificate, sign_note(other.text(), certified.origin, log)),
        (certificate, sign_note(CHECKPOINT.text(), certified.origin, device)),
        (sign_note(certified.text(), NAME, log), note),
        ("", note),
        (certificate, ""),
    ):
        with pytest.raises(NoteInvalid):
            signed_checkpoint(*bad, NAME, device.public)


def test_a_certificate_there_and_back() -> None:
    """What it certifies, and under which names."""
    assert read_log_key(LOG_KEY.text()) == LOG_KEY
    assert (LOG_KEY.signer, LOG_KEY.origin) == (NAME, CHECKPOINT.origin)


@pytest.mark.parametrize(
    ("part", "other"),
    [
        ("v1", "v2"),
        ("waypoint/coast", "coast"),
        ("/7", "/07"),
        ("/7", ""),
        ("flight 00", "flight zz"),
        ("flight 00", "00"),
    ],
)
def test_a_malformed_certificate_is_refused(part: str, other: str) -> None:
    """One way to write it."""
    with pytest.raises(NoteInvalid):
        read_log_key(LOG_KEY.text().replace(part, other))
