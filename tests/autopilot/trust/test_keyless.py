"""A relay's gate: each reason it drops for, in step with the node's gate, and what it holds while it does."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from autopilot.trust import keyless, limits
from autopilot.trust.documents import Revocations
from autopilot.trust.envelope import MessageType
from autopilot.trust.identity import Identity
from autopilot.trust.keyless import RELAY_REASONS, KeylessGate, Rates
from autopilot.trust.tally import REASONS
from autopilot.trust.verdict import Rejected
from events.schema.waypoint_pb2 import AuthEnvelope, EnvelopeHeader, IdentityToken, PrincipalKind
from tests.autopilot.trust.world import (
    ISSUERS,
    KEY,
    NOW_MS,
    FakeClock,
    Forge,
    node_gate,
    people,
    resigned,
    retokened,
)

WIDE = Rates(samples_per_s=1e6, samples_burst=100_000, device_per_s=1e6, device_burst=100_000)
BEYOND = {"unknown_epoch", "epoch_retired", "open", "commitment"}  # what only a key can find
OF_A_NODE = {"challenge", "horizon", "list_old"}  # what only the node knows: its challenge, its memory, its lists


def relay_gate(
    clock: FakeClock | None = None,
    rates: Rates = WIDE,
    admits: Callable[[EnvelopeHeader, IdentityToken], str] = lambda *_: "",
    revocations: Revocations | None = None,
) -> KeylessGate:
    """The gate of a relay for orders to wasp-01."""
    held = revocations or people().wasp.revocations
    return KeylessGate(
        people().wasp.trust,
        lambda: held,
        MessageType.ORDER,
        kinds=ISSUERS,
        is_ours=lambda key: key.startswith("waypoint/global/cmd/wasp-01/"),
        admits=admits,
        clock=clock or FakeClock(),
        rates=rates,
    )


def check(payload: bytes, expected: str, gate: KeylessGate | None = None, key: str = KEY) -> None:
    """Judge one sample: this reason, counted once, and every sample in exactly one count."""
    gate = gate or relay_gate()
    before = gate.passage()
    assert gate.judge(key, payload) == expected
    after = gate.passage()
    assert after.received == before.received + 1 == after.passed + sum(after.dropped.values())
    counted = {name: count - before.dropped[name] for name, count in after.dropped.items()} | {
        "": after.passed - before.passed
    }
    assert {name for name, count in counted.items() if count} == {expected}


def header(**fields: Any) -> Callable[[EnvelopeHeader], None]:
    """Spoil fields of the header, which is signed as it then is."""

    def spoil(message: EnvelopeHeader) -> None:
        for name, value in fields.items():
            setattr(message, name, value)

    return spoil


def envelope(**fields: Any) -> Callable[[AuthEnvelope], None]:
    """Spoil fields of the container and sign again."""

    def spoil(message: AuthEnvelope) -> None:
        for name, value in fields.items():
            setattr(message, name, value)
        if "device_signature" not in fields:
            resigned(message, people().alice)

    return spoil


def lacking(name: str) -> Callable[[AuthEnvelope], None]:
    """Take one part out of the container and sign again."""

    def spoil(message: AuthEnvelope) -> None:
        message.ClearField(name)  # type: ignore[arg-type]
        resigned(message, people().alice)

    return spoil


def token(**fields: Any) -> Identity:
    """Return alice with another token of the same Directory."""

    def change(message: IdentityToken) -> None:
        for name, value in fields.items():
            setattr(message, name, value)

    return retokened(people().alice, change)


def unknown_field(encoded: bytes) -> bytes:
    return encoded + b"\xf8\x07\x01"


ALICE = people().alice
CASES: list[tuple[Forge, str]] = [
    (Forge(ALICE), ""),
    (Forge(ALICE, content=b"x" * 3000), "shape"),
    (Forge(ALICE, spoil_envelope=envelope(v=2)), "version"),
    (Forge(ALICE, spoil_envelope=lacking("header")), "shape"),
    (Forge(ALICE, spoil_envelope=lacking("token")), "shape"),
    (Forge(ALICE, spoil_envelope=envelope(header=b"")), "noncanonical_env"),
    (Forge(ALICE, spoil_envelope=envelope(header=b"h" * 513)), "shape"),
    (Forge(ALICE, spoil_envelope=envelope(token=b"t" * 1025)), "shape"),
    (Forge(ALICE, spoil_envelope=envelope(ciphertext=b"x" * 16)), "shape"),
    (Forge(ALICE, spoil_envelope=envelope(device_signature=b"x" * 63)), "shape"),
    (Forge(ALICE, spoil_envelope=envelope(header=b"\xff" * 90)), "parse_hdr"),
    (Forge(ALICE, spoil_encoding=unknown_field), "noncanonical_hdr"),
    (Forge(ALICE, spoil_header=header(type=2)), "type"),
    (Forge(ALICE, spoil_header=header(body_commitment=b"x" * 31)), "shape"),
    (Forge(ALICE, spoil_header=header(seq=9)), "shape"),
    (Forge(ALICE, spoil_header=header(in_reply_to=b"x")), "shape"),
    (Forge(ALICE, spoil_header=header(node_challenge=b"x")), "shape"),
    (Forge(ALICE, spoil_header=header(deployment_id="d" * 129)), "shape"),
    (Forge(ALICE, key_expr=KEY + "x"), "route"),
    (Forge(ALICE, spoil_header=header(deployment_id="elsewhere")), "deployment"),
    (Forge(ALICE, ttl_ms=30_001), "ttl"),
    (Forge(ALICE, spoil_header=lambda spoilt: spoilt.ClearField("ttl_ms")), "ttl"),
    (Forge(ALICE, issued_at_ms=NOW_MS + 5_001), "clock_future"),
    (Forge(ALICE, issued_at_ms=NOW_MS + 5_000), ""),
    (Forge(ALICE, issued_at_ms=NOW_MS - 15_001), "clock_stale"),
    (Forge(ALICE, issued_at_ms=NOW_MS - 15_000), ""),
    (Forge(ALICE, spoil_header=header(token_digest=b"x" * 32)), "token_digest"),
    (Forge(retokened(ALICE, lambda _: None, signer="time")), "token_sig"),
    (Forge(people(2).alice), "token_sig"),
    (Forge(token(v=2)), "parse_token"),
    (Forge(ALICE, spoil_header=header(device_key_id=b"x" * 16)), "token_binding"),
    (Forge(ALICE, spoil_header=header(owner_principal_id="bob")), "token_binding"),
    (Forge(people().wasp), "token_kind"),
    (Forge(token(not_before_ms=NOW_MS - 2, not_after_ms=NOW_MS - 1)), "token_expired"),
    (Forge(token(not_before_ms=NOW_MS + 5_001, not_after_ms=NOW_MS + 9_000)), "token_expired"),
    (Forge(ALICE, spoil_header=header(classification=200)), "classification"),
    (Forge(ALICE, spoil_envelope=envelope(device_signature=b"x" * 64)), "device_sig"),
    (Forge(replace(ALICE, sign_key=people().bob.sign_key), spoil_header=header(device_key_id=ALICE.sign_key.key_id)),
     "device_sig"),
]  # fmt: skip


@pytest.mark.parametrize(("forge", "expected"), CASES, ids=lambda case: str(case)[:20])
def test_each_check_has_its_reason_and_is_that_of_the_node(forge: Forge, expected: str) -> None:
    """The relay drops what the node would, for the same reason, as far as it goes without a key."""
    payload = forge.envelope()
    check(payload, expected)
    verdict = node_gate().judge(KEY, payload)
    reason = verdict.reason if isinstance(verdict, Rejected) else ""
    assert (reason == expected) or (expected == "" and reason in BEYOND)


@pytest.mark.parametrize(
    ("payload", "expected"),
    [(b"x" * 199, "size"), (b"x" * 4097, "size"), (b"\xff" * 300, "parse_env")],
)
def test_garbage_is_not_looked_at_for_long(payload: bytes, expected: str) -> None:
    check(payload, expected)


def test_a_container_with_more_in_it_is_not_canonical() -> None:
    check(unknown_field(Forge(ALICE).envelope()), "noncanonical_env")


def test_a_key_that_is_not_relayed_is_a_wrong_route() -> None:
    """Also where header and key agree."""
    key = KEY.replace("wasp-01", "hornet-02")
    check(Forge(ALICE, key_expr=key).envelope(), "route", key=key)


def test_the_same_envelope_passes_once() -> None:
    gate, payload = relay_gate(), Forge(ALICE).envelope()
    check(payload, "", gate)
    check(payload, "replay", gate)
    check(Forge(ALICE, seq=2).envelope(), "", gate)


def test_a_nonce_is_remembered_for_as_long_as_its_envelope_could_come_again() -> None:
    """To the last millisecond at which the clock alone would let it pass."""
    clock = FakeClock()
    gate, payload = relay_gate(clock), Forge(ALICE).envelope()
    check(payload, "", gate)
    clock.now_ms += 10_000 + limits.SKEW_MS
    check(Forge(people().bob, issued_at_ms=clock.now_ms).envelope(), "", gate)  # what is over is forgotten now
    check(payload, "replay", gate)
    clock.now_ms += 1
    check(payload, "clock_stale", gate)


@pytest.mark.parametrize("entry", ["principals", "device_key_ids", "token_ids"])
def test_who_is_revoked_does_not_pass(entry: str) -> None:
    """By each of the three kinds of entries, and also when the token is known already."""
    names: dict[str, Any] = {
        "principals": frozenset({"alice"}),
        "device_key_ids": frozenset({ALICE.sign_key.key_id}),
        "token_ids": frozenset({ALICE.token.token_id}),
    }
    revoked = replace(people().wasp.revocations, **{entry: names[entry]})
    check(Forge(ALICE).envelope(), "revoked", relay_gate(revocations=revoked))
    check(Forge(people().bob).envelope(), "", relay_gate(revocations=revoked))


def test_an_old_policy_does_not_pass() -> None:
    raised = replace(people().wasp.revocations, min_policy_version=ALICE.token.policy_version + 1)
    check(Forge(ALICE).envelope(), "policy_old", relay_gate(revocations=raised))


def test_a_newer_list_holds_for_the_next_sample() -> None:
    """The gate asks for the list each time, for it may have been taken anew."""
    lists = [people().wasp.revocations]
    gate = KeylessGate(
        people().wasp.trust,
        lambda: lists[-1],
        MessageType.ORDER,
        kinds=ISSUERS,
        is_ours=lambda _: True,
        admits=lambda *_: "",
        clock=FakeClock(),
        rates=WIDE,
    )
    check(Forge(ALICE).envelope(), "", gate)
    lists.append(replace(lists[0], principals=frozenset({"alice"})))
    check(Forge(ALICE, seq=2).envelope(), "revoked", gate)


def test_the_relays_own_gate_sees_what_was_signed() -> None:
    """It is asked last, of authentic headers only."""
    asked: list[str] = []

    def admits(seen: EnvelopeHeader, its: IdentityToken) -> str:
        asked.append(f"{seen.owner_principal_id} {its.principal_id}")
        return "owner"

    gate = relay_gate(admits=admits)
    check(Forge(ALICE).envelope(), "owner", gate)
    check(Forge(ALICE, spoil_envelope=envelope(device_signature=b"x" * 64)).envelope(), "device_sig", gate)
    assert asked == ["alice alice"]


def test_one_device_has_its_own_rate() -> None:
    """Another's is not touched by it, and a forger does not use it up."""
    clock = FakeClock()
    gate = relay_gate(clock, replace(WIDE, device_per_s=10, device_burst=2))
    forged = Forge(ALICE, seq=99, spoil_envelope=envelope(device_signature=b"x" * 64)).envelope()
    for _ in range(5):
        check(forged, "device_sig", gate)
    for seq, expected in ((1, ""), (2, ""), (3, "device_rate")):
        check(Forge(ALICE, seq=seq).envelope(), expected, gate)
    check(Forge(people().bob, seq=4).envelope(), "", gate)
    clock.now_ms += 100
    check(Forge(ALICE, seq=3).envelope(), "", gate)


def test_what_is_judged_has_a_rate() -> None:
    clock = FakeClock()
    gate = relay_gate(clock, replace(WIDE, samples_per_s=10, samples_burst=1))
    check(b"x", "size", gate)
    check(b"x", "rate", gate)
    clock.now_ms += 100
    check(b"x", "size", gate)


def test_a_full_window_refuses_the_new() -> None:
    """512 of one device; what is alive is never forgotten for it."""
    gate = relay_gate()
    for seq in range(limits.WINDOW_PER_DEVICE):
        assert gate.judge(KEY, Forge(ALICE, seq=seq + 1).envelope()) == ""
    check(Forge(ALICE, seq=1000).envelope(), "window_full", gate)
    check(Forge(ALICE).envelope(), "replay", gate)
    check(Forge(people().bob).envelope(), "", gate)


def test_what_is_not_authentic_grows_nothing() -> None:
    """Devices, tokens and nonces that a forger makes up leave no trace."""
    gate, spoilt = relay_gate(), envelope(device_signature=b"x" * 64)
    for seq in range(200):
        gate.judge(KEY, Forge(people(2).alice, seq=seq + 1).envelope())
        gate.judge(KEY, Forge(ALICE, seq=seq + 1, spoil_envelope=spoilt).envelope())
    assert (len(gate._window), len(gate._devices), len(gate._tokens)) == (0, 0, 1)


def test_buckets_of_devices_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """The one that was silent longest goes."""
    monkeypatch.setattr(keyless, "DEVICES_MAX", 2)
    gate = relay_gate(rates=replace(WIDE, device_per_s=1, device_burst=1))
    check(Forge(ALICE).envelope(), "", gate)
    check(Forge(people().bob).envelope(), "", gate)
    check(Forge(ALICE, seq=2).envelope(), "device_rate", gate)
    check(Forge(people().viewer).envelope(), "", gate)
    check(Forge(ALICE, seq=3).envelope(), "device_rate", gate)
    check(Forge(people().bob, seq=2).envelope(), "", gate)


def test_known_tokens_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "TOKEN_CACHE", 2)
    gate = relay_gate()
    for number, who in enumerate((ALICE, people().bob, people().viewer, ALICE)):
        check(Forge(who, seq=number + 1).envelope(), "", gate)
        assert len(gate._tokens) <= 2


def test_the_unforeseen_is_counted_and_not_raised() -> None:
    def admits(*_: object) -> str:
        raise RuntimeError("odd")

    check(Forge(ALICE).envelope(), "internal", relay_gate(admits=admits))


def test_mutations_are_judged_as_the_node_judges_them() -> None:
    """A thousand spoilt envelopes: none passes, and both gates give the same reason."""
    chance, payload = random.Random(7), Forge(ALICE).envelope()
    ours, theirs = relay_gate(), node_gate()
    for _ in range(1000):
        spoilt = bytearray(payload)
        spoilt[chance.randrange(len(spoilt))] ^= 1 << chance.randrange(8)
        cut = bytes(spoilt[: chance.choice((len(spoilt), chance.randrange(len(spoilt))))])
        verdict = theirs.judge(KEY, cut)
        assert isinstance(verdict, Rejected)
        assert ours.judge(KEY, cut) == verdict.reason


def test_reasons_are_those_of_the_node_but_for_what_a_key_finds() -> None:
    """So that counts of both can be laid side by side."""
    assert set(RELAY_REASONS) - set(REASONS) == {"owner", "device_rate"}
    assert set(REASONS) - set(RELAY_REASONS) == BEYOND | OF_A_NODE
    assert PrincipalKind.NODE not in ISSUERS


def test_a_node_without_time_is_heard_once() -> None:
    """Its status and answers carry no time, and their readers judge them; an order without one is stale."""
    key = "waypoint/global/status/wasp-01"

    def undated(message: EnvelopeHeader) -> None:
        message.ClearField("issued_at_ms")

    gate = KeylessGate(
        people().wasp.trust,
        lambda: people().wasp.revocations,
        MessageType.STATUS,
        kinds=frozenset({PrincipalKind.NODE}),
        is_ours=lambda expression: expression == key,
        admits=lambda *_: "",
        clock=FakeClock(),
        rates=WIDE,
    )
    told = Forge(people().wasp, MessageType.STATUS, key, spoil_header=undated).envelope()
    check(told, "", gate, key)
    check(told, "replay", gate, key)
    check(Forge(ALICE, spoil_header=undated).envelope(), "clock_stale")
