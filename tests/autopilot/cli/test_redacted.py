"""`autopilot export redacted`: what goes, what is said to descend from it, and that nothing of it is in the copy."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from autopilot.cli import export, replay, verify
from autopilot.cli.redactions import FILE
from autopilot.node.sealing import CERTIFICATE_FILE, KEY_FILE
from autopilot.trust.identity import ROOT_FILE, TOKEN_FILE
from autopilot.trust.notes import sign_note
from autopilot.trust.replayed import VERDICT_FILE, SignedVerdict
from events.chain import salt_of
from events.store import SqliteStore, create_flight
from events.store.head import read_head_file
from tests.autopilot.cli.flown import run
from tests.autopilot.trust.world import people
from tests.flights import FLIGHT_ID, SECRET, Flight, closed, opened, position, story
from tests.replay.sealed import sealed_story

STORY = story()
PAPERS = {CERTIFICATE_FILE, TOKEN_FILE, ROOT_FILE}
WHO = ["--by", "A. Roth", "--because", "a home"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return the folder of the whole story, sealed and closed, with something as its verdict."""
    folder = sealed_story(tmp_path).flight.folder
    (folder / VERDICT_FILE).write_text("a verdict")
    return folder


def judged(root: Path) -> Path:
    """Return the folder of a short flight of wasp-01 with the verdict that it signed."""
    wasp = people().wasp
    signer = f"waypoint/{wasp.deployment_id}/{wasp.principal_id}"
    manifest = opened(node=wasp.principal_id, deployment_id=wasp.deployment_id, node_public_key=wasp.public_key)
    flight, store = create_flight(root, 1, FLIGHT_ID, SECRET)
    Flight(manifest, position(0, 0), closed(), store=store)
    said = SignedVerdict(
        origin=f"{signer}/1",
        flight_id=FLIGHT_ID.hex(),
        seq=store.head.seq,
        leaf=store.head.leaf.hex(),
        software="0.1.0",
        verdict="REPLAYS",
    )
    (flight.folder / VERDICT_FILE).write_text(sign_note(said.text(), signer, wasp.sign_key))
    store.close()
    return flight.folder


def test_the_verdict_of_the_node_stands_beside(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It was over the whole log, and is told as such."""
    folder = judged(tmp_path)
    check_redacted(folder, ["--seq", "1", *WHO], capsys)
    told = "signed by wasp-01: REPLAYS over the whole log up to record 2"
    check_replay("verify", tmp_path / "copy", 65, "INCOMPLETE(1)", told, capsys)
    check_replay("verify", folder, 0, "identical", "signed by wasp-01: REPLAYS up to record 2", capsys)


def check_redacted(
    folder: Path, words: list[str], capsys: pytest.CaptureFixture[str], code: int = 0, err: str = ""
) -> str:
    """Check exit code and a part of what is said on stderr; return stdout."""
    assert run(export, ["export", "redacted", str(folder), str(folder.parent / "copy"), *words]) == code
    told = capsys.readouterr()
    assert err in told.err
    assert [one.name for one in folder.parent.iterdir() if one.name.startswith(".")] == []
    assert (folder.parent / "copy").exists() == (code == 0 and "--dry-run" not in words)
    return told.out


def check_replay(command: str, copy: Path, code: int, out: str, err: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Check what a command of `autopilot replay` says of a copy."""
    assert run(replay, ["replay", command, str(copy)]) == code
    told = capsys.readouterr()
    assert (out in told.out, err in told.err) == (True, True), told


def plain(folder: Path, words: list[str], capsys: pytest.CaptureFixture[str]) -> dict[str, object]:
    """Return what a dry run chooses."""
    found: dict[str, object] = json.loads(check_redacted(folder, [*words, "--dry-run", "--json"], capsys))
    return found


def check_nothing_left(copy: Path, removed: set[int]) -> None:
    """Search every byte of a copy for the secret, salts and bodies."""
    content = b"".join(path.read_bytes() for path in sorted(copy.rglob("*")) if path.is_file())
    assert SECRET not in content
    for record in STORY.records:
        assert (salt_of(SECRET, record.seq) in content) == (record.seq not in removed)
        if record.seq in removed and len(record.body) > 8:
            same = [one for one in STORY.records if one.body == record.body and one.seq not in removed]
            assert same != [] or record.body not in content, record.seq


def test_a_copy_of_a_flight(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The papers, the verdict, a head, and who did it; no secret, no key, no evidence."""
    (folder / "evidence").mkdir()
    (folder / KEY_FILE).write_bytes(b"key")
    check_redacted(folder, ["--seq", "8,64-66", *WHO], capsys, 0, "not carried over: evidence\n")
    copy = folder.parent / "copy"
    assert {one.name for one in copy.iterdir()} == {*PAPERS, VERDICT_FILE, FILE, "flight.db", "head"}
    for name in (*PAPERS, VERDICT_FILE):
        assert (copy / name).read_bytes() == (folder / name).read_bytes()
    check_nothing_left(copy, {8, 64, 65, 66})
    said = json.loads((copy / FILE).read_text())
    assert [(one["by"], one["because"], one["removed"]) for one in said["redactions"]] == [
        ("A. Roth", "a home", "8,64-66")
    ]
    seen = read_head_file(copy)
    assert seen is not None
    assert (seen.head.seq, seen.head.leaf.hex()) == (said["head"]["seq"], said["head"]["leaf"])


def test_a_copy_is_read_as_a_flight_is(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Check, verify beside the node's own verdict, show, and what each exits with."""
    check_redacted(folder, ["--seq", "8", *WHO], capsys)
    copy = folder.parent / "copy"
    check_replay("check", copy, 65, "records 0 to 120 hold", "", capsys)  # its papers are not signed here
    check_replay("verify", copy, 65, "INCOMPLETE(8): nothing differs", "redacted by A. Roth at 2", capsys)
    check_replay("show", copy, 0, "8  point_at_place         removed from this copy", "", capsys)
    assert run(replay, ["replay", "why", str(copy), "22"]) == 0
    assert "8  point_at_place         removed from this copy" in capsys.readouterr().out
    (copy / FILE).write_text("[]")
    check_replay("verify", copy, 74, "", "can't be read", capsys)


def test_proofs_and_bundle_of_a_copy(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A chain through what was removed is proved; the bundle names what it does without."""
    check_redacted(folder, ["--seq", "8,49", *WHO], capsys)
    copy, out = folder.parent / "copy", folder.parent / "out"
    assert run(export, ["export", "proof", str(copy), "--seq", "22", str(out)]) == 0
    assert run(verify, ["verify", str(out)]) == 0
    assert "8  point_at_place         removed from this copy" in capsys.readouterr().out
    assert run(export, ["export", "bundle", str(copy), str(out)]) == 0
    gaps = json.loads(out.read_text())["gaps"]
    assert (gaps["removed"], gaps["left_out"].split(",")[:2]) == ("8,49", ["6-7", "9-13"])


def test_redacting_a_copy_again(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What was removed stays so, and both who removed are named."""
    check_redacted(folder, ["--seq", "8", *WHO], capsys)
    copy, again = folder.parent / "copy", folder.parent / "again"
    words = ["export", "redacted", str(copy), str(again), "--kind", "gimbal_reported", *WHO]
    assert run(export, words) == 0
    check_nothing_left(again, {8, 20, 21})
    check_replay("verify", again, 65, "INCOMPLETE(8,20-21)", "records 8, because: a home", capsys)
    assert [one["removed"] for one in json.loads((again / FILE).read_text())["redactions"]] == ["8", "20-21"]
    assert run(export, words) == 73
    assert "is there already" in capsys.readouterr().err


def test_everything_but_the_manifest(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A stretch without a kind is all of it."""
    check_redacted(folder, ["--before", "1e9", *WHO], capsys)
    check_nothing_left(folder.parent / "copy", set(range(1, 121)))
    check_replay("verify", folder.parent / "copy", 65, "INCOMPLETE(1-120)", "records 1-120", capsys)


def test_what_is_chosen(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By number, by kind, both, and within a stretch whose end is not in it."""
    kinds = ["--kind", "gimbal_reported,time_passed"]
    assert plain(folder, ["--seq", "8,64-66"], capsys)["chosen"] == "8,64-66"
    assert plain(folder, kinds, capsys)["chosen"] == "20-21,117"
    assert plain(folder, [*kinds, "--seq", "5"], capsys)["chosen"] == "5,20-21,117"
    ns = STORY.records[21].at.flight_ns
    assert plain(folder, [*kinds, "--after", str(ns / 1e9)], capsys)["chosen"] == "21,117"
    assert plain(folder, [*kinds, "--before", str(ns / 1e9)], capsys)["chosen"] == "20"
    assert plain(folder, ["--before", "0.1"], capsys)["chosen"] == "1-4"


def test_what_descends_is_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By cause, by an outcome's effect, by a place that is said again; and what a replay computes again."""
    found = plain(folder, ["--seq", "8"], capsys)
    assert (found["led_to"], found["computed_again"], found["removed"]) == ("14-22,96", "8", "8")
    assert found["same_place"] == "6-7,9-13,23-24"
    assert plain(folder, ["--seq", "5"], capsys)["led_to"] == ""
    found = plain(folder, ["--seq", "8", "--with-descendants"], capsys)
    assert (found["removed"], found["computed_again"]) == ("6-24,96", "")
    assert plain(folder, ["--kind", "poi_opened"], capsys)["same_place"] == "45-50,53-62,72"
    out = check_redacted(folder, ["--seq", "8", "--dry-run"], capsys, 0, "a replay decides again what 8 said")
    assert out.splitlines()[0] == "would be removed: 1 records"
    check_redacted(folder, ["--seq", "8", "--dry-run"], capsys, 0, "what they led to stays, 10 records")
    check_redacted(folder, ["--kind", "order_received", *WHO], capsys, 0, "        and ")


@pytest.mark.parametrize(
    ("words", "code", "err"),
    [
        ([], 2, "say which records"),
        (["--seq", "8"], 2, "say --by whom"),
        (["--seq", "8", "--by", "A"], 2, "say --by whom"),
        (["--seq", "0", *WHO], 65, "record 0 is the manifest"),
        (["--kind", "flight_opened", *WHO], 65, "record 0 is the manifest"),
        (["--seq", "121", *WHO], 65, "there is no record 121: the last one is 120"),
        (["--kind", "log_damaged", *WHO], 65, "no record of the flight is chosen"),
        (["--after", "1e9", *WHO], 65, "no record of the flight is chosen"),
    ],
)
def test_refusals(folder: Path, words: list[str], code: int, err: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Each with its code, and nothing is written."""
    check_redacted(folder, words, capsys, code, err)


@pytest.mark.parametrize("words", [["--seq", "x"], ["--seq", "1-"], ["--seq", "-3"], ["--kind", "no_such_kind"]])
def test_words_that_name_nothing(folder: Path, words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """A list that can't be read is an error of usage."""
    with pytest.raises(SystemExit, match="2"):
        run(export, ["export", "redacted", str(folder), "copy", *words])


def test_a_damaged_flight_is_not_copied(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A copy would look whole. One without a head file is copied without."""
    head = (folder / "head").read_bytes()
    (folder / "head").write_bytes(head.replace(b"WPHEAD", b"XPHEAD"))
    check_redacted(folder, ["--seq", "8", *WHO], capsys)
    assert not (folder.parent / "copy" / "head").exists()
    store = SqliteStore(folder / "flight.db")
    store._connection.execute("UPDATE record SET body = x'00' WHERE seq = 9")
    store.close()
    assert run(export, ["export", "redacted", str(folder), str(folder.parent / "other"), "--seq", "8", *WHO]) == 65
    assert "the log is damaged, and a copy would hide that" in capsys.readouterr().err


def test_what_can_not_be_written(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nowhere, and something that is there."""
    out = folder.parent / "no" / "where"
    assert run(export, ["export", "redacted", str(folder), str(out), "--seq", "8", *WHO]) == 73
    assert run(export, ["export", "redacted", str(folder), str(folder), "--seq", "8", *WHO]) == 73
    assert run(export, ["export", "redacted", str(folder / "none"), str(out), "--seq", "8", *WHO]) == 66
    assert "there is no flight" in capsys.readouterr().err
