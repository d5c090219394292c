"""`autopilot directory` and `autopilot enrol` as they are typed: words, exit codes, and files that travel."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path
from typing import Any

import pytest

from autopilot.cli.main import main
from autopilot.trust.identity import load_identity


class Shell:
    """Types commands in a folder."""

    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self._capsys, self._monkeypatch = folder, capsys, monkeypatch

    def type(self, words: str, stdin: str = "") -> tuple[int, str, str]:
        """Run one command; return exit code, data and words."""
        self._monkeypatch.chdir(self.folder)
        self._monkeypatch.setattr("sys.stdin", io.StringIO(stdin))
        code = main(words.split())
        said = self._capsys.readouterr()
        return code, said.out, said.err

    def json(self, words: str, stdin: str = "") -> dict[str, Any]:
        """Run one command that succeeds; return its facts."""
        code, out, err = self.type(f"{words} --json", stdin)
        assert (code, err) == (os.EX_OK, "")
        facts: dict[str, Any] = json.loads(out)
        return facts

    def check_refused(self, words: str, code: int, because: str) -> None:
        """Check exit code and the words of a refusal; nothing is said on stdout."""
        found = self.type(words)
        assert (found[0], found[1], because in found[2]) == (code, "", True), found


@pytest.fixture
def shell(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Shell:
    """A shell where a Directory was made."""
    made = Shell(tmp_path, capsys, monkeypatch)
    assert made.json("directory init d --deployment coast-watch")["deployment_id"] == "coast-watch"
    return made


def test_a_device_without_a_link_is_enrolled_by_files(shell: Shell) -> None:
    """The code by hand, the request out, the answer in."""
    code = shell.json("directory enrol d wasp-01 --kind node --callsign WASP-01")["code"]
    assert shell.json("enrol --out keys --request request", code)["request"] == "request"
    assert shell.json("directory admit d request answer")["principal_id"] == "wasp-01"
    assert shell.json("enrol --out keys --response answer", code.lower())["callsign"] == "WASP-01"
    assert load_identity(shell.folder / "keys").principal_id == "wasp-01"
    shell.check_refused(f"enrol --out keys --request request --code {code}", os.EX_NOPERM, "holds an identity already")
    shell.check_refused("enrol --out other --request request --code AAAA", os.EX_NOPERM, "type it again")
    shell.check_refused(f"enrol --out o --response nothing --code {code}", os.EX_IOERR, "nothing: No such file")
    shell.check_refused(f"enrol --out o --response answer --code {code}", os.EX_NOPERM, "o/device.sign")


def test_a_request_that_is_refused_says_what_to_do(shell: Shell) -> None:
    """The person at the Directory is told the reason, and the fix."""
    code = shell.json("directory enrol d wasp-01 --kind node")["code"]
    for out in ("one", "two"):
        shell.json(f"enrol --out {out} --request {out}.request", code)
    shell.json("directory admit d one.request answer")
    shell.check_refused("directory admit d two.request answer", os.EX_NOPERM, "used by another device")
    (shell.folder / "junk").write_bytes(b"junk")
    shell.check_refused("directory admit d junk answer", os.EX_NOPERM, "refused (malformed)")
    shell.check_refused("directory admit d nothing answer", os.EX_IOERR, "nothing: No such file")


def test_a_lost_drone_is_shut_out(shell: Shell) -> None:
    """Revoked, a new epoch, and a refreshed folder that knows it."""
    shell.json("directory issue d wasp-01 --kind node --out wasp")
    alice = shell.json("directory issue d alice --kind operator --role operator --out alice")
    assert shell.json("directory revoke d wasp-01") == {"root_version": 1, "list_version": 2, "epoch_id": 2}
    assert shell.json("directory refresh d alice")["principal_id"] == "alice"
    held = load_identity(shell.folder / "alice")
    assert (set(held.revocations.principals), list(held.epochs), len(held.known_nodes)) == ({"wasp-01"}, [2], 0)
    shell.check_refused("directory refresh d wasp", os.EX_DATAERR, "is revoked")
    exported = shell.json(f"directory export d {alice['device_key_id']} out")
    assert (exported["folder"], (shell.folder / "out" / "device.sign").exists()) == ("out", False)
    found = shell.json(f"directory revoke d --device {alice['device_key_id']} --token {alice['token_id']}")
    assert found["epoch_id"] == 3


def test_what_is_in_force_is_listed(shell: Shell) -> None:
    """For a person and for a program."""
    shell.json("directory issue d wasp-01 --kind node --out wasp")
    shell.json("directory issue d alice --kind operator --role operator --role viewer --out alice")
    shell.json("directory enrol d hornet-02 --kind node")
    shell.json("directory revoke d alice --min-policy 2 --min-epoch 1")
    shell.json("directory rotate d --purpose time --root d/root.key")
    shell.json("directory rotate d --lead 60")
    facts = shell.json("directory list d")
    assert [facts[name] for name in ("root_version", "list_version", "epoch_id")] == [2, 2, 3]
    assert [(each["principal_id"], each["live"]) for each in facts["devices"]] == [("wasp-01", True), ("alice", False)]
    assert facts["revoked"] == {
        "principals": ["alice"],
        "devices": [],
        "tokens": [],
        "min_policy_version": 2,
        "min_epoch_id": 1,
    }
    assert [(each["principal_id"], each["used"]) for each in facts["codes"]] == [("hornet-02", False)]
    lines = shell.type("directory list d")[1].splitlines()
    assert lines[0] == "coast-watch: root 2, list 2 (due in 3.0 d), epoch 3"
    assert [line.split()[:3] for line in lines[1:3]] == [
        ["wasp-01", "node", "-"],
        ["alice", "operator", "operator,viewer"],
    ]
    assert lines[3:] == ["revoked: alice", "code for hornet-02: open"]


def test_mistakes_are_told_with_their_fix(shell: Shell) -> None:
    """And with an exit code for scripts."""
    shell.check_refused("directory init d", os.EX_CANTCREAT, "choose another folder")
    shell.check_refused("directory list nowhere", os.EX_DATAERR, "autopilot directory init")
    shell.check_refused("directory revoke d who", os.EX_DATAERR, "directory list")
    shell.check_refused("directory rotate d --purpose time --root nowhere", os.EX_DATAERR, "nowhere: No such file")
    shell.check_refused("directory serve d", os.EX_DATAERR, "--connect")
    shell.check_refused("enrol --out keys --request x --renew", os.EX_NOPERM, "--connect")
    (shell.folder / "file").write_bytes(b"")
    shell.check_refused("directory issue d x --kind node --out file/x", os.EX_IOERR, "Not a directory")


@pytest.mark.parametrize(
    "words",
    ["issue d x --kind node --out o --hours 0", "revoke d --device 00", "revoke d --token zz", "rotate d --purpose x"],
)
def test_arguments_are_checked(shell: Shell, words: str) -> None:
    """Before anything is opened."""
    with pytest.raises(SystemExit) as caught:
        shell.type(f"directory {words}")
    assert caught.value.code == 2


def test_a_person_is_told_in_words(shell: Shell) -> None:
    """What to do next."""
    assert "autopilot enrol --out FOLDER" in shell.type("directory enrol d wasp-01 --kind node")[1]
    assert "in force: root 1, list 2, epoch 1" in shell.type("directory revoke d")[1]
    assert "take root-1.key, root-2.key offline" in shell.type("directory init e --roots 2 --threshold 2")[1]


@pytest.mark.parametrize("name", ["directory", "enrol"])
def test_help_has_examples(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Of both commands."""
    with pytest.raises(SystemExit):
        main([name, "--help"])
    assert f"examples:\n  autopilot {name} " in capsys.readouterr().out
