"""The edges of a relay's gate: what is just enough passes, and what is known already costs no second look."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from autopilot.trust import documents, keyless, limits
from autopilot.trust.envelope import MessageType
from autopilot.trust.keyless import KeylessGate
from events.schema.waypoint_pb2 import EnvelopeHeader, IdentityToken, PrincipalKind
from tests.autopilot.trust.test_gate import set_times, set_to
from tests.autopilot.trust.test_keyless import ALICE, WIDE, check, relay_gate
from tests.autopilot.trust.world import NOW_MS, FakeClock, Forge, people, retokened

STATUS_KEY = "waypoint/global/status/wasp-01"


def test_the_least_policy_is_enough() -> None:
    """Below it a token is out."""
    least = people().wasp.revocations
    check(Forge(ALICE).envelope(), "", relay_gate(revocations=replace(least, min_policy_version=1)))
    check(Forge(ALICE).envelope(), "policy_old", relay_gate(revocations=replace(least, min_policy_version=2)))


@pytest.mark.parametrize(
    ("begins_ms", "ends_ms", "expected"),
    [
        (NOW_MS + limits.SKEW_MS, NOW_MS + 10**6, ""),
        (NOW_MS + limits.SKEW_MS + 1, NOW_MS + 10**6, "token_expired"),
        (NOW_MS - 10, NOW_MS, ""),
        (NOW_MS - 10, NOW_MS - 1, "token_expired"),
    ],
)
def test_a_token_is_valid_to_its_last_millisecond(begins_ms: int, ends_ms: int, expected: str) -> None:
    """And from its first, with the allowance for a clock that is behind."""
    timed = retokened(people().alice, lambda token: set_times(token, begins_ms, ends_ms))
    check(Forge(timed).envelope(), expected)


def test_the_longest_life_passes() -> None:
    """A millisecond more does not."""
    check(Forge(ALICE, spoil_header=set_to("ttl_ms", limits.TTL_MS_MAX)).envelope(), "")
    check(Forge(ALICE, spoil_header=set_to("ttl_ms", limits.TTL_MS_MAX + 1)).envelope(), "ttl")


def test_a_known_token_costs_no_second_verification(monkeypatch: pytest.MonkeyPatch) -> None:
    """The signature of the Directory is verified once."""
    asked: list[bytes] = []
    verify: Callable[..., IdentityToken] = documents.verify_token

    def counted(data: bytes, *rest: object) -> IdentityToken:
        asked.append(data)
        return verify(data, *rest)

    monkeypatch.setattr(keyless, "verify_token", counted)
    gate = relay_gate()
    for seq in (1, 2):
        check(Forge(ALICE, seq=seq).envelope(), "", gate)
    assert asked == [people().alice.token_bytes]


def test_as_many_tokens_are_known_as_the_limit_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of more, the one not heard for longest goes."""
    monkeypatch.setattr(limits, "TOKEN_CACHE", 2)
    gate, bob = relay_gate(), people().bob
    for who, seq in ((ALICE, 1), (bob, 1), (ALICE, 2)):
        check(Forge(who, seq=seq).envelope(), "", gate)
    assert list(gate._tokens) == [bob.token_digest, people().alice.token_digest]
    other = retokened(people().alice, set_to("callsign", "ANOTHER"))
    check(Forge(other, seq=3).envelope(), "", gate)
    assert list(gate._tokens) == [people().alice.token_digest, other.token_digest]


def test_a_dated_status_is_judged_by_its_date() -> None:
    """Only one without a date is left to its reader."""

    def late(message: EnvelopeHeader) -> None:
        message.issued_at_ms = NOW_MS - 10**6

    gate = KeylessGate(
        people().wasp.trust,
        lambda: people().wasp.revocations,
        MessageType.STATUS,
        kinds=frozenset({PrincipalKind.NODE}),
        is_ours=lambda expression: expression == STATUS_KEY,
        admits=lambda *_: "",
        clock=FakeClock(),
        rates=WIDE,
    )
    told = Forge(people().wasp, MessageType.STATUS, STATUS_KEY, spoil_header=late).envelope()
    check(told, "clock_stale", gate, STATUS_KEY)
