"""The operator's side without a network: what is published when, and which answers are believed."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from autopilot.ground import compose
from autopilot.ground.following import Commander
from autopilot.ground.issuer import Issuer, UnknownNode
from autopilot.ground.ledger import Answer, Order
from autopilot.trust.envelope import MessageType, Packer
from autopilot.trust.gate import Gate
from autopilot.trust.identity import Identity, load_identity
from autopilot.trust.keys import digest
from autopilot.trust.verdict import Opened
from autopilot.wire.keys import ack_key, status_key
from events.schema.waypoint_pb2 import (
    AckResult,
    AuthEnvelope,
    CameraStatus,
    CommandAck,
    DeviceCommand,
    EnvelopeHeader,
    NodeStatus,
    OrderStage,
    ResultState,
)
from tests.autopilot.trust.world import NOW_MS, FakeClock, FakeWire, node_gate, people, seeded

POI = "0b7c5e2a-6f0e-8d3a-9a51-3f1f5a0c9d12"


class Desk:
    """Alice at her desk: an issuer over a fake wire, and a gate as the node would have it."""

    def __init__(self, folder: Path) -> None:
        alice = Path(shutil.copytree(people().alice.folder, folder / "alice"))
        self.clock, self.wire = FakeClock(), FakeWire()
        self.issuer = Issuer(load_identity(alice), clock=self.clock, wire=self.wire, random=seeded(6))
        self.gate: Gate[bytes] = node_gate(clock=self.clock)
        self.taken = 0

    def send(self, command: DeviceCommand | None = None, life_s: float = 10) -> Order:
        """Give an order and let it leave."""
        order = self.issuer.send("wasp-01", command or compose.release(), life_s)
        self.issuer.turn()
        return order

    def arrived(self) -> list[Opened[bytes]]:
        """What the node's gate opened of what has been put since the last call."""
        verdicts = [self.gate.judge(key, payload) for key, payload, urgent in self.wire.puts[self.taken :] if urgent]
        self.taken = len(self.wire.puts)
        assert all(isinstance(verdict, Opened) for verdict in verdicts)
        return [verdict for verdict in verdicts if isinstance(verdict, Opened)]

    def later(self, milliseconds: int) -> list[Opened[bytes]]:
        """Let time pass, let the issuer work, and return what arrived."""
        self.clock.now_ms += milliseconds
        self.issuer.turn()
        return self.arrived()

    def answer(
        self,
        order: Order,
        in_reply_to: bytes,
        signer: Identity | None = None,
        key: str = "",
        **changes: object,
    ) -> None:
        """Answer as a node: `signer` on `key`, with changes to the ack."""
        fields: dict[str, object] = {
            "command_id": order.command_id,
            "result": AckResult.ACK_ACCEPTED,
            "acked_at_ms": self.clock.now_ms,
            "result_state": ResultState.FINAL,
        }
        ack = CommandAck(**(fields | changes))  # type: ignore[arg-type]
        key = key or ack_key("wasp-01", order.command_id)
        packer = Packer(signer or people().wasp, self.clock, seeded(self.clock.now_ms))
        content = ack.SerializeToString(deterministic=True)
        packed = packer.pack(MessageType.ACK, key, content, ttl_ms=5000, in_reply_to=in_reply_to)
        self.issuer.receive_ack(key, packed.envelope)

    def tell(self, status: NodeStatus, signer: Identity | None = None, node: str = "wasp-01") -> None:
        """Publish a status as a node."""
        packer = Packer(signer or people().wasp, self.clock)
        packed = packer.pack(
            MessageType.STATUS, status_key(node), status.SerializeToString(deterministic=True), ttl_ms=5000
        )
        self.issuer.receive_status(status_key(node), packed.envelope)


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path)


def check_not_believed(desk: Desk, reason: str, spoil: Callable[[Order, bytes], None]) -> None:
    """An answer that `spoil` gives changes nothing, and is counted as `reason`; the true one still counts."""
    order = desk.send()
    (opened,) = desk.arrived()
    spoil(order, opened.message.digest)
    assert order.answer == Answer()
    assert [*desk.issuer.disbelieved().items()] == [(reason, 1)] * bool(reason)
    desk.clock.now_ms += 1
    desk.answer(order, opened.message.digest)
    assert order.answer.state == "final"


def test_an_order_is_bound_to_its_node_and_answered(desk: Desk) -> None:
    order = desk.send(compose.point_at_place(52.1, -4.3, 12.5))
    (opened,) = desk.arrived()
    command = DeviceCommand.FromString(opened.content)
    assert command.command_id == order.command_id
    assert command.target_node_pubkey == people().wasp.public_key
    roi = command.camera_roi
    assert (roi.lat_e7, roi.lon_e7, roi.altitude_dm) == (521_000_000, -43_000_000, 125)
    assert opened.message.key_expr == f"waypoint/global/cmd/wasp-01/{order.command_id}"
    desk.answer(order, opened.message.digest, detail="done", mav_result=0, event_seq=9)
    assert order.answer == Answer(
        state="final", result="accepted", detail="done", mav_result=0, event_seq=9, acked_at_ms=NOW_MS
    )


def test_an_order_is_published_again_each_second_of_its_life_as_a_fresh_envelope(desk: Desk) -> None:
    desk.send(life_s=3)
    first = desk.arrived()
    assert desk.later(999) == []
    second, third = desk.later(1), desk.later(1000)
    assert desk.later(1000) == []
    assert desk.later(60_000) == []
    every = first + second + third
    assert len({opened.message.nonce for opened in every}) == 3
    assert len({opened.content for opened in every}) == 1
    assert len({opened.order_seq for opened in every}) == 1
    assert [opened.message.ttl_ms for opened in every] == [3000, 2000, 1000]


def test_nothing_is_published_after_the_last_word_but_after_a_pending_one(desk: Desk) -> None:
    order = desk.send()
    (opened,) = desk.arrived()
    desk.answer(order, opened.message.digest, result_state=ResultState.PENDING, detail="received")
    assert (order.answer.state, order.is_done) == ("pending", False)
    (again,) = desk.later(1000)
    desk.answer(order, again.message.digest, result=AckResult.ACK_REJECTED)
    assert (order.answer.state, order.answer.result) == ("final", "rejected")
    assert desk.later(1000) == []
    desk.answer(order, opened.message.digest, result=AckResult.ACK_TIMEOUT)
    assert order.answer.result == "rejected"


def test_a_repeat_is_the_same_order_with_an_answer_of_its_own(desk: Desk) -> None:
    order = desk.send()
    (first,) = desk.arrived()
    desk.answer(order, first.message.digest, result=AckResult.ACK_REJECTED)
    repeat = desk.issuer.repeat(order)
    (second,) = desk.later(10)
    assert (second.content, second.order_seq) == (first.content, first.order_seq)
    assert second.message.nonce != first.message.nonce
    desk.answer(repeat, second.message.digest, result=AckResult.ACK_REJECTED, duplicate=True)
    assert (repeat.answer.result, repeat.answer.duplicate) == ("rejected", True)
    assert not order.answer.duplicate


def test_the_link_down_holds_an_order_back_and_does_not_lose_it(desk: Desk) -> None:
    desk.wire.up = False
    order = desk.send()
    assert desk.later(5000) == []
    assert order.envelopes == []
    desk.wire.up = True
    (opened,) = desk.later(100)
    assert opened.message.ttl_ms == 4900


def test_a_session_that_refuses_is_asked_again(desk: Desk) -> None:
    desk.wire.refuses = True
    desk.send()
    desk.wire.refuses = False
    assert len(desk.later(100)) == 1


def test_answers_of_others_are_not_believed(desk: Desk) -> None:
    check_not_believed(desk, "wrong_signer", lambda order, to: desk.answer(order, to, people().hornet))


def test_answers_to_other_envelopes_are_not_believed(desk: Desk) -> None:
    check_not_believed(desk, "unknown_envelope", lambda order, _: desk.answer(order, digest(b"other")))


def test_answers_on_another_node_s_key_are_not_believed(desk: Desk) -> None:
    desk.issuer.watch("hornet-02")
    check_not_believed(
        desk, "wrong_route", lambda order, to: desk.answer(order, to, key=ack_key("hornet-02", order.command_id))
    )


def test_a_key_that_was_given_for_the_wrong_node_does_not_let_that_node_answer(desk: Desk) -> None:
    desk.issuer.know_node("wasp-01", people().hornet.public_key)
    order = desk.send()
    (opened,) = desk.arrived()
    desk.answer(order, opened.message.digest, people().hornet)
    assert (order.answer, desk.issuer.disbelieved()) == (Answer(), {"wrong_route": 1})


def test_answers_for_another_order_are_not_believed(desk: Desk) -> None:
    check_not_believed(desk, "wrong_order", lambda order, to: desk.answer(order, to, command_id=POI))


def test_answers_on_another_order_s_key_are_not_believed(desk: Desk) -> None:
    check_not_believed(desk, "wrong_order", lambda order, to: desk.answer(order, to, key=ack_key("wasp-01", POI)))


@pytest.mark.parametrize(
    "changes", [{"command_id": ""}, {"acked_at_ms": 0}, {"result": AckResult.ACK_INVALID_SIGNATURE}, {"result": 99}]
)
def test_an_empty_or_odd_answer_is_not_acceptance(desk: Desk, changes: dict[str, object]) -> None:
    check_not_believed(desk, "", lambda order, to: desk.answer(order, to, **changes))  # type: ignore[arg-type]
    assert desk.issuer.tallies()["acks"].malformed == 1


def test_an_answer_by_an_operator_or_for_a_stranger_is_dropped(desk: Desk) -> None:
    order = desk.send()
    (opened,) = desk.arrived()
    desk.answer(order, opened.message.digest, people().bob)
    desk.answer(order, opened.message.digest, people(2).wasp)
    desk.answer(order, opened.message.digest, key=ack_key("stranger", order.command_id))
    assert order.answer == Answer()
    dropped = desk.issuer.tallies()["acks"].rejected
    assert (dropped["token_kind"], dropped["token_sig"], dropped["route"]) == (1, 1, 1)


def test_an_answer_to_one_order_cannot_serve_another(desk: Desk) -> None:
    first, second = desk.send(), desk.send()
    to_first, _ = desk.arrived()
    desk.answer(second, to_first.message.digest)
    assert (first.answer, second.answer) == (Answer(), Answer())


def test_a_node_s_status_is_kept_newest_and_names_who_holds_the_camera(desk: Desk) -> None:
    desk.issuer.watch("wasp-01")
    assert desk.issuer.status("wasp-01") is None
    desk.tell(NodeStatus(at_ms=5, cameras=[CameraStatus(camera=1, state="operator", callsign="BOB")]))
    desk.tell(NodeStatus(at_ms=4))
    seen = desk.issuer.wait_status("wasp-01", lambda status: status.at_ms == 5, 0)
    assert seen is not None
    assert seen.status.cameras[0].callsign == "BOB"
    assert desk.issuer.wait_status("wasp-01", lambda status: status.at_ms == 6, 0) is None


def test_a_status_by_another_node_is_not_taken(desk: Desk) -> None:
    desk.issuer.watch("wasp-01")
    desk.tell(NodeStatus(at_ms=5), people().hornet)
    desk.tell(NodeStatus(at_ms=5), people(2).wasp)
    desk.tell(NodeStatus())
    assert desk.issuer.status("wasp-01") is None


def test_an_unknown_node_is_learned_from_its_status(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    desk.issuer._heard.node_keys.clear()
    with pytest.raises(UnknownNode):
        desk.send()
    desk.issuer.watch("wasp-01")
    desk.tell(NodeStatus(at_ms=5))
    assert desk.issuer.knows("wasp-01")
    assert desk.send().node_key == people().wasp.public_key
    desk.issuer.know_node("new", b"\x01" * 32)
    assert desk.issuer.send("new", compose.release()).node_key == b"\x01" * 32


@pytest.mark.parametrize("life_s", [0, -1, 30.001])
def test_a_life_that_no_node_takes_is_refused(desk: Desk, life_s: float) -> None:
    with pytest.raises(ValueError, match="30 s"):
        desk.send(life_s=life_s)


def test_without_a_group_key_nothing_is_sent(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    desk.clock.now_ms += 40 * 24 * 3_600_000
    order = desk.send()
    assert (order.answer.state, desk.wire.puts) == ("failed", [])
    assert "group key" in order.answer.detail
    assert desk.issuer.wait(order, 0).state == "failed"


def test_what_a_person_means_becomes_the_wire_s_units() -> None:
    angles = compose.point_at_angles(-30.5, -90, north=True).camera_pitch_yaw
    assert (angles.pitch_cdeg, angles.yaw_cdeg, angles.yaw_locked, angles.camera) == (-3050, 27_000, True, 1)
    assert compose.point_at_angles(0, 359.999).camera_pitch_yaw.yaw_cdeg == 0
    assert compose.release(2).camera_release.camera == 2
    assert compose.judge(POI, confirmed=True).poi_confirm.poi_id == POI
    assert compose.judge(POI, confirmed=False).poi_decline.poi_id == POI


def test_an_issuer_s_threads_send_and_end(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    with desk.issuer:
        order = desk.issuer.send("wasp-01", compose.release())
        with desk.issuer._ledger.changed:
            assert desk.issuer._ledger.changed.wait_for(lambda: order.envelopes, 20)
    heard = {key for key in desk.wire.subscriptions if "/trust/" not in key}
    assert heard == {"waypoint/global/ack/wasp-01/*", "waypoint/global/status/wasp-01"}
    assert len(desk.wire.subscriptions) == 2 + 3  # newer roots, lists and this device's bundles
    assert replace(order.answer) == Answer()


def test_a_node_s_challenge_is_echoed_as_long_as_it_gives_one(desk: Desk) -> None:
    """The newest, in every envelope; one of another length is none."""

    def echoed() -> bytes:
        envelope = AuthEnvelope.FromString(desk.wire.puts[-1][1])
        return EnvelopeHeader.FromString(envelope.header).node_challenge

    desk.issuer.watch("wasp-01")
    desk.send()
    assert echoed() == b""
    given = ((b"a" * 16, b"a" * 16), (b"b" * 16, b"b" * 16), (b"c" * 8, b""), (b"", b""))
    for at_ms, (challenge, echo) in enumerate(given, start=1):
        desk.tell(NodeStatus(at_ms=at_ms, node_challenge=challenge))
        assert len(desk.later(1000)) == 1 + (at_ms == 1)  # the first one too
        assert echoed() == echo


def test_what_the_node_holds_and_how_far_it_got_is_told(desk: Desk) -> None:
    """Each rung to whoever waits, and the facts beside the last word."""
    order, told = desk.send(), list[str]()
    (opened,) = desk.arrived()

    def on_told(answer: Answer) -> None:
        told.append(answer.stage)
        desk.clock.now_ms += 1
        desk.answer(order, opened.message.digest, revocation_version=7, time_quality=1, event_seq=9)

    desk.issuer.wait(order, 0, on_told)
    assert told == []
    desk.answer(order, opened.message.digest, result_state=ResultState.PENDING, stage=OrderStage.SENT)
    answer = desk.issuer.wait(order, 20, on_told)
    assert (told, answer.state) == (["sent"], "final")
    assert (answer.revocation_version, answer.time_quality, answer.event_seq) == (7, 1, 9)


def test_what_the_status_says_of_an_order(desk: Desk) -> None:
    """The gimbal, who commanded last, and what Alice may do."""
    order = desk.send(compose.point_at_place(52, 4, 0))
    (opened,) = desk.arrived()
    desk.answer(order, opened.message.digest, event_seq=9)
    assert desk.issuer.permissions("wasp-01") is None
    camera = CameraStatus(camera=1, command_id=order.command_id, callsign="ALICE", aim="arrived", error_cdeg=40)
    said = NodeStatus(at_ms=5, head_seq=9, cameras=[camera], command_enabled=True, camera_roles=["operator"])
    desk.tell(said)
    assert desk.issuer.wait_pointing(order, timeout_s=0).words() == "arrived, 0.4 deg off"
    assert desk.issuer.commander("wasp-01") == Commander("ALICE", order.command_id, holds=True)
    assert desk.issuer.commander("wasp-01", 2) is None
    may = desk.issuer.permissions("wasp-01")
    assert may is not None
    assert [one.allowed for one in may] == [True, False]
    desk.clock.now_ms += 100 * 24 * 3_600_000
    late = desk.issuer.permissions("wasp-01")
    assert late is not None
    assert late[0].because == "this identity has expired"
