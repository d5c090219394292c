"""An operator's presence: said to whom it is asked for, so that the node's own gate takes it, and no longer."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from autopilot.trust.envelope import MessageType
from autopilot.trust.gate import Gate
from autopilot.trust.limits import PRESENCE_TTL_MS
from autopilot.trust.verdict import Opened
from autopilot.wire.keys import presence_key
from events.schema.waypoint_pb2 import NodeStatus, OperatorPresence, PrincipalKind
from tests.autopilot.ground.test_issuer import Desk
from tests.autopilot.trust.world import people

HERE = presence_key("wasp-01", "alice")


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path)


def said(desk: Desk) -> list[str]:
    """Let a turn of presence come; return the keys it was said on."""
    before = len(desk.wire.puts)
    desk.issuer._attendance.turn()
    assert all(not urgent for _, _, urgent in desk.wire.puts[before:])
    return [key for key, _, _ in desk.wire.puts[before:]]


def opened(desk: Desk) -> Opened[bytes]:
    """Return the last presence as wasp-01 opens it."""
    gate: Gate[bytes] = Gate(
        people().wasp,
        MessageType.PRESENCE,
        kinds=frozenset({PrincipalKind.OPERATOR}),
        is_ours=lambda key: key == HERE,
        reader=lambda _, content: content,
        clock=desk.clock,
    )
    verdict = gate.judge(*desk.wire.puts[-1][:2])
    assert isinstance(verdict, Opened)
    return verdict


def test_who_does_not_attend_says_nothing(desk: Desk) -> None:
    """Neither by watching nor by ordering."""
    desk.issuer.watch("wasp-01")
    desk.send()
    assert said(desk) == []
    assert desk.issuer.attended() == frozenset()


def test_presence_is_a_sealed_word_of_three_seconds_that_nobody_answers(desk: Desk) -> None:
    """Of this device, for this node; it says which status was heard last."""
    desk.issuer.attend("wasp-01")
    assert said(desk) == [HERE]
    first = opened(desk)
    assert (first.message.sender.principal_id, first.message.ttl_ms) == ("alice", PRESENCE_TTL_MS)
    assert OperatorPresence.FromString(first.content) == OperatorPresence()
    desk.tell(NodeStatus(at_ms=5, head_seq=41))
    assert said(desk) == [HERE]
    again = opened(desk)
    assert OperatorPresence.FromString(again.content) == OperatorPresence(heard_head_seq=41)
    assert again.message.nonce != first.message.nonce
    assert desk.issuer.history() == ()


def test_a_challenge_of_the_node_is_echoed(desk: Desk) -> None:
    desk.issuer.attend("wasp-01")
    desk.tell(NodeStatus(at_ms=5, node_challenge=b"c" * 16))
    said(desk)
    assert b"c" * 16 in opened(desk).message.envelope


def test_several_nodes_have_their_turns_and_who_leaves_has_none(desk: Desk) -> None:
    keys = {node: presence_key(node, "alice") for node in ("hornet-02", "wasp-01")}
    for node in keys:
        desk.issuer.attend(node)
    assert desk.issuer.attended() == frozenset(keys)
    assert sorted(said(desk) + said(desk)) == sorted(keys.values())
    desk.issuer.leave("hornet-02")
    assert said(desk) + said(desk) == [keys["wasp-01"]] * 2
    desk.issuer.leave("wasp-01")
    assert said(desk) == []


def test_without_a_link_nothing_is_kept_for_later(desk: Desk) -> None:
    desk.issuer.attend("wasp-01")
    desk.wire.up = False
    assert said(desk) == []
    desk.wire.up, desk.wire.refuses = True, True
    assert said(desk) == []
    desk.wire.refuses = False
    assert said(desk) == [HERE]


def test_without_a_group_key_nothing_is_said(desk: Desk) -> None:
    desk.issuer.attend("wasp-01")
    desk.clock.now_ms += 40 * 24 * 3_600_000
    assert said(desk) == []


def test_it_goes_on_by_itself_and_ends_with_the_issuer(desk: Desk) -> None:
    """A thread says it; after the end it is said no more."""
    put, twice = desk.wire.put, threading.Semaphore(0)

    def counted(key_expr: str, payload: bytes, *, urgent: bool) -> None:
        put(key_expr, payload, urgent=urgent)
        twice.release()

    desk.wire.put = counted  # type: ignore[method-assign]
    with desk.issuer:
        desk.issuer.attend("wasp-01")
        assert twice.acquire(timeout=20)
        assert twice.acquire(timeout=20)
    assert not desk.issuer._attendance._thread.is_alive()
