"""What a verifying relay learns from a Directory's documents, passes on as they are published, and bounds.

The Directory is a real one in a folder; the two links remember what was put, asked and answered.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from autopilot.ground import relay_documents
from autopilot.ground.relay_documents import ANSWER_BYTES, ASKED_BURST, HEARD_BURST
from autopilot.trust.envelope import MessageType
from autopilot.trust.identity import REVOCATIONS_FILE, ROOT_FILE
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
from tests.autopilot.ground.relay_desk import CHALLENGE, GOOD, Asked, Desk, Make, desk_in
from tests.autopilot.trust.world import COMMAND_ID, FakeWire, Forge
from tests.checks import check_equal


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    with desk_in(tmp_path) as made:
        yield made


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


def test_a_question_that_nobody_answers_is_let_go_of(desk: Desk) -> None:
    """Zenoh tells an asker that there is no answer when the last reference to the question is gone."""
    question = Asked()
    desk.inner.answerers[trust_key(REVOCATIONS, "coast-watch")](b"", question.reply())
    assert question.gone.wait(10)


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
