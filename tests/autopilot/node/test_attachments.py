"""Large inputs lie beside the log, whole, by their digest, and in the next flight's folder too."""

from __future__ import annotations

from pathlib import Path

import pytest

from autopilot.node.attachments import Attachments


def check_folder(folder: Path, expected: dict[str, bytes]) -> None:
    """Check the files of a flight, and that nothing half-written lies beside them."""
    assert {file.name: file.read_bytes() for file in (folder / "evidence").iterdir()} == expected


def test_what_is_kept_goes_on(tmp_path: Path) -> None:
    """The newest is in force in the next flight; older ones stay where they were."""
    first, second = tmp_path / "1", tmp_path / "2"
    first.mkdir()
    second.mkdir()
    attachments = Attachments()
    before = attachments.folder
    attachments.attend(first)
    assert (before, attachments.folder) == (None, first)
    attachments.keep("aa", b"one")
    attachments.keep("bb", b"two")
    attachments.keep("bb", b"two")
    attachments.attend(second)
    check_folder(first, {"aa": b"one", "bb": b"two"})
    check_folder(second, {"bb": b"two"})


def test_without_a_flight_nothing_is_kept(tmp_path: Path) -> None:
    """It is said; and a folder that fails does not stop a flight from opening."""
    attachments = Attachments()
    with pytest.raises(OSError, match="no flight is open"):
        attachments.keep("aa", b"one")
    attachments.attend(tmp_path / "gone")
    with pytest.raises(FileNotFoundError):
        attachments.keep("aa", b"one")
    (tmp_path / "1").mkdir()
    attachments.attend(tmp_path / "1")
    attachments.keep("aa", b"one")
    attachments.attend(tmp_path / "gone")
    check_folder(tmp_path / "1", {"aa": b"one"})
