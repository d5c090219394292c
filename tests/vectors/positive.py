"""Makes the positive vectors: order, ack, status and presence with every value between; papers; a checkpoint."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

from google.protobuf.message import Message

from autopilot.trust.documents import PURPOSES
from autopilot.trust.envelope import MessageType, Packer, open_sealed, sealing_key, signature_input
from autopilot.trust.identity import Identity
from autopilot.trust.keys import key_id
from autopilot.trust.notes import Checkpoint, LogKey, sign_note
from autopilot.trust.pae import ENVELOPE_SEAL, le64, pae
from autopilot.wire.keys import ack_key, order_key, presence_key, status_key
from events.chain import Chain, salt_of
from events.records import Moment
from events.schema.waypoint_pb2 import (
    AckResult,
    AuthEnvelope,
    CameraRoi,
    CommandAck,
    DeviceCommand,
    EnvelopeHeader,
    NodeStatus,
    OperatorPresence,
    ResultState,
    SignedDoc,
)
from events.tree import Peaks
from tests.autopilot.trust.world import FakeClock
from tests.vectors import cast

Vector = dict[str, Any]
FLIGHT_ID = cast.secret("flight", 16)


def keys() -> Vector:
    """Return every key, by name."""
    names = ("root", *(f"dir.{purpose}" for purpose in PURPOSES), *cast.PEOPLE, "wasp-01/3")
    signing = {name: cast.sign_key(name) for name in names}
    boxes = {name: cast.box_key(name) for name in cast.PEOPLE}
    return {
        "sign": {
            name: {"seed": key.seed.hex(), "public": key.public.hex(), "key_id": key_id(key.public).hex()}
            for name, key in signing.items()
        },
        "box": {name: {"secret": key.secret.hex(), "public": key.public.hex()} for name, key in boxes.items()},
        "epoch": {"1": cast.secret("epoch.1").hex()},
    }


def papers() -> Vector:
    """Return the documents of the Directory, each with what is signed."""
    trust_root = _paper("TrustRoot", cast.signed("TrustRoot", cast.root()))
    tokens = {name: _paper("IdentityToken", cast.signed("IdentityToken", cast.token(name))) for name in cast.PEOPLE}
    lists = {name: _paper("RevocationList", data) for name, data in cast.lists().items()}
    epoch = _paper("EpochBundle", cast.signed("EpochBundle", cast.bundle("alice")))
    epoch |= {"ephemeral_secret": cast.secret("alice.ephemeral").hex(), "recipient": "alice"}
    beacon = _paper("TimeBeacon", cast.signed("TimeBeacon", cast.beacon()))
    return {
        "trust_root": trust_root,
        "tokens": tokens,
        "revocations": lists,
        "epoch_bundle": epoch,
        "time_beacon": beacon,
        "pairs": PAIRS,
    }


PAIRS = [  # what a receiver that holds the first says of the second
    {"held": "v12", "offered": "v13", "expected": "accepted"},
    {"held": "v13", "offered": "v13", "expected": "nothing new"},
    {"held": "v13", "offered": "v12", "expected": "rl_rollback"},
    {"held": "v13", "offered": "v13_other", "expected": "rl_equivocation"},
]


def _paper(kind: str, data: bytes) -> Vector:
    context, signer = cast.SIGNERS[kind]
    document = SignedDoc.FromString(data)
    return {
        "context": context.decode(),
        "signer": signer,
        "body": document.body.hex(),
        "signature_input": pae(context, document.body).hex(),
        "signature": document.sigs[0].sig.hex(),
        "document": data.hex(),
        "digest": hashlib.blake2b(data, digest_size=32).hexdigest(),
    }


def order_content() -> bytes:
    """Return the order: look at a place."""
    roi = CameraRoi(lat_e7=521_000_000, lon_e7=43_000_000, altitude_dm=125)
    command = DeviceCommand(
        command_id=cast.COMMAND_ID, target_node_pubkey=cast.sign_key("wasp-01").public, camera_roi=roi
    )
    return command.SerializeToString(deterministic=True)


def messages() -> Vector:
    """Return order, ack, status and presence, from their content to the envelope."""
    key = order_key("wasp-01", cast.COMMAND_ID)
    order = _message("alice", MessageType.ORDER, key, order_content(), ttl_ms=10_000, order_seq=5)
    said = CommandAck(
        command_id=cast.COMMAND_ID,
        result=AckResult.ACK_ACCEPTED,
        detail="camera 1 points at the place",
        acked_at_ms=cast.NOW_MS + 40,
        result_state=ResultState.FINAL,
        revocation_version=12,
        event_seq=17,
    )
    answers = bytes.fromhex(order["digest"])
    ack = _message(
        "wasp-01",
        MessageType.ACK,
        ack_key("wasp-01", cast.COMMAND_ID),
        _bytes(said),
        ttl_ms=30_000,
        in_reply_to=answers,
    )
    seen = NodeStatus(at_ms=cast.NOW_MS, flight_id=FLIGHT_ID, head_seq=17, health="normal", command_enabled=True)
    status = _message("wasp-01", MessageType.STATUS, status_key("wasp-01"), _bytes(seen), ttl_ms=10_000)
    here = OperatorPresence(heard_head_seq=17)
    presence = _message("alice", MessageType.PRESENCE, presence_key("wasp-01", "alice"), _bytes(here), ttl_ms=3_000)
    return {"order": order, "ack": ack, "status": status, "presence": presence}


def _bytes(message: Message) -> bytes:
    return message.SerializeToString(deterministic=True)


def packer(name: str, label: str) -> Packer:
    """Return what seals for a device, its chance taken from `label`."""
    drawn = (cast.secret(f"{label}.{number}", 64) for number in range(99))
    return Packer(cast.identity(name), FakeClock(cast.NOW_MS), lambda size: next(drawn)[:size])


def _message(name: str, kind: MessageType, key_expr: str, content: bytes, **how: Any) -> Vector:
    packed = packer(name, kind.name.lower()).pack(kind, key_expr, content, **how)
    return {"sender": name, "content": content.hex(), **taken_apart(cast.identity(name), kind, packed.envelope)}


def taken_apart(sender: Identity, kind: MessageType, envelope: bytes) -> Vector:
    """Return every intermediate value of an envelope that `sender` sealed."""
    outer = AuthEnvelope.FromString(envelope)
    header = EnvelopeHeader.FromString(outer.header)
    epoch = sender.epochs[header.epoch_id]
    key = sealing_key(kind, epoch, header.device_key_id)
    plaintext = open_sealed(key, header.nonce, outer.header, outer.ciphertext)
    signed = signature_input(outer.header, outer.token, outer.ciphertext)
    values = {
        "plaintext": plaintext,
        "commitment": hashlib.sha256(plaintext).digest(),
        "header": outer.header,
        "aad": pae(ENVELOPE_SEAL, outer.header),
        "sealing_key_input": le64(header.epoch_id) + header.device_key_id,
        "sealing_key": key,
        "nonce": header.nonce,
        "ciphertext": outer.ciphertext,
        "token": outer.token,
        "signature_input": signed,
        "device_signature": outer.device_signature,
        "digest": hashlib.blake2b(signed, digest_size=32).digest(),
        "envelope": envelope,
    }
    named = {"key_expr": header.key_expr, "type": header.type, "in_reply_to": header.in_reply_to.hex()}
    return named | {name: value.hex() for name, value in values.items()}


def checkpoint() -> Vector:
    """Return three records, their leaves, the root over them, and the note that the log's key signs."""
    secret = cast.secret("flight.secret")
    chain, peaks, records = Chain(FLIGHT_ID, secret), Peaks(), []
    for seq, (cause, kind, body) in enumerate(_BODIES):
        at = Moment(seq * 1_000_000, seq * 1_000_000 + 5, 2, cast.NOW_MS * 1_000_000 + seq, 3)
        before = chain.leaf
        leaf = chain.extend(seq, cause, at, kind, 1, body)
        peaks.append(leaf)
        numbers = [seq, cause, *at, kind, 1]
        told = {"salt": salt_of(secret, seq), "body": body, "leaf_before": before, "leaf": leaf}
        records.append({"numbers": numbers} | {name: data.hex() for name, data in told.items()})
    key = cast.sign_key("wasp-01/3")
    certified = LogKey(
        deployment_id=cast.DEPLOYMENT, node="wasp-01", flight_number=3, flight_id=FLIGHT_ID, public_key=key.public
    )
    text = Checkpoint(certified.origin, 3, peaks.root(), 2_000_000).text()
    return {
        "flight_id": FLIGHT_ID.hex(),
        "flight_secret": secret.hex(),
        "records": records,
        "root": peaks.root().hex(),
        "origin": certified.origin,
        "note": sign_note(text, certified.origin, key),
        "certificate": sign_note(certified.text(), certified.signer, cast.sign_key("wasp-01")),
    }


_BODIES: Sequence[tuple[int, int, bytes]] = ((-1, 1, b"one"), (0, 2, b""), (0, 3, b"three" * 9))
