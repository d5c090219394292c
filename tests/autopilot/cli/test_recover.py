"""`autopilot replay recover`: what holds of a damaged log is copied and verifies, and what does not is said."""

from __future__ import annotations

import json
from hashlib import sha256
from pathlib import Path
from typing import Any

import apsw
import pytest

from autopilot.cli import replay
from autopilot.node.sealing import CERTIFICATE_FILE, KEY_FILE
from events import Chain, Moment
from events.store import SqliteStore, StoreFailed, create_flight, recovering
from events.store.flights import read_flight
from tests.autopilot.cli.flown import run, story_on_disk
from tests.flights import FLIGHT_ID, SECRET, story

STARTS = [record.seq for record in story().records if record.cause < 0]


def changed(folder: Path, sql: str) -> None:
    """Change a log behind its chain's back."""
    connection = apsw.Connection(str(folder / "flight.db"))
    connection.execute(sql)
    connection.close()


def digests(folder: Path) -> dict[str, str]:
    """Return the digests of what lies in a folder."""
    return {file.name: sha256(file.read_bytes()).hexdigest() for file in folder.iterdir() if file.is_file()}


def check_recovered(folder: Path, code: int, capsys: pytest.CaptureFixture[str], **expected: Any) -> Path:
    """Check what is said of a log, that it stays as it is, and that its copy replays; return the copy."""
    before, out = digests(folder), folder.parent / "out"
    assert run(replay, ["replay", "recover", str(folder), str(out), "--json"]) == code
    said = json.loads(capsys.readouterr().out)["recovered"]
    assert {name: said[name] for name in expected} == expected
    assert said["whole"] == (code == 0)
    assert digests(folder) == before
    assert sorted(path.name for path in folder.parent.glob(".recover-*")) == []
    if said["records"]:
        reader = read_flight(out)
        assert (reader.head.seq, reader.head.leaf.hex()) == (said["last_seq"], said["last_leaf"])
        reader.close()
        assert run(replay, ["replay", "verify", str(out)]) == 0
        assert ("INCOMPLETE: it ends early" in capsys.readouterr().err) == bool(said["lost"] or said["left_out"])
        assert json.loads((out / "recovered.json").read_text())["recovered"] == said
    assert out.exists() == bool(said["records"])
    return out


def test_a_whole_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit 0, and the same leaves; the papers come along, the key does not."""
    folder = story_on_disk(tmp_path)
    (folder / CERTIFICATE_FILE).write_text("paper")
    (folder / KEY_FILE).write_text("secret")
    out = check_recovered(folder, 0, capsys, last_seq=120, left_out=[], lost=[])
    assert [(out / name).exists() for name in (CERTIFICATE_FILE, KEY_FILE)] == [True, False]


@pytest.mark.parametrize("seq", range(3, 121, 9))
def test_a_record_that_does_not_hold(tmp_path: Path, capsys: pytest.CaptureFixture[str], seq: int) -> None:
    """The copy ends with the last whole step before it; what holds behind it is named, and it alone is lost."""
    folder = story_on_disk(tmp_path)
    changed(folder, f"UPDATE record SET body = zeroblob(9) WHERE seq = {seq}")
    end = max(start for start in STARTS if start <= seq) - 1
    left_out = [[first, last] for first, last in ((end + 1, seq - 1), (seq + 1, 120)) if first <= last]
    check_recovered(folder, 65, capsys, last_seq=end, left_out=left_out, lost=[[seq, seq]])


@pytest.mark.parametrize("seq", [STARTS[20], STARTS[20] + 1])
def test_a_gap(tmp_path: Path, capsys: pytest.CaptureFixture[str], seq: int) -> None:
    """What follows a gap can't be held against anything: its first record counts as lost too."""
    folder = story_on_disk(tmp_path)
    changed(folder, f"DELETE FROM record WHERE seq = {seq}")
    end = max(start for start in STARTS if start < seq) - 1
    check_recovered(folder, 65, capsys, last_seq=end, left_out=[[end + 1, seq - 1], [seq + 2, 120]])


def test_an_end_that_was_cut(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The head file knows more: a commit is whole, so everything is copied; without that file nobody knows."""
    folder = story_on_disk(tmp_path)
    changed(folder, f"DELETE FROM record WHERE seq >= {STARTS[-3]}")
    check_recovered(folder, 65, capsys, last_seq=STARTS[-3] - 1, left_out=[], lost=[[STARTS[-3], 120]])


def test_what_was_signed_says_what_is_lost(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A checkpoint over more than there is; those over less come along."""
    flight, store = create_flight(tmp_path, 1, FLIGHT_ID, SECRET)
    store.append(story().records)
    store.add_checkpoint(121, "over all")
    store.close()
    changed(flight.folder, f"DELETE FROM record WHERE seq >= {STARTS[-3]}")
    (flight.folder / "head").unlink()
    out = check_recovered(flight.folder, 65, capsys, lost=[[STARTS[-3], 120]])
    reader = read_flight(out)
    assert reader.checkpoints() == []
    reader.close()


def test_a_log_without_its_head_is_copied_whole(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Something is wrong, and nothing is known to be missing."""
    folder = story_on_disk(tmp_path)
    (folder / "head").unlink()
    check_recovered(folder, 65, capsys, last_seq=120, left_out=[], lost=[])


def test_a_torn_tail_is_no_damage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As a power cut leaves it: the log keeps its tail, the copy has none."""
    flight, store = create_flight(tmp_path / "flights", 1, FLIGHT_ID, SECRET)
    store.append(story().records)
    left = tmp_path / "left"
    left.mkdir()
    for name in ("flight.db", "flight.db-wal", "head"):
        (left / name).write_bytes((flight.folder / name).read_bytes())
    store.close()
    with (left / "flight.db-wal").open("ab") as wal:
        wal.write((left / "flight.db-wal").read_bytes()[32:][:3000])
    check_recovered(left, 0, capsys, last_seq=120)


def test_nothing_can_be_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No copy, and what the head file knew is lost."""
    folder = story_on_disk(tmp_path)
    (folder / "flight.db").write_bytes(b"no database" * 1000)
    check_recovered(folder, 65, capsys, last_seq=-1, left_out=[], lost=[[0, 120]])
    assert run(replay, ["replay", "recover", str(folder), str(tmp_path / "out")]) == 65
    out = capsys.readouterr().out
    assert "copied: nothing" in out
    assert "lost: records 0 to 120" in out


def test_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The same words about the log as `check`, which judges its signatures as well, and where the copy is."""
    folder = story_on_disk(tmp_path)
    changed(folder, f"UPDATE record SET body = zeroblob(9) WHERE seq = {STARTS[20]}")
    run(replay, ["replay", "check", str(folder)])
    checked = capsys.readouterr().out
    assert run(replay, ["replay", "recover", str(folder), str(tmp_path / "out")]) == 65
    out = capsys.readouterr().out
    assert out.splitlines()[:2] == checked.splitlines()[:2]
    assert f"copied: records 0 to {STARTS[20] - 1} to {tmp_path / 'out'}" in out
    assert f"left out: records {STARTS[20] + 1} to 120 can be read" in out
    assert out.endswith(f"lost: records {STARTS[20]}\n")


def test_records_of_a_newer_version_are_copied_as_they_are(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What this software does not know it keeps."""
    folder = story_on_disk(tmp_path)
    reader = read_flight(folder)
    at = Moment(1 << 40, 0, 1, 0, 2)
    leaf = Chain(FLIGHT_ID, SECRET, reader.head.leaf).extend(121, -1, at, 60_000, 3, b"newer")
    reader.close()
    store = SqliteStore(folder / "flight.db")
    store._connection.execute(
        f"INSERT INTO record VALUES ({', '.join('?' * 11)})", (121, -1, *at, 60_000, 3, b"newer", leaf)
    )
    store.close()
    (folder / "head").unlink()
    assert run(replay, ["replay", "recover", str(folder), str(tmp_path / "out")]) == 65
    capsys.readouterr()
    copy = read_flight(tmp_path / "out")
    assert next(iter(copy.stored(121)))[3:7] == (60_000, 3, b"newer", leaf)
    copy.close()


def test_what_can_not_be_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """66 where there is no log, 73 where OUT is there, 74 where the log can't be read or does not keep still."""
    folder = story_on_disk(tmp_path)
    assert run(replay, ["replay", "recover", str(tmp_path / "none"), str(tmp_path / "out")]) == 66
    assert run(replay, ["replay", "recover", str(folder), str(folder)]) == 73
    assert "is there already" in capsys.readouterr().err
    broken = tmp_path / "broken"
    (broken / "flight.db").mkdir(parents=True)
    assert run(replay, ["replay", "recover", str(broken), str(tmp_path / "out")]) == 74
    looks = iter(range(99))
    monkeypatch.setattr(recovering, "_looks", lambda _: [(next(looks), 0)])
    with pytest.raises(StoreFailed, match="is being recorded in"):
        recovering.recover(folder, tmp_path / "out", ())
    assert not (tmp_path / "out").exists()
