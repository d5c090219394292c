"""The node's side of the mesh without a network: samples to observations, effects to envelopes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import pytest
from google.protobuf.message import Message

from autopilot.adapters.mesh.adapter import MeshAdapter
from autopilot.ports.config import MeshSection
from autopilot.ports.edges import InputClass
from autopilot.trust.envelope import MessageType
from autopilot.trust.gate import Gate
from autopilot.trust.keys import digest
from autopilot.trust.tally import Tally
from autopilot.trust.verdict import Opened
from autopilot.wire import keys
from events.schema.common_pb2 import Place
from events.schema.orders_pb2 import AckPublished, AckResult, OrderMalformed, OrderReceived, SendAck
from events.schema.vehicle_pb2 import VehicleLinkChanged
from events.schema.waypoint_pb2 import AckResult as WireResult
from events.schema.waypoint_pb2 import (
    CameraPitchYaw,
    CameraRelease,
    CameraRoi,
    CameraZoom,
    CommandAck,
    DeviceCommand,
    NodeStatus,
    PoiConfirm,
    PoiDecline,
    PrincipalKind,
    ResultState,
)
from tests.autopilot.trust.world import COMMAND_ID, KEY, FakeClock, FakeWire, Forge, people, seeded

POI = "0b7c5e2a-6f0e-8d3a-9a51-3f1f5a0c9d12"


@dataclass
class Node:
    """An adapter over a fake wire, and what it offered."""

    wire: FakeWire = field(default_factory=FakeWire)
    clock: FakeClock = field(default_factory=FakeClock)
    offered: list[tuple[InputClass, Message]] = field(default_factory=list)
    takes: bool = True
    has_origin: bool = True

    def __post_init__(self) -> None:
        config = MeshSection(samples_per_s=100_000, samples_burst=100_000)
        self.adapter = MeshAdapter(
            config, people().wasp, self.clock, self.locate, self.offer, wire=self.wire, random=seeded(5)
        )

    def locate(self, latitude_e7: int, longitude_e7: int, altitude_mm: int) -> Place | None:
        """A place without its cell."""
        place = Place(latitude_e7=latitude_e7, longitude_e7=longitude_e7, altitude_mm=altitude_mm, mgrs="31U")
        return place if self.has_origin else None

    def offer(self, input_class: InputClass, observation: Message) -> bool:
        """Take an observation, or refuse it."""
        self.offered += [(input_class, observation)] * self.takes
        return self.takes

    def turn(self) -> bool:
        """Let the outbox send."""
        return self.adapter._outbox.turn()


def command(**variant: object) -> bytes:
    target = people().wasp.public_key
    message = DeviceCommand(command_id=COMMAND_ID, target_node_pubkey=target, **variant)  # type: ignore[arg-type]
    return message.SerializeToString(deterministic=True)


def check_received(content: bytes) -> OrderReceived:
    """The content becomes an order that carries everything the core and a later proof need."""
    node, envelope = Node(), Forge(people().alice, content=content).envelope()
    node.adapter.receive(KEY, envelope)
    (taken,) = node.offered
    observation = taken[1]
    assert taken[0] is InputClass.ORDER
    assert isinstance(observation, OrderReceived)
    assert observation.issuer.principal_id == "alice"
    assert observation.issuer.callsign == "ALICE"
    assert list(observation.issuer.roles) == ["operator"]
    assert observation.issuer.device_key_id == people().alice.sign_key.key_id
    assert (observation.command_id, observation.order_seq) == (COMMAND_ID, 7)
    assert observation.body_digest == digest(content)
    assert (observation.life_ms, observation.nonce_life_ms) == (10_000, 20_000)
    assert observation.envelope == envelope
    assert len(observation.opened) > 32
    assert len(observation.in_reply_to) == 32
    assert len(observation.nonce) == 24
    assert node.adapter.tally() == replace(Tally(), received=1, opened=1)
    return observation


def check_malformed(because: str, content: bytes, *, has_origin: bool = True, key: str = KEY) -> OrderMalformed:
    """The content becomes a malformed order that says why, and can be answered."""
    node = Node(has_origin=has_origin)
    node.adapter.receive(key, Forge(people().alice, content=content, key_expr=key).envelope())
    ((input_class, observation),) = node.offered
    assert input_class is InputClass.ORDER
    assert isinstance(observation, OrderMalformed)
    assert because in observation.because
    assert observation.issuer.principal_id == "alice"
    assert observation.command_id == key.rpartition("/")[2]
    assert (len(observation.in_reply_to), len(observation.nonce)) == (32, 24)
    assert observation.nonce_life_ms == 20_000
    assert node.adapter.tally() == replace(Tally(), received=1, malformed=1)
    return observation


def test_a_place_is_worked_out_at_the_edge() -> None:
    order = check_received(command(camera_roi=CameraRoi(lat_e7=521_000_000, lon_e7=-43_000_000, altitude_dm=125)))
    assert order.WhichOneof("order") == "point_at_place"
    place = order.point_at_place.place
    assert (place.latitude_e7, place.longitude_e7, place.altitude_mm) == (521_000_000, -43_000_000, 12_500)
    assert (order.point_at_place.camera, place.mgrs) == (1, "31U")
    assert order.target_public_key == people().wasp.public_key


def test_angles_a_release_and_judgements_are_decoded() -> None:
    angles = CameraPitchYaw(pitch_cdeg=-9000, yaw_cdeg=35_999, camera=2, yaw_locked=True)
    order = check_received(command(camera_pitch_yaw=angles)).point_at_angles
    assert (order.pitch_cdeg, order.yaw_cdeg, order.camera, order.yaw_locked) == (-9000, 35_999, 2, True)
    assert check_received(command(camera_release=CameraRelease())).release_camera.camera == 1
    zoom = check_received(command(camera_zoom=CameraZoom(zoom_e4=10_000, camera=2))).zoom_camera
    assert (zoom.zoom_e4, zoom.camera) == (10_000, 2)
    assert check_received(command(camera_zoom=CameraZoom())).zoom_camera.camera == 1
    confirmed = check_received(command(poi_confirm=PoiConfirm(poi_id=POI))).judge_poi
    declined = check_received(command(poi_decline=PoiDecline(poi_id=POI))).judge_poi
    assert (confirmed.poi_id, confirmed.confirmed) == (POI, True)
    assert (declined.poi_id, declined.confirmed) == (POI, False)


def test_an_unknown_variant_is_an_order_with_nothing_ordered() -> None:
    order = check_received(command() + b"\x9a\x06\x02\x08\x01")  # field 99
    assert order.WhichOneof("order") is None
    assert check_received(command()).WhichOneof("order") is None


ROI = {"lat_e7": 1, "lon_e7": 1, "altitude_dm": 1}
OUT_OF_RANGE: dict[str, tuple[str, bytes]] = {
    "latitude": ("camera_roi.lat_e7", command(camera_roi=CameraRoi(**(ROI | {"lat_e7": 900_000_001})))),
    "south": ("camera_roi.lat_e7", command(camera_roi=CameraRoi(**(ROI | {"lat_e7": -900_000_001})))),
    "longitude": ("camera_roi.lon_e7", command(camera_roi=CameraRoi(**(ROI | {"lon_e7": 1_800_000_001})))),
    "west": ("camera_roi.lon_e7", command(camera_roi=CameraRoi(**(ROI | {"lon_e7": -1_800_000_001})))),
    "high": ("camera_roi.altitude_dm", command(camera_roi=CameraRoi(**(ROI | {"altitude_dm": 200_001})))),
    "deep": ("camera_roi.altitude_dm", command(camera_roi=CameraRoi(**(ROI | {"altitude_dm": -5_001})))),
    "up": ("camera_pitch_yaw.pitch_cdeg", command(camera_pitch_yaw=CameraPitchYaw(pitch_cdeg=9001))),
    "down": ("camera_pitch_yaw.pitch_cdeg", command(camera_pitch_yaw=CameraPitchYaw(pitch_cdeg=-9001))),
    "round": ("camera_pitch_yaw.yaw_cdeg", command(camera_pitch_yaw=CameraPitchYaw(yaw_cdeg=36_000))),
    "close": ("camera_zoom.zoom_e4", command(camera_zoom=CameraZoom(zoom_e4=10_001))),
    "a finding without id": ("poi_confirm.poi_id", command(poi_confirm=PoiConfirm())),
    "a finding in capitals": ("poi_decline.poi_id", command(poi_decline=PoiDecline(poi_id=POI.upper()))),
    "no content": ("SealedBody", b""),
    "no message": ("DeviceCommand", b"\xff\xff"),
    "no UTF-8": ("UTF-8", b"\x0a\x02\xff\xfe"),
    "no UUID": ("command_id", DeviceCommand(command_id="order-1").SerializeToString()),
    "a UUID without hyphens": (
        "command_id",
        DeviceCommand(command_id=COMMAND_ID.replace("-", "")).SerializeToString(),
    ),
    "another id than the key's": ("not the one in the key", DeviceCommand(command_id=POI).SerializeToString()),
}


@pytest.mark.parametrize("name", OUT_OF_RANGE)
def test_what_cannot_be_read_names_the_field(name: str) -> None:
    check_malformed(*OUT_OF_RANGE[name])


def test_the_bounds_themselves_are_inside() -> None:
    roi = CameraRoi(lat_e7=-900_000_000, lon_e7=1_800_000_000, altitude_dm=200_000)
    assert check_received(command(camera_roi=roi)).WhichOneof("order") == "point_at_place"


def test_without_an_origin_there_is_no_place() -> None:
    """The order goes to the core all the same, which refuses it once and for good."""
    node = Node(has_origin=False)
    content = command(camera_roi=CameraRoi(lat_e7=1, altitude_dm=3))
    node.adapter.receive(KEY, Forge(people().alice, content=content).envelope())
    ((_, observation),) = node.offered
    assert isinstance(observation, OrderReceived)
    assert observation.point_at_place.place == Place(latitude_e7=1, longitude_e7=0, altitude_mm=300)


def test_a_key_with_an_odd_id_is_answered_on_that_key() -> None:
    check_malformed("not the one in the key", command(), key="waypoint/global/cmd/wasp-01/odd")


def test_orders_for_others_or_on_other_keys_are_not_ours() -> None:
    for key in (
        "waypoint/global/cmd/hornet-02/" + COMMAND_ID,
        "waypoint/global/cmd/wasp-01",
        f"waypoint/global/cmd/wasp-01/{COMMAND_ID}/more",
        f"waypoint/global/ack/wasp-01/{COMMAND_ID}",
    ):
        node = Node()
        node.adapter.receive(key, Forge(people().alice, content=command(), key_expr=key).envelope())
        assert node.adapter.take_rejections() == {"route": 1}
        assert node.offered == []


def test_rejections_are_told_once() -> None:
    node = Node()
    node.adapter.receive(KEY, b"garbage")
    node.adapter.receive(KEY, b"garbage")
    node.adapter.receive(KEY, b"\xff" * 300)
    assert node.adapter.take_rejections() == {"parse_env": 1, "size": 2}
    assert node.adapter.take_rejections() == {}
    node.adapter.receive(KEY, b"garbage")
    assert node.adapter.take_rejections() == {"size": 1}
    assert node.adapter.tally().rejected["size"] == 3
    assert node.wire.puts == []


def test_a_restored_nonce_stops_a_replay() -> None:
    order = check_received(command(camera_release=CameraRelease()))
    node = Node()
    node.adapter.restore_window([(order.issuer.device_key_id, order.nonce, order.nonce_life_ms)])
    node.adapter.receive(KEY, order.envelope)
    assert node.adapter.take_rejections() == {"replay": 1}


def opened_ack(node: Node) -> Opened[bytes]:
    """Open the one envelope on the wire as Alice would."""
    ((key, payload, urgent),) = node.wire.puts
    gate: Gate[bytes] = Gate(
        people().alice,
        MessageType.ACK if urgent else MessageType.STATUS,
        kinds=frozenset({PrincipalKind.NODE}),
        is_ours=lambda _: True,
        reader=lambda _, content: content,
        clock=node.clock,
    )
    verdict = gate.judge(key, payload)
    assert isinstance(verdict, Opened)
    return verdict


ACK = SendAck(
    command_id=COMMAND_ID, result=AckResult.ACK_TIMEOUT, detail="d", final=True, in_reply_to=b"\x05" * 32, mav_result=4
)


def test_an_answer_is_sealed_bound_and_reported() -> None:
    node = Node()
    node.adapter.perform(42, ACK, node.clock.mono_ns())
    assert not node.turn()
    opened = opened_ack(node)
    ack = CommandAck.FromString(opened.content)
    assert node.wire.puts[0][0] == f"waypoint/global/ack/wasp-01/{COMMAND_ID}"
    assert opened.message.in_reply_to == b"\x05" * 32
    assert opened.message.sender.public_key == people().wasp.public_key
    assert (ack.command_id, ack.result, ack.detail, ack.mav_result) == (COMMAND_ID, WireResult.ACK_TIMEOUT, "d", 4)
    assert (ack.result_state, ack.event_seq, ack.duplicate) == (ResultState.FINAL, 42, False)
    assert (ack.acked_at_ms, ack.revocation_version, ack.time_quality) == (node.clock.now_ms, 1, 2)
    assert node.offered == [(InputClass.OUTCOME, AckPublished(effect_seq=42))]


def test_a_pending_or_repeated_answer_says_so() -> None:
    node = Node()
    node.adapter.perform(1, SendAck(command_id=COMMAND_ID, duplicate=True), node.clock.mono_ns())
    node.turn()
    ack = CommandAck.FromString(opened_ack(node).content)
    assert (ack.result_state, ack.duplicate) == (ResultState.PENDING, True)


def test_an_answer_waits_for_the_link_and_is_given_up_in_time() -> None:
    node = Node()
    node.wire.up = False
    node.adapter.perform(1, ACK, node.clock.mono_ns())
    assert node.turn()
    node.clock.now_ms += 29_999
    node.adapter.perform(2, ACK, node.clock.mono_ns())
    assert node.turn()
    assert node.offered == []
    node.clock.now_ms += 1
    assert node.turn()
    assert node.offered == [(InputClass.OUTCOME, AckPublished(effect_seq=1, failure="no link"))]
    node.wire.up = True
    assert not node.turn()
    assert node.offered[1:] == [(InputClass.OUTCOME, AckPublished(effect_seq=2))]
    assert len(node.wire.puts) == 1


def test_an_outcome_that_the_inbox_refuses_is_offered_again() -> None:
    node = Node(takes=False)
    node.adapter.perform(1, ACK, node.clock.mono_ns())
    assert node.turn()
    assert node.turn()
    node.takes = True
    assert not node.turn()
    assert node.offered == [(InputClass.OUTCOME, AckPublished(effect_seq=1))]
    assert len(node.wire.puts) == 1


def test_answers_beyond_the_bound_are_reported_at_once() -> None:
    node = Node()
    node.wire.up = False
    for seq in range(1025):
        node.adapter.perform(seq, ACK, node.clock.mono_ns())
    assert node.turn()
    assert node.offered == [(InputClass.OUTCOME, AckPublished(effect_seq=1024, failure="too many answers wait"))]


def test_a_full_inbox_answers_busy_without_a_last_word() -> None:
    node = Node(takes=False)
    node.adapter.receive(KEY, Forge(people().alice, content=command(camera_release=CameraRelease())).envelope())
    node.turn()
    ack = CommandAck.FromString(opened_ack(node).content)
    assert (ack.result, ack.result_state) == (WireResult.ACK_REJECTED, ResultState.PENDING)
    assert ack.detail.startswith("busy")
    assert not ack.HasField("event_seq")
    node.takes = True
    assert not node.turn()
    assert node.offered == []


def test_the_newest_status_wins_and_none_is_kept_for_later() -> None:
    node = Node()
    node.adapter.publish_status(NodeStatus(at_ms=1))
    node.adapter.publish_status(NodeStatus(at_ms=2))
    node.turn()
    node.turn()
    opened = opened_ack(node)
    assert NodeStatus.FromString(opened.content).at_ms == 2
    assert node.wire.puts[0][0] == "waypoint/global/status/wasp-01"
    node.wire.up = False
    node.adapter.publish_status(NodeStatus(at_ms=3))
    assert not node.turn()
    node.wire.up = True
    node.turn()
    assert len(node.wire.puts) == 1


def test_an_effect_of_another_port_is_left_alone() -> None:
    node = Node()
    node.adapter.perform(1, VehicleLinkChanged(), 0)
    assert not node.turn()
    assert (node.wire.puts, node.offered) == ([], [])


def test_the_threads_send_and_end() -> None:
    node = Node()
    node.adapter.start()
    assert list(node.wire.subscriptions) == ["waypoint/global/cmd/wasp-01/**"]
    node.adapter.perform(1, ACK, node.clock.mono_ns())
    node.adapter.stop()
    assert node.offered == [(InputClass.OUTCOME, AckPublished(effect_seq=1))]


def test_keys_come_apart_as_they_were_put_together() -> None:
    assert keys.order_address(keys.order_key("n", "c")) == keys.Address("n", "c")
    assert keys.ack_address(keys.ack_key("n", "c")) == keys.Address("n", "c")
    assert keys.status_node(keys.status_key("n")) == "n"
    odd: list[tuple[Callable[[str], object], str]] = [
        (keys.order_address, keys.ack_key("n", "c")),
        (keys.order_address, "waypoint/cell/cmd/n/c"),
        (keys.order_address, "waypoint/global/cmd/n/"),
        (keys.ack_address, "waypoint/global/ack/n/c/d"),
        (keys.status_node, "waypoint/global/status/"),
        (keys.status_node, "waypoint/global/status/n/m"),
    ]
    assert [take(key) for take, key in odd] == [None] * len(odd)
    assert len({channel.pattern for channel in keys.CHANNELS}) == len(keys.CHANNELS)


def test_a_defect_over_one_message_does_not_silence_the_rest(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The outbox says it and goes on."""
    node = Node()

    def broken() -> bool:
        raise RuntimeError("odd")

    with monkeypatch.context() as patch:
        patch.setattr(node.adapter._outbox, "turn", broken)
        assert not node.adapter._outbox._surely_turned()
    assert "odd" in capsys.readouterr().err
    node.adapter.perform(1, ACK, node.clock.mono_ns())
    assert not node.adapter._outbox._surely_turned()
    assert node.offered == [(InputClass.OUTCOME, AckPublished(effect_seq=1))]


def test_the_status_names_the_list_that_the_node_holds() -> None:
    """So that whoever holds a newer one sees that this node does not."""
    node, status = Node(), NodeStatus(at_ms=1)
    node.adapter.publish_status(status)
    assert status.revocation_version == people().alice.revocations.version
