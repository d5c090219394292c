"""The gate while what its node believes changes: lists and keys in flight, a time that is not known, a lost memory."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from autopilot.trust.envelope import MessageType, Packer
from autopilot.trust.gate import Gate
from autopilot.trust.limits import HORIZON_MS
from autopilot.trust.verdict import Opened, Rejected, Sealed
from events.schema.waypoint_pb2 import AuthEnvelope, EnvelopeHeader, PrincipalKind
from tests.autopilot.trust.papers import (
    HOUR_MS,
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
from tests.autopilot.trust.test_gate import check_opens, check_reject, set_to
from tests.autopilot.trust.world import ISSUERS, KEY, NOW_MS, Forge, people, resigned, retokened, seeded

GOOD = Forge(people().alice)


@pytest.fixture
def node(tmp_path: Path) -> Device:
    return device(tmp_path / "wasp")


@pytest.fixture
def lost(tmp_path: Path) -> Device:
    """A node that does not know what time it is."""
    return device(tmp_path / "wasp", HostClocks(wall_ms=0))


def gate_of(node: Device) -> Gate[bytes]:
    return Gate(
        people().wasp,
        MessageType.ORDER,
        kinds=ISSUERS,
        is_ours=lambda key: key == KEY,
        reader=lambda _message, content: content,
        clock=node.host,
        samples_per_s=1e6,
        samples_burst=100_000,
        believing=node.book,
    )


def echoing(challenge: bytes, seq: int = 1, **changes: object) -> bytes:
    echo = set_to("node_challenge", challenge)
    return replace(GOOD, seq=seq, spoil_header=echo, **changes).envelope()  # type: ignore[arg-type]


def test_a_revocation_in_flight_is_the_end_of_the_next_order(node: Device) -> None:
    """Also where the token was known; and the list of before, replayed after a restart, brings nobody back."""
    gate, old = gate_of(node), a_list(2)
    node.book.offer("revocations", old)
    check_opens(GOOD.envelope(), gate)
    node.book.offer("revocations", a_list(3, "alice"))
    check_reject("revoked", replace(GOOD, seq=2).envelope(), gate)
    check_opens(replace(GOOD, identity=people().bob).envelope(), gate)
    again = node.restart()
    again.book.offer("revocations", old)
    check_reject("revoked", replace(GOOD, seq=3).envelope(), gate_of(again))


def test_tokens_of_a_key_that_was_replaced_are_void_at_once(node: Device) -> None:
    gate = gate_of(node)
    check_opens(GOOD.envelope(), gate)
    node.book.offer("trust_root", a_root(2, token=OTHER["token"]))
    check_reject("token_sig", replace(GOOD, seq=2).envelope(), gate)


def in_epoch(epoch_id: int, seq: int) -> bytes:
    alice = people().alice
    epoch = replace(alice.epochs[1], epoch_id=epoch_id, secret=epoch_secret(epoch_id))
    member = replace(alice, epochs={1: epoch})
    return replace(GOOD, identity=member, seq=seq, spoil_header=set_to("epoch_id", epoch_id)).envelope()


def test_an_unknown_epoch_is_dropped_asked_for_and_then_opens(node: Device) -> None:
    gate = gate_of(node)
    check_reject("unknown_epoch", in_epoch(2, 1), gate)
    assert node.asked.take() == ["epoch"]
    node.book.offer("epoch", a_bundle(2, not_before_ms=NOW_MS + 10_000))
    check_reject("epoch_retired", in_epoch(2, 2), gate)
    node.host.pass_ms(5_000)
    opened = gate.judge(KEY, in_epoch(2, 3))
    assert isinstance(opened, Opened)


def test_the_epoch_before_opens_for_two_minutes(node: Device) -> None:
    gate = gate_of(node)
    node.book.offer("epoch", a_bundle(2))
    node.host.pass_ms(120_000)
    check_opens(replace(GOOD, issued_at_ms=NOW_MS + 120_000).envelope(), gate)
    node.host.pass_ms(1)
    check_reject("epoch_retired", replace(GOOD, seq=2, issued_at_ms=NOW_MS + 120_001).envelope(), gate)


def test_an_epoch_that_needs_a_newer_list_waits_for_it(node: Device) -> None:
    gate = gate_of(node)
    node.book.offer("epoch", a_bundle(2, min_revocation_version=2))
    check_reject("list_old", in_epoch(2, 1), gate)
    node.book.offer("revocations", a_list(2))
    assert isinstance(gate.judge(KEY, in_epoch(2, 2)), Opened)


@pytest.mark.parametrize(
    ("payload", "reason", "asks"),
    [
        (replace(GOOD, spoil_header=set_to("revocation_version", 9)).envelope(), "", ["revocations"]),
        (replace(GOOD, spoil_header=set_to("epoch_id", 9)).envelope(), "unknown_epoch", ["epoch"]),
        (
            replace(
                GOOD,
                spoil_header=set_to("epoch_id", 9),
                spoil_envelope=lambda envelope: resigned(envelope, people().bob),
            ).envelope(),
            "device_sig",
            [],
        ),
        (
            replace(GOOD, identity=people().bob, spoil_header=set_to("revocation_version", 9)).envelope(),
            "revoked",
            [],
        ),
    ],
)
def test_only_who_is_known_and_not_revoked_makes_a_node_ask(
    node: Device, payload: bytes, reason: str, asks: list[str]
) -> None:
    node.book.offer("revocations", a_list(2, "bob"))
    verdict = gate_of(node).judge(KEY, payload)
    assert isinstance(verdict, Opened) or verdict == Rejected(reason)
    assert node.asked.take() == asks


def test_a_token_from_an_authentic_envelope_raises_the_floor_and_a_forged_one_does_not(lost: Device) -> None:
    later = retokened(people().alice, set_to("not_before_ms", NOW_MS + HOUR_MS))
    gate, challenge = gate_of(lost), lost.book.challenge()
    forged = replace(GOOD, identity=later, spoil_header=set_to("node_challenge", challenge))
    spoiled = replace(forged, spoil_envelope=lambda envelope: resigned(envelope, people().bob))
    check_reject("device_sig", spoiled.envelope(), gate)
    assert lost.clock.floor_ms == NOW_MS
    check_opens(forged.envelope(), gate)
    assert lost.clock.floor_ms == NOW_MS + HOUR_MS


def test_the_message_says_how_long_the_list_has_been_due(node: Device) -> None:
    node.book.offer("revocations", a_list(2, next_update_ms=NOW_MS - 7))
    opened = check_opens(GOOD.envelope(), gate_of(node))
    assert (opened.message.overdue_ms, opened.message.time_uncertain, opened.message.before_memory) == (7, False, False)
    node.book.offer("revocations", a_list(3, next_update_ms=NOW_MS))
    assert check_opens(replace(GOOD, seq=2).envelope(), gate_of(node)).message.overdue_ms == 0


def test_who_does_not_know_the_time_takes_only_an_echo(lost: Device) -> None:
    """The right challenge, or the one before; whatever the sender's clock says."""
    gate, first = gate_of(lost), lost.book.challenge()
    check_reject("challenge", GOOD.envelope(), gate)
    check_reject("challenge", echoing(b"x" * 16), gate)
    opened = check_opens(echoing(first, issued_at_ms=NOW_MS - 30 * 24 * HOUR_MS), gate)
    assert (opened.message.time_uncertain, opened.message.life_ms, opened.message.nonce_life_ms) == (
        True,
        10_000,
        60_000,
    )
    check_reject("replay", echoing(first, issued_at_ms=NOW_MS - 30 * 24 * HOUR_MS), gate)
    lost.host.mono_ms += 30_000
    check_opens(echoing(first, seq=2), gate)
    check_reject("ttl", echoing(first, seq=3, ttl_ms=30_001), gate)
    lost.host.mono_ms += 30_000
    check_reject("challenge", echoing(first, seq=4), gate)
    check_reject("challenge", echoing(first, issued_at_ms=NOW_MS - 30 * 24 * HOUR_MS), gate)
    assert gate.tally().balances()


def test_a_token_that_is_surely_over_is_over_also_without_a_clock(lost: Device) -> None:
    gate = gate_of(lost)
    lost.host.pass_ms(12 * HOUR_MS)
    check_opens(echoing(lost.book.challenge()), gate)
    lost.host.pass_ms(1)
    check_reject("token_expired", echoing(lost.book.challenge(), seq=2), gate)


def test_ten_thousand_replays_after_a_boot_without_a_clock(tmp_path: Path) -> None:
    """Orders that were heard before the boot, whatever GPS claims meanwhile: none passes, nothing is kept of them."""
    node = device(tmp_path / "wasp")
    gate, corpus = gate_of(node), [replace(GOOD, seq=seq).envelope() for seq in range(1, 501)]
    assert all(isinstance(gate.judge(KEY, payload), Opened) for payload in corpus)
    again = node.restart(host=HostClocks(mono_ms=1, wall_ms=0))
    gate = gate_of(again)
    gate.restore([], whole=False)
    told = list(again.log.told)
    for claimed_ms in [NOW_MS, NOW_MS - 11 * 60_000, NOW_MS + 11 * 60_000, NOW_MS + 87_600 * HOUR_MS] * 5:
        again.clock.hear_gps(claimed_ms)
        again.host.mono_ms += 20_000
        assert {gate.judge(KEY, payload) for payload in corpus} == {Rejected("challenge")}
    tally = gate.tally()
    assert (tally.received, tally.rejected["challenge"], tally.opened) == (10_000, 10_000, 0)
    assert (len(gate._window), len(gate._tokens)) == (0, 0)
    assert again.log.told == told


def test_after_a_beacon_the_wall_clock_judges_again(lost: Device) -> None:
    gate = gate_of(lost)
    used = echoing(lost.book.challenge())
    check_opens(used, gate)
    lost.book.turn()
    challenge = lost.asked.requests[-1][1]
    assert challenge is not None
    lost.book.offer("time", a_beacon(challenge, NOW_MS))
    check_reject("replay", used, gate)
    check_opens(replace(GOOD, seq=2).envelope(), gate)
    check_reject("clock_stale", replace(GOOD, seq=3, issued_at_ms=NOW_MS - HOUR_MS).envelope(), gate)
    lost.host.mono_ms += 40_000
    check_reject("clock_stale", used, gate)


def test_a_start_without_memory_takes_nothing_from_before_it(node: Device) -> None:
    """Up to the skew of two clocks after it; for 40 s, by which everything that was sent before has run out."""
    gate = gate_of(node)
    gate.restore([], whole=False)
    check_reject("horizon", GOOD.envelope(), gate)
    check_reject("horizon", replace(GOOD, issued_at_ms=NOW_MS + 5_000).envelope(), gate)
    node.host.pass_ms(1)
    check_reject("horizon", replace(GOOD, issued_at_ms=NOW_MS + 5_000).envelope(), gate)
    maybe = check_opens(replace(GOOD, issued_at_ms=NOW_MS + 5_001).envelope(), gate)
    assert maybe.message.before_memory
    node.host.pass_ms(24_999)
    again = check_opens(replace(GOOD, seq=2, issued_at_ms=NOW_MS + 25_000).envelope(), gate)
    assert again.message.before_memory
    node.host.pass_ms(1)
    fresh = check_opens(replace(GOOD, seq=3, issued_at_ms=NOW_MS + 25_001).envelope(), gate)
    assert not fresh.message.before_memory
    node.host.pass_ms(HORIZON_MS - 25_001)
    check_reject("horizon", replace(GOOD, seq=4, issued_at_ms=NOW_MS + 5_000, ttl_ms=30_000).envelope(), gate)
    node.host.pass_ms(1)
    check_reject("clock_stale", replace(GOOD, seq=4, issued_at_ms=NOW_MS + 5_000, ttl_ms=30_000).envelope(), gate)


def test_a_start_that_remembers_all_has_no_horizon(node: Device) -> None:
    gate = gate_of(node)
    gate.restore([])
    assert not check_opens(GOOD.envelope(), gate).message.before_memory


def test_without_memory_and_clock_an_echo_may_still_be_a_repeat(lost: Device) -> None:
    gate = gate_of(lost)
    gate.restore([], whole=False)
    assert check_opens(echoing(lost.book.challenge()), gate).message.before_memory
    ahead = echoing(lost.book.challenge(), seq=3, issued_at_ms=NOW_MS + HOUR_MS)
    assert check_opens(ahead, gate).message.before_memory
    lost.host.mono_ms += HORIZON_MS + 1
    assert not check_opens(echoing(lost.book.challenge(), seq=2), gate).message.before_memory


def test_a_node_that_does_not_know_the_time_says_so_by_none(lost: Device) -> None:
    """Its answers and status bear none; only a gate that is told to takes such, and no node's order gate is."""
    key = "waypoint/global/status/wasp-01"
    packer = Packer(people().wasp, lost.host, seeded(8), lost.book)
    packed, host = packer.pack(MessageType.STATUS, key, b"said", ttl_ms=10_000), HostClocks()

    def status_gate(*, takes_undated: bool) -> Gate[bytes]:
        return Gate(
            people().alice,
            MessageType.STATUS,
            kinds=frozenset({PrincipalKind.NODE}),
            is_ours=lambda _key: True,
            reader=_content,
            clock=host,
            takes_undated=takes_undated,
        )

    check_reject("clock_stale", packed.envelope, status_gate(takes_undated=False), key)
    gate = status_gate(takes_undated=True)
    opened = check_opens(packed.envelope, gate, key)
    assert (opened.message.issued_at_ms, opened.message.life_ms) == (0, 10_000)
    check_reject("replay", packed.envelope, gate, key)
    dated = Packer(people().wasp, HostClocks(), seeded(9)).pack(MessageType.STATUS, key, b"said", ttl_ms=10_000)
    host.pass_ms(HOUR_MS)
    check_reject("clock_stale", dated.envelope, gate, key)
    check_reject("clock_stale", replace(GOOD, issued_at_ms=NOW_MS - HOUR_MS).envelope(), gate_of(device(lost.folder)))


def test_an_issuer_echoes_a_challenge(node: Device) -> None:
    packed = Packer(people().alice, node.host, seeded(8)).pack(
        MessageType.ORDER, KEY, b"content", ttl_ms=10_000, node_challenge=b"c" * 16
    )
    opened = check_opens(packed.envelope, gate_of(node))
    assert header_of(opened.message.envelope).node_challenge == b"c" * 16


def test_a_packer_goes_by_what_is_believed_now(node: Device) -> None:
    packer = Packer(people().wasp, node.host, seeded(8), node.book)
    node.book.offer("revocations", a_list(4))
    node.book.offer("epoch", a_bundle(2))
    packed = packer.pack(MessageType.STATUS, "k", b"said", ttl_ms=10_000)
    header = header_of(packed.envelope)
    assert (header.epoch_id, header.revocation_version, header.issued_at_ms) == (2, 4, NOW_MS)


def header_of(envelope: bytes) -> EnvelopeHeader:
    return EnvelopeHeader.FromString(AuthEnvelope.FromString(envelope).header)


def _content(_message: Sealed, content: bytes) -> bytes:
    return content
