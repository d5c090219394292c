"""The envelope to the byte, checked against a second writing of the format from its specification."""

from __future__ import annotations

import hashlib

import pytest
from nacl import bindings

from autopilot.trust import limits
from autopilot.trust.envelope import MessageType, Packed, Packer, PackError, open_sealed, seal
from autopilot.trust.keys import SealBroken, SignKey, key_id, verify
from autopilot.trust.pae import pae
from autopilot.trust.verdict import Opened
from events.schema.waypoint_pb2 import AuthEnvelope, EnvelopeHeader, SealedBody
from tests.autopilot.trust.world import KEY, NOW_MS, FakeClock, Forge, node_gate, people, seeded


def packed(**changes: object) -> Packed:
    arguments: dict[str, object] = {"ttl_ms": 10_000, "order_seq": 5, **changes}
    packer = Packer(people().alice, FakeClock(), seeded(3))
    return packer.pack(MessageType.ORDER, KEY, b"content", **arguments)  # type: ignore[arg-type]


def test_pae_frames_without_doubt() -> None:
    assert pae() == b"\0" * 8
    assert pae(b"") == b"\1" + b"\0" * 15
    assert pae(b"test") == b"\1" + b"\0" * 7 + b"\4" + b"\0" * 7 + b"test"
    assert pae(b"ab", b"c") != pae(b"a", b"bc")


def test_a_key_has_one_id() -> None:
    key = bytes(range(32))
    assert key_id(key) == hashlib.blake2b(key, digest_size=16, person=b"wp.keyid.v1").digest()


def test_what_is_packed_follows_the_specification() -> None:
    """Every step again, by hand: lengths, contexts, key derivation, seal, commitment, signature."""
    alice = people().alice
    envelope = AuthEnvelope.FromString(packed().envelope)
    header = EnvelopeHeader.FromString(envelope.header)
    assert (envelope.v, envelope.token) == (1, alice.token_bytes)
    assert header.nonce[:8] == header.seq.to_bytes(8, "little")
    assert (header.issued_at_ms, header.ttl_ms, header.epoch_id) == (NOW_MS, 10_000, 1)

    def frame(*parts: bytes) -> bytes:
        out = len(parts).to_bytes(8, "little")
        for part in parts:
            out += len(part).to_bytes(8, "little") + part
        return out

    derived = (1).to_bytes(8, "little") + header.device_key_id
    key = hashlib.blake2b(derived, key=alice.epochs[1].secret, person=b"wp.cmd.seal.v1", digest_size=32).digest()
    aad = frame(b"waypoint/v1/AuthEnvelope/aead", envelope.header)
    plain = bindings.crypto_aead_xchacha20poly1305_ietf_decrypt(envelope.ciphertext, aad, header.nonce, key)
    body = SealedBody.FromString(plain[32:])
    assert (body.order_seq, body.content) == (5, b"content")
    assert header.body_commitment == hashlib.sha256(plain).digest()
    context = b"waypoint/v1/AuthEnvelope/device-signature"
    signed = frame(context, envelope.header, envelope.token, envelope.ciphertext)
    verify(alice.public_key, signed, envelope.device_signature)
    assert packed().digest == hashlib.blake2b(signed, digest_size=32).digest()


def test_types_do_not_open_each_other() -> None:
    """An ack's ciphertext under an order's header opens for nobody: the type feeds the key."""
    gate = node_gate()
    forged = Forge(people().alice, message_type=MessageType.ACK, spoil_header=lambda h: setattr(h, "type", 1))
    gate.judge(KEY, forged.envelope())
    assert gate.tally().rejected["open"] == 1


def test_a_message_sent_again_is_another_envelope() -> None:
    packer = Packer(people().alice, FakeClock(), seeded(3))
    first, second = (packer.pack(MessageType.ORDER, KEY, b"c", ttl_ms=1000, order_seq=5) for _ in range(2))
    assert first.nonce != second.nonce
    assert first.digest != second.digest
    gate = node_gate()
    assert isinstance(gate.judge(KEY, first.envelope), Opened)
    assert isinstance(gate.judge(KEY, second.envelope), Opened)


def test_nonces_stay_apart_when_chance_fails() -> None:
    packer = Packer(people().alice, FakeClock(), lambda count: b"\0" * count)
    nonces = {packer.pack(MessageType.ORDER, KEY, b"c", ttl_ms=1000).nonce for _ in range(50)}
    assert len(nonces) == 50


@pytest.mark.parametrize("ttl_ms", [0, -1, 30_001])
def test_a_life_that_nobody_takes_is_not_packed(ttl_ms: int) -> None:
    with pytest.raises(PackError, match="life"):
        packed(ttl_ms=ttl_ms)


def test_nothing_is_packed_without_a_key_or_too_large() -> None:
    clock = FakeClock(NOW_MS + 32 * 24 * 3_600_000)
    with pytest.raises(PackError, match="group key"):
        Packer(people().alice, clock).pack(MessageType.ORDER, KEY, b"c", ttl_ms=1000)
    packer = Packer(people().alice, FakeClock())
    largest = limits.CIPHERTEXT_BYTES_MAX - 16 - 32 - 3
    packer.pack(MessageType.ORDER, KEY, b"c" * largest, ttl_ms=1000)
    with pytest.raises(PackError, match="too large"):
        packer.pack(MessageType.ORDER, KEY, b"c" * (largest + 1), ttl_ms=1000)


@pytest.mark.parametrize("length", range(18))
def test_a_short_ciphertext_is_broken_and_not_an_error_of_ours(length: int) -> None:
    with pytest.raises(SealBroken):
        open_sealed(b"k" * 32, b"n" * 24, b"header", b"c" * length)


def test_the_header_is_bound_to_the_seal() -> None:
    sealed = seal(b"k" * 32, b"n" * 24, b"header", b"text")
    assert open_sealed(b"k" * 32, b"n" * 24, b"header", sealed) == b"text"
    with pytest.raises(SealBroken):
        open_sealed(b"k" * 32, b"n" * 24, b"headex", sealed)


def test_a_signature_is_rfc_8032() -> None:
    """RFC 8032, 7.1, TEST 2."""
    key = SignKey.from_seed(bytes.fromhex("4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb"))
    assert key.public.hex() == "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c"
    assert key.sign(b"\x72").hex().startswith("92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da")
    assert key.seed.hex() not in repr(key)
