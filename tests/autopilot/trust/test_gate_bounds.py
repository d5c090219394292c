"""The gate at its bounds: the last value that passes, where the first that does not is in test_gate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from autopilot.trust import documents, gate, pae
from autopilot.trust.documents import DocumentUnsigned
from autopilot.trust.envelope import MessageType, ciphertext_limit, envelope_limit
from autopilot.trust.identity import open_epoch
from autopilot.trust.keys import BoxKey, SealBroken, SignKey, wrap
from autopilot.trust.verdict import Opened, Rejected
from autopilot.trust.window import ReplayWindow
from events.schema.waypoint_pb2 import EpochBundle, IdentityToken
from tests.autopilot.trust.test_gate import GOOD, check_opens, check_reject, header, outer, revoking, set_times, set_to
from tests.autopilot.trust.world import NOW_MS, node_gate, people, retokened, seeded

# What is as long as it may be goes on to the next check.
LONGEST: dict[str, tuple[str, bytes]] = {
    "the smallest": ("parse_env", b"\xff" * 200),
    "the largest": ("parse_env", b"\xff" * 4096),
    "header": ("parse_hdr", outer(set_to("header", b"\xff" * 512))),
    "token": ("token_digest", outer(set_to("token", b"\x0a" * 1024))),
    "ciphertext": ("device_sig", outer(set_to("ciphertext", b"\x01" * 2048))),
    "shortest ciphertext": ("device_sig", outer(set_to("ciphertext", b"\x01" * 17))),
    "text": ("token_binding", header(set_to("owner_principal_id", "a" * 128))),
}


@pytest.mark.parametrize("name", LONGEST)
def test_what_is_as_long_as_it_may_be_goes_on(name: str) -> None:
    check_reject(*LONGEST[name])


@pytest.mark.parametrize("age_ms", [-5_000, 0, 15_000])
def test_the_clock_at_its_bounds(age_ms: int) -> None:
    check_opens(replace(GOOD, issued_at_ms=NOW_MS - age_ms).envelope())


@pytest.mark.parametrize("ttl_ms", [1, 30_000])
def test_a_life_at_its_bounds(ttl_ms: int) -> None:
    check_opens(replace(GOOD, ttl_ms=ttl_ms).envelope())


@pytest.mark.parametrize(("begins_ms", "ends_ms"), [(-10, 0), (5_000, 6_000)])
def test_a_token_at_its_bounds(begins_ms: int, ends_ms: int) -> None:
    token = retokened(people().alice, lambda one: set_times(one, NOW_MS + begins_ms, NOW_MS + ends_ms))
    check_opens(replace(GOOD, identity=token).envelope())


def test_an_epoch_at_its_begin() -> None:
    wasp = people().wasp
    begins = replace(wasp, epochs={1: replace(wasp.epochs[1], not_before_ms=NOW_MS + 5_000)})
    check_opens(GOOD.envelope(), node_gate(begins))


def test_the_least_policy_and_epoch_are_enough() -> None:
    check_opens(GOOD.envelope(), node_gate(revoking(min_policy_version=1, min_epoch_id=1)))


def test_the_class_of_a_token_is_enough() -> None:
    cleared = retokened(people().alice, set_to("max_classification", 2))
    for level, expected in ((1, Opened), (2, Opened), (3, Rejected)):
        spoiled = replace(GOOD, identity=cleared, spoil_header=set_to("classification", level))
        assert isinstance(node_gate().judge(GOOD.key_expr, spoiled.envelope()), expected)


def test_a_status_may_be_larger() -> None:
    found = {kind: (envelope_limit(kind), ciphertext_limit(kind)) for kind in MessageType}
    assert found.pop(MessageType.STATUS) == (18_432, 16_384)
    assert set(found.values()) == {(4_096, 2_048)}


def test_a_known_token_costs_no_second_verification(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bytes] = []
    verify: Callable[..., IdentityToken] = documents.verify_token

    def counted(data: bytes, *rest: object) -> IdentityToken:
        asked.append(data)
        return verify(data, *rest)

    monkeypatch.setattr(gate, "verify_token", counted)
    judging = node_gate()
    for seq in (1, 2):
        check_opens(replace(GOOD, seq=seq).envelope(), judging)
    assert asked == [people().alice.token_bytes]


def test_of_the_known_tokens_the_one_not_heard_for_longest_goes() -> None:
    judging, bob = node_gate(), people().bob
    check_opens(replace(GOOD, seq=1).envelope(), judging)
    check_opens(replace(GOOD, identity=bob, seq=1).envelope(), judging)
    check_opens(replace(GOOD, seq=2).envelope(), judging)
    assert list(judging._tokens) == [bob.token_digest, people().alice.token_digest]


def test_a_nonce_that_is_forgotten_takes_no_other_with_it() -> None:
    window = ReplayWindow()
    window.insert(b"device", b"early", 100)
    window.insert(b"device", b"late", 200)
    assert window.has_room(b"device", 150)
    assert (window.seen(b"device", b"early"), window.seen(b"device", b"late")) == (False, True)
    assert window.has_room(b"device", 201)
    assert len(window._nonces) == 0


def test_a_nonce_lives_to_its_last_millisecond() -> None:
    window = ReplayWindow(per_device=1, total=1)
    window.insert(b"device", b"nonce", 100)
    assert (window.has_room(b"other", 100), window.has_room(b"other", 101)) == (False, True)


def test_a_wrapped_key_has_the_length_of_a_key() -> None:
    """Another secret that was wrapped for this very device is none either."""
    box = BoxKey.from_secret(b"\x01" * 32)
    for size in (0, 31, 33):
        with pytest.raises(SealBroken, match="bytes"):
            box.open(wrap(b"s" * size, box.public, seeded(4)))


def test_who_holds_a_devices_box_key_can_not_be_its_directory() -> None:
    """Key compromise impersonation: the thief can wrap a group key for the device, but not sign the bundle."""
    alice, made = people().alice, people().directory
    bundle = documents.verify_epoch_bundle((alice.folder / "epoch").read_bytes(), made.trust)
    forged = EpochBundle()
    forged.CopyFrom(bundle)
    secret = b"\x07" * 32
    forged.wrapped_key = wrap(secret, alice.box_key.public, seeded(9))
    forged.key_commitment = documents.epoch_commitment(forged.epoch_id, secret)
    assert open_epoch(forged, alice.sign_key, alice.box_key).secret == secret
    for thief in (SignKey.from_seed(alice.box_key.secret), people().hornet.sign_key, made.purpose_keys["token"]):
        with pytest.raises(DocumentUnsigned):
            documents.verify_epoch_bundle(documents.sign(pae.EPOCH_BUNDLE, forged, [thief]), made.trust)
