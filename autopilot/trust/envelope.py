"""The envelope: how a message is sealed and signed, to the byte, and how its parts are opened.

    SIG_INPUT  = PAE(context, header, token, ciphertext)     signed by the device, Ed25519
    AAD        = PAE(context, header)                        header covers device, token, route, nonce
    K          = BLAKE2b-256(key = epoch secret, person = by type, LE64(epoch_id) || device_key_id)
    plaintext  = 32 random bytes || SealedBody               SHA-256 of it is in the header
    ciphertext = XChaCha20-Poly1305-IETF(K, nonce, AAD, plaintext)

Identity is in the associated data and feeds the key, so a ciphertext that another member signs
again does not open. Members share the epoch's secret: authorship rests on the signature alone.
Which message may be believed is the gate's business, not this file's.
"""

from __future__ import annotations

import hashlib
import os
import threading
from dataclasses import dataclass
from enum import IntEnum

from nacl import bindings
from nacl.exceptions import CryptoError

from autopilot.trust import limits
from autopilot.trust.believing import Believing, Fixed
from autopilot.trust.clock import Clock
from autopilot.trust.identity import Epoch, Identity
from autopilot.trust.keys import Random, SealBroken, digest
from autopilot.trust.pae import ENVELOPE_SEAL, ENVELOPE_SIGNATURE, le64, pae
from events.schema.waypoint_pb2 import AuthEnvelope, EnvelopeHeader, SealedBody

VERSION = 1


class MessageType(IntEnum):
    """What an envelope carries; bound by the header and by the sealing key."""

    ORDER = 1
    ACK = 2
    STATUS = 3
    COSIGNATURE = 5
    PRESENCE = 6


_PERSON = {
    MessageType.ORDER: b"wp.cmd.seal.v1",
    MessageType.ACK: b"wp.ack.seal.v1",
    MessageType.STATUS: b"wp.sta.seal.v1",
    MessageType.COSIGNATURE: b"wp.cos.seal.v1",
    MessageType.PRESENCE: b"wp.pre.seal.v1",
}


@dataclass(frozen=True, slots=True)
class Packed:
    """An envelope ready to be published."""

    envelope: bytes
    digest: bytes  # BLAKE2b-256 of the signature input: what an ack names as in_reply_to
    nonce: bytes


class PackError(Exception):
    """A message can't be sealed; the text says why. Nothing is ever sent unsealed instead."""


def signature_input(header: bytes, token: bytes, ciphertext: bytes) -> bytes:
    """Return the bytes that a device signs."""
    return pae(ENVELOPE_SIGNATURE, header, token, ciphertext)


def sealing_key(message_type: MessageType, epoch: Epoch, device_key_id: bytes) -> bytes:
    """Return the 32-byte key of one sender, one epoch and one type of message."""
    data = le64(epoch.epoch_id) + device_key_id
    return hashlib.blake2b(data, digest_size=32, key=epoch.secret, person=_PERSON[message_type]).digest()


def seal(key: bytes, nonce: bytes, header: bytes, plaintext: bytes) -> bytes:
    """Return ciphertext and tag."""
    return bindings.crypto_aead_xchacha20poly1305_ietf_encrypt(plaintext, pae(ENVELOPE_SEAL, header), nonce, key)


def open_sealed(key: bytes, nonce: bytes, header: bytes, ciphertext: bytes) -> bytes:
    """Return the plaintext. Raises SealBroken, also for a ciphertext too short to be one."""
    if len(ciphertext) <= limits.TAG_BYTES or len(nonce) != limits.NONCE_BYTES:
        raise SealBroken("the ciphertext or nonce has an impossible length")
    try:
        return bindings.crypto_aead_xchacha20poly1305_ietf_decrypt(ciphertext, pae(ENVELOPE_SEAL, header), nonce, key)
    except CryptoError as error:
        raise SealBroken("the ciphertext does not open") from error


def ciphertext_limit(message_type: int) -> int:
    """Return the most bytes of ciphertext that a message of this type may have."""
    return limits.STATUS_CIPHERTEXT_BYTES_MAX if message_type == MessageType.STATUS else limits.CIPHERTEXT_BYTES_MAX


def envelope_limit(message_type: int) -> int:
    """Return the most bytes that an envelope of this type may have."""
    return limits.STATUS_ENVELOPE_BYTES_MAX if message_type == MessageType.STATUS else limits.ENVELOPE_BYTES_MAX


class Packer:
    """Packs one device's messages. May be used from several threads.

    Every call makes a fresh envelope: another nonce, another time, so a message that is sent
    again is not a replay. The running number starts at the wall clock, which keeps nonces apart
    over restarts even where the random half fails.
    """

    def __init__(
        self, identity: Identity, clock: Clock, random: Random = os.urandom, believing: Believing | None = None
    ) -> None:
        """Make a packer of `identity`, or of whatever `believing` holds when it packs.

        Where the time is uncertain envelopes bear none; only acks and status are taken so.
        """
        self._believing = believing or Fixed(identity, clock)
        self._random = random
        self._seq = 0
        self._lock = threading.Lock()

    def pack(
        self,
        message_type: MessageType,
        key_expr: str,
        content: bytes,
        *,
        ttl_ms: int,
        order_seq: int = 0,
        in_reply_to: bytes = b"",
        node_challenge: bytes = b"",
    ) -> Packed:
        """Seal and sign `content` for one key expression.

        `ttl_ms` is the life from now; `node_challenge` echoes a node whose time is uncertain. Raises
        PackError without a usable epoch key, and where the message is larger or lives longer than a
        receiver would take.
        """
        identity, time = self._believing.held, self._believing.time()
        epoch = identity.current_epoch(time.now_ms, certain=time.trusted)
        if epoch is None:
            raise PackError("no group key is in use now; issue the identity again")
        if not 0 < ttl_ms <= limits.TTL_MS_MAX:
            raise PackError(f"a life of {ttl_ms} ms is outside 1 to {limits.TTL_MS_MAX}")
        body = SealedBody()
        if order_seq:
            body.order_seq = order_seq
        if content:  # an explicit default would not be canonical
            body.content = content
        plaintext = self._random(limits.SALT_BYTES) + body.SerializeToString(deterministic=True)
        if len(plaintext) + limits.TAG_BYTES > ciphertext_limit(message_type):
            raise PackError(f"a message of {len(plaintext)} bytes is too large for its type")
        seq = self._next_seq(time.now_ms)
        header = EnvelopeHeader(
            type=message_type,
            key_expr=key_expr,
            owner_principal_id=identity.principal_id,
            device_key_id=identity.sign_key.key_id,
            token_digest=identity.token_digest,
            nonce=le64(seq) + self._random(limits.NONCE_BYTES - 8),
            epoch_id=epoch.epoch_id,
            ttl_ms=ttl_ms,
            seq=seq,
            revocation_version=identity.revocations.version,
            deployment_id=identity.deployment_id,
            body_commitment=hashlib.sha256(plaintext).digest(),
        )
        if time.trusted:
            header.issued_at_ms = time.now_ms
        if in_reply_to:
            header.in_reply_to = in_reply_to
        if node_challenge:
            header.node_challenge = node_challenge
        return _sealed(identity, message_type, header, epoch, plaintext)

    def _next_seq(self, now_ms: int) -> int:
        with self._lock:
            self._seq = max(self._seq + 1, now_ms)
            return self._seq


def _sealed(
    identity: Identity, message_type: MessageType, header: EnvelopeHeader, epoch: Epoch, plaintext: bytes
) -> Packed:
    encoded = header.SerializeToString(deterministic=True)
    key = sealing_key(message_type, epoch, header.device_key_id)
    ciphertext = seal(key, header.nonce, encoded, plaintext)
    signed = signature_input(encoded, identity.token_bytes, ciphertext)
    envelope = AuthEnvelope(
        v=VERSION,
        header=encoded,
        token=identity.token_bytes,
        ciphertext=ciphertext,
        device_signature=identity.sign_key.sign(signed),
    )
    return Packed(envelope.SerializeToString(deterministic=True), digest(signed), header.nonce)
