"""A Directory's documents through a verifying relay: what comes in, what stays outside by which counter.

The Directory is a real one in a folder; the two links remember what was put, asked and answered.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from autopilot.ground.directory_changes import Removal
from autopilot.ground.directory_papers import ROOT_KEY_FILE
from autopilot.ground.directory_store import read_key
from autopilot.ground.relay_documents import ANSWER_BYTES
from autopilot.trust import pae
from autopilot.trust.documents import sign
from autopilot.trust.identity import REVOCATIONS_FILE, ROOT_FILE
from autopilot.trust.keys import SignKey
from autopilot.wire.keys import (
    EPOCHS,
    REVOCATIONS,
    TIMES,
    TRUST_ROOTS,
    Channel,
    trust_key,
)
from events.schema.waypoint_pb2 import EpochBundle, RevocationList, SignedDoc, TimeBeacon, TrustRoot
from tests.autopilot.ground.relay_desk import CHALLENGE, GOOD, Desk, desk_in, several
from tests.autopilot.trust.world import NOW_MS
from tests.checks import check_equal

Change = Callable[[Any], None]


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    with desk_in(tmp_path) as made:
        yield made


def question(desk: Desk, channel: Channel) -> bytes:
    """Return what a node asks."""
    return {EPOCHS: desk.device, TIMES: CHALLENGE}.get(channel, b"")


PURPOSES = {REVOCATIONS: "revoke", EPOCHS: "epoch", TIMES: "time"}
CONTEXTS = {REVOCATIONS: pae.REVOCATION_LIST, EPOCHS: pae.EPOCH_BUNDLE, TIMES: pae.TIME_BEACON}
BODIES: dict[Channel, Any] = {REVOCATIONS: RevocationList, EPOCHS: EpochBundle, TIMES: TimeBeacon}


def again(desk: Desk, channel: Channel, change: Change = lambda _: None, key: SignKey | None = None) -> bytes:
    """Return the good document of a kind with a change, signed by its own purpose key or by another one."""
    found = desk.bundles()[0] if channel is EPOCHS else GOOD[channel](desk)
    body = BODIES[channel].FromString(SignedDoc.FromString(found).body)
    change(body)
    signed = sign(CONTEXTS[channel], body, [key or desk.key(PURPOSES[channel])])
    return several(signed) if channel is EPOCHS else signed


def check_stays(desk: Desk, channel: Channel, answer: bytes, because: str) -> None:
    """An answer stays outside, counted by its reason; the good one beside it comes in."""
    good, about = GOOD[channel](desk), question(desk, channel)
    check_equal(desk.ask(channel, about, answer), [])
    check_equal(desk.counts(channel), {"received": 1, "passed": 0, because: 1})
    check_equal(desk.ask(channel, about, answer, good), [good])
    check_equal(desk.counts(channel), {"received": 3, "passed": 1, because: 2})
    asked = {"asked": 2, "answered": 1, "unanswered": 1, "size": 0, "rate": 0, "busy": 0, "late": 0}
    check_equal(desk.relay.counts()["questions"], asked)


@pytest.mark.parametrize("channel", GOOD, ids=lambda channel: channel.name)
def test_what_proves_itself_comes_in_as_it_came(desk: Desk, channel: Channel) -> None:
    good, about = GOOD[channel](desk), question(desk, channel)
    check_equal(desk.ask(channel, about, good), [good])
    check_equal(desk.outer.asked, [(trust_key(channel, "coast-watch"), about)])
    check_equal(desk.counts(channel), {"received": 1, "passed": 1})


@pytest.mark.parametrize("channel", GOOD, ids=lambda channel: channel.name)
def test_what_is_too_long_or_not_to_be_read_stays_outside(desk: Desk, channel: Channel) -> None:
    check_equal(desk.ask(channel, question(desk, channel), bytes(ANSWER_BYTES[channel] + 1)), [])
    check_equal(desk.ask(channel, question(desk, channel), b"\xff" * ANSWER_BYTES[channel]), [])
    check_equal(desk.counts(channel), {"received": 2, "passed": 0, "malformed": 1, "size": 1})


@pytest.mark.parametrize("channel", CONTEXTS, ids=lambda channel: channel.name)
def test_what_a_stranger_signed_stays_outside(desk: Desk, channel: Channel) -> None:
    check_stays(desk, channel, again(desk, channel, key=SignKey.from_seed(b"x" * 32)), "unsigned")


@pytest.mark.parametrize("channel", CONTEXTS, ids=lambda channel: channel.name)
def test_what_a_key_for_another_purpose_signed_stays_outside(desk: Desk, channel: Channel) -> None:
    check_stays(desk, channel, again(desk, channel, key=desk.key("token")), "other_purpose")


def older_root(desk: Desk) -> bytes:
    """Return the root that the relay's was replaced by since."""
    before = desk.newest(ROOT_FILE)
    desk.world.rotate("time")
    desk.ask(TRUST_ROOTS, b"", desk.newest(ROOT_FILE))
    return before


def root_of(desk: Desk, change: Change) -> bytes:
    """Return the newest root with a change, signed by the root's key again."""
    body = TrustRoot.FromString(SignedDoc.FromString(desk.newest(ROOT_FILE)).body)
    change(body)
    return sign(pae.TRUST_ROOT, body, [read_key(desk.world.folder, ROOT_KEY_FILE)])


def shift(name: str, value: Any) -> Change:
    """Return a change of one field."""
    return lambda body: setattr(body, name, value)


@pytest.mark.parametrize(
    ("channel", "name", "value", "because"),
    [
        (REVOCATIONS, "issued_at_ms", 1, "equivocation"),
        (REVOCATIONS, "deployment_id", "elsewhere", "malformed"),
        (EPOCHS, "recipient_device_key_id", b"d" * 16, "foreign"),
        (EPOCHS, "wrapped_key", b"w" * 79, "malformed"),
        (EPOCHS, "key_commitment", b"k" * 31, "malformed"),
        (EPOCHS, "deployment_id", "elsewhere", "malformed"),
        (TIMES, "challenge", b"d" * 16, "unasked"),
        (TIMES, "deployment_id", "elsewhere", "malformed"),
    ],
)
def test_what_is_signed_and_no_answer_stays_outside(
    desk: Desk, channel: Channel, name: str, value: Any, because: str
) -> None:
    check_stays(desk, channel, again(desk, channel, shift(name, value)), because)


@pytest.mark.parametrize(
    ("name", "value", "because"),
    [
        ("expires_ms", NOW_MS, "old"),
        ("expires_ms", NOW_MS + 1, "equivocation"),
        ("deployment_id", "elsewhere", "foreign"),
        ("v", 2, "malformed"),
    ],
)
def test_a_root_that_does_not_follow_stays_outside(desk: Desk, name: str, value: Any, because: str) -> None:
    check_stays(desk, TRUST_ROOTS, root_of(desk, shift(name, value)), because)


def test_a_root_under_other_root_keys_stays_outside(desk: Desk) -> None:
    """It is whole by its own word, which anybody's is."""
    other = SignKey.from_seed(b"o" * 32)
    body = TrustRoot.FromString(SignedDoc.FromString(desk.newest(ROOT_FILE)).body)
    body.version, body.root_keys[:] = 9, [other.public]
    check_stays(desk, TRUST_ROOTS, sign(pae.TRUST_ROOT, body, [other]), "unsigned")


def test_an_older_root_stays_outside(desk: Desk) -> None:
    before = older_root(desk)
    check_equal(desk.ask(TRUST_ROOTS, b"", before), [])
    check_equal(desk.counts(TRUST_ROOTS), {"received": 2, "passed": 1, "old": 1})


@pytest.mark.parametrize("count", [0, 5])
def test_bundles_are_one_to_four(desk: Desk, count: int) -> None:
    check_stays(desk, EPOCHS, several(*desk.bundles() * count), "malformed")


def test_one_bundle_that_is_wrong_spoils_them_all(desk: Desk) -> None:
    check_stays(desk, EPOCHS, several(*desk.bundles(), *desk.bundles("alice")), "foreign")


@pytest.mark.parametrize(("later_ms", "because"), [(0, ""), (1, "old")])
def test_a_bundle_that_is_over_stays_outside(desk: Desk, later_ms: int, because: str) -> None:
    """Two minutes after its retirement, and the five seconds that clocks may differ by."""
    (only,) = desk.bundles()
    bundle = EpochBundle.FromString(SignedDoc.FromString(only).body)
    desk.clock.now_ms = bundle.retire_at_ms + 125_000 + later_ms
    desk.ask(EPOCHS, desk.device, several(only))
    passed = {"received": 1, "passed": 0, because: 1} if because else {"received": 1, "passed": 1}
    check_equal(desk.counts(EPOCHS), passed)


def test_a_bundle_that_the_list_makes_void_stays_outside(desk: Desk) -> None:
    before = several(*desk.bundles())
    desk.world.revoke("alice")
    desk.world.revoke(removal=Removal(min_epoch_id=2))
    desk.ask(REVOCATIONS, b"", desk.newest(REVOCATIONS_FILE))
    check_equal(desk.ask(EPOCHS, desk.device, before), [])
    check_equal(desk.counts(EPOCHS), {"received": 1, "passed": 0, "old": 1})
    least = several(desk.bundles()[-1])
    check_equal(desk.ask(EPOCHS, desk.device, least), [least])
