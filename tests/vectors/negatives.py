"""Makes the negative vectors: for each counter of the gate at least one envelope that must end in it.

A case is an envelope, the key that it arrives on, the receiver's clock, and what is not usual about the receiver:
another revocation list, epoch, bucket, nonces that it holds, or envelopes that came before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from google.protobuf.message import Message

from autopilot.trust import documents, pae
from autopilot.trust.envelope import MessageType
from autopilot.trust.identity import Identity
from autopilot.trust.keys import digest, key_id
from autopilot.wire.keys import ack_key, order_key, presence_key
from events.schema.waypoint_pb2 import AuthEnvelope, EnvelopeHeader, IdentityToken
from tests.autopilot.trust.world import Forge, resigned
from tests.vectors import cast
from tests.vectors.positive import order_content, packer

Vector = dict[str, Any]
Change = Callable[[Any], None]
KEY = order_key("wasp-01", cast.COMMAND_ID)
ALICE, BOB = cast.identity("alice"), cast.identity("bob")
GOOD = Forge(ALICE, key_expr=KEY, content=order_content(), issued_at_ms=cast.NOW_MS)


def negatives() -> list[Vector]:
    """Return every case, in the order of the gate."""
    groups = (
        _containers(),
        _headers(),
        _reencodings(),
        _clocks(),
        _tokens(),
        _keys(),
        _moved(),
        _present(),
        _receivers(),
    )
    return [case for group in groups for case in group]


def _case(counter: str, name: str, envelope: bytes, key_expr: str = KEY, **receiver: Any) -> Vector:
    return {"counter": counter, "name": name, "key_expr": key_expr, **receiver, "envelope": envelope.hex()}


def _outer(change: Change) -> bytes:
    return replace(GOOD, spoil_envelope=change).envelope()


def _header(change: Change) -> bytes:
    return replace(GOOD, spoil_header=change).envelope()


def _set(name: str, value: object) -> Change:
    return lambda message: setattr(message, name, value)


def _without(name: str) -> Change:
    return lambda message: message.ClearField(name)


def _containers() -> Iterator[Vector]:
    good = GOOD.envelope()
    yield _case("size", "empty", b"")
    yield _case("size", "199 bytes", good[:199])
    yield _case("size", "4097 bytes", good + bytes(4097 - len(good)))
    yield _case("parse_env", "cut off", good[:-1])
    yield _case("parse_env", "no protobuf", b"\xff" * 600)
    yield _case("noncanonical_env", "unknown field", good + b"\xa0\x06\x01")
    yield _case("noncanonical_env", "version twice", b"\x08\x01" + good)
    yield _case("noncanonical_env", "signature in front", good[-66:] + good[:-66])
    for part in ("header", "token", "ciphertext", "device_signature"):
        yield _case("shape", f"no {part}", _outer(_without(part)))
    for part, size in (("header", 513), ("token", 1025), ("ciphertext", 16), ("ciphertext", 2049)):
        yield _case("shape", f"{part} of {size} bytes", _outer(_set(part, b"\x0a" * size)))
    for size in (63, 65):
        yield _case("shape", f"device_signature of {size} bytes", _outer(_set("device_signature", b"\x01" * size)))
    yield _case("version", "version 2", _outer(_set("v", 2)))
    yield _case("version", "no version", _outer(_without("v")))


def _headers() -> Iterator[Vector]:
    yield _case("parse_hdr", "no protobuf", _outer(_set("header", b"\xff" * 20)))
    yield _case("parse_hdr", "text that is not UTF-8", replace(GOOD, spoil_encoding=_not_utf8).envelope())
    yield _case("type", "an ack on the key of orders", _header(_set("type", 2)))
    yield _case("type", "an unknown type", _header(_set("type", 99)))
    sizes = {"device_key_id": 16, "token_digest": 32, "nonce": 24, "body_commitment": 32}
    for part, size in (sizes | {"in_reply_to": 32, "node_challenge": 16}).items():
        for wrong in (size - 1, size + 1):
            yield _case("shape", f"{part} of {wrong} bytes", _header(_set(part, b"\x01" * wrong)))
    yield _case("shape", "nonce of another seq", _header(_set("seq", 2)))
    yield _case("shape", "a text of 129 characters", _header(_set("owner_principal_id", "a" * 129)))
    yield _case("deployment", "another deployment", _header(_set("deployment_id", "other")))


def _not_utf8(encoded: bytes) -> bytes:
    return encoded.replace(b"coast-watch", b"coast\xffwatch")


def _reordered(encoded: bytes) -> bytes:
    tail = EnvelopeHeader(deployment_id=cast.DEPLOYMENT).SerializeToString()
    return tail + encoded.replace(tail, b"", 1)


REENCODINGS: dict[str, Callable[[bytes], bytes]] = {
    "fields reordered": _reordered,
    "a field twice": lambda encoded: encoded[:2] + encoded,
    "an overlong number": lambda encoded: b"\x08\x81\x00" + encoded[2:],
    "an unknown field": lambda encoded: encoded + b"\xa0\x06\x01",
    "an explicit default": lambda encoded: encoded.replace(b"\x2a\x10", b"\x20\x00\x2a\x10", 1),
    "two encodings merged": lambda encoded: encoded + encoded,
    "a number of 64 bits in a field of 32": lambda encoded: b"\x08\x81\x80\x80\x80\x10" + encoded[2:],
}


def _reencodings() -> Iterator[Vector]:
    """The same header to a lenient parser, signed by its rightful sender."""
    for name, change in REENCODINGS.items():
        yield _case("noncanonical_hdr", name, replace(GOOD, spoil_encoding=change).envelope())


def _clocks() -> Iterator[Vector]:
    yield _case("ttl", "no life", _header(_without("ttl_ms")))
    yield _case("ttl", "a life of 30,001 ms", _header(_set("ttl_ms", 30_001)))
    yield _case("clock_future", "5,001 ms from the future", _header(_set("issued_at_ms", cast.NOW_MS + 5_001)))
    yield _case("clock_stale", "15,001 ms old, of 10,000", _header(_set("issued_at_ms", cast.NOW_MS - 15_001)))
    yield _case("clock_stale", "no time", _header(_without("issued_at_ms")))


def with_token(change: Change, signer: str = "dir.token", context: bytes = pae.IDENTITY_TOKEN) -> Identity:
    """Return Alice with a token that was changed and signed again."""
    changed = IdentityToken()
    changed.CopyFrom(ALICE.token)
    change(changed)
    data = documents.sign(context, changed, [cast.sign_key(signer)])
    return replace(ALICE, token=changed, token_bytes=data, token_digest=digest(data))


def _tokened(counter: str, name: str, change: Change, **how: Any) -> Vector:
    return _case(counter, name, replace(GOOD, identity=with_token(change, **how)).envelope())


def _tokens() -> Iterator[Vector]:
    yield _case("token_digest", "another's token", _outer(_set("token", BOB.token_bytes)))
    yield _tokened("token_sig", "signed by dir.revoke", _as_it_is, signer="dir.revoke")
    yield _tokened("token_sig", "signed by the root", _as_it_is, signer="root")
    yield _tokened("token_sig", "signed by Alice herself", _as_it_is, signer="alice")
    yield _tokened("token_sig", "signed as another document", _as_it_is, context=pae.EPOCH_BUNDLE)
    yield _tokened("parse_token", "version 2", _set("v", 2))
    yield _tokened("parse_token", "another deployment", _set("deployment_id", "other"))
    yield _tokened("parse_token", "roles unsorted", lambda paper: paper.roles.extend(["admin"]))
    yield _tokened("parse_token", "unknown kind", _set("kind", 9))
    yield _tokened("parse_token", "a key of zeros", _set("device_box_pk", bytes(32)))
    yield _tokened("token_expired", "expired 1 ms ago", lambda paper: _lives(paper, -10, -1))
    yield _tokened("token_expired", "valid in 5,001 ms", lambda paper: _lives(paper, 5_001, 9_000))


def _as_it_is(_paper: IdentityToken) -> None:
    """Change nothing."""


def _lives(paper: IdentityToken, begins_ms: int, ends_ms: int) -> None:
    paper.not_before_ms, paper.not_after_ms = cast.NOW_MS + begins_ms, cast.NOW_MS + ends_ms


def _keys() -> Iterator[Vector]:
    yield _case("token_binding", "another's key id", _header(_set("device_key_id", key_id(BOB.public_key))))
    yield _case("token_binding", "another's channel", _header(_set("owner_principal_id", "bob")))
    yield _case("token_kind", "a node that orders", replace(GOOD, identity=cast.identity("hornet-02")).envelope())
    yield _case("classification", "above the token's", _header(_set("classification", 2)))
    yield _case("device_sig", "signed by another member", _outer(lambda outer: resigned(outer, BOB)))
    yield _case("device_sig", "zeros", _outer(_set("device_signature", bytes(64))))
    yield _case("device_sig", "another ciphertext", _outer(_set("ciphertext", b"\x05" * 100)))
    yield _case("unknown_epoch", "epoch 2", _header(_set("epoch_id", 2)))
    yield _case("commitment", "to another plaintext", _header(_set("body_commitment", b"\x01" * 32)))


def _as_bob(outer: AuthEnvelope) -> None:
    stolen = EnvelopeHeader.FromString(outer.header)
    stolen.owner_principal_id, stolen.device_key_id = "bob", key_id(BOB.public_key)
    stolen.token_digest = BOB.token_digest
    outer.header, outer.token = _bytes(stolen), BOB.token_bytes
    resigned(outer, BOB)


def _bytes(message: Message) -> bytes:
    return message.SerializeToString(deterministic=True)


def _moved() -> Iterator[Vector]:
    """What is whole, where it does not belong."""
    yield _case("open", "Alice's ciphertext signed again by Bob", _outer(_as_bob))
    odd = Forge(ALICE, MessageType.ACK, KEY, order_content(), spoil_header=_set("type", 1))
    yield _case("open", "sealed as an ack, signed as an order", odd.envelope())
    yield _case("open", "sealed over another header", _outer(_later))
    yield _case("route", "on the key of another node", GOOD.envelope(), order_key("hornet-02", cast.COMMAND_ID))
    other = cast.COMMAND_ID.replace("0b", "0c", 1)
    yield _case("route", "on the key of another order", GOOD.envelope(), order_key("wasp-01", other))
    elsewhere = order_key("hornet-02", cast.COMMAND_ID)
    yield _case("route", "for another node", replace(GOOD, key_expr=elsewhere).envelope(), elsewhere)
    answer = packer("wasp-01", "swapped").pack(
        MessageType.ACK, ack_key("wasp-01", cast.COMMAND_ID), b"\x10\x01", ttl_ms=30_000, in_reply_to=digest(b"order")
    )
    swapped = {"receiver": "alice", "gate": "ack"}
    yield _case("route", "an ack on the key of another order", answer.envelope, ack_key("wasp-01", other), **swapped)


def _present() -> Iterator[Vector]:
    """What does not keep an operators' link up."""
    here = presence_key("wasp-01", "alice")
    good = replace(GOOD, message_type=MessageType.PRESENCE, key_expr=here, content=b"\x08\x11", ttl_ms=3_000)
    at = {"gate": "presence"}
    as_order = replace(good, key_expr=KEY)
    yield _case("type", "a presence on the key of orders", as_order.envelope())
    as_presence = replace(good, message_type=MessageType.ORDER, spoil_header=_set("type", 6))
    yield _case("open", "sealed as an order, signed as a presence", as_presence.envelope(), here, **at)
    elsewhere = presence_key("hornet-02", "alice")
    yield _case("route", "a presence at another node", replace(good, key_expr=elsewhere).envelope(), elsewhere, **at)
    node = presence_key("wasp-01", "hornet-02")
    other = replace(good, key_expr=node, identity=cast.identity("hornet-02"))
    yield _case("token_kind", "a node that is present", other.envelope(), node, **at)
    stale = replace(good, issued_at_ms=cast.NOW_MS - 8_001)
    yield _case("clock_stale", "a presence of 3,000 ms, 8,001 ms old", stale.envelope(), here, **at)


def _later(outer: AuthEnvelope) -> None:
    changed = EnvelopeHeader.FromString(outer.header)
    changed.ttl_ms += 1
    outer.header = _bytes(changed)
    resigned(outer, ALICE)


def _receivers() -> Iterator[Vector]:
    """A good envelope, and a receiver that knows better."""
    good, before = GOOD.envelope(), [GOOD.envelope().hex()]
    yield _case("rate", "the bucket is empty", replace(GOOD, seq=2).envelope(), burst=1, before=before)
    yield _case("replay", "the same bytes again", good, before=before)
    again = replace(GOOD, content=b"\x10\x01").envelope()
    yield _case("replay", "the same nonce again", again, before=before)
    for name, says in (("v13_alice", "principal"), ("v13_device", "device"), ("v13_token", "token")):
        yield _case("revoked", says, good, revocations=name)
    yield _case("policy_old", "a policy of before", good, revocations="v13_policy")
    yield _case("epoch_retired", "below the least epoch", good, revocations="v13_epoch")
    yield _case("epoch_retired", "120,001 ms after its end", good, epoch_ms=[-cast.HOUR_MS, -120_001])
    yield _case("epoch_retired", "5,001 ms before its begin", good, epoch_ms=[5_001, cast.HOUR_MS])
    yield _case("challenge", "no echo, and the receiver does not know the time", good, uncertain=True)
    echoes = _header(_set("node_challenge", b"\x01" * 16))
    yield _case("challenge", "an echo of another challenge", echoes, uncertain=True)
    yield _case("horizon", "the receiver started just now and remembers nothing", good, forgotten=True)
    yield _case("list_old", "the epoch needs list 13", good, epoch_needs_list=13)
    yield _case("window_full", "512 nonces of this device are held", good, nonces_held=512)
