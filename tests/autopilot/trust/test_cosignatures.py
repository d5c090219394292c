"""Cosignatures: the published form, there and back, and what is refused."""

from __future__ import annotations

import base64
import hashlib
from dataclasses import replace

import pytest

from autopilot.trust.cosignatures import (
    COSIGNATURES_MAX,
    check_cosignature,
    cosign,
    cosigned,
    cosigner_name,
    parted,
)
from autopilot.trust.keys import SignKey, verify
from autopilot.trust.notes import NoteInvalid, open_note, sign_note

LOG, KEY = SignKey.from_seed(b"l" * 32), SignKey.from_seed(b"w" * 32)
ORIGIN, NAME = "waypoint/coast-watch/wasp-01/3", "waypoint/coast-watch/alice"
TEXT = f"{ORIGIN}\n5\n{base64.b64encode(bytes(32)).decode()}\nflight_ns 7\n"
NOTE = sign_note(TEXT, ORIGIN, LOG)
# The example of C2SP tlog-cosignature; its witness signed at this time.
PUBLISHED = (
    "example.com/behind-the-sofa\n20852163\nCsUYapGGPo4dkMgIAUqom/Xajj7h2fB2MPA3j2jxq2I=\n\n"
    "— example.com/behind-the-sofa "
    "Az3grlgtzPICa5OS8npVmf1Myq/5IZniMp+ZJurmRDeOoRDe4URYN7u5/Zhcyv2q1gGzGku9nTo+zyWE+xeMcTOAYQ8=\n"
    "— witness.example.com/w1 "
    "jWbPPwAAAABkGFDLEZMHwSRaJNiIDoe9DYn/zXcrtPHeolMI5OWXEhZCB9dlrDJsX3b2oyin1nPZqhf5nNo0xUe+mbIUBkBIfZ+qnA==\n"
)
PUBLISHED_TIME_S = 1679315147


def check_refused(note: str) -> None:
    """Check that a note can't be taken apart."""
    with pytest.raises(NoteInvalid):
        parted(note)


def check_not_believed(text: str, name: str, key: SignKey) -> None:
    """Check that a cosignature of NOTE does not stand for this."""
    with pytest.raises(NoteInvalid):
        check_cosignature(text, cosign(TEXT, NAME, KEY, 100), name, key.public)


def test_the_published_example() -> None:
    """Its parts, and the same bytes again."""
    text, bare, (line,) = parted(PUBLISHED)
    assert (line.name, line.time_s) == ("witness.example.com/w1", PUBLISHED_TIME_S)
    assert (text.count("\n"), bare.count("— "), cosigned(bare, [line])) == (3, 1, PUBLISHED)


def test_what_is_signed() -> None:
    """A line of its own, the time, the text; the key id has the type of cosignatures."""
    one = cosign(TEXT, NAME, KEY, 1234)
    verify(KEY.public, f"cosignature/v1\ntime 1234\n{TEXT}".encode(), one.signature)
    assert one.key_id == hashlib.sha256(NAME.encode() + b"\n\x04" + KEY.public).digest()[:4]
    assert cosigner_name("coast-watch", "alice") == NAME
    check_cosignature(TEXT, one, NAME, KEY.public)


def test_a_cosigned_note_there_and_back() -> None:
    """Several lines; the log's own signature stays what it was."""
    lines = [cosign(TEXT, f"{NAME}-{number}", KEY, number) for number in range(3)]
    text, bare, found = parted(cosigned(NOTE, lines))
    assert (text, bare, found) == (TEXT, NOTE, tuple(lines))
    assert open_note(bare, ORIGIN, LOG.public) == TEXT
    assert parted(NOTE) == (TEXT, NOTE, ())


def test_what_is_not_believed() -> None:
    """Another text, name or key; and a signature of a note is none."""
    check_not_believed(TEXT.replace("\n5\n", "\n6\n"), NAME, KEY)
    check_not_believed(TEXT, f"{NAME}2", KEY)
    check_not_believed(TEXT, NAME, LOG)
    moved = cosign(TEXT, NAME, KEY, 100)
    for other in (replace(moved, name=f"{NAME}2"), replace(moved, key_id=bytes(4))):
        with pytest.raises(NoteInvalid, match="is not by"):
            check_cosignature(TEXT, other, NAME, KEY.public)
    later = replace(moved, time_s=101)
    with pytest.raises(NoteInvalid, match="not what"):
        check_cosignature(TEXT, later, NAME, KEY.public)
    with pytest.raises(NoteInvalid):
        open_note(cosigned(NOTE, [moved]), ORIGIN, LOG.public)


def test_notes_that_can_not_be_taken_apart() -> None:
    """Odd lines, too many, too long, none."""
    line = cosign(TEXT, NAME, KEY, 100).line()
    data = line.split(" ")[2].strip()
    check_refused("")
    check_refused(TEXT)
    check_refused("one line\n")
    check_refused(NOTE[:-1])
    check_refused(NOTE + "— x\n")
    check_refused(NOTE + "\n")
    check_refused(NOTE + f"— {NAME} {data[:-4]}\n")
    check_refused(NOTE + f"— {NAME} {data[:-2]}!=\n")
    check_refused(NOTE + f"— {NAME} {data[:-5]}\n")
    check_refused(NOTE + NOTE.rpartition("\n\n")[2])
    check_refused(NOTE + line * (COSIGNATURES_MAX + 1))
    check_refused("x" * 4096 + NOTE)
    assert len(parted(NOTE + line * COSIGNATURES_MAX)[2]) == COSIGNATURES_MAX
    raw = base64.b64decode(data)
    other = data[:-3] + chr(ord(data[-3]) + 1) + data[-2:]
    assert base64.b64decode(other) == raw
    check_refused(NOTE + f"— {NAME} {other}\n")
