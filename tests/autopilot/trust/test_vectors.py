"""The published vectors, every intermediate value made again by a stranger: hashlib and libsodium, none of our code."""

from __future__ import annotations

import base64
import hashlib
import json
from typing import Any

import pytest
from nacl import bindings

from tests.house import REPO
from tests.vectors import independent
from tests.vectors.independent import NotCanonical, Value, blake2b, is_signed, pae

MADE: dict[str, Any] = json.loads((REPO / "tests/vectors/positive.json").read_text("utf-8"))
PAPERS, KEYS, MESSAGES, CHECKPOINT = MADE["papers"], MADE["keys"], MADE["messages"], MADE["checkpoint"]
REPEATED = {"IdentityToken": frozenset({7}), "RevocationList": frozenset({7, 8, 9}), "TrustRoot": frozenset({6, 7})}


def of(values: dict[str, str], *names: str) -> list[bytes]:
    """Return these values of a vector as bytes."""
    return [bytes.fromhex(values[name]) for name in names]


def public(name: str) -> bytes:
    return bytes.fromhex(KEYS["sign"][name]["public"])


def _singles() -> list[tuple[str, dict[str, Any]]]:
    return [("EpochBundle", PAPERS["epoch_bundle"]), ("TimeBeacon", PAPERS["time_beacon"])]


def papers() -> list[tuple[str, dict[str, Any]]]:
    """Return every signed document with its kind."""
    tokens = [("IdentityToken", paper) for paper in PAPERS["tokens"].values()]
    lists = [("RevocationList", paper) for paper in PAPERS["revocations"].values()]
    return [("TrustRoot", PAPERS["trust_root"]), *tokens, *lists, *_singles()]


def check_paper(kind: str, paper: dict[str, Any]) -> None:
    """Framing, signature, container and canonical form of one document."""
    body, signed, signature, document, told = of(paper, "body", "signature_input", "signature", "document", "digest")
    assert signed == pae(f"waypoint/v1/{kind}".encode(), body)
    assert is_signed(public(paper["signer"]), signed, signature)
    sig = independent.encoded([(1, independent.key_id(public(paper["signer"]))), (2, signature)])
    assert document == independent.encoded([(1, body), (2, sig)])
    assert told == blake2b(document)
    read = independent.spans(body, REPEATED.get(kind, frozenset()))
    assert independent.encoded((number, value) for number, value, _, _ in read) == body


def fields_of(paper: dict[str, Any], kind: str) -> dict[int, Value]:
    return independent.fields(bytes.fromhex(paper["body"]), REPEATED.get(kind, frozenset()))


def test_the_second_writing_is_a_strangers() -> None:
    text = (REPO / "tests/vectors/independent.py").read_text("utf-8")
    imports = [line for line in text.splitlines() if line.startswith(("from ", "import "))]
    assert {line.split()[1].partition(".")[0] for line in imports} == {
        *("__future__", "base64", "hashlib", "struct", "collections", "nacl"),
    }


def test_keys_are_made_from_their_names() -> None:
    for name, key in KEYS["sign"].items():
        seed, verifies, hint = of(key, "seed", "public", "key_id")
        assert seed == blake2b(f"autopilot vectors {MADE['seed']}: {name}.sign".encode())
        assert bindings.crypto_sign_seed_keypair(seed)[0] == verifies
        assert hint == hashlib.blake2b(verifies, digest_size=16, person=b"wp.keyid.v1").digest()
    for key in KEYS["box"].values():
        secret, opens = of(key, "secret", "public")
        assert bindings.crypto_scalarmult_base(secret) == opens


@pytest.mark.parametrize(("kind", "paper"), papers(), ids=lambda part: part if isinstance(part, str) else "")
def test_every_document_is_framed_signed_and_canonical(kind: str, paper: dict[str, Any]) -> None:
    check_paper(kind, paper)


def test_each_purpose_has_its_own_key() -> None:
    signers = {kind: {paper["signer"] for other, paper in papers() if other == kind} for kind, _ in papers()}
    assert signers == {
        "TrustRoot": {"root"},
        "IdentityToken": {"dir.token"},
        "RevocationList": {"dir.revoke"},
        "EpochBundle": {"dir.epoch"},
        "TimeBeacon": {"dir.time"},
    }


def test_a_token_names_its_holders_keys() -> None:
    for name, paper in PAPERS["tokens"].items():
        token = fields_of(paper, "IdentityToken")
        assert (token[3], token[5]) == (name.encode(), public(name))
        assert token[6] == bytes.fromhex(KEYS["box"][name]["public"])


def test_the_group_key_is_committed_to_and_opens_for_its_device() -> None:
    paper, secret = PAPERS["epoch_bundle"], bytes.fromhex(KEYS["epoch"]["1"])
    bundle = fields_of(paper, "EpochBundle")
    epoch_id, wrapped = bundle[3], bundle[9]
    assert isinstance(epoch_id, int)
    assert isinstance(wrapped, bytes)
    assert bundle[4] == blake2b(b"waypoint/v1/epoch-commit" + independent.le64(epoch_id) + secret)
    box = KEYS["box"][paper["recipient"]]
    opens, holds = of(box, "public", "secret")
    assert bindings.crypto_box_seal_open(wrapped, opens, holds) == secret
    assert bundle[8] == independent.key_id(public(paper["recipient"]))
    ephemeral = bytes.fromhex(paper["ephemeral_secret"])
    sender = bindings.crypto_scalarmult_base(ephemeral)
    nonce = hashlib.blake2b(sender + opens, digest_size=24).digest()
    assert wrapped == sender + bindings.crypto_box(secret, nonce, opens, ephemeral)


@pytest.mark.parametrize("pair", PAPERS["pairs"], ids=lambda pair: f"{pair['held']} then {pair['offered']}")
def test_pairs_of_revocation_lists_are_what_they_are_called(pair: dict[str, str]) -> None:
    held, offered = (PAPERS["revocations"][pair[part]] for part in ("held", "offered"))
    before, after = (fields_of(paper, "RevocationList")[3] for paper in (held, offered))
    assert isinstance(before, int)
    assert isinstance(after, int)
    same = held["digest"] == offered["digest"]
    assert {
        "accepted": after > before and fields_of(offered, "RevocationList")[6] == bytes.fromhex(held["digest"]),
        "nothing new": after == before and same,
        "rl_rollback": after < before,
        "rl_equivocation": after == before and not same,
    }[pair["expected"]]


@pytest.mark.parametrize("name", MESSAGES)
def test_every_intermediate_of_a_message(name: str) -> None:
    """From the envelope to the content and back, each value from those before it."""
    made = MESSAGES[name]
    sender, envelope = made["sender"], bytes.fromhex(made["envelope"])
    header, token, ciphertext, signature = of(made, "header", "token", "ciphertext", "device_signature")
    assert envelope == independent.encoded([(1, 1), (2, header), (3, token), (4, ciphertext), (5, signature)])
    read = independent.header_fields(header)
    device, nonce = independent.key_id(public(sender)), read[7]
    assert isinstance(nonce, bytes)
    assert (read[1], read[2], read[3]) == (made["type"], made["key_expr"].encode(), sender.encode())
    assert (read[5], read[6]) == (device, blake2b(token))
    assert (read[11], nonce.hex()) == (int.from_bytes(nonce[:8], "little"), made["nonce"])
    assert (read[9], read[13], read[15]) == (MADE["now_ms"], 12, MADE["deployment_id"].encode())
    aad, key_input, key, signed = of(made, "aad", "sealing_key_input", "sealing_key", "signature_input")
    assert aad == pae(b"waypoint/v1/AuthEnvelope/aead", header)
    assert key_input == independent.le64(1) + device
    assert key == independent.sealing_key(bytes.fromhex(KEYS["epoch"]["1"]), made["type"], 1, device)
    plaintext = independent.opened(key, nonce, header, ciphertext)
    assert (plaintext.hex(), read[16]) == (made["plaintext"], hashlib.sha256(plaintext).digest())
    assert made["commitment"] == hashlib.sha256(plaintext).hexdigest()
    assert independent.fields(plaintext[32:])[2] == bytes.fromhex(made["content"])
    assert signed == pae(b"waypoint/v1/AuthEnvelope/device-signature", header, token, ciphertext)
    assert is_signed(public(sender), signed, signature)
    assert made["digest"] == blake2b(signed).hex()


def test_an_ack_names_the_order_that_it_answers() -> None:
    assert MESSAGES["ack"]["in_reply_to"] == MESSAGES["order"]["digest"]
    header = independent.fields(bytes.fromhex(MESSAGES["ack"]["header"]))
    assert header[14] == bytes.fromhex(MESSAGES["order"]["digest"])
    assert MESSAGES["order"]["in_reply_to"] == MESSAGES["status"]["in_reply_to"] == ""


def test_the_order_is_bound_to_its_node() -> None:
    content = independent.fields(bytes.fromhex(MESSAGES["order"]["content"]))
    assert content[5] == public("wasp-01")
    assert content[1] == MESSAGES["order"]["key_expr"].rpartition("/")[2].encode()


def test_leaves_root_and_note_of_a_checkpoint() -> None:
    """Three records, one after the other, and the tree over them."""
    flight_id, secret = of(CHECKPOINT, "flight_id", "flight_secret")
    before, leaves = bytes(32), []
    for seq, record in enumerate(CHECKPOINT["records"]):
        salt, body, last, leaf = of(record, "salt", "body", "leaf_before", "leaf")
        assert salt == blake2b(independent.le64(seq), 16, secret)
        assert (record["numbers"][0], last) == (seq, before)
        assert leaf == independent.leaf(flight_id, record["numbers"], before, salt, body)
        before = leaf
        leaves.append(leaf)
    root = independent.root_of(leaves)
    inner = hashlib.sha256(b"\x01" + leaves[0] + leaves[1]).digest()
    assert root == hashlib.sha256(b"\x01" + inner + leaves[2]).digest() == bytes.fromhex(CHECKPOINT["root"])
    origin, note = CHECKPOINT["origin"], CHECKPOINT["note"]
    assert note.split("\n")[:4] == [origin, "3", base64.b64encode(root).decode(), "flight_ns 2000000"]
    assert independent.note_holds(note, origin, public("wasp-01/3"))
    assert independent.note_holds(CHECKPOINT["certificate"], origin.rpartition("/")[0], public("wasp-01"))
    assert not independent.note_holds(note.replace("\n3\n", "\n4\n"), origin, public("wasp-01/3"))
    assert base64.b64encode(public("wasp-01/3")).decode() in CHECKPOINT["certificate"]


@pytest.mark.parametrize(
    "data",
    [
        b"\x08\x81\x00",
        b"\x08\x00",
        b"\x12\x00",
        b"\x10\x01\x08\x01",
        b"\x08\x01\x08\x01",
        b"\x0d\x01\x01\x01\x01",
        b"\x12\x05a",
        b"\x08",
        b"\x88",
        b"\x08" + b"\xff" * 9 + b"\x7f",
    ],
)
def test_the_second_reading_is_strict(data: bytes) -> None:
    with pytest.raises(NotCanonical):
        independent.fields(data)
