"""Documents that change in flight: what is taken, what is refused and how loudly, what survives a restart."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from autopilot.trust import kept, keys
from autopilot.trust.believing import Heard
from autopilot.trust.fetching import Offered, What
from autopilot.trust.identity import load_identity
from autopilot.trust.judging import Floors, Known
from events.schema.trust_pb2 import RevocationsTaken, TimeLearned, TrustAlarm
from tests.autopilot.trust.papers import (
    HOUR_MS,
    KEYS,
    OTHER,
    Device,
    HostClocks,
    a_beacon,
    a_bundle,
    a_list,
    a_root,
    device,
    epoch_secret,
)
from tests.autopilot.trust.world import NOW_MS, people

REVOKE_ID = KEYS["revoke"].key_id


@pytest.fixture
def node(tmp_path: Path) -> Device:
    return device(tmp_path / "wasp")


def check_offer(node: Device, kind: What, data: bytes, result: Offered) -> None:
    """A document meets its fate; unless it is taken, disk, log and what is in force stay, but for an alarm."""
    held, files = node.book.held, contents(node.folder)
    told = [each for each in node.log.told if not isinstance(each, TrustAlarm)]
    assert node.book.offer(kind, data) is result
    if result is not Offered.TAKEN:
        assert node.book.held is held
        assert contents(node.folder) == files
        assert [each for each in node.log.told if not isinstance(each, TrustAlarm)] == told


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def alarms(node: Device) -> list[tuple[str, str, int, int]]:
    found = [each for each in node.log.told if isinstance(each, TrustAlarm)]
    return [(each.what, each.document, each.held_version, each.offered_version) for each in found]


def test_a_newer_list_is_kept_recorded_and_in_force(node: Device) -> None:
    data = a_list(12, "bob", issued_at_ms=NOW_MS + 60_000)
    check_offer(node, "revocations", data, Offered.TAKEN)
    assert node.book.held.revocations.principals == {"bob"}
    path = node.folder / "revocations"
    assert path.read_bytes() == data
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    (told,) = node.log.told
    assert isinstance(told, RevocationsTaken)
    assert (told.key_id, told.list_version, told.issued_at_ms) == (REVOKE_ID, 12, NOW_MS + 60_000)
    assert told.next_update_ms == NOW_MS + 72 * HOUR_MS
    assert told.digest == node.book.held.revocations.digest
    assert node.clock.floor_ms == NOW_MS + 60_000
    check_offer(node, "revocations", data, Offered.SAME)
    assert alarms(node) == []


@pytest.mark.parametrize(
    ("kind", "data", "result"),
    [
        ("revocations", b"", Offered.UNSIGNED),
        ("revocations", b"\xff" * 300, Offered.MALFORMED),
        ("revocations", b"\x0a" * 300_000, Offered.MALFORMED),
        ("revocations", a_list(13, key=KEYS["token"]), Offered.UNSIGNED),
        ("revocations", a_list(13, deployment_id="other"), Offered.MALFORMED),
        ("revocations", people(2).wasp.folder.joinpath("revocations").read_bytes(), Offered.UNSIGNED),
        ("epoch", b"\xff" * 300, Offered.MALFORMED),
        ("epoch", a_bundle(2, key=KEYS["revoke"]), Offered.UNSIGNED),
        ("epoch", a_bundle(2, recipient=people().hornet), Offered.FOREIGN),
        ("epoch", a_bundle(2, wrapped_key=b"\x01" * 80), Offered.MALFORMED),
        ("epoch", a_bundle(2, key_commitment=b"\x01" * 32), Offered.MALFORMED),
        ("epoch", a_bundle(2, deployment_id="other"), Offered.MALFORMED),
        ("trust_root", a_root(2, key=OTHER["token"]), Offered.UNSIGNED),
        ("trust_root", people(2).wasp.folder.joinpath("trust_root").read_bytes(), Offered.UNSIGNED),
        ("trust_root", a_root(2, deployment_id="other"), Offered.FOREIGN),
        ("time", b"\xff" * 100, Offered.MALFORMED),
        ("time", a_beacon(b"c" * 16, NOW_MS, key=KEYS["token"]), Offered.UNSIGNED),
        ("time", a_beacon(b"c" * 16, NOW_MS), Offered.UNASKED),
        ("time", a_beacon(b"c" * 15, NOW_MS), Offered.MALFORMED),
    ],
)
def test_what_is_not_proved_changes_nothing(node: Device, kind: What, data: bytes, result: Offered) -> None:
    check_offer(node, kind, data, result)
    assert node.log.told == []
    assert node.book.counts() == {f"{kind}: {result.value}": 1}


def test_an_older_list_is_a_rollback_and_another_of_the_same_version_an_equivocation(node: Device) -> None:
    check_offer(node, "revocations", a_list(12, "bob"), Offered.TAKEN)
    check_offer(node, "revocations", a_list(11), Offered.ROLLBACK)
    node.host.pass_ms(10_000)
    check_offer(node, "revocations", a_list(12, "alice"), Offered.EQUIVOCATION)
    assert alarms(node) == [("rollback", "revocations", 12, 11), ("equivocation", "revocations", 12, 12)]
    assert node.book.held.revocations.principals == {"bob"}


def test_anybody_may_send_old_lists_around_and_the_log_hears_of_it_once(node: Device) -> None:
    check_offer(node, "revocations", a_list(1000), Offered.TAKEN)
    for version in range(900):
        node.book.offer("revocations", a_list(version + 1))
    node.host.pass_ms(9_999)
    node.book.offer("revocations", a_list(2))
    assert len(alarms(node)) == 1
    node.host.pass_ms(1)
    node.book.offer("revocations", a_list(1))
    assert len(alarms(node)) == 1
    node.book.offer("revocations", a_list(2))
    assert len(alarms(node)) == 2


def test_a_stolen_key_that_ran_far_ahead_is_overcome_by_a_new_root(node: Device) -> None:
    """Versions are counted for each key apart; until its successor's first list comes the old list revokes on."""
    check_offer(node, "revocations", a_list(2**63, "alice"), Offered.TAKEN)
    check_offer(node, "revocations", a_list(13, "bob"), Offered.ROLLBACK)
    check_offer(node, "trust_root", a_root(2, revoke=OTHER["revoke"]), Offered.TAKEN)
    assert node.book.held.revocations.principals == {"alice"}
    assert node.asked.take() == ["revocations"]
    check_offer(node, "revocations", a_list(2**63 + 1, "alice"), Offered.UNSIGNED)
    again = node.restart(Floors({REVOKE_ID: Known(2**63, node.book.held.revocations.digest)}, 1, Known(2, b"")))
    assert again.book.held.revocations.principals == {"alice"}
    check_offer(again, "revocations", a_list(1, "bob", key=OTHER["revoke"]), Offered.TAKEN)
    assert again.book.held.revocations.principals == {"bob"}
    assert load_identity(node.folder).revocations.principals == {"bob"}


def test_a_root_only_grows(node: Device) -> None:
    check_offer(node, "trust_root", a_root(1, revoke=OTHER["revoke"]), Offered.EQUIVOCATION)
    check_offer(node, "trust_root", people().wasp.folder.joinpath("trust_root").read_bytes(), Offered.SAME)
    check_offer(node, "trust_root", a_root(3, time=OTHER["time"]), Offered.TAKEN)
    node.host.pass_ms(10_000)
    check_offer(node, "trust_root", a_root(2, revoke=OTHER["revoke"]), Offered.ROLLBACK)
    assert [one[:2] for one in alarms(node)] == [("equivocation", "trust_root"), ("rollback", "trust_root")]
    assert node.log.kinds() == ["TrustAlarm", "RootTaken", "TrustAlarm"]


def test_epochs_overlap_for_two_minutes_and_then_their_keys_are_gone(node: Device) -> None:
    check_offer(node, "epoch", a_bundle(2, not_before_ms=NOW_MS + 60_000), Offered.TAKEN)
    assert node.log.kinds() == ["EpochTaken"]
    assert {each: epoch.secret for each, epoch in node.book.held.epochs.items()}[2] == epoch_secret(2)
    assert node.book.held.current_epoch(NOW_MS + 59_999) == node.book.held.epochs[1]
    assert node.book.held.current_epoch(NOW_MS + 60_000) == node.book.held.epochs[2]
    issued = (node.folder / "epoch").read_bytes()
    node.host.pass_ms(180_000)
    node.book.turn()
    assert set(node.book.held.epochs) == {1, 2}
    node.host.pass_ms(1)
    node.book.turn()
    assert set(node.book.held.epochs) == {2}
    assert (node.folder / "epoch").read_bytes() == (node.folder / "epochs" / "2").read_bytes() != issued
    assert not (node.folder / "epoch.over").exists()
    assert set(load_identity(node.folder).epochs) == {2}
    check_offer(node, "epoch", issued, Offered.OLD)


def test_the_newest_key_is_kept_also_when_it_is_over(node: Device) -> None:
    """There is always one; it opens nothing, but says which epoch this node has come to."""
    node.host.pass_ms(32 * 24 * HOUR_MS)
    node.book.turn()
    assert set(node.book.held.epochs) == {1}


def test_a_node_without_time_always_has_a_key_to_answer_with(node: Device) -> None:
    """Unless the list says that none is left."""
    held = node.book.held
    assert held.current_epoch(0) is None
    assert held.current_epoch(0, certain=False) == held.epochs[1]
    node.book.offer("revocations", a_list(2, min_epoch_id=2))
    assert node.book.held.current_epoch(0, certain=False) is None


def test_old_bundles_are_overwritten(node: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    erased: list[str] = []

    def erase(path: Path) -> None:
        erased.append(path.name)
        path.unlink()

    monkeypatch.setattr(kept, "erase_file", erase)
    for epoch_id in (2, 3, 4):
        check_offer(node, "epoch", a_bundle(epoch_id), Offered.TAKEN)
    assert set(node.book.held.epochs) == {2, 3, 4}
    node.host.pass_ms(120_001)
    node.book.turn()
    assert set(node.book.held.epochs) == {4}
    assert sorted(erased) == ["2", "3", "epoch.over"]
    assert sorted(path.name for path in (node.folder / "epochs").iterdir()) == ["4"]


def test_an_erased_file_holds_nothing_any_more(tmp_path: Path) -> None:
    secret, other_name = tmp_path / "secret", tmp_path / "other"
    secret.write_bytes(b"\x07" * 32)
    other_name.hardlink_to(secret)
    keys.erase_file(secret)
    assert other_name.read_bytes() == bytes(32)
    assert not secret.exists()


def test_epochs_only_grow_and_one_id_is_one_key(node: Device) -> None:
    check_offer(node, "epoch", a_bundle(5), Offered.TAKEN)
    check_offer(node, "epoch", a_bundle(5, retire_at_ms=NOW_MS + 25 * HOUR_MS), Offered.SAME)
    check_offer(node, "epoch", a_bundle(4), Offered.OLD)
    check_offer(node, "epoch", a_bundle(5, key_commitment=b"\x01" * 32), Offered.EQUIVOCATION)
    assert alarms(node) == [("equivocation", "epoch", 5, 5)]
    check_offer(node, "revocations", a_list(2, min_epoch_id=7), Offered.TAKEN)
    check_offer(node, "epoch", a_bundle(6), Offered.OLD)
    assert node.book.held.current_epoch(NOW_MS) is None
    check_offer(node, "epoch", a_bundle(7), Offered.TAKEN)


def test_an_epoch_that_needs_a_newer_list_makes_the_book_ask_for_it(node: Device) -> None:
    check_offer(node, "epoch", a_bundle(2, min_revocation_version=2), Offered.TAKEN)
    assert node.asked.take() == ["revocations"]
    node.host.pass_ms(10_000)
    check_offer(node, "epoch", a_bundle(3), Offered.TAKEN)
    assert node.asked.take() == []


@pytest.mark.parametrize(
    ("heard", "asks"),
    [
        (Heard(1, 1, 0), []),
        (Heard(2, 1, 0), ["revocations"]),
        (Heard(1, 2, 0), ["epoch"]),
        (Heard(9, 9, 0), ["revocations", "epoch"]),
        (Heard(0, 0, 0), []),
    ],
)
def test_who_knows_of_something_newer_makes_the_book_ask_every_10_s(
    node: Device, heard: Heard, asks: list[str]
) -> None:
    node.book.heard(heard)
    assert node.asked.take() == asks
    node.host.pass_ms(9_999)
    node.book.heard(heard)
    assert node.asked.take() == []
    node.host.pass_ms(1)
    node.book.heard(heard)
    assert node.asked.take() == asks


def test_tokens_raise_the_floor(node: Device) -> None:
    node.book.heard(Heard(1, 1, NOW_MS + 4_000))
    assert node.clock.floor_ms == NOW_MS + 4_000


def test_a_withheld_list_grows_stale_and_is_asked_for(node: Device) -> None:
    """For 100 hours: overdue by what is past its due time, to the millisecond; asked for all the time."""
    check_offer(node, "revocations", a_list(2, next_update_ms=NOW_MS + 10 * HOUR_MS), Offered.TAKEN)
    found: list[int] = []
    for _ in range(100):
        node.host.pass_ms(HOUR_MS)
        node.book.turn()
        found.append(node.book.overdue_ms() // HOUR_MS)
    assert found == [0] * 10 + list(range(1, 91))
    assert node.asked.take() == ["revocations"] * 90
    assert node.book.held.revocations.version == 2


def test_staleness_needs_no_clock(tmp_path: Path) -> None:
    """A time that is not known is still not before the floor, and that rises with the node's own monotonic clock."""
    node = device(tmp_path / "wasp", HostClocks(wall_ms=0), host_trusted=False)
    check_offer(node, "revocations", a_list(2, next_update_ms=NOW_MS + HOUR_MS), Offered.TAKEN)
    node.host.pass_ms(HOUR_MS)
    assert node.book.overdue_ms() == 0
    node.host.pass_ms(1)
    assert node.book.overdue_ms() == 1


def test_an_uncertain_time_is_asked_for_and_learned(tmp_path: Path) -> None:
    node = device(tmp_path / "wasp", HostClocks(wall_ms=0))
    node.book.turn()
    ((what, challenge),) = node.asked.requests
    assert what == "time"
    assert challenge is not None
    assert node.book.offer("time", a_beacon(challenge, NOW_MS + HOUR_MS)) is Offered.TAKEN
    assert node.book.time().trusted
    node.book.turn()
    assert [each.source for each in node.log.told if isinstance(each, TimeLearned)] == ["document", "beacon"]
    assert node.book.offer("time", a_beacon(challenge, NOW_MS + HOUR_MS)) is Offered.UNASKED


def test_what_was_learned_of_the_time_is_told_when_the_log_takes_it(node: Device) -> None:
    node.log.refuses = True
    node.book.turn()
    node.log.refuses = False
    node.book.turn()
    node.book.turn()
    assert [each.source for each in node.log.told if isinstance(each, TimeLearned)] == ["host", "document"]


def test_a_beacon_that_contradicts_what_was_signed_is_an_alarm(tmp_path: Path) -> None:
    node = device(tmp_path / "wasp", HostClocks(wall_ms=0))
    node.book.turn()
    challenge = node.asked.requests[0][1]
    assert challenge is not None
    assert node.book.offer("time", a_beacon(challenge, NOW_MS - HOUR_MS)) is Offered.ROLLBACK
    assert alarms(node) == [("rollback", "time", NOW_MS, NOW_MS - HOUR_MS)]
