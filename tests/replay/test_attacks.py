"""Attacks by somebody who holds the disk: a seeded sample of each kind, and what can't be seen is what is said.

Ten thousand of them are `tests.torture.attacks`.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from random import Random

import pytest

from autopilot.ground.sealed import Found
from tests.checks import check_equal
from tests.torture import attacks
from tests.torture.attacking import KINDS, Attacker, fork, write
from tests.torture.attacks import Counts, Flown, attacked, changed, finding, flown
from tests.torture.forging import Skill

SAMPLE = 120


def test_every_attack_is_found_up_to_the_last_witnessed_head() -> None:
    """With the right record, and nothing is said of what nobody touched."""
    said: list[str] = []
    found = attacks.run(SAMPLE, seed=7, report=said.append)
    check_equal((found["missed"], found["false_alarms"]), ([], 0))
    check_equal((found["found"], found["up_to_the_last_witnessed_head"]), (SAMPLE, SAMPLE))
    check_equal(set(found["found_by_kind"]), set(KINDS))
    assert found["untouched_folders_held_against_a_witness"] > 5
    assert found["behind_it_not_to_be_seen"] > 0
    hidden = {Skill.LIVE_KEY.value, "nothing signed anew"}
    assert set(found["not_to_be_seen_by_skill"]) <= hidden, found["not_to_be_seen_by_skill"]
    assert said


@pytest.fixture(scope="module")
def was(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    """Return flights of which the newest is open."""
    return flown(tmp_path_factory.mktemp("flown"), 2)


def forked(was: Flown, root: Path, seed: int) -> Attacker:
    """Fork the open flight at a seeded place, signed anew with the key that was read while it was open."""
    write(was.files, root)
    attacker = Attacker(root, Random(seed), was.keys, [])
    attacker.begin()
    attacker.logs, attacker.skill, attacker.relinked = attacker.logs[-1:], Skill.LIVE_KEY, False
    fork(attacker)
    return attacker


def test_the_window(was: Flown, tmp_path: Path) -> None:
    """The open flight's key signs another history unseen exactly behind what the witness has kept."""
    seen, unseen = 0, 0
    for seed in range(12):
        root = tmp_path / str(seed)
        forked(was, root, seed)
        records, _ = changed(was, root)
        place = min(records.items())
        for kept in was.kept:
            behind = place >= (kept.log_key.flight_number, kept.checkpoint.size)
            found = finding(root, kept)
            check_equal((seed, bool(found)), (seed, not behind))
            seen, unseen = seen + bool(found), unseen + (not found)
    assert seen > 3
    assert unseen > 0


def test_a_miss_is_counted(was: Flown, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An attack that is not found, or found elsewhere, is a miss; so the count can fail."""
    for answer in ([], [Found(9, 0, 0, "elsewhere")]):
        monkeypatch.setattr(attacks, "finding", lambda _root, _kept, answer=answer: answer)
        counts = Counts()
        for number in range(20):
            attacked(was, tmp_path / "attacked", Random(number), "edit a body", counts)
        assert len(counts.missed) > 3
        check_equal(counts.found.total() + counts.found_behind.total(), 0)
        shutil.rmtree(tmp_path / "attacked")


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_each_attack_changes_something(was: Flown, tmp_path: Path, kind: str) -> None:
    """In the records, the checkpoints or the papers beside them."""
    chance = Random(11)
    _, records, papers = attacks._changing(was, tmp_path / "attacked", chance, kind)
    other = attacks._beside(attacks.files_below(tmp_path / "attacked")) != attacks._beside(was.files)
    assert records or papers or other
