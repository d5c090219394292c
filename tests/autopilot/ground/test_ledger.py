"""What an issuer believes of its orders: it only grows, however answers are delayed, doubled and reordered."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.ground.ledger import Answer, Ledger, Order
from autopilot.trust.envelope import Packed
from autopilot.trust.verdict import Sealed, Sender
from autopilot.wire.keys import ack_key
from events.schema.waypoint_pb2 import AckResult, CommandAck, OrderStage, PrincipalKind, ResultState
from tests.autopilot.trust.world import COMMAND_ID

NODE_KEY = b"N" * 32
RUNGS = ("", "received", "sent", "in progress")


def ordered() -> Order:
    """Return an order that was not answered."""
    return Order(
        node="wasp-01",
        node_key=NODE_KEY,
        command_id=COMMAND_ID,
        content=b"",
        order_seq=1,
        ends_mono_ns=10_000_000_000,
        due_mono_ns=0,
    )


def sealed(in_reply_to: bytes) -> Sealed:
    """Return the node's own answer as a gate opens it."""
    sender = Sender(
        principal_id="wasp-01",
        callsign="",
        kind=PrincipalKind.NODE,
        roles=(),
        public_key=NODE_KEY,
        device_key_id=b"",
    )
    return Sealed(
        sender=sender,
        key_expr=ack_key("wasp-01", COMMAND_ID),
        nonce=b"",
        issued_at_ms=1,
        ttl_ms=1,
        life_ms=1,
        nonce_life_ms=1,
        digest=b"",
        in_reply_to=in_reply_to,
        revocation_version=1,
        plaintext=b"",
        envelope=b"",
    )


def rung(stage: int) -> CommandAck:
    """Return an answer that is not the last word."""
    ack = CommandAck(command_id=COMMAND_ID, result_state=ResultState.PENDING, acked_at_ms=1, detail=f"at {stage}")
    if stage:
        ack.stage = OrderStage.ValueType(stage)
    return ack


def last(result: AckResult.ValueType) -> CommandAck:
    """Return a last word."""
    return CommandAck(command_id=COMMAND_ID, result=result, result_state=ResultState.FINAL, acked_at_ms=1)


ACKS = st.lists(
    st.one_of(
        st.sampled_from([rung(stage) for stage in range(4)]),
        st.sampled_from([last(AckResult.ACK_ACCEPTED), last(AckResult.ACK_TIMEOUT), last(AckResult.ACK_REJECTED)]),
    ),
    max_size=12,
)


def height(answer: Answer) -> int:
    """Return how far up the ladder an answer is."""
    return {"waiting": -1, "pending": RUNGS.index(answer.stage)}.get(answer.state, len(RUNGS))


@given(ACKS, st.lists(st.integers(0, 2), min_size=12, max_size=12))
def test_a_last_word_never_changes_and_nobody_is_told_less(acks: list[CommandAck], replies: list[int]) -> None:
    """Any answers in any order, to any of the envelopes: up the ladder only, the first last word for good, one row."""
    settled: list[Answer] = []
    ledger, order = Ledger(lambda _, answer: settled.append(answer)), ordered()
    ledger.add(order)
    for envelope in (b"0", b"1", b"2"):
        ledger.published(order, Packed(b"", envelope, b""), 0)
    seen = [order.answer]
    for ack, reply in zip(acks, replies, strict=False):
        assert ledger.believe(sealed(b"%d" % reply), ack) == ""
        seen.append(order.answer)
    heights = [height(answer) for answer in seen]
    assert heights == sorted(heights)
    finals = [ack for ack in acks if ack.result_state == ResultState.FINAL]
    assert settled == [answer for answer in seen if answer.state == "final"][:1]
    assert len(settled) == min(len(finals), 1)
    assert [answer.result for answer in settled] == [
        AckResult.Name(ack.result).removeprefix("ACK_").lower() for ack in finals[:1]
    ]
    reached = [len(RUNGS)] * len(finals) + [ack.stage for ack in acks if ack not in finals]
    assert heights[-1] == max([-1, *reached])


@pytest.mark.parametrize("stage", range(4))
def test_each_rung_is_told_by_its_name(stage: int) -> None:
    ledger, order = Ledger(), ordered()
    ledger.published(order, Packed(b"", b"0", b""), 0)
    ledger.believe(sealed(b"0"), rung(stage))
    assert (order.answer.state, order.answer.stage, order.answer.detail) == ("pending", RUNGS[stage], f"at {stage}")
    assert not order.is_done


def test_an_old_node_s_only_word_is_its_last() -> None:
    """Seed 000 knows no result_state; a stage on a last word means nothing; what is absent stays unknown."""
    ledger, order = Ledger(), ordered()
    ledger.published(order, Packed(b"", b"0", b""), 0)
    ack = CommandAck(command_id=COMMAND_ID, acked_at_ms=1, stage=OrderStage.SENT)
    ledger.believe(sealed(b"0"), ack)
    assert (order.answer.state, order.answer.stage, order.answer.result) == ("final", "", "accepted")
    assert (order.answer.revocation_version, order.answer.time_quality, order.answer.event_seq) == (None, None, None)


def test_orders_are_overdue_once() -> None:
    """Two seconds after their life, if nobody answered finally."""
    ledger, order, answered = Ledger(), ordered(), ordered()
    ledger.add(order)
    ledger.add(answered)
    ledger.failed(answered, "because")
    assert ledger.overdue(11_999_999_999) == []
    assert ledger.next_due() == 0
    ledger.due(11_999_999_999)
    assert ledger.next_due() == 12_000_000_000
    assert ledger.overdue(12_000_000_000) == [order]
    assert ledger.overdue(13_000_000_000) == []
    assert ledger.next_due() is None
