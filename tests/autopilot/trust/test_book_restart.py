"""What of the book survives: kills between disk, log and force, disks and logs that are older than each other."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from autopilot.trust import kept, keys
from autopilot.trust.fetching import Offered
from autopilot.trust.identity import load_identity
from autopilot.trust.judging import Floors, Known
from events.schema.trust_pb2 import RevocationsTaken
from tests.autopilot.trust.papers import (
    HOUR_MS,
    KEYS,
    Device,
    HostClocks,
    a_bundle,
    a_list,
    a_root,
    device,
)
from tests.autopilot.trust.test_book import check_offer
from tests.autopilot.trust.world import NOW_MS

REVOKE_ID = KEYS["revoke"].key_id


@pytest.fixture
def node(tmp_path: Path) -> Device:
    return device(tmp_path / "wasp")


def test_nothing_is_in_force_before_it_is_durable(node: Device) -> None:
    node.log.commits = False
    assert node.book.offer("revocations", a_list(12, "bob")) is Offered.TAKEN
    assert node.book.offer("epoch", a_bundle(2)) is Offered.TAKEN
    assert [node.book.settled, node.book.held.revocations.version, set(node.book.held.epochs)] == [False, 1, {1}]
    check_offer(node, "revocations", a_list(11), Offered.ROLLBACK)
    node.log.commit()
    assert [node.book.settled, node.book.held.revocations.version, set(node.book.held.epochs)] == [True, 12, {1, 2}]


def test_what_the_log_refuses_is_not_in_force_and_may_come_again(node: Device) -> None:
    node.log.refuses = True
    for kind, data in (("revocations", a_list(12)), ("epoch", a_bundle(2)), ("trust_root", a_root(2))):
        assert node.book.offer(kind, data) is Offered.NOT_KEPT  # type: ignore[arg-type]
    assert node.book.held.revocations.version == 1
    assert node.book.settled
    node.log.refuses = False
    for kind, data in (("revocations", a_list(12)), ("epoch", a_bundle(2)), ("trust_root", a_root(2))):
        check_offer(node, kind, data, Offered.TAKEN)  # type: ignore[arg-type]


def test_what_the_disk_refuses_is_not_in_force(node: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(kept, "write_file", full)
        check_offer(node, "revocations", a_list(12), Offered.NOT_KEPT)
    assert node.log.told == []
    check_offer(node, "revocations", a_list(12), Offered.TAKEN)


class Killed(BaseException):
    """The process ends here."""


STEPS: list[Callable[[Device], None]] = [
    lambda node: setattr(node.log, "commits", False),  # after the record, before the swap
    lambda node: setattr(node.log, "refuses", True),  # after the disk, before the record
]


@pytest.mark.parametrize("step", range(len(STEPS)))
def test_a_kill_between_disk_and_log_is_made_up_for_at_the_start(node: Device, step: int) -> None:
    """The disk is newer than the log: the start goes by it and says so."""
    STEPS[step](node)
    for kind, data in (("revocations", a_list(13, "bob")), ("epoch", a_bundle(2)), ("trust_root", a_root(2))):
        node.book.offer(kind, data)  # type: ignore[arg-type]
    again = node.restart(logged(node, version=1))
    assert again.book.held.revocations.principals == {"bob"}
    assert again.log.kinds() == ["RevocationsTaken", "RootTaken", "EpochTaken"]
    check_offer(again, "revocations", a_list(12), Offered.ROLLBACK)
    check_offer(again, "epoch", a_bundle(1, not_before_ms=NOW_MS + 1), Offered.EQUIVOCATION)


def logged(node: Device, version: int, digest: bytes | None = None, epoch_id: int = 1, root: int = 1) -> Floors:
    """Return what a log knows that has taken a list of this version."""
    known = Known(version, node.book.held.revocations.digest if digest is None else digest)
    return Floors({REVOKE_ID: known}, epoch_id, Known(root, b""))


@pytest.mark.parametrize("at", ["write_file", "sync_folder"])
@pytest.mark.parametrize("nth", [1, 2])
def test_a_kill_at_each_step_on_the_disk_leaves_a_folder_that_starts(
    node: Device, monkeypatch: pytest.MonkeyPatch, at: str, nth: int
) -> None:
    steps = iter(range(1, 99))

    def dying(*arguments: object, **named: object) -> None:
        if next(steps) == nth:
            raise Killed
        getattr(keys, at)(*arguments, **named)

    for kind, data in (("revocations", a_list(13)), ("epoch", a_bundle(2)), ("trust_root", a_root(2))):
        steps = iter(range(1, 99))
        with monkeypatch.context() as patch:
            patch.setattr(kept, at, dying)
            with suppress(Killed):
                node.book.offer(kind, data)  # type: ignore[arg-type]
        found = load_identity(node.folder)
        assert found.revocations.version in (1, 13)
        node = device(node.folder)
        assert node.book.offer(kind, data) in (Offered.TAKEN, Offered.SAME)  # type: ignore[arg-type]


def test_a_disk_that_is_older_than_the_log_is_said_and_made_good(node: Device) -> None:
    """The log says 13, the file 12: somebody, or something, took it back."""
    check_offer(node, "revocations", a_list(12), Offered.TAKEN)
    again = node.restart(logged(node, version=13, digest=b"\x01" * 32))
    (told,) = again.log.told
    assert isinstance(told, RevocationsTaken)
    assert told.list_version == 12
    assert again.asked.take() == ["revocations"]
    again.host.pass_ms(10_000)
    again.book.turn()
    assert again.asked.take() == ["revocations"]
    check_offer(again, "revocations", a_list(12), Offered.ROLLBACK)
    check_offer(again, "revocations", a_list(13), Offered.EQUIVOCATION)
    check_offer(again, "revocations", a_list(14), Offered.TAKEN)
    again.host.pass_ms(10_000)
    again.book.turn()
    assert again.asked.take() == []


def test_the_lost_list_itself_is_taken_again(node: Device, tmp_path: Path) -> None:
    other = device(tmp_path / "other")
    check_offer(other, "revocations", a_list(13, "bob"), Offered.TAKEN)
    again = node.restart(logged(other, version=13))
    check_offer(again, "revocations", a_list(13, "bob"), Offered.TAKEN)
    check_offer(again, "revocations", a_list(13, "bob"), Offered.SAME)


def test_an_old_list_is_a_rollback_also_after_a_restart(node: Device) -> None:
    check_offer(node, "revocations", a_list(12, "bob"), Offered.TAKEN)
    again = node.restart(logged(node, version=12))
    assert again.log.told == []
    check_offer(again, "revocations", a_list(11), Offered.ROLLBACK)


def test_a_log_that_knows_a_newer_epoch_makes_the_start_ask_for_it(node: Device) -> None:
    again = node.restart(logged(node, version=1, epoch_id=5))
    assert again.asked.take() == ["epoch"]
    check_offer(again, "epoch", a_bundle(4), Offered.OLD)
    check_offer(again, "epoch", a_bundle(5), Offered.TAKEN)


def test_the_floor_of_the_time_survives(node: Device) -> None:
    again = node.restart(logged(node, version=1), NOW_MS + HOUR_MS, host=HostClocks(wall_ms=0))
    assert again.clock.time().earliest_ms == NOW_MS + HOUR_MS
    assert not again.clock.time().trusted
