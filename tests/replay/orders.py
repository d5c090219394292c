"""A flight with a real order in it: sealed by an operator, opened by the node's gate, and in the log as it came."""

from __future__ import annotations

from typing import Any

from autopilot.adapters.mesh.orders import order_received, read_order
from autopilot.ground import compose
from autopilot.ground.ordered import Addressee
from autopilot.trust.clock import Clock
from autopilot.trust.envelope import MessageType, signature_input
from autopilot.trust.gate import Gate
from autopilot.trust.keys import digest
from autopilot.trust.pae import le64
from autopilot.trust.verdict import Opened
from events.schema.common_pb2 import Issuer
from events.schema.orders_pb2 import OrderReceived
from events.schema.waypoint_pb2 import AuthEnvelope, DeviceCommand, EnvelopeHeader, SealedBody
from tests import flights
from tests.autopilot.trust.world import COMMAND_ID, ISSUERS, KEY, FakeClock, Forge, people
from tests.flights import Flight, answered, limits

WORDS = "point camera 1 at 52.1000000 4.3000000, 12.5 m AMSL"


def addressee() -> Addressee:
    """Return node wasp-01, and whom it believes."""
    wasp = people().wasp
    return Addressee(wasp.deployment_id, wasp.principal_id, wasp.public_key, wasp.trust.keys["token"])


def command(**changes: Any) -> DeviceCommand:
    """Return what is ordered of wasp-01."""
    made = compose.point_at_place(52.1, 4.3, 12.5)
    made.command_id, made.target_node_pubkey = COMMAND_ID, people().wasp.public_key
    for name, value in changes.items():
        setattr(made, name, value)
    return made


def forged(ordered: DeviceCommand | None = None, **spoilt: Any) -> Forge:
    """Return an order of Alice's, of which a test may spoil a part."""
    values: dict[str, Any] = {"identity": people().alice, "key_expr": KEY}
    return Forge(**(values | {"content": (ordered or command()).SerializeToString(deterministic=True)} | spoilt))


def recorded(forge: Forge, **changes: Any) -> OrderReceived:
    """Return the observation as a node would have made it that believes everything."""
    raw, opened = forge.envelope(), forge.plaintext()
    envelope = AuthEnvelope.FromString(raw)
    header = EnvelopeHeader.FromString(envelope.header)
    body = SealedBody.FromString(opened[32:])
    ordered = DeviceCommand.FromString(body.content)
    sender = forge.identity
    made = OrderReceived(
        issuer=Issuer(
            principal_id=sender.principal_id, callsign=sender.callsign, device_key_id=header.device_key_id, roles=["r"]
        ),
        command_id=ordered.command_id,
        body_digest=digest(body.content),
        target_public_key=ordered.target_node_pubkey,
        order_seq=body.order_seq,
        nonce=header.nonce,
        nonce_life_ms=45_000,
        life_ms=10_000,
        in_reply_to=digest(signature_input(envelope.header, envelope.token, envelope.ciphertext)),
        issued_at_ms=header.issued_at_ms,
        envelope=raw,
        opened=opened,
    )
    as_asked = read_ordered(ordered)
    made.MergeFrom(as_asked)
    for name, value in changes.items():
        setattr(made, name, value)
    return made


def read_ordered(ordered: DeviceCommand) -> OrderReceived:
    """Return what a node records as asked, alone."""
    whole = judged(forged(command_with(ordered)))
    bare = OrderReceived()
    arm = whole.WhichOneof("order")
    if arm is not None:
        getattr(bare, arm).CopyFrom(getattr(whole, arm))
    return bare


def command_with(ordered: DeviceCommand) -> DeviceCommand:
    """Return the same asked of wasp-01 under the id of its key, whatever a test has spoilt."""
    made = DeviceCommand()
    made.CopyFrom(ordered)
    made.command_id, made.target_node_pubkey = COMMAND_ID, people().wasp.public_key
    return made


def judged(forge: Forge, clock: Clock | None = None) -> OrderReceived:
    """Return what the node's own gate and reader make of an envelope."""
    gate = Gate(
        people().wasp,
        MessageType.ORDER,
        kinds=ISSUERS,
        is_ours=lambda key: key == forge.key_expr,
        reader=lambda message, content: read_order(message, content, lambda *_: flights.place(0, 0)),
        clock=clock or FakeClock(),
    )
    verdict = gate.judge(forge.key_expr, forge.envelope())
    assert isinstance(verdict, Opened), verdict
    made = order_received(verdict)
    arm, asked_of = made.WhichOneof("order"), DeviceCommand.FromString(verdict.content)
    places: dict[str, tuple[Any, Any]] = {
        "point_at_place": (asked_of.camera_roi, made.point_at_place),
        "fly_to_place": (asked_of.fly_to_waypoint, made.fly_to_place),
    }
    if arm in places:  # the place of a test lies where the order says
        asked, spot = places[arm][0], places[arm][1].place
        spot.latitude_e7, spot.longitude_e7, spot.altitude_mm = asked.lat_e7, asked.lon_e7, asked.altitude_dm * 100
    return made


def ordered_flight(order: OrderReceived | None = None) -> Flight:
    """Return a flight of wasp-01 in which Alice's order is accepted."""
    wasp = people().wasp
    manifest = flights.opened(
        limits(camera_roles=["operator"]),
        node=wasp.principal_id,
        node_public_key=wasp.public_key,
        deployment_id=wasp.deployment_id,
        flight_number=3,
    )
    flight = Flight(manifest, *flights.opened_well()[1:])
    flight.tell(order or judged(forged()), 100)
    flight.tell(answered(flight.effect()), 30)
    return flight


def of_seq(seq: int) -> bytes:
    """Return a nonce that belongs to a running number, and is not the one of `forged`."""
    return le64(seq) + bytes(16)
