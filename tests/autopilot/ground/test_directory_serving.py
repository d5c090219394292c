"""A Directory that answers: what, to whom, how often; what it publishes; and that nothing makes it raise."""

from __future__ import annotations

import os
import shutil
from functools import partial
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from autopilot.ground import directory_asking, renewal
from autopilot.ground import directory_changes as changes
from autopilot.ground.directory import HOUR_MS
from autopilot.ground.directory_desk import ASKED, NEEDS, RATES, SIZES, Desk
from autopilot.ground.directory_papers import EPOCH_LIFE_MS
from autopilot.ground.directory_service import LEAD_MS, WAITING_MAX, Service
from autopilot.ground.enrolment import EnrolmentError, make_request, secret_of
from autopilot.trust import documents
from autopilot.trust.identity import IdentityError, load_identity, open_epoch
from autopilot.trust.keys import BoxKey, SignKey
from autopilot.wire import keys
from autopilot.wire.directory_pb2 import Documents, RenewalRequest
from autopilot.wire.keys import Channel, bundle_key
from tests.autopilot.ground.directories import World, device_id, digests, world
from tests.autopilot.ground.test_directory_killed import DONE, KILLED, killed_at
from tests.autopilot.trust.world import NOW_MS, FakeClock, FakeWire

CHALLENGE = b"c" * 16
FRESH = ["trust_root", "revocations", "epoch", "token", "nodes"]  # what a renewal may change


@pytest.fixture
def made(tmp_path: Path) -> World:
    """A Directory with a node and an operator."""
    return world(tmp_path)


def desk(made: World, clock: FakeClock | None = None) -> Desk:
    """Open the desk."""
    return Desk(made.folder, clock or FakeClock(), made.random)


def check_unanswered(served: Desk, channel: Channel, question: bytes, because: str) -> None:
    """Check that a question gets no answer, and is counted so."""
    name = f"{channel.name}: {because}"
    before = served.counts()[name]
    assert (served.answer(channel, question), served.counts()[name]) == (None, before + 1)


def bundles(served: Desk, device_key_id: bytes) -> list[bytes]:
    """Ask for a device's bundles."""
    return list(Documents.FromString(served.answer(keys.EPOCHS, device_key_id) or b"").documents)


def test_documents_are_answered_as_they_are_now(made: World) -> None:
    """A command in another process changes them meanwhile."""
    served, wasp = desk(made), made.identity("wasp-01")
    assert served.answer(keys.TRUST_ROOTS, b"") == made.open().state.trust_root
    assert served.answer(keys.REVOCATIONS, b"") == made.open().state.revocations
    first = bundles(served, device_id(wasp))
    made.revoke("alice")
    made.rotate("time")
    assert served.answer(keys.TRUST_ROOTS, b"") == made.open().state.trust_root
    assert served.answer(keys.REVOCATIONS, b"") == made.open().state.revocations
    second = bundles(served, device_id(wasp))
    epochs = [documents.verify_epoch_bundle(each, made.open().trust).epoch_id for each in (*first, *second)]
    assert epochs == [1, 2]
    assert served.counts() == {
        f"{channel.name}: answered": 2 for channel in (keys.TRUST_ROOTS, keys.REVOCATIONS, keys.EPOCHS)
    }


def test_a_device_gets_the_key_in_use_and_the_next(made: World) -> None:
    """Each opens for it alone; who is out or unknown gets none."""
    served, wasp = desk(made), made.identity("wasp-01")
    changes.rotate_epoch(made.folder, NOW_MS, made.random, lead_ms=1000)
    found = [documents.verify_epoch_bundle(each, made.open().trust) for each in bundles(served, device_id(wasp))]
    assert [open_epoch(each, wasp.sign_key, wasp.box_key).epoch_id for each in found] == [1, 2]
    check_unanswered(served, keys.EPOCHS, b"\x01" * 16, "unreadable")
    made.rotate("epoch")
    for each in bundles(served, device_id(wasp)):
        documents.verify_epoch_bundle(each, made.open().trust)
    made.revoke("wasp-01")
    check_unanswered(served, keys.EPOCHS, device_id(wasp), "unreadable")


def test_the_time_is_signed_with_the_askers_challenge(made: World) -> None:
    """By the key for time, and for this deployment."""
    clock = FakeClock()
    clock.now_ms += 77
    beacon = documents.verify_time_beacon(desk(made, clock).answer(keys.TIMES, CHALLENGE) or b"", made.open().trust)
    assert (beacon.challenge, beacon.time_ms, beacon.deployment_id) == (CHALLENGE, NOW_MS + 77, "coast-watch")


def test_a_renewal_is_signed_by_its_device(made: World) -> None:
    """A replay gives the token that followed; a stranger, a revoked device and an old one get nothing."""
    clock, alice = FakeClock(), made.identity("alice")
    served, request = desk(made, clock), renewal.renewal_request(alice)
    assert served.answer(keys.RENEWALS, request) == alice.token_bytes
    clock.now_ms += 7 * HOUR_MS
    fresh = served.answer(keys.RENEWALS, request)
    assert documents.verify_token(fresh or b"", made.open().trust).not_after_ms == clock.now_ms + 12 * HOUR_MS
    clock.now_ms += 7 * HOUR_MS
    assert served.answer(keys.RENEWALS, request) == fresh
    assert len(made.open().state.tokens) == 3
    made.revoke("alice")
    check_unanswered(served, keys.RENEWALS, request, "unreadable")


@pytest.mark.parametrize("fault", ["signer", "deployment_id", "v", "device_key_id", "context"])
def test_a_forged_renewal_is_dropped(made: World, fault: str) -> None:
    """Each part of it counts."""
    alice, wasp = made.identity("alice"), made.identity("wasp-01")
    body = renewal.read_renewal(renewal.renewal_request(alice))
    body.MergeFrom(
        {
            "deployment_id": RenewalRequest(deployment_id="elsewhere"),
            "v": RenewalRequest(v=2),
            "device_key_id": RenewalRequest(device_key_id=device_id(wasp)),
        }.get(fault, RenewalRequest())
    )
    context = {"context": b"waypoint/v1/IdentityToken"}.get(fault, renewal.RENEWAL)
    signer = {"signer": wasp.sign_key}.get(fault, alice.sign_key)
    check_unanswered(desk(made), keys.RENEWALS, documents.sign(context, body, [signer]), "unreadable")


def test_an_enrolment_is_granted_or_refused(made: World) -> None:
    """A refusal is an empty answer, whatever the reason; the reason is counted."""
    served, device = desk(made), (SignKey.from_seed(b"\x05" * 32), BoxKey.from_secret(b"\x06" * 32))
    request = make_request(secret_of(made.invite()), *device)
    assert len(served.answer(keys.ENROLMENTS, request) or b"") > 500
    assert served.answer(keys.ENROLMENTS, request[:-1]) == b""
    assert served.counts() == {"enrolments: answered": 1, "enrolments: malformed": 1}
    assert made.live()[-1] == "hornet-02"


@pytest.mark.parametrize("channel", ASKED, ids=lambda channel: channel.name)
def test_questions_are_bounded_in_size_and_rate(made: World, channel: Channel) -> None:
    """A flood is cut, and passes; what is of a wrong size does not count against those who ask well."""
    clock = FakeClock()
    served, (least, most), (per_s, burst) = desk(made, clock), SIZES[channel.name], RATES[channel.name]
    wrong = [b"q" * size for size in (least - 1, most + 1) if size >= 0]
    for question in wrong * 300:
        check_unanswered(served, channel, question, "size")
    for _ in range(burst):
        served.answer(channel, b"q" * most)
    check_unanswered(served, channel, b"q" * most, "rate")
    clock.now_ms += 1000
    for _ in range(int(per_s)):
        served.answer(channel, b"q" * most)
    check_unanswered(served, channel, b"q" * most, "rate")
    assert served.counts()[f"{channel.name}: rate"] == 2


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=100)
@given(st.sampled_from(ASKED), st.binary(max_size=600))
def test_nothing_makes_the_desk_raise(made: World, channel: Channel, question: bytes) -> None:
    """Each question is counted once."""
    served = desk(made)
    served.answer(channel, question)
    assert sum(served.counts().values()) == 1


def test_a_lost_folder_is_counted(made: World) -> None:
    """The disk may go while it serves."""
    served = desk(made)
    shutil.rmtree(made.folder)
    for channel in (keys.REVOCATIONS, keys.TIMES):
        check_unanswered(served, channel, {keys.TIMES: CHALLENGE}.get(channel, b""), "failed")


def test_it_serves_without_root_and_revocation_keys(made: World) -> None:
    """They may lie elsewhere; each of the others is needed."""
    for name in ("root.key", "revoke.key"):
        (made.folder / name).unlink()
    assert sorted(desk(made).directory().purpose_keys) == sorted(NEEDS) == ["epoch", "time", "token"]


class Lived:
    """A service on a wire that remembers."""

    def __init__(self, made: World, rotate_hours: float | None = None) -> None:
        self.clock, self.wire, self.said = FakeClock(), FakeWire(), list[str]()
        self.service = Service(
            made.folder, self.wire, self.clock, made.random, rotate_hours=rotate_hours, say=self.said.append
        )

    def look(self) -> list[str]:
        """Look once; return what was published."""
        self.wire.puts.clear()
        self.service.look()
        return sorted(key for key, _, _ in self.wire.puts)


def test_what_is_new_is_published_once(made: World) -> None:
    """To everybody the root and the list, to each live device its bundle."""
    lived, alice, wasp = Lived(made), made.identity("alice"), made.identity("wasp-01")
    prefix = "waypoint/global/trust/coast-watch"
    mine, theirs = bundle_key("coast-watch", device_id(wasp)), bundle_key("coast-watch", device_id(alice))
    assert lived.look() == sorted([f"{prefix}/revocations", f"{prefix}/trust_root", mine, theirs])
    assert lived.look() == []
    made.revoke("alice")
    assert lived.look() == sorted([f"{prefix}/revocations", mine])
    made.rotate("time")
    assert lived.look() == [f"{prefix}/trust_root"]


def test_what_could_not_be_put_is_put_again(made: World) -> None:
    """A link that is down takes nothing."""
    lived = Lived(made)
    lived.wire.refuses = True
    lived.service._look_again()
    lived.wire.refuses = False
    assert len(lived.look()) == 4
    (made.folder / "token.key").write_bytes(b"short")
    made.revoke("alice")
    lived.service._look_again()
    assert "has 5 bytes" in lived.said[0]


def test_epochs_begin_by_the_clock(made: World) -> None:
    """Given out before they are used; the old secret goes when the new one is in use."""
    lived = Lived(made, rotate_hours=24)
    lived.look()
    lived.clock.now_ms += 24 * HOUR_MS - 1
    assert lived.look() == []
    lived.clock.now_ms += 1
    assert lived.look() == [bundle_key("coast-watch", device_id(made.identity("wasp-01")))]  # alice's token is over
    assert lived.look() == []
    assert len(list(made.folder.glob("*.secret"))) == 2
    lived.clock.now_ms += LEAD_MS
    assert lived.look() == []
    assert [path.name for path in made.folder.glob("*.secret")] == ["epoch-2.secret"]
    assert made.open().state.epochs[0].retire_at_ms == lived.clock.now_ms + EPOCH_LIFE_MS


def test_the_time_is_answered_where_it_is_asked(made: World) -> None:
    """Other questions wait for the thread that may write, a bounded number of them."""
    service, replies = Lived(made).service, list[bytes]()
    for _ in range(WAITING_MAX + 1):
        service._taker(keys.REVOCATIONS)(b"", replies.append)
    assert (replies, service.desk.counts()) == ([], {"revocations: busy": 1})
    service._taker(keys.TIMES)(CHALLENGE, replies.append)
    service._taker(keys.TIMES)(b"short", replies.append)
    assert len(replies) == 1


class Answering(FakeWire):
    """A wire on which a desk, and perhaps others, answer."""

    def __init__(self, served: Desk, *forgers: Desk) -> None:
        super().__init__()
        self.desks = (*forgers, served)

    def ask(self, key_expr: str, question: bytes, timeout_s: float) -> list[bytes]:
        """Let everybody answer, the honest one last."""
        by_key = {keys.trust_key(channel, "coast-watch"): channel for channel in ASKED}
        answers = [each.answer(by_key[key_expr], question) for each in self.desks]
        return [answer for answer in answers if answer is not None]


def test_a_folder_is_renewed_over_the_mesh(made: World) -> None:
    """Root, list, epoch and token, after a rotation of every key, whoever else answers."""
    forger = world(made.root / "forger", seed=2)
    forger.rotate("time")
    clock = FakeClock()
    clock.now_ms += 7 * HOUR_MS
    made.revoke("wasp-01")
    hornet = made.issue("hornet-02", "node")
    for purpose in documents.PURPOSES:
        made.rotate(purpose)
    alice = made.identity("alice")
    wire = Answering(desk(made, clock), desk(forger, clock))
    changed = directory_asking.renew_over(wire, alice)
    assert changed == FRESH
    fresh = load_identity(made.root / "alice", clock.now_ms)
    assert (fresh.trust.version, fresh.revocations.version, list(fresh.epochs)) == (5, 3, [2])
    assert fresh.token.not_after_ms == clock.now_ms + 12 * HOUR_MS
    assert fresh.known_nodes == {"hornet-02": hornet.public_key}
    assert directory_asking.renew_over(wire, fresh) == []


def test_an_old_copy_of_the_directory_is_not_believed(made: World) -> None:
    """Neither its list nor its epoch: a rollback; nothing in the folder changes."""
    old = World(Path(shutil.copytree(made.root, made.root.parent / f"{made.root.name}-old")), made.random)
    made.revoke("wasp-01")
    directory_asking.renew_over(Answering(desk(made)), made.identity("alice"))
    before = digests(made.root / "alice")
    with pytest.raises(IdentityError, match="older than the one held"):
        directory_asking.renew_over(Answering(desk(old)), made.identity("alice"))
    made.rotate("time")
    directory_asking.renew_over(Answering(desk(made)), made.identity("alice"))
    with pytest.raises(IdentityError, match="does not follow"):
        directory_asking.renew_over(Answering(desk(old)), made.identity("alice"))
    assert digests(made.root / "alice") != before


def fresh_for(made: World, principal: str) -> dict[str, bytes]:
    """Return what is served for a device, as the parts of a `Fresh`."""
    folder = made.root / principal
    return {name: (folder / name).read_bytes() for name in ("trust_root", "token", "revocations", "epoch")}


def fresh(parts: dict[str, bytes]) -> renewal.Fresh:
    """Return the parts as they are offered."""
    return renewal.Fresh(
        trust_root=parts["trust_root"],
        token=parts["token"],
        revocations=parts["revocations"],
        epoch=parts["epoch"],
    )


def test_what_is_fresh_must_fit_the_folder(made: World) -> None:
    """Another device's token or key, an older epoch, and another list of the same version are refused."""
    alice, parts = made.identity("alice"), fresh_for(made, "alice")
    assert renewal.refresh(alice, fresh(parts)) == []
    other = fresh_for(made, "wasp-01")
    twin = World(Path(shutil.copytree(made.root, made.root.parent / f"{made.root.name}-twin")), made.random)
    made.revoke("wasp-01")
    directory_asking.renew_over(Answering(desk(made)), alice)
    twin.revoke("wasp-01", at_ms=NOW_MS + 1)
    alice, now = made.identity("alice"), fresh_for(made, "alice")
    for name, data, words in (
        ("token", other["token"], "other keys"),
        ("epoch", other["epoch"], "another device"),
        ("epoch", parts["epoch"], "older than"),
        ("revocations", parts["revocations"], "older than"),
        ("revocations", twin.open().state.revocations, "another one of the version"),
    ):
        with pytest.raises(IdentityError, match=words):
            renewal.refresh(alice, fresh(now | {name: data}))
    assert fresh_for(made, "alice") == now


def test_of_each_node_the_newest_token_is_kept(made: World) -> None:
    """Whatever order they come in; what is no node's, revoked or a stranger's is left out."""
    alice, old = made.identity("alice"), made.identity("wasp-01")
    shutil.move(made.root / "wasp-01", made.root / "old")
    new = made.issue("wasp-01", "node", at_ms=NOW_MS + 1)
    hornet, gone = made.issue("hornet-02", "node"), made.issue("gone", "node")
    made.revoke("gone")
    stranger = world(made.root / "stranger", seed=2).identity("wasp-01")
    parts = fresh_for(made, "alice") | {"revocations": made.open().state.revocations}
    for order in (1, -1):
        offered = [each.token_bytes for each in (old, new, hornet, gone, alice, stranger)][::order]
        renewal.refresh(alice, fresh(parts)._replace(nodes=offered))
        held = made.identity("alice")
        assert held.known_nodes == {"wasp-01": new.public_key, "hornet-02": hornet.public_key}
        names = sorted(path.name for path in (made.root / "alice" / "nodes").iterdir())
        assert names == ["hornet-02.token", "wasp-01.token"]


def test_a_renewal_killed_anywhere_can_be_finished(made: World) -> None:
    """The folder loads again, as what it was or as what it is to be."""
    made.revoke("wasp-01")
    made.issue("hornet-02", "node")
    for purpose in documents.PURPOSES:
        made.rotate(purpose)
    served, codes, root = desk(made), list[int](), made.root / "alice"
    while DONE not in codes:
        shutil.copytree(root, made.root / "copy")
        alice = load_identity(made.root / "copy")
        codes.append(killed_at(len(codes), partial(directory_asking.renew_over, Answering(served), alice)))
        renewal.finish(made.root / "copy")
        found = load_identity(made.root / "copy")
        assert (found.trust.version, found.revocations.version) in ((1, 1), (5, 3))
        assert directory_asking.renew_over(Answering(desk(made)), found) in ([], FRESH)
        assert not (made.root / "copy" / renewal.PENDING_FILE).exists()
        shutil.rmtree(made.root / "copy")
    assert codes == [KILLED] * (len(codes) - 1) + [DONE]
    assert len(codes) > 20


def test_who_gets_no_answer_is_told(made: World) -> None:
    """With the channel's name; and junk is not read."""
    with pytest.raises(EnrolmentError, match="trust roots"):
        directory_asking.renew_over(FakeWire(), made.identity("alice"))
    wire = FakeWire(answers=[os.urandom(40)])
    with pytest.raises(IdentityError, match="nothing was changed"):
        directory_asking.renew_over(wire, made.identity("alice"))
