"""A Directory's documents through a verifying relay: what comes in, what stays outside by which counter.

The Directory is a real one in a folder; the two links remember what was put, asked and answered.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from autopilot.ground import relay_documents
from autopilot.ground.directory_changes import Removal
from autopilot.ground.directory_papers import ROOT_KEY_FILE, signed_beacon, signed_bundle
from autopilot.ground.directory_store import read_key
from autopilot.ground.relay import Relay
from autopilot.ground.relay_config import VerifySection
from autopilot.ground.relay_documents import ANSWER_BYTES, ASKED_BURST, HEARD_BURST
from autopilot.ground.relay_papers import Papers
from autopilot.trust import pae
from autopilot.trust.documents import sign
from autopilot.trust.envelope import MessageType
from autopilot.trust.identity import REVOCATIONS_FILE, ROOT_FILE
from autopilot.trust.keys import SignKey
from autopilot.wire.directory_pb2 import Documents as Several
from autopilot.wire.keys import (
    BUNDLES,
    EPOCHS,
    ORDERS,
    REVOCATIONS,
    TIMES,
    TRUST_ROOTS,
    Channel,
    bundle_key,
    order_key,
    trust_key,
)
from events.schema.waypoint_pb2 import EpochBundle, RevocationList, SignedDoc, TimeBeacon, TrustRoot
from tests.autopilot.ground import directories
from tests.autopilot.trust.world import COMMAND_ID, NOW_MS, FakeClock, FakeWire, Forge
from tests.checks import check_equal

CHALLENGE = b"c" * 16
Make = Callable[["Desk"], bytes]
Change = Callable[[Any], None]


class Desk:
    """A Directory outside, a relay, and somebody inside who asks it."""

    def __init__(self, root: Path) -> None:
        self.world, self.clock = directories.world(root), FakeClock()
        self.world.issue("bob")
        self.public = root / "public"
        self.public.mkdir()
        self.lay_out()
        self.outer, self.inner = FakeWire(), FakeWire()
        self.papers = Papers(self.public, NOW_MS)
        config = VerifySection(documents=str(self.public), nodes=("wasp-01",))
        self.relay = Relay(config, self.papers, self.clock, self.outer, self.inner)
        self.device = self.world.identity("wasp-01").sign_key.key_id
        self.relay.start()

    def lay_out(self) -> None:
        """Copy the Directory's public documents as they are now into the relay's folder."""
        for name in (ROOT_FILE, REVOCATIONS_FILE):
            (self.public / name).write_bytes(self.newest(name))

    def newest(self, name: str) -> bytes:
        """Return the Directory's trust root or list as it is now."""
        return (self.world.folder / name).read_bytes()

    def key(self, purpose: str) -> SignKey:
        """Return one of the Directory's keys."""
        return self.world.open().purpose_keys[purpose]

    def beacon(self, challenge: bytes = CHALLENGE) -> bytes:
        """Return the time, signed."""
        return signed_beacon(self.world.open(), challenge, NOW_MS)

    def bundles(self, who: str = "wasp-01") -> list[bytes]:
        """Return the bundles of a device."""
        made, token = self.world.open(), self.world.identity(who).token
        return [signed_bundle(made, epoch, token) for epoch in made.state.epochs]

    def ask(self, channel: Channel, question: bytes, *answers: bytes) -> list[bytes]:
        """Ask inside while these are the answers outside; return what came of it."""
        self.outer.answers, replied = list(answers), list[bytes]()
        self.inner.answerers[trust_key(channel, "coast-watch")](question, replied.append)
        self.settle()
        return replied

    def publish(self, key_expr: str, payload: bytes) -> None:
        """Publish outside."""
        pattern = key_expr if key_expr in self.outer.subscriptions else trust_key(BUNDLES, "coast-watch")
        self.outer.subscriptions[pattern.replace("<device_key_id>", "*")](key_expr, payload)
        self.settle()

    def settle(self) -> None:
        """Wait until the relay has done what it has to do."""
        for lane in self.relay._documents._lanes.values():
            done = threading.Event()
            assert lane.put(done.set)
            assert done.wait(10)

    def counts(self, channel: Channel) -> dict[str, int]:
        """Return what became of documents of a kind."""
        return self.relay.counts()[channel.name]

    def inside(self) -> list[tuple[str, bytes]]:
        """Stop the relay; return what it put inside."""
        self.relay.stop()
        return [(key, payload) for key, payload, _ in self.inner.puts]


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    made = Desk(tmp_path)
    yield made
    made.relay.stop()


def several(*found: bytes) -> bytes:
    """Encode an answer of several documents."""
    return Several(documents=found).SerializeToString(deterministic=True)


def question(desk: Desk, channel: Channel) -> bytes:
    """Return what a node asks."""
    return {EPOCHS: desk.device, TIMES: CHALLENGE}.get(channel, b"")


GOOD: dict[Channel, Make] = {
    TRUST_ROOTS: lambda desk: desk.newest(ROOT_FILE),
    REVOCATIONS: lambda desk: desk.newest(REVOCATIONS_FILE),
    EPOCHS: lambda desk: several(*desk.bundles()),
    TIMES: lambda desk: desk.beacon(),
}
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


def ordered(desk: Desk, who: str, seq: int) -> bool:
    """Say whether an order of somebody passes the relay's own gate."""
    key = order_key("wasp-01", COMMAND_ID)
    passed = desk.relay.counts()["orders"]["passed"]
    desk.relay.receive(ORDERS, key, Forge(desk.world.identity(who), MessageType.ORDER, key, seq=seq).envelope())
    return desk.relay.counts()["orders"]["passed"] > passed


def test_a_newer_list_is_the_relay_s_own_at_once(desk: Desk) -> None:
    """It passes and holds here too; the older one that was held before stays outside from then on."""
    before = desk.newest(REVOCATIONS_FILE)
    assert ordered(desk, "alice", 1)
    desk.world.revoke("alice")
    newer = desk.newest(REVOCATIONS_FILE)
    check_equal(desk.ask(REVOCATIONS, b"", before, newer, before), [newer])
    assert not ordered(desk, "alice", 2)
    check_equal(desk.relay.counts()["orders"]["revoked"], 1)
    check_equal(desk.counts(REVOCATIONS), {"received": 3, "passed": 2, "old": 1})


def test_a_list_from_the_mesh_outlives_the_file_that_is_older(desk: Desk) -> None:
    """The file that lies there is no news, and is not complained of; an older one that is laid there is."""
    before = desk.newest(REVOCATIONS_FILE)
    desk.world.revoke("alice")
    desk.ask(REVOCATIONS, b"", desk.newest(REVOCATIONS_FILE))
    check_equal((desk.relay.look(), desk.papers.revocations().version), ("", 2))
    desk.lay_out()
    check_equal((desk.relay.look(), desk.papers.revocations().version), ("", 2))
    (desk.public / REVOCATIONS_FILE).write_bytes(before)
    assert "version 1 is older than 2, which is held" in desk.relay.look()
    check_equal(desk.papers.revocations().version, 2)


def test_a_newer_root_is_the_relay_s_own_at_once(desk: Desk) -> None:
    """Lists under the new key pass, also of a lower version; tokens under an old key no longer do."""
    desk.world.revoke("alice")
    desk.ask(REVOCATIONS, b"", desk.newest(REVOCATIONS_FILE))
    assert ordered(desk, "bob", 1)
    for purpose in ("revoke", "token"):
        desk.world.rotate(purpose)
    newer = desk.newest(REVOCATIONS_FILE)
    check_equal(desk.ask(REVOCATIONS, b"", newer), [])
    root = desk.newest(ROOT_FILE)
    check_equal(desk.ask(TRUST_ROOTS, b"", root), [root])
    check_equal(desk.ask(REVOCATIONS, b"", newer), [newer])
    old = desk.relay.counts()["orders"]["passed"]
    assert not ordered(desk, "bob", 2)
    check_equal((desk.relay.counts()["orders"]["token_sig"], desk.relay.counts()["orders"]["passed"]), (1, old))


@pytest.mark.parametrize(("channel", "length"), [(TRUST_ROOTS, 1), (REVOCATIONS, 1), (EPOCHS, 15), (TIMES, 17)])
def test_a_question_of_another_length_stays_inside(desk: Desk, channel: Channel, length: int) -> None:
    check_equal(desk.ask(channel, bytes(length), GOOD[channel](desk)), [])
    check_equal((desk.outer.asked, desk.relay.counts()["questions"]["size"]), ([], 1))


def test_questions_are_bounded_for_all_askers_together_and_by_kind(desk: Desk) -> None:
    for _ in range(ASKED_BURST + 5):
        desk.ask(TIMES, CHALLENGE)
    desk.ask(REVOCATIONS, b"")
    found = desk.relay.counts()["questions"]
    check_equal((found["asked"], found["rate"], found["unanswered"]), (ASKED_BURST + 1, 5, ASKED_BURST + 1))
    desk.clock.now_ms += 50
    desk.ask(TIMES, CHALLENGE)
    desk.ask(TIMES, CHALLENGE)
    check_equal(desk.relay.counts()["questions"]["rate"], 6)


class Slow(FakeWire):
    """A link whose answers wait until they are let through."""

    def __init__(self) -> None:
        super().__init__()
        self.asking, self.go = threading.Event(), threading.Event()

    def ask(self, key_expr: str, question: bytes, timeout_s: float) -> list[bytes]:
        """Wait."""
        self.asking.set()
        assert self.go.wait(10)
        return super().ask(key_expr, question, timeout_s)


def test_questions_that_wait_are_bounded_and_forgotten_when_nobody_waits(desk: Desk) -> None:
    """Behind a Directory that does not answer."""
    slow = desk.relay._documents._outer = Slow()
    ask = desk.inner.answerers[trust_key(REVOCATIONS, "coast-watch")]
    replied: list[bytes] = []
    slow.answers = [desk.newest(REVOCATIONS_FILE)]
    ask(b"", replied.append)
    assert slow.asking.wait(10)
    done = threading.Event()
    for _ in range(relay_documents.WAITING_MAX - 1):
        ask(b"", replied.append)
    assert desk.relay._documents._lanes["documents"].put(done.set)
    for _ in range(3):
        ask(b"", replied.append)
    desk.clock.now_ms += 2_001
    slow.go.set()
    assert done.wait(10)
    found, waited = desk.relay.counts()["questions"], relay_documents.WAITING_MAX - 1
    check_equal((found["busy"], found["asked"], found["late"], found["answered"]), (3, 1 + waited, waited, 1))
    check_equal((len(replied), len(slow.asked)), (1, 1))


def test_the_time_is_not_asked_for_behind_other_questions(desk: Desk) -> None:
    slow = desk.relay._documents._outer = Slow()
    desk.inner.answerers[trust_key(REVOCATIONS, "coast-watch")](b"", lambda _: None)
    assert slow.asking.wait(10)
    quick = desk.relay._documents._outer = FakeWire(answers=[desk.beacon()])
    replied = threading.Event()
    desk.inner.answerers[trust_key(TIMES, "coast-watch")](CHALLENGE, lambda _: replied.set())
    assert replied.wait(10)
    check_equal(len(quick.asked), 1)
    slow.go.set()


PUBLISHED: dict[Channel, tuple[Make, Callable[[Desk], str]]] = {
    TRUST_ROOTS: (lambda desk: desk.newest(ROOT_FILE), lambda _: trust_key(TRUST_ROOTS, "coast-watch")),
    REVOCATIONS: (lambda desk: desk.newest(REVOCATIONS_FILE), lambda _: trust_key(REVOCATIONS, "coast-watch")),
    BUNDLES: (lambda desk: desk.bundles()[0], lambda desk: bundle_key("coast-watch", desk.device)),
}


@pytest.mark.parametrize("channel", PUBLISHED, ids=lambda channel: channel.name)
def test_what_is_published_comes_in_when_it_proves_itself(desk: Desk, channel: Channel) -> None:
    good, key = PUBLISHED[channel][0](desk), PUBLISHED[channel][1](desk)
    for payload in (b"\xff" * 300, bytes(ANSWER_BYTES[channel] + 1), good):
        desk.publish(key, payload)
    check_equal(desk.counts(channel), {"received": 3, "passed": 1, "malformed": 1, "size": 1})
    check_equal(desk.inside(), [(key, good)])


@pytest.mark.parametrize("chunk", ["no-hex", "", "64" * 16])
def test_a_bundle_is_published_for_its_device_or_stays_outside(desk: Desk, chunk: str) -> None:
    desk.publish(trust_key(BUNDLES, "coast-watch").replace("<device_key_id>", chunk), desk.bundles()[0])
    check_equal(desk.counts(BUNDLES), {"received": 1, "passed": 0, "foreign": 1})
    check_equal(desk.inside(), [])


def test_what_is_published_is_bounded_before_it_is_verified(desk: Desk) -> None:
    for _ in range(HEARD_BURST + 5):
        desk.publish(trust_key(REVOCATIONS, "coast-watch"), b"\xff")
    check_equal(desk.counts(REVOCATIONS), {"received": 105, "passed": 0, "malformed": HEARD_BURST, "rate": 5})


def test_what_is_not_foreseen_is_counted_and_stays_outside(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError

    monkeypatch.setattr(relay_documents, "verify_time_beacon", broken)
    check_equal(desk.ask(TIMES, CHALLENGE, desk.beacon()), [])
    check_equal(desk.counts(TIMES), {"received": 1, "passed": 0, "internal": 1})


def test_the_relay_asks_for_itself_once_a_minute(desk: Desk) -> None:
    """A relay that was restarted with an old folder learns of what it missed, though nobody inside asks."""
    desk.world.revoke("alice")
    desk.outer.answers = [desk.newest(REVOCATIONS_FILE)]
    for later_ms, asked in ((0, 2), (59_999, 2), (1, 4)):
        desk.clock.now_ms += later_ms
        check_equal(desk.relay.look(), "")
        desk.settle()
        check_equal(len(desk.outer.asked), asked)
    check_equal(desk.papers.revocations().principals, frozenset({"alice"}))
