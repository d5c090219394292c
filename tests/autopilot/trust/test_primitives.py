"""Ed25519 and XChaCha20-Poly1305 as they are used here, against edge vectors that were computed without them."""

from __future__ import annotations

import json

import pytest
from nacl import bindings

from autopilot.trust.envelope import open_sealed, seal
from autopilot.trust.keys import BoxKey, SealBroken, SignatureInvalid, SignKey, verify
from tests.house import REPO
from tests.vectors import chacha, curve, edges

PUBLISHED = json.loads((REPO / "tests/vectors/primitives.json").read_text("utf-8"))
SIGNATURES, SEALS = PUBLISHED["ed25519"], PUBLISHED["xchacha20_poly1305"]
RFC_8032 = {  # section 7.1: public key, signature
    "RFC 8032 test 1": (
        "d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a",
        "e5564300c360ac729086e2cc806e828a84877f1eb8e5d974d873e065224901555fb8821590a33bacc61e39701cf9b46b"
        "d25bf5f0595bbe24655141438e7a100b",
    ),
    "RFC 8032 test 2": (
        "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c",
        "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da085ac1e43e15996e458f3613d0f11d8c"
        "387b2eaeb4302aeeb00d291612bb0c00",
    ),
    "RFC 8032 test 3": (
        "fc51cd8e6218a1a38da47ed00230f0580816ed13ba3303ac5deb911548908025",
        "6291d657deec24024827e69c3abe01a30ce548a284743a445e3680d7db5ac3ac18ff9b538d16f290ae67f760984dc659"
        "4a7c15e9716ed28dc027beceea1ec40a",
    ),
}
SUNSCREEN = (
    b"Ladies and Gentlemen of the class of '99: "
    b"If I could offer you only one tip for the future, sunscreen would be it."
)
SUNSCREEN_SEALED = (  # draft-irtf-cfrg-xchacha-03, A.3.1
    "bd6d179d3e83d43b9576579493c0e939572a1700252bfaccbed2902c21396cbb731c7f1b0b4aa6440bf3a82f4eda7e39ae64c6708c54c216"
    "cb96b72e1213b4522f8c9ba40db5d945b11b69b982c1bb9e3f3fac2bc369488f76b2383565d3fff921f9664c97637da9768812f615c68b13"
    "b52ec0875924c1c7987947deafd8780acf49"
)


def is_believed(vector: dict[str, str]) -> bool:
    """Ask our own function; anything but its one exception would escape here."""
    try:
        verify(*(bytes.fromhex(vector[part]) for part in ("public", "message", "signature")))
    except SignatureInvalid:
        return False
    return True


def opened(vector: dict[str, str]) -> bytes | None:
    try:
        return open_sealed(*(bytes.fromhex(vector[part]) for part in ("key", "nonce", "header", "sealed")))
    except SealBroken:
        return None


@pytest.mark.parametrize("valid", [True, False])
def test_signatures_are_believed_exactly_where_they_are_valid(valid: bool) -> None:
    """Small order, other encodings, S + L, wrong lengths, single bits: the strictest reading."""
    asked = [vector for vector in SIGNATURES if vector["valid"] is valid]
    assert [vector["name"] for vector in asked if is_believed(vector) is not valid] == []
    assert len(asked) == {True: 11, False: 177}[valid]


def test_signatures_of_mixed_order_raise_nothing_else() -> None:
    """Only their key's holder can make them; a library may take what the equation times eight takes."""
    either = [vector for vector in SIGNATURES if vector["valid"] == "either"]
    for vector in either:
        is_believed(vector)
        assert curve.holds(
            *(bytes.fromhex(vector[part]) for part in ("public", "message", "signature")), cofactored=True
        )
    assert len(either) == 14


def test_the_arithmetic_that_made_them_is_that_of_rfc_8032() -> None:
    found = {vector["name"]: (vector["public"], vector["signature"]) for vector in SIGNATURES}
    assert {name: found[name] for name in RFC_8032} == RFC_8032
    assert [point.times(8) for point in curve.torsion()] == [curve.ZERO] * 8
    assert len({data for point in curve.torsion() for data in curve.encodings(point)}) == 14
    for seed, message in ((b"\x33" * 32, b""), (b"\x44" * 32, b"m" * 200)):
        key = SignKey.from_seed(seed)
        assert (key.public, key.sign(message)) == (curve.public_of(seed), curve.sign(seed, message))


def test_a_key_of_small_order_would_verify_without_the_librarys_own_check() -> None:
    """So the refusal of these vectors is a check and not luck: their equation holds."""
    small = [vector for vector in SIGNATURES if vector["name"].startswith("key of small order")]
    assert len(small) == 14
    for vector in small:
        parts = (bytes.fromhex(vector[part]) for part in ("public", "message", "signature"))
        assert curve.holds(*parts, cofactored=False)


@pytest.mark.parametrize("valid", [True, False])
def test_seals_open_exactly_where_they_are_whole(valid: bool) -> None:
    """Every bit of a tag, every length, every part exchanged."""
    asked = [vector for vector in SEALS if vector["valid"] is valid]
    expected = [bytes.fromhex(vector["plaintext"]) if valid else None for vector in asked]
    assert [opened(vector) for vector in asked] == expected
    assert len(asked) == {True: 21, False: 242}[valid]


def test_seals_are_made_as_the_second_writing_makes_them() -> None:
    for vector in SEALS:
        if vector["valid"]:
            parts = (bytes.fromhex(vector[part]) for part in ("key", "nonce", "header", "plaintext"))
            assert seal(*parts).hex() == vector["sealed"]


def test_the_second_writing_is_that_of_the_draft() -> None:
    """draft-irtf-cfrg-xchacha-03, 2.2.1 and A.3.1; the library agrees."""
    nonce = bytes.fromhex("000000090000004a0000000031415927")
    subkey = "82413b4227b27bfed30e42508a877d73a0f9e4d58a74a853c12ec41326d3ecdc"
    assert chacha.hchacha20(bytes(range(32)), nonce).hex() == subkey
    key, nonce24, aad = bytes(range(128, 160)), bytes(range(64, 88)), bytes.fromhex("50515253c0c1c2c3c4c5c6c7")
    assert chacha.seal(key, nonce24, aad, SUNSCREEN).hex() == SUNSCREEN_SEALED
    library = bindings.crypto_aead_xchacha20poly1305_ietf_encrypt(SUNSCREEN, aad, nonce24, key)
    assert library.hex() == SUNSCREEN_SEALED


def test_what_the_bindings_raise_on_odd_lengths_is_kept_from_the_gate() -> None:
    """They raise ValueError and TypeError where ours raise one exception each."""
    with pytest.raises(ValueError, match="negative"):
        bindings.crypto_aead_xchacha20poly1305_ietf_decrypt(b"c" * 15, b"", bytes(24), bytes(32))
    with pytest.raises(TypeError):
        bindings.crypto_aead_xchacha20poly1305_ietf_decrypt(b"c" * 17, b"", bytes(12), bytes(32))
    box = BoxKey.from_secret(b"\x01" * 32)
    for length in (0, 1, 47, 48, 79, 81):
        with pytest.raises(SealBroken):
            box.open(b"\x05" * length)
    for length in (0, 31, 33, 64):
        with pytest.raises(ValueError, match="32 bytes"):
            SignKey.from_seed(bytes(length))
        with pytest.raises(ValueError, match="32 bytes"):
            BoxKey.from_secret(bytes(length))


def test_a_box_of_small_order_opens_nothing() -> None:
    """An ephemeral key of small order makes the shared secret zero for everybody: libsodium refuses it."""
    box = BoxKey.from_secret(b"\x01" * 32)
    for point in (bytes(32), b"\x01" + bytes(31)):
        with pytest.raises(SealBroken):
            box.open(point + b"\x05" * 48)


def test_the_published_vectors_are_what_the_script_makes() -> None:
    """If this fails: `python -m tests.vectors.make`, and say why the bytes changed."""
    assert edges.signatures() == SIGNATURES
    assert edges.seals() == SEALS
