"""How a TrustRoot follows another, and a root of several keys."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from autopilot.ground import directory
from autopilot.ground.directory import HOUR_MS, DirectoryError
from autopilot.trust import documents, roots
from autopilot.trust.documents import DocumentError
from tests.autopilot.ground.directories import World, world
from tests.autopilot.trust.world import NOW_MS

LIFE_MS = 12 * HOUR_MS


@pytest.fixture
def made(tmp_path: Path) -> World:
    """A Directory with a node and an operator."""
    return world(tmp_path)


def check_refused(words: str, act: object, *args: object, **kwargs: object) -> None:
    """Check that the Directory refuses, and says why."""
    assert callable(act)
    with pytest.raises(DirectoryError, match=words):
        act(*args, **kwargs)


def test_a_root_follows_only_by_its_own_signature(made: World) -> None:
    """Neither an older root, nor the same, nor a stranger's."""
    first = made.open().state.trust_root
    made.rotate("time")
    second = made.open().state.trust_root
    made.rotate("time")
    third = made.open().state.trust_root
    assert roots.verify_successor(third, first).version == 3
    stranger = world(made.root / "stranger", seed=2)
    stranger.rotate("time")
    for data, pinned in ((first, second), (second, second), (stranger.open().state.trust_root, first)):
        with pytest.raises(DocumentError):
            roots.verify_successor(data, pinned)


def test_a_root_of_another_deployment_never_follows(made: World) -> None:
    """Even when the same root key signs it."""
    first = made.open().state.trust_root
    other = roots.root_of(first)
    other.version, other.deployment_id = 2, "elsewhere"
    signed = documents.sign(b"waypoint/v1/TrustRoot", other, [made.open().root_key])
    with pytest.raises(DocumentError, match="another deployment"):
        roots.verify_successor(signed, first)
    other.deployment_id = "coast-watch"
    other.keys.pop()
    unwhole = documents.sign(b"waypoint/v1/TrustRoot", other, [made.open().root_key])
    with pytest.raises(DocumentError, match="one for each purpose"):
        roots.verify_successor(unwhole, first)


def test_a_root_of_several_keys_needs_as_many(tmp_path: Path) -> None:
    """Two of three, which lie elsewhere; one is not enough, nor the same one twice."""
    made = World(tmp_path, lambda count: os.urandom(count))
    directory.init(made.folder, deployment_id="d", now_ms=NOW_MS, random=made.random, roots=3, threshold=2)
    stick = tmp_path / "stick"
    stick.mkdir()
    keys = [Path(shutil.move(made.folder / name, stick / name)) for name in directory.root_files(3)]
    check_refused("root.key", made.rotate, "time")
    check_refused("2 different ones with --root", made.rotate, "time", NOW_MS, keys[0])
    check_refused("2 different ones with --root", made.rotate, "time", NOW_MS, keys[0], keys[0])
    assert made.open().trust.version == 1
    assert made.rotate("time", NOW_MS, keys[0], keys[2]).root_version == 2
    made.issue("wasp-01", "node")
    assert made.revoke("wasp-01").list_version == 2


@pytest.mark.parametrize(("roots_made", "threshold"), [(0, 0), (1, 0), (1, 2), (17, 1)])
def test_a_root_that_makes_no_sense_is_refused(tmp_path: Path, roots_made: int, threshold: int) -> None:
    """Nothing is written."""
    with pytest.raises(DirectoryError, match="of"):
        directory.init(
            tmp_path / "d", deployment_id="d", now_ms=1, random=os.urandom, roots=roots_made, threshold=threshold
        )
    assert not (tmp_path / "d").exists()
