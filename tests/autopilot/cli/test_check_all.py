"""`autopilot replay check` on a node's flights, with and without a witness: what is printed, and the exit codes."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from autopilot.cli import replay
from autopilot.ground.kept import FOLDER
from events.store import flights_in
from tests.autopilot.cli.flown import run
from tests.autopilot.trust.world import people
from tests.torture.attacks import kept_by_a_witness
from tests.torture.flying import Drone
from tests.torture.forging import logs_in


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Return the flights of wasp-01; beside them lies the folder of the operator who kept its checkpoints."""
    drone = Drone(tmp_path / "flights", 5)
    for _ in range(2):
        drone.fly(4)
        drone.end()
    drone.session.store.close()
    kept_by_a_witness(tmp_path, drone)
    shutil.copy(people().alice.folder / "trust_root", tmp_path / "operator" / "trust_root")
    return tmp_path / "flights"


def check_says(capsys: pytest.CaptureFixture[str], code: int, words: list[str], *parts: str) -> str:
    """Check what the command prints and how it ends."""
    assert run(replay, ["replay", "check", *words]) == code
    said = capsys.readouterr()
    assert [part in said.out + said.err for part in parts] == [True] * len(parts), said
    return said.out


def test_flights_that_hold(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Alone, together, and against the witness."""
    operator = str(root.parent / "operator")
    check_says(capsys, 0, [str(flights_in(root)[0].folder)], "sound: records 0 to")
    check_says(capsys, 0, [str(root)], "sound: 3 flights, witnessed up to nothing\n")
    check_says(capsys, 0, [str(root), "--witness", operator], "sound: 3 flights, witnessed up to flight 3, ")
    plain = json.loads(check_says(capsys, 0, [str(root), "--witness", operator, "--json"]))
    assert (plain["sound"], plain["flights"], plain["found"]) == (True, 3, [])
    shutil.rmtree(root.parent / "operator" / FOLDER / "wasp-01")
    check_says(capsys, 0, [str(root), "--witness", operator], "witnessed up to nothing")


def test_flights_that_do_not_hold(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One record was changed and chained anew; one flight is gone; what is only told does not make it wrong."""
    operator, first = str(root.parent / "operator"), flights_in(root)[0].folder
    log = logs_in(root)[0]
    seq = max(size for size in log.checkpoints if size < len(log.rows))
    log.rows[seq] = log.rows[seq]._replace(body=b"")
    log.chain()
    log.write(head=True)
    check_says(capsys, 65, [str(first)], "wrong: records 0 to", f" {seq}", "those that were signed")
    plain = json.loads(check_says(capsys, 65, [str(first), "--json"]))
    assert (plain["sound"], plain["action"], plain["found"][0]["first"]) == (False, "go_on", seq)
    check_says(capsys, 65, [str(root)], "wrong: 3 flights", "flight 1, records ", "flight 2 says of it")
    shutil.rmtree(first)
    check_says(capsys, 0, [str(root)], "sound: 2 flights", "flight 1, record", "the flights before it are not here")
    shutil.rmtree(flights_in(root)[1].folder)
    check_says(capsys, 65, [str(root), "--witness", operator], "flight 3, record 0: a witness kept a checkpoint")
    plain = json.loads(check_says(capsys, 65, [str(root), "--witness", operator, "--json"]))
    assert (plain["sound"], plain["witnessed"].startswith("flight 3, ")) == (False, True)


def test_what_is_found_is_said_once(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By the examination or by the seals."""
    folder = flights_in(root)[0].folder
    (folder / "head").unlink()
    plain = json.loads(check_says(capsys, 65, [str(folder), "--json"]))
    assert (plain["sound"], plain["found"], "there is no head file" in plain["words"]) == (False, [], True)


def test_a_witness_that_can_not_be_asked(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit 64 for one flight alone, 66 where there is no such folder, 65 where nothing can be believed."""
    operator = root.parent / "operator"
    check_says(capsys, 64, [str(flights_in(root)[0].folder), "--witness", str(operator)], "the folder of all flights")
    check_says(capsys, 66, [str(root), "--witness", str(root)], "trust_root")
    kept = max((operator / FOLDER / "wasp-01").glob("*.json"))
    kept.write_text("{}", encoding="utf-8")
    check_says(capsys, 65, [str(root), "--witness", str(operator)], "what was kept can't be read")
    shutil.copy(people(2).alice.folder / "trust_root", operator / "trust_root")
    check_says(capsys, 65, [str(root), "--witness", str(operator)], "autopilot: ")
