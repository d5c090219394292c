"""A Directory killed at each file operation of each command: the old state or the new one, and no version twice."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from autopilot.ground import directory
from autopilot.ground import directory_changes as changes
from autopilot.ground import enrolment_desk as desk
from autopilot.ground.directory import DirectoryError
from autopilot.ground.directory_changes import Removal
from autopilot.ground.directory_papers import list_body
from autopilot.ground.enrolment import make_request, secret_of
from autopilot.trust import documents, roots
from autopilot.trust.keys import BoxKey, SignKey, digest
from events.schema.waypoint_pb2 import SignedDoc
from tests.autopilot.ground.directories import World, device_id, world
from tests.autopilot.trust.world import NOW_MS, seeded

OPERATIONS = ("open", "replace", "unlink", "fsync", "write", "mkdir")
KILLED, DONE = 9, 0

Command = Callable[[World], object]


def issue(made: World) -> object:
    return made.issue(f"bob-{len(made.open().state.tokens)}", at_ms=NOW_MS)


def admit(made: World) -> object:
    request = make_request(secret_of(made.invite()), SignKey.from_seed(os.urandom(32)), BoxKey.from_secret(b"b" * 32))
    return desk.admit(made.folder, request, NOW_MS, made.random)


COMMANDS: dict[str, Command] = {
    "issue": issue,
    "revoke": lambda made: made.revoke("alice"),
    "sign the list anew": lambda made: made.revoke(),
    "rotate the epoch": lambda made: changes.rotate_epoch(made.folder, NOW_MS, made.random),
    "rotate revoke": lambda made: made.rotate("revoke"),
    "rotate token": lambda made: made.rotate("token"),
    "invite": lambda made: made.invite(),
    "admit": admit,
    "renew": lambda made: changes.renew(
        made.folder, device_id(made.identity("alice")), NOW_MS + 11 * 3_600_000, made.random
    ),
}


def killed_at(number: int, act: Callable[[], object]) -> int:
    """Run `act` in a process that dies before its file operation `number`; return its exit code."""
    child = os.fork()
    if child == 0:
        left = [number]
        for name in OPERATIONS:
            setattr(os, name, _counted(getattr(os, name), left))
        try:
            act()
        except BaseException:  # noqa: BLE001 - a child must not go on in the test's place
            os._exit(1)
        os._exit(DONE)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _counted(operation: Callable[..., Any], left: list[int]) -> Callable[..., Any]:
    def counted(*args: Any, **kwargs: Any) -> Any:
        if not left[0]:
            os._exit(KILLED)
        left[0] -= 1
        return operation(*args, **kwargs)

    return counted


def visible(folder: Path) -> dict[tuple[str, int], bytes]:
    """Return every version that may be seen in the folder, by what it is of, with its digest."""
    state = directory.open_directory(folder).state
    found = {("epoch", epoch.epoch_id): _secret(folder, epoch.epoch_id) for epoch in state.epochs}
    lists = [state.revocations, (folder / "revocations").read_bytes()]
    trusted = [state.trust_root, (folder / "trust_root").read_bytes()]
    found |= {("root", roots.root_of(data).version): digest(data) for data in trusted}
    bodies = [documents.parse(SignedDoc, data).body for data in lists]
    found |= {("list", type(list_body(state)).FromString(body).version): digest(body) for body in bodies}
    return found


def _secret(folder: Path, epoch_id: int) -> bytes:
    return digest((folder / f"epoch-{epoch_id}.secret").read_bytes())


def check_killed(base: World, root: Path, number: int, command: Command) -> int:
    """Kill the command there; the folder is whole, the command can be given again, and no version means two things."""
    shutil.copytree(base.root, root)
    made = World(root, seeded(100 + number))
    code = killed_at(number, lambda: command(made))
    seen = visible(made.folder)
    again = World(root, seeded(10_000 + number))
    for principal in ("wasp-01", "alice"):
        assert again.identity(principal).principal_id == principal
    shutil.rmtree(root / "bob-2", ignore_errors=True)
    command(again)
    later = visible(made.folder)
    assert {place: later[place] for place in seen.keys() & later.keys()} == {
        place: seen[place] for place in seen.keys() & later.keys()
    }
    assert not list(made.folder.glob("*.part"))
    named = {key.name for key in again.open().state.keys} | {"root.key"}
    assert {path.name for path in made.folder.glob("*.key")} == named
    assert len(list(made.folder.glob("*.secret"))) == len(again.open().state.epochs)
    shutil.rmtree(root)
    return code


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_killed_anywhere_is_whole_or_undone(tmp_path: Path, name: str) -> None:
    """Every file operation is tried until the command gets through."""
    base = world(tmp_path / "base")
    codes = list[int]()
    while DONE not in codes:
        codes.append(check_killed(base, tmp_path / str(len(codes)), len(codes), COMMANDS[name]))
    assert codes == [KILLED] * (len(codes) - 1) + [DONE]
    assert len(codes) > 5


def test_making_a_directory_killed_anywhere_can_be_done_again(tmp_path: Path) -> None:
    """Until the state is there, there is no Directory."""

    def make(folder: Path) -> object:
        return directory.init(folder, deployment_id="d", now_ms=NOW_MS, random=os.urandom)

    code, number = KILLED, 0
    while code == KILLED:
        folder = tmp_path / str(number)
        code = killed_at(number, partial(make, folder))
        try:
            directory.open_directory(folder)
        except DirectoryError:
            make(folder)
        assert directory.open_directory(folder).trust.version == 1
        number += 1
    assert (code, number > 20) == (DONE, True)


def test_commands_at_the_same_time_wait_for_each_other(tmp_path: Path) -> None:
    """No change is lost, and no version is given out twice."""
    made = world(tmp_path)
    children = [_revoking(made) for _ in range(4)]
    assert [os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) for child in children] == [DONE] * 4
    assert made.open().revoked.version == 41


def _revoking(made: World) -> int:
    child = os.fork()
    if child == 0:
        code = 1
        try:
            for _ in range(10):
                changes.revoke(made.folder, Removal(), NOW_MS, os.urandom)
            code = DONE
        finally:
            os._exit(code)
    return child


def test_a_commit_outlives_a_power_cut(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The new state is synced before it takes the name, and the folder after that."""
    made, done = world(tmp_path), list[str]()
    sync, replace = os.fsync, os.replace

    def synced(descriptor: int) -> None:
        done.append(Path(os.readlink(f"/proc/self/fd/{descriptor}")).name)
        sync(descriptor)

    def replaced(source: Path, target: Path) -> None:
        done.append(f"{Path(target).name}!")
        replace(source, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", replaced)
    made.revoke()
    start = done.index("directory.state.part")
    assert done[start : start + 3] == ["directory.state.part", "directory.state!", "directory"]
