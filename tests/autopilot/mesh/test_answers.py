"""What leaves as an answer: each rung by its name, only last words reported; and whose orders are heard at all."""

from __future__ import annotations

import pytest

from autopilot.ports.edges import InputClass
from events.schema.orders_pb2 import ACK_STAGE_UNSPECIFIED, AckPublished, AckStage, SendAck
from events.schema.waypoint_pb2 import CameraRelease, CommandAck, OrderStage, PrincipalKind, ResultState
from tests.autopilot.mesh.test_adapter import Node, command, opened_ack
from tests.autopilot.trust.world import COMMAND_ID, KEY, Forge, people, retokened


@pytest.mark.parametrize("stage", AckStage.values())
def test_a_rung_leaves_and_is_not_reported(stage: AckStage.ValueType) -> None:
    """With the log's number for it; the two catalogues name the same rungs."""
    node = Node()
    effect = SendAck(command_id=COMMAND_ID, in_reply_to=b"\x05" * 32, detail="so far")
    if stage != ACK_STAGE_UNSPECIFIED:
        effect.stage = stage
    node.adapter.perform(9, effect, node.clock.mono_ns())
    node.turn()
    opened = opened_ack(node)
    ack = CommandAck.FromString(opened.content)
    assert (ack.result_state, ack.event_seq, ack.detail) == (ResultState.PENDING, 9, "so far")
    assert opened.message.in_reply_to == b"\x05" * 32
    assert "ACK_STAGE_" + OrderStage.Name(ack.stage).removeprefix("ORDER_STAGE_") == AckStage.Name(stage)
    assert ack.HasField("stage") == (stage != ACK_STAGE_UNSPECIFIED)
    assert node.offered == []


def test_a_last_word_is_reported() -> None:
    """The log learns that it left; there is no stage on it."""
    node = Node()
    node.adapter.perform(9, SendAck(command_id=COMMAND_ID, final=True), node.clock.mono_ns())
    node.turn()
    assert not CommandAck.FromString(opened_ack(node).content).HasField("stage")
    assert node.offered == [(InputClass.OUTCOME, AckPublished(effect_seq=9))]


@pytest.mark.parametrize("kind", [PrincipalKind.NODE, PrincipalKind.SERVICE])
def test_nodes_and_services_never_command(kind: PrincipalKind.ValueType) -> None:
    """Whatever roles their token says: dropped, counted, unanswered."""
    node = Node()
    sender = retokened(people().alice, lambda token: setattr(token, "kind", kind))
    node.adapter.receive(KEY, Forge(sender, content=command(camera_release=CameraRelease())).envelope())
    assert node.offered == []
    assert node.adapter.take_rejections() == {"token_kind": 1}
    node.turn()
    assert node.wire.puts == []
