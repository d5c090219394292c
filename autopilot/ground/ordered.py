"""Checks that an operator's key signed an order for this node, without the group key: a part of the verifier.

Like the rest of the verifier it is written from docs/proof.md (Orders), with the standard library and one Ed25519
verification. The log holds the envelope as it was received and the plaintext that it sealed; the signed header commits
to that plaintext, so nobody needs to open anything. Each step binds one thing to the next, and a step that fails says
which.
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import NamedTuple

from autopilot.ground.asked import Parts, inner_of, number_of, recorded_order, signed_order, text_of, words
from autopilot.ground.papers import (
    field_of,
    fields_all,
    name_of,
    parts_of,
    purpose_of,
    require,
    signed_body,
    signed_by,
)

ORDER = 20  # kind of the records that hold one
OPERATOR = 1  # the kind of principals that may order
SKEW_MS = 5_000
SALT_BYTES = 32


class Addressee(NamedTuple):
    """The node that an order must be for, and whom it believes."""

    deployment: str
    node: str
    node_key: bytes
    token_key: bytes  # the Directory's, for tokens


@dataclass(frozen=True, slots=True)
class Revoked:
    """A revocation list whose signature holds."""

    version: int
    principals: frozenset[bytes]
    device_key_ids: frozenset[bytes]
    token_ids: frozenset[bytes]


@dataclass(frozen=True, slots=True, kw_only=True)
class ProvedOrder:
    """An order whose giver is proved."""

    seq: int  # its record
    command_id: str
    principal: str
    callsign: str
    roles: tuple[str, ...]
    device_key: bytes
    token_key: bytes
    issued_at_ms: int  # sender's clock, milliseconds since 1970
    order_seq: int
    node: str
    asked: str  # what the signed bytes ask for, in words
    list_version: int | None = None  # revocation list that does not name the sender; None: none was given

    def words(self) -> str:
        """Return in one sentence who ordered what."""
        at = datetime.fromtimestamp(self.issued_at_ms / 1000, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
        listed = f", and is not on revocation list {self.list_version}" if self.list_version is not None else ""
        return (
            f"Proved: {self.principal} ({self.callsign}) signed order {self.command_id} for {self.node}, to"
            f" {self.asked}, at {at} by the sender's clock, with device key {self.device_key.hex()}, which the"
            f" Directory's key {self.token_key.hex()[:16]} vouches for{listed}"
        )


def check_order(seq: int, body: bytes, to: Addressee, revoked: Revoked | None = None) -> ProvedOrder | None:
    """Check an `order_received`; None where its record holds no envelope. Raises ProofRefused.

    1. The envelope has its parts, and its header is that of an order for this node, of this deployment.
    2. The token is the one that the header names; the Directory signed it; it is an operator's.
    3. The device key of the token is the one that the header names, and it signed header, token and ciphertext.
    4. The token was valid when the order was issued; a revocation list that is given does not name the sender.
    5. The plaintext is the one that the signed header commits to; it holds the order, bound to this node's key.
    6. What the node recorded beside it is what was signed.
    """
    what = f"record {seq}, order"
    record = parts_of(body, what)
    if not fields_all(record, 11):
        return None
    sent = _sent(field_of(record, 11, what), to, what)  # 1 to 3
    _check_sender(sent, revoked, what)  # 4
    content = _content(record, sent, to, what)  # 5
    _check_recorded(record, sent, content, what)  # 6
    return ProvedOrder(
        seq=seq,
        command_id=content.command_id,
        principal=sent.principal,
        callsign=text_of(sent.token, 12),
        roles=tuple(role.decode("utf-8", "replace") for role in fields_all(sent.token, 7)),
        device_key=sent.device_key,
        token_key=to.token_key,
        issued_at_ms=number_of(sent.header, 9),
        order_seq=content.order_seq,
        node=to.node,
        asked=words(signed_order(content.command, what)),
        list_version=revoked.version if revoked is not None else None,
    )


class _Sent(NamedTuple):
    """An envelope that a device signed, and the token that names the device."""

    header: Parts
    token: Parts
    principal: str
    device_key: bytes
    device_key_id: bytes
    digest: bytes  # of what was signed; an answer names it


class _Content(NamedTuple):
    """What was sealed."""

    command_id: str
    order_seq: int
    command: Parts
    digest: bytes


def _sent(data: bytes, to: Addressee, what: str) -> _Sent:
    # 1. Envelope and header.
    envelope = parts_of(data, what)
    require([field for field, _ in envelope] == [1, 2, 3, 4, 5] and envelope[0] == (1, 1), f"{what}: is no envelope")
    raw_header, raw_token, ciphertext, signature = (field_of(envelope, number, what) for number in (2, 3, 4, 5))
    header = parts_of(raw_header, what)
    require(number_of(header, 1) == 1, f"{what}: the envelope carries no order")
    require(text_of(header, 15) == to.deployment, f"{what}: of another deployment")
    # 2. Token.
    require(field_of(header, 6, what) == _digest(raw_token), f"{what}: the token is not the one that was signed for")
    token = parts_of(signed_body(raw_token, b"waypoint/v1/IdentityToken", [to.token_key], 1, what), what)
    require(name_of(token, 2, what) == to.deployment, f"{what}: the token is of another deployment")
    require(number_of(token, 4) == OPERATOR, f"{what}: the sender is no operator")
    # 3. Device.
    device_key, principal = field_of(token, 5, what), name_of(token, 3, what)
    device_key_id = hashlib.blake2b(device_key, digest_size=16, person=b"wp.keyid.v1").digest()
    require(field_of(header, 5, what) == device_key_id, f"{what}: the token is of another device")
    require(text_of(header, 3) in ("", principal), f"{what}: the token is of another principal")
    signed = _pae(b"waypoint/v1/AuthEnvelope/device-signature", raw_header, raw_token, ciphertext)
    signed_by(device_key, signed, signature, what)
    return _Sent(header, token, principal, device_key, device_key_id, _digest(signed))


def _check_sender(sent: _Sent, revoked: Revoked | None, what: str) -> None:
    """Refuse a token that was not valid then, and a sender on the list, which does not say since when."""
    issued_at_ms = number_of(sent.header, 9)
    valid = number_of(sent.token, 8) - SKEW_MS <= issued_at_ms <= number_of(sent.token, 9)
    require(valid, f"{what}: the sender's token was not valid then")
    if revoked is not None:
        named = (
            sent.principal.encode() in revoked.principals,
            sent.device_key_id in revoked.device_key_ids,
            b"".join(fields_all(sent.token, 11)) in revoked.token_ids,
        )
        require(not any(named), f"{what}: the sender is on revocation list {revoked.version}")


def _content(record: Parts, sent: _Sent, to: Addressee, what: str) -> _Content:
    opened = field_of(record, 12, what)
    committed = field_of(sent.header, 16, what) == hashlib.sha256(opened).digest()
    require(committed, f"{what}: the opened text is not the one that was signed for")
    sealed = parts_of(opened[SALT_BYTES:], what)
    content = field_of(sealed, 2, what)
    command = parts_of(content, what)
    command_id = field_of(command, 1, what).decode("utf-8", "replace")
    key_expr = f"waypoint/global/cmd/{to.node}/{command_id}"
    require(text_of(sent.header, 2) == key_expr, f"{what}: was sent to another node, or under another id")
    require(field_of(command, 5, what) == to.node_key, f"{what}: is bound to another node's key")
    return _Content(command_id, number_of(sealed, 1), command, _digest(content))


def _check_recorded(record: Parts, sent: _Sent, content: _Content, what: str) -> None:
    issuer = inner_of(record, 1, what)
    recorded = {
        "principal": (name_of(issuer, 1, what), sent.principal),
        "device": (field_of(issuer, 3, what), sent.device_key_id),
        "command_id": (text_of(record, 2), content.command_id),
        "body": (field_of(record, 3, what), content.digest),
        "target": (field_of(record, 4, what), field_of(content.command, 5, what)),
        "number": (number_of(record, 5), content.order_seq),
        "nonce": (field_of(record, 6, what), field_of(sent.header, 7, what)),
        "answer's reference": (field_of(record, 9, what), sent.digest),
        "time": (number_of(record, 10), number_of(sent.header, 9)),
        "order": (recorded_order(record, what), signed_order(content.command, what)),
    }
    for name, (found, true) in recorded.items():
        require(found == true, f"{what}: the {name} was recorded otherwise than it was signed")


def read_revoked(document: bytes, trust_root: bytes) -> Revoked:
    """Read a revocation list that the trust root's key for them signed. Raises ProofRefused."""
    what = "revocations"
    deployment, key = purpose_of(trust_root, b"revoke")
    parts = parts_of(signed_body(document, b"waypoint/v1/RevocationList", [key], 1, what), what)
    require(name_of(parts, 2, what) == deployment, "revocations: of another deployment")
    sets = (frozenset(fields_all(parts, number)) for number in (7, 8, 9))
    return Revoked(number_of(parts, 3), *sets)


def _digest(data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=32).digest()


def _pae(*pieces: bytes) -> bytes:
    """Frame pieces so that they can be taken apart in one way only (PASETO PAE)."""
    count = struct.Struct("<Q").pack
    return count(len(pieces)) + b"".join(count(len(piece)) + piece for piece in pieces)
