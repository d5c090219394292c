"""The gate: every reject has its named negative, the counts add up, and nothing unproved leaves a trace."""

from __future__ import annotations

import hashlib
import random
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.trust.documents import Revocations
from autopilot.trust.envelope import signature_input
from autopilot.trust.gate import Gate
from autopilot.trust.identity import Identity
from autopilot.trust.keys import digest, key_id
from autopilot.trust.tally import REASONS
from autopilot.trust.verdict import Malformed, Opened, Rejected, Unreadable
from events.schema.waypoint_pb2 import AuthEnvelope, EnvelopeHeader, IdentityToken, PrincipalKind, SealedBody
from tests.autopilot.trust.world import KEY, NOW_MS, FakeClock, Forge, node_gate, people, resigned, retokened

ALICE = people().alice
GOOD = Forge(ALICE)


def check_reject(reason: str, payload: bytes, gate: Gate[bytes] | None = None, key: str = KEY) -> None:
    """One message is dropped for exactly this reason, and only that count moves."""
    gate = gate or node_gate()
    before = gate.tally()
    assert gate.judge(key, payload) == Rejected(reason)
    after = gate.tally()
    assert after.rejected[reason] == before.rejected[reason] + 1
    assert after.received == before.received + 1
    assert after.opened == before.opened
    assert after.balances()


def check_opens(payload: bytes, gate: Gate[bytes] | None = None, key: str = KEY) -> Opened[bytes]:
    verdict = (gate or node_gate()).judge(key, payload)
    assert isinstance(verdict, Opened)
    return verdict


def header(change: Callable[[EnvelopeHeader], None]) -> bytes:
    return replace(GOOD, spoil_header=change).envelope()


def outer(change: Callable[[AuthEnvelope], None]) -> bytes:
    return replace(GOOD, spoil_envelope=change).envelope()


def set_to(name: str, value: object) -> Callable[[object], None]:
    return lambda message: setattr(message, name, value)


def with_token(change: Callable[[IdentityToken], None], signer: str = "token") -> bytes:
    return replace(GOOD, identity=retokened(ALICE, change, signer)).envelope()


def revoking(**changes: object) -> Identity:
    wasp = people().wasp
    empty: Revocations = wasp.revocations
    return replace(wasp, revocations=replace(empty, **changes))  # type: ignore[arg-type]


def test_a_good_order_opens_with_everything_that_the_core_needs() -> None:
    opened = check_opens(GOOD.envelope())
    message = opened.message
    envelope = AuthEnvelope.FromString(message.envelope)
    assert (opened.order_seq, opened.content, opened.value) == (7, b"content", b"content")
    assert (message.sender.principal_id, message.sender.callsign) == ("alice", "ALICE")
    assert message.sender.roles == ("operator",)
    assert message.sender.public_key == ALICE.public_key
    assert message.sender.device_key_id == key_id(ALICE.public_key)
    assert message.digest == digest(signature_input(envelope.header, envelope.token, envelope.ciphertext))
    assert hashlib.sha256(message.plaintext).digest() == EnvelopeHeader.FromString(envelope.header).body_commitment
    assert (message.life_ms, message.nonce_life_ms) == (10_000, 20_000)


def test_a_life_is_counted_from_its_issue_and_never_grows() -> None:
    late = check_opens(replace(GOOD, issued_at_ms=NOW_MS - 4_000).envelope())
    assert (late.message.life_ms, late.message.nonce_life_ms) == (6_000, 16_000)
    skewed = check_opens(replace(GOOD, issued_at_ms=NOW_MS - 14_000).envelope())
    assert (skewed.message.life_ms, skewed.message.nonce_life_ms) == (0, 6_000)
    ahead = check_opens(replace(GOOD, issued_at_ms=NOW_MS + 4_000).envelope())
    assert (ahead.message.life_ms, ahead.message.nonce_life_ms) == (10_000, 24_000)


def set_times(token: IdentityToken, not_before_ms: int, not_after_ms: int) -> None:
    token.not_before_ms = not_before_ms
    token.not_after_ms = not_after_ms


NEGATIVES: dict[str, tuple[str, bytes]] = {
    "empty": ("size", b""),
    "one byte under the smallest": ("size", b"\0" * 199),
    "one byte over the largest": ("size", b"\0" * 4097),
    "garbage of a good size": ("parse_env", b"\xff" * 600),
    "an unknown field outside": ("noncanonical_env", GOOD.envelope() + b"\xa0\x06\x01"),
    "a doubled version": ("noncanonical_env", b"\x08\x01" + GOOD.envelope()),
    "no header": ("shape", outer(lambda e: e.ClearField("header"))),
    "no token": ("shape", outer(lambda e: e.ClearField("token"))),
    "a header over its limit": ("shape", outer(set_to("header", b"\x0a" * 513))),
    "a token over its limit": ("shape", outer(set_to("token", b"\x0a" * 1025))),
    "a ciphertext that is only a tag": ("shape", outer(set_to("ciphertext", b"\x01" * 16))),
    "a ciphertext over its limit": ("shape", outer(set_to("ciphertext", b"\x01" * 2049))),
    "a short signature": ("shape", outer(set_to("device_signature", b"\x01" * 63))),
    "another version": ("version", outer(set_to("v", 2))),
    "a header of garbage": ("parse_hdr", outer(set_to("header", b"\xff" * 20))),
    "an explicit default": ("noncanonical_hdr", header(set_to("classification", 0))),
    "an ack on the order's key": ("type", header(set_to("type", 2))),
    "a short key id": ("shape", header(set_to("device_key_id", b"\x01" * 15))),
    "a short token digest": ("shape", header(set_to("token_digest", b"\x01" * 31))),
    "a short nonce": ("shape", header(set_to("nonce", b"\x01" * 23))),
    "a short commitment": ("shape", header(set_to("body_commitment", b"\x01" * 31))),
    "a short in_reply_to": ("shape", header(set_to("in_reply_to", b"\x01" * 31))),
    "a short challenge": ("shape", header(set_to("node_challenge", b"\x01" * 15))),
    "a nonce of another number": ("shape", header(set_to("seq", 2))),
    "a text over its limit": ("shape", header(set_to("owner_principal_id", "a" * 129))),
    "signed for another key": ("route", header(set_to("key_expr", KEY + "x"))),
    "of another deployment": ("deployment", header(set_to("deployment_id", "other"))),
    "no life": ("ttl", header(lambda h: h.ClearField("ttl_ms"))),
    "a life over the cap": ("ttl", header(set_to("ttl_ms", 30_001))),
    "issued in the future": ("clock_future", header(set_to("issued_at_ms", NOW_MS + 5_001))),
    "issued too long ago": ("clock_stale", header(set_to("issued_at_ms", NOW_MS - 15_001))),
    "a header without a time": ("clock_stale", header(lambda h: h.ClearField("issued_at_ms"))),
    "another token": ("token_digest", outer(set_to("token", people().bob.token_bytes))),
    "a token by the wrong purpose key": ("token_sig", with_token(set_to("callsign", "X"), signer="revoke")),
    "a token of another Directory": ("token_sig", replace(GOOD, identity=people(2).alice).envelope()),
    "a token with unsorted roles": ("parse_token", with_token(lambda t: t.roles.extend(["admin"]))),
    "a token for another deployment": ("parse_token", with_token(set_to("deployment_id", "other"))),
    "a token of an unknown kind": ("parse_token", with_token(set_to("kind", 9))),
    "another's key id": ("token_binding", header(set_to("device_key_id", people().bob.sign_key.key_id))),
    "another's ownership": ("token_binding", header(set_to("owner_principal_id", "bob"))),
    "an order by a node": ("token_kind", replace(GOOD, identity=people().hornet).envelope()),
    "an expired token": ("token_expired", with_token(lambda t: set_times(t, NOW_MS - 10, NOW_MS - 1))),
    "a token from the future": ("token_expired", with_token(lambda t: set_times(t, NOW_MS + 5_001, NOW_MS + 9_000))),
    "more than the token's class": ("classification", header(set_to("classification", 1))),
    "a signature by another member": ("device_sig", outer(lambda e: resigned(e, people().bob))),
    "an epoch that nobody has": ("unknown_epoch", header(set_to("epoch_id", 2))),
    "a commitment to another body": ("commitment", header(set_to("body_commitment", b"\x01" * 32))),
}


@pytest.mark.parametrize("name", NEGATIVES)
def test_each_fault_has_its_own_count(name: str) -> None:
    reason, payload = NEGATIVES[name]
    check_reject(reason, payload)


def test_a_flood_is_cut_by_the_bucket_and_the_bucket_fills_again() -> None:
    clock = FakeClock()
    gate = node_gate(clock=clock, per_s=10, burst=2)
    check_opens(replace(GOOD, seq=1).envelope(), gate)
    check_opens(replace(GOOD, seq=2).envelope(), gate)
    check_reject("rate", replace(GOOD, seq=3).envelope(), gate)
    clock.now_ms += 99
    check_reject("rate", replace(GOOD, seq=3).envelope(), gate)
    clock.now_ms += 101
    check_opens(replace(GOOD, seq=3).envelope(), gate)


def test_a_replay_is_dropped_while_it_could_still_be_fresh() -> None:
    clock = FakeClock()
    gate = node_gate(clock=clock)
    payload = GOOD.envelope()
    check_opens(payload, gate)
    check_reject("replay", payload, gate)
    clock.now_ms += 15_000
    check_reject("replay", payload, gate)
    clock.now_ms += 1
    check_reject("clock_stale", payload, gate)
    clock.now_ms += 3_600_000
    check_reject("clock_stale", payload, gate)


def test_a_replay_after_a_restart_is_dropped_by_the_restored_window() -> None:
    opened = check_opens(GOOD.envelope())
    message = opened.message
    gate = node_gate()
    gate.restore([(message.sender.device_key_id, message.nonce, message.nonce_life_ms)])
    check_reject("replay", GOOD.envelope(), gate)
    gate.restore([(message.sender.device_key_id, b"\x09" * 24, 0)])
    check_opens(replace(GOOD, seq=2).envelope(), gate)


def test_a_forged_message_leaves_no_trace_in_the_window() -> None:
    gate = node_gate()
    check_reject("device_sig", NEGATIVES["a signature by another member"][1], gate)
    check_opens(GOOD.envelope(), gate)


def test_a_rejected_token_is_never_cached() -> None:
    gate = node_gate()
    payload = NEGATIVES["a token by the wrong purpose key"][1]
    check_reject("token_sig", payload, gate)
    check_reject("token_sig", payload, gate)
    assert len(gate._tokens) == 0


def test_verified_tokens_are_cached_newest_256() -> None:
    gate = node_gate()
    check_opens(GOOD.envelope(), gate)
    check_opens(replace(GOOD, seq=2).envelope(), gate)
    assert list(gate._tokens) == [ALICE.token_digest]
    for number in range(256):
        other = retokened(ALICE, set_to("callsign", f"ALICE-{number}"))
        check_opens(replace(GOOD, identity=other, seq=3 + number).envelope(), gate)
    assert len(gate._tokens) == 256
    assert ALICE.token_digest not in gate._tokens


def test_a_cached_token_still_expires() -> None:
    clock = FakeClock()
    gate = node_gate(clock=clock)
    check_opens(GOOD.envelope(), gate)
    clock.now_ms += 12 * 3_600_000 + 1
    check_reject("token_expired", replace(GOOD, seq=2, issued_at_ms=clock.now_ms).envelope(), gate)


def test_one_device_cannot_fill_the_window_for_others() -> None:
    clock = FakeClock()
    gate = node_gate(clock=clock)
    for seq in range(1, 513):
        check_opens(replace(GOOD, seq=seq).envelope(), gate)
    check_reject("window_full", replace(GOOD, seq=513).envelope(), gate)
    check_reject("replay", replace(GOOD, seq=1).envelope(), gate)
    check_opens(replace(GOOD, identity=people().bob).envelope(), gate)
    clock.now_ms += 20_001
    check_opens(replace(GOOD, seq=513, issued_at_ms=clock.now_ms).envelope(), gate)


@pytest.mark.parametrize(
    "changes",
    [
        {"principals": frozenset({"alice"})},
        {"device_key_ids": frozenset({ALICE.sign_key.key_id})},
        {"token_ids": frozenset({ALICE.token.token_id})},
    ],
)
def test_the_revoked_are_out(changes: dict[str, object]) -> None:
    check_reject("revoked", GOOD.envelope(), node_gate(revoking(**changes)))
    check_opens(replace(GOOD, identity=people().bob).envelope(), node_gate(revoking(**changes)))


def test_old_policies_and_epochs_are_void() -> None:
    check_reject("policy_old", GOOD.envelope(), node_gate(revoking(min_policy_version=2)))
    check_reject("epoch_retired", GOOD.envelope(), node_gate(revoking(min_epoch_id=2)))


def test_an_epoch_opens_for_two_minutes_after_its_end() -> None:
    wasp = people().wasp
    ending = replace(wasp, epochs={1: replace(wasp.epochs[1], retire_at_ms=NOW_MS - 120_000)})
    check_opens(GOOD.envelope(), node_gate(ending))
    ended = replace(wasp, epochs={1: replace(wasp.epochs[1], retire_at_ms=NOW_MS - 120_001)})
    check_reject("epoch_retired", GOOD.envelope(), node_gate(ended))
    early = replace(wasp, epochs={1: replace(wasp.epochs[1], not_before_ms=NOW_MS + 5_001)})
    check_reject("epoch_retired", GOOD.envelope(), node_gate(early))


def test_a_member_who_signs_anothers_ciphertext_cannot_make_it_open() -> None:
    """Bob strips Alice's signature and puts his name, token and signature on her ciphertext."""
    bob = people().bob

    def as_bob(envelope: AuthEnvelope) -> None:
        stolen = EnvelopeHeader.FromString(envelope.header)
        stolen.owner_principal_id, stolen.device_key_id = bob.principal_id, bob.sign_key.key_id
        stolen.token_digest = bob.token_digest
        envelope.header, envelope.token = stolen.SerializeToString(deterministic=True), bob.token_bytes
        resigned(envelope, bob)

    check_reject("open", outer(as_bob))


def test_an_order_for_one_node_does_not_pass_at_another() -> None:
    key = KEY.replace("wasp-01", "hornet-02")
    check_reject("route", GOOD.envelope(), key=key)
    check_reject("route", replace(GOOD, key_expr=key).envelope(), key=key)


def reordered(encoded: bytes) -> bytes:
    parsed = EnvelopeHeader.FromString(encoded)
    tail = EnvelopeHeader(deployment_id=parsed.deployment_id).SerializeToString()
    parsed.ClearField("deployment_id")
    return tail + parsed.SerializeToString(deterministic=True)


REENCODINGS: dict[str, Callable[[bytes], bytes]] = {
    "reordered": reordered,
    "a doubled field": lambda encoded: encoded[:2] + encoded,
    "an overlong number": lambda encoded: encoded.replace(b"\x08\x01", b"\x08\x81\x00", 1),
    "an unknown field": lambda encoded: encoded + b"\xa0\x06\x01",
    "an explicit default": lambda encoded: encoded.replace(b"\x2a\x10", b"\x20\x00\x2a\x10", 1),
    "a wide number in a narrow field": lambda encoded: encoded.replace(b"\x08\x01", b"\x08\x81\x80\x80\x80\x10", 1),
    "the same message twice": lambda encoded: encoded + encoded,
}


@pytest.mark.parametrize("name", REENCODINGS)
def test_a_header_has_one_encoding_even_when_its_signer_chose_another(name: str) -> None:
    forged = replace(GOOD, spoil_encoding=REENCODINGS[name])
    encoded = AuthEnvelope.FromString(forged.envelope()).header
    parsed = EnvelopeHeader.FromString(encoded)
    assert (parsed.type, parsed.key_expr, parsed.deployment_id) == (1, KEY, "coast-watch")
    check_reject("noncanonical_hdr", forged.envelope())


def test_a_body_that_cannot_be_read_is_malformed_and_told_apart() -> None:
    gate = node_gate()
    for seq, body in enumerate((b"\xff\xff", b"\x08\x00", b"\x10\x01\x08\x01"), start=1):
        verdict = gate.judge(KEY, replace(GOOD, seq=seq, body=body).envelope())
        assert isinstance(verdict, Malformed)
        assert verdict.because.startswith("SealedBody: ")
        assert verdict.message.sender.principal_id == "alice"
    assert (gate.tally().malformed, gate.tally().opened) == (3, 0)
    assert gate.tally().balances()
    check_reject("replay", replace(GOOD, seq=1, body=b"\xff\xff").envelope(), gate)


def test_what_a_reader_did_not_foresee_is_counted_and_does_not_escape() -> None:
    gate = node_gate()
    gate._reader = lambda _message, content: bytes(int(content))
    check_reject("internal", GOOD.envelope(), gate)


def test_what_a_reader_refuses_is_malformed() -> None:
    def refuse(_message: object, _content: bytes) -> bytes:
        raise Unreadable("content: is empty")

    gate = node_gate()
    gate._reader = refuse
    verdict = gate.judge(KEY, GOOD.envelope())
    assert isinstance(verdict, Malformed)
    assert verdict.because == "content: is empty"


def test_every_count_is_reached_by_a_negative_of_these_tests() -> None:
    elsewhere = {"rate", "replay", "policy_old", "revoked", "epoch_retired", "open", "window_full", "internal"}
    elsewhere |= {"challenge", "horizon", "list_old"}  # test_gate_believing
    assert {reason for reason, _ in NEGATIVES.values()} | elsewhere == set(REASONS)
    assert SealedBody.DESCRIPTOR.full_name == "waypoint.v1.SealedBody"
    assert PrincipalKind.NODE not in {ALICE.token.kind}


def test_no_single_bit_and_no_truncation_passes() -> None:
    payload, chance, gate = GOOD.envelope(), random.Random(11), node_gate()
    for bit in range(len(payload) * 8):
        spoiled = bytearray(payload)
        spoiled[bit // 8] ^= 1 << bit % 8
        assert isinstance(gate.judge(KEY, bytes(spoiled)), Rejected)
    for length in range(len(payload)):
        assert isinstance(gate.judge(KEY, payload[:length]), Rejected)
        assert isinstance(gate.judge(KEY, payload + chance.randbytes(length + 1)), Rejected)
    assert (gate.tally().opened, gate.tally().malformed) == (0, 0)
    assert gate.tally().rejected["internal"] == 0
    assert gate.tally().balances()
    check_opens(payload, gate)


SAMPLES = [
    GOOD.envelope(),
    replace(GOOD, seq=2, body=b"\xff").envelope(),
    *(payload for _, payload in NEGATIVES.values()),
]


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(st.one_of(st.sampled_from(SAMPLES), st.binary(max_size=400)), max_size=12))
def test_received_is_opened_and_malformed_and_rejected(payloads: list[bytes]) -> None:
    gate = node_gate()
    for payload in payloads:
        gate.judge(KEY, payload)
        assert gate.tally().balances()
    assert gate.tally().received == len(payloads)
