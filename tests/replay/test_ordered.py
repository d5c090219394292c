"""Who gave an order, proved without the group key: each binding holds, and its absence is refused by its own words."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from autopilot.cli import export, replay, verify
from autopilot.ground import compose
from autopilot.ground.ordered import ProvedOrder, check_order, read_revoked
from autopilot.ground.papers import ProofRefused
from autopilot.ground.verifier import check
from autopilot.node.sealing import Sealer
from autopilot.trust import documents, pae
from autopilot.trust.identity import REVOCATIONS_FILE, ROOT_FILE
from events.schema.orders_pb2 import MissionVerb, OrderReceived
from events.schema.safety_pb2 import FLIGHT_MODE_LAND, FLIGHT_MODE_MISSION, FlightMode, OverrideScope
from events.schema.waypoint_pb2 import (
    AuthEnvelope,
    CameraZoom,
    DeviceCommand,
    EnvelopeHeader,
    PoiFollow,
    PrincipalKind,
    RevocationList,
)
from events.store import MemoryStore, create_flight
from replay.proof import prove
from tests.autopilot.cli.flown import run
from tests.autopilot.trust.world import COMMAND_ID, NOW_MS, FakeClock, people, resigned, retokened, seeded
from tests.flights import FLIGHT_ID, SECRET
from tests.replay.orders import (
    WORDS,
    addressee,
    command,
    command_with,
    forged,
    judged,
    of_seq,
    ordered_flight,
    recorded,
)
from tests.replay.test_proof import changed, papers, sealed

ORDER_SEQ = 5
FLIGHT_MODES = ("return", "loiter", "guided", "land")
SCOPES = ("battery_return", "link_return", "fence_return")


def proved(order: OrderReceived) -> ProvedOrder:
    """Check an order; return what is proved."""
    found = check_order(9, order.SerializeToString(deterministic=True), addressee())
    assert found is not None
    return found


def check_unproved(order: OrderReceived, because: str) -> None:
    """Check that an order is refused for a reason."""
    with pytest.raises(ProofRefused, match=because):
        check_order(9, order.SerializeToString(deterministic=True), addressee())


def test_who_gave_an_order_is_proved() -> None:
    """By name, key and voucher, at a time, for this node, as the gate recorded it."""
    alice, order = people().alice, proved(judged(forged()))
    assert (order.principal, order.callsign, order.roles) == ("alice", "ALICE", ("operator",))
    assert (order.device_key, order.token_key) == (alice.public_key, alice.trust.keys["token"])
    assert (order.command_id, order.issued_at_ms, order.order_seq, order.node) == (COMMAND_ID, NOW_MS, 7, "wasp-01")
    assert (order.asked, order.list_version) == (WORDS, None)
    for part in (f"alice (ALICE) signed order {COMMAND_ID} for wasp-01", WORDS, alice.public_key.hex(), "2026-09-21"):
        assert part in order.words()


@pytest.mark.parametrize(
    ("ordered", "asked"),
    [
        (compose.point_at_angles(-30.5, 90, north=True), "point camera 1 to pitch -30.50, yaw 90.00 from north"),
        (compose.point_at_angles(5, 1, camera=2), "point camera 2 to pitch 5.00, yaw 1.00 from the nose"),
        (compose.release(), "let go of camera 1"),
        (compose.judge(COMMAND_ID, confirmed=True), f"confirm finding {COMMAND_ID}"),
        (compose.judge(COMMAND_ID, confirmed=False), f"decline finding {COMMAND_ID}"),
        (compose.point_at_place(-1, -2, -3), "point camera 1 at -1.0000000 -2.0000000, -3.0 m AMSL"),
        (compose.zoom(30.5), "zoom camera 1 to 30.50 % of its range"),
        (DeviceCommand(camera_zoom=CameraZoom(zoom_e4=5)), "zoom camera 1 to 0.05 % of its range"),
        (DeviceCommand(poi_follow=PoiFollow(poi_id=COMMAND_ID)), f"keep finding {COMMAND_ID} in view with camera 1"),
        (compose.zoom(0, 2), "zoom camera 2 to 0.00 % of its range"),
        (compose.fly(52.1, -4.3, 60), "fly to 52.1000000 -4.3000000, 60.0 m AMSL, and stay there"),
        *((compose.flight_mode(mode), f"put the vehicle into mode {mode}") for mode in FLIGHT_MODES),
        (compose.flight_mode("hover"), "put the vehicle into mode (none that this version knows)"),
        *(
            (compose.override(scope, 90, "it's on fire"), f'hold {scope} off for 90.0 s, because of "it\'s on fire"')
            for scope in SCOPES
        ),
        (compose.override("all", 1, ""), "hold (none that this version knows) off for 1.0 s, because of ''"),
        (compose.override("link_return", 1, "a\nb"), "hold link_return off for 1.0 s, because of 'a\\nb'"),
        (compose.acknowledge(17), "take on self-test 17 as it came out"),
        *((compose.mission(verb), f"{verb} the mission") for verb in ("begin", "pause", "resume", "abort")),
        (compose.mission("dance"), "do something that this version does not know with the mission"),
        (compose.follow(COMMAND_ID), f"keep finding {COMMAND_ID} in view with camera 1"),
        (compose.follow(COMMAND_ID, 2), f"keep finding {COMMAND_ID} in view with camera 2"),
        (DeviceCommand(), "do something that this version does not know"),
    ],
)
def test_what_was_ordered_is_read_from_the_signed_bytes(ordered: DeviceCommand, asked: str) -> None:
    ordered.command_id, ordered.target_node_pubkey = COMMAND_ID, people().wasp.public_key
    assert proved(judged(forged(ordered))).asked == asked


def test_a_log_without_the_envelope_proves_no_giver() -> None:
    """It is said so, and is no lie."""
    bare = judged(forged())
    bare.ClearField("envelope")
    assert check_order(9, bare.SerializeToString(deterministic=True), addressee()) is None
    flight = ordered_flight(bare)
    found = check(prove(sealed_flight(flight.records), ORDER_SEQ, papers()))
    assert found.orders == ()
    assert found.order_words() == ("Not proved: who gave the order of record 5, for the log holds no envelope of it",)


def _in_header(**values: Any) -> dict[str, Any]:
    def spoil(header: EnvelopeHeader) -> None:
        for name, value in values.items():
            setattr(header, name, value)

    return {"spoil_header": spoil}


def _flipped(part: str) -> Callable[[AuthEnvelope], None]:
    def spoil(envelope: AuthEnvelope) -> None:
        data = bytearray(getattr(envelope, part))
        data[len(data) // 2] ^= 1
        setattr(envelope, part, bytes(data))

    return spoil


def _given(**values: Any) -> Any:
    """Return Alice with a token that says otherwise, signed by the Directory."""

    def change(token: Any) -> None:
        for name, value in values.items():
            setattr(token, name, value)

    return retokened(people().alice, change)


@pytest.mark.parametrize(
    ("spoilt", "because"),
    [
        (_in_header(type=2), "carries no order"),
        (_in_header(deployment_id="inland"), "of another deployment"),
        (_in_header(token_digest=bytes(32)), "not the one that was signed for"),
        (_in_header(device_key_id=bytes(16)), "token is of another device"),
        (_in_header(owner_principal_id="bob"), "token is of another principal"),
        (_in_header(body_commitment=bytes(32)), "opened text is not the one"),
        (_in_header(key_expr=f"waypoint/global/cmd/hornet-02/{COMMAND_ID}"), "sent to another node"),
        (_in_header(key_expr="waypoint/global/cmd/wasp-01/other"), "sent to another node"),
        ({"spoil_envelope": _flipped("ciphertext")}, "signature does not match"),
        ({"spoil_envelope": _flipped("device_signature")}, "signature does not match"),
        ({"spoil_envelope": lambda envelope: resigned(envelope, people().bob)}, "signature does not match"),
        ({"spoil_envelope": lambda envelope: setattr(envelope, "v", 2)}, "is no envelope"),
        ({"spoil_envelope": lambda envelope: envelope.ClearField("ciphertext")}, "is no envelope"),
        ({"issued_at_ms": NOW_MS - 400 * 86_400_000}, "was not valid then"),
        ({"issued_at_ms": NOW_MS + 400 * 86_400_000}, "was not valid then"),
        ({"identity": people(2).alice}, "key that is not known"),
        ({"identity": _given(deployment_id="inland")}, "token is of another deployment"),
        ({"identity": _given(kind=PrincipalKind.NODE)}, "is no operator"),
        ({"identity": _given(kind=PrincipalKind.SERVICE)}, "is no operator"),
        ({"identity": _given(device_sign_pk=people().bob.public_key)}, "token is of another device"),
        ({"identity": retokened(people().alice, lambda _: None, signer="revoke")}, "key that is not known"),
        ({"ordered": command(target_node_pubkey=people().hornet.public_key)}, "bound to another node's key"),
        ({"ordered": command(command_id="0b7c5e2a-6f0e-4d3a-9a51-3f1f5a0c9d12")}, "sent to another node"),
    ],
)
def test_each_binding_of_the_envelope(spoilt: dict[str, Any], because: str) -> None:
    """Everything else is right, signed again where it was signed: what is left refuses it."""
    check_unproved(recorded(forged(**spoilt)), because)


@pytest.mark.parametrize(
    ("change", "because"),
    [
        (lambda one: setattr(one.issuer, "principal_id", "bob"), "principal was recorded otherwise"),
        (lambda one: setattr(one.issuer, "device_key_id", bytes(16)), "device was recorded otherwise"),
        (lambda one: setattr(one, "command_id", "other"), "command_id was recorded otherwise"),
        (lambda one: setattr(one, "body_digest", bytes(32)), "body was recorded otherwise"),
        (lambda one: setattr(one, "target_public_key", bytes(32)), "target was recorded otherwise"),
        (lambda one: setattr(one, "order_seq", 8), "number was recorded otherwise"),
        (lambda one: setattr(one, "nonce", of_seq(2)), "nonce was recorded otherwise"),
        (lambda one: setattr(one, "in_reply_to", bytes(32)), "reference was recorded otherwise"),
        (lambda one: setattr(one, "issued_at_ms", NOW_MS + 1), "time was recorded otherwise"),
        (lambda one: setattr(one.point_at_place, "camera", 2), "order was recorded otherwise"),
        (lambda one: setattr(one.point_at_place.place, "latitude_e7", 1), "order was recorded otherwise"),
        (lambda one: setattr(one.point_at_place.place, "altitude_mm", 1), "order was recorded otherwise"),
        (lambda one: one.release_camera.SetInParent(), "order was recorded otherwise"),
        (lambda one: one.ClearField("point_at_place"), "order was recorded otherwise"),
        (lambda one: setattr(one, "opened", one.opened[:-1]), "opened text is not the one"),
        (lambda one: setattr(one, "envelope", one.envelope + b"\x08\x01"), "out of order"),
        (lambda one: setattr(one, "envelope", one.envelope + b"\x32\x00"), "is no envelope"),
        (lambda one: setattr(one, "envelope", b"\x08"), "ends within"),
    ],
)
def test_a_node_that_records_otherwise_is_found_out(change: Callable[[OrderReceived], object], because: str) -> None:
    """What stands beside the envelope is what was signed, or nothing is proved."""
    order = judged(forged())
    assert proved(order)
    change(order)
    check_unproved(order, because)


FLY, MODE = compose.fly(52.1, 4.3, 60), compose.flight_mode("loiter")
OVERRIDE, BEGIN = compose.override("link_return", 90, "in view"), compose.mission("begin")
FOLLOW = compose.follow(COMMAND_ID, 2)


@pytest.mark.parametrize(
    ("ordered", "change"),
    [
        (FLY, lambda one: setattr(one.fly_to_place.place, "latitude_e7", 521_000_001)),
        (FLY, lambda one: setattr(one.fly_to_place.place, "longitude_e7", -43_000_000)),
        (FLY, lambda one: setattr(one.fly_to_place.place, "altitude_mm", 60_100)),
        (FLY, lambda one: one.point_at_place.place.CopyFrom(one.fly_to_place.place)),
        (MODE, lambda one: setattr(one.set_flight_mode, "mode", FlightMode.FLIGHT_MODE_RETURN)),
        (MODE, lambda one: setattr(one.set_flight_mode, "mode", FlightMode.FLIGHT_MODE_UNSPECIFIED)),
        (compose.flight_mode("mission"), lambda one: setattr(one.set_flight_mode, "mode", FLIGHT_MODE_MISSION)),
        (compose.flight_mode("hover"), lambda one: setattr(one.set_flight_mode, "mode", FLIGHT_MODE_LAND)),
        (OVERRIDE, lambda one: setattr(one.override_safety, "scope", OverrideScope.OVERRIDE_BATTERY_RETURN)),
        (OVERRIDE, lambda one: setattr(one.override_safety, "reason", "in sight")),
        (OVERRIDE, lambda one: setattr(one.override_safety, "held_for_ms", 900_000)),
        (compose.override("all", 1, "x"), lambda one: setattr(one.override_safety, "scope", 3)),
        (compose.acknowledge(17), lambda one: setattr(one.acknowledge_selftest, "report_id", 18)),
        (BEGIN, lambda one: setattr(one.mission, "verb", MissionVerb.MISSION_ABORT)),
        (BEGIN, lambda one: one.mission.Clear()),
        (compose.mission("dance"), lambda one: setattr(one.mission, "verb", MissionVerb.MISSION_BEGIN)),
        (FOLLOW, lambda one: setattr(one.follow_poi, "poi_id", COMMAND_ID[::-1])),
        (FOLLOW, lambda one: setattr(one.follow_poi, "camera", 1)),
        (FOLLOW, lambda one: setattr(one.judge_poi, "poi_id", COMMAND_ID)),
        (FOLLOW, lambda one: one.ClearField("follow_poi")),
        (compose.zoom(30), lambda one: setattr(one.zoom_camera, "zoom_e4", 3001)),
        (compose.zoom(30), lambda one: setattr(one.zoom_camera, "camera", 2)),
        (compose.release(), lambda one: setattr(one.mission, "verb", MissionVerb.MISSION_BEGIN)),
    ],
)
def test_a_node_that_flies_otherwise_than_was_signed_is_found_out(
    ordered: DeviceCommand, change: Callable[[OrderReceived], object]
) -> None:
    """Each value of each order of the flight, and one kind for another."""
    order = judged(forged(command_with(ordered)))
    assert proved(order)
    change(order)
    check_unproved(order, "order was recorded otherwise")


def test_of_two_orders_in_one_the_last_counts_as_it_does_for_a_node() -> None:
    """Bytes that were signed may hold both arms of a oneof; a node carries out the one behind."""
    both = command_with(MODE).SerializeToString() + compose.follow(COMMAND_ID).SerializeToString()
    head = command_with(compose.release()).SerializeToString()
    twofold = forged(content=head + compose.mission("abort").SerializeToString())
    assert proved(judged(twofold)).asked == "abort the mission"
    assert proved(judged(forged(content=both))).asked == f"keep finding {COMMAND_ID} in view with camera 1"


def test_an_envelope_is_of_the_node_and_deployment_in_question() -> None:
    """The same order proves nothing for another addressee."""
    body, to = judged(forged()).SerializeToString(deterministic=True), addressee()
    for other, because in (
        (to._replace(node="hornet-02"), "another node"),
        (to._replace(node_key=people().hornet.public_key), "another node's key"),
        (to._replace(deployment="inland"), "another deployment"),
        (to._replace(token_key=people(2).wasp.trust.keys["token"]), "not known"),
    ):
        with pytest.raises(ProofRefused, match=because):
            check_order(9, body, other)


def revocations(signer: str = "revoke", **values: Any) -> bytes:
    """Return a revocation list of the Directory."""
    given: dict[str, Any] = {"v": 1, "deployment_id": "coast-watch", "version": 12}
    listed = RevocationList(**(given | values))
    return documents.sign(pae.REVOCATION_LIST, listed, [people().directory.purpose_keys[signer]])


def test_a_giver_on_the_revocation_list_is_refused() -> None:
    """By name, key or token; a list by another key or deployment is none; and who is not on it is said not to be."""
    root = (people().wasp.folder / ROOT_FILE).read_bytes()
    body, alice = judged(forged()).SerializeToString(deterministic=True), people().alice
    fine = check_order(9, body, addressee(), read_revoked(revocations(principals=["bob"]), root))
    assert fine is not None
    assert "is not on revocation list 12" in fine.words()
    for listed in (
        {"principals": ["alice", "bob"]},
        {"device_key_ids": [alice.sign_key.key_id]},
        {"token_ids": [alice.token.token_id]},
    ):
        with pytest.raises(ProofRefused, match="on revocation list 12"):
            check_order(9, body, addressee(), read_revoked(revocations(**listed), root))
    with pytest.raises(ProofRefused, match="not known"):
        read_revoked(revocations(signer="token"), root)
    with pytest.raises(ProofRefused, match="another deployment"):
        read_revoked(revocations(deployment_id="inland"), root)


def sealed_flight(records: Any) -> MemoryStore:
    """Return a signed log of these records."""
    return sealed(records=records)


def test_a_decision_is_proved_together_with_who_ordered_it() -> None:
    """The answer, and back to the order; under 10 KB; a proof of which the order does not hold is none."""
    flight = ordered_flight()
    last = flight.records[-1]
    data = prove(sealed_flight(flight.records), last.seq, papers())
    found = check(data, (people().wasp.folder / ROOT_FILE).read_bytes(), revocations())
    assert [one.seq for one in found.orders] == [ORDER_SEQ]
    assert [one.kind.name for one in (flight.records[one.seq] for one in found.records)] == [
        *("send_ack", "command_answered", "point_at_place", "order_received")
    ]
    assert found.order_words() == (found.orders[0].words(),)
    assert len(data) < 10_000
    bad = judged(forged())
    bad.issuer.principal_id = "bob"
    other = ordered_flight(bad)
    with pytest.raises(ProofRefused, match="principal was recorded otherwise"):
        check(prove(sealed_flight(other.records), ORDER_SEQ, papers()))
    with pytest.raises(ProofRefused, match="on revocation list"):
        check(data, None, revocations(principals=["alice"]))


def with_body(data: bytes, text: str) -> bytes:
    """Return a proof whose first record has another body."""
    return changed(data, lambda proof: proof["records"][0].update(body=text))


def test_no_bit_of_a_proved_order_can_be_changed() -> None:
    """Every 5th bit of the record's body."""
    flight = ordered_flight()
    data = prove(sealed_flight(flight.records), ORDER_SEQ, papers())
    body = base64.b64decode(json.loads(data)["records"][0]["body"])
    for bit in range(0, len(body) * 8, 41):
        flipped = bytearray(body)
        flipped[bit // 8] ^= 1 << bit % 8
        text = base64.b64encode(flipped).decode()
        with pytest.raises(ProofRefused):
            check(with_body(data, text))


def test_the_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`replay why` says who signed, `export proof` and `verify` prove it to anybody."""
    flight, store = create_flight(tmp_path, 3, FLIGHT_ID, SECRET)
    told = ordered_flight()
    records = told.records
    sealing = Sealer(people().wasp, FakeClock(), seeded(7)).open(flight, store, told.state)
    store.append(records)
    sealing.close(5_000)
    store.close()
    folder, out, last = str(flight.folder), str(tmp_path / "proof.json"), str(records[-1].seq)
    assert run(replay, ["replay", "why", folder, last]) == 0
    said = capsys.readouterr().out
    assert f"record 5: Proved: alice (ALICE) signed order {COMMAND_ID} for wasp-01, to {WORDS}" in said
    assert run(replay, ["replay", "why", folder, last, "--json"]) == 0
    assert "Proved: alice" in json.loads(capsys.readouterr().out)["signed"]["5"]
    assert run(export, ["export", "proof", folder, "--seq", last, out]) == 0
    assert run(verify, ["verify", out, "--revocations", str(people().alice.folder / REVOCATIONS_FILE)]) == 0
    assert "Proved: alice (ALICE) signed order" in capsys.readouterr().out
    assert run(verify, ["verify", out, "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)["orders"]
    assert (told["principal"], told["device_key"]) == ("alice", people().alice.public_key.hex())
    listed = tmp_path / "listed"
    listed.write_bytes(revocations(principals=["alice"]))
    assert run(verify, ["verify", out, "--revocations", str(listed)]) == 65
    assert "record 5, order: the sender is on revocation list 12" in capsys.readouterr().err
    (flight.folder / ROOT_FILE).write_bytes((people(2).wasp.folder / ROOT_FILE).read_bytes())
    assert run(replay, ["replay", "why", folder, last]) == 0
    assert "record 5: Not proved: who gave it: token" in capsys.readouterr().out
    (flight.folder / ROOT_FILE).unlink()
    assert run(replay, ["replay", "why", folder, last]) == 0
    assert "nothing beside the log vouches for keys" in capsys.readouterr().out
