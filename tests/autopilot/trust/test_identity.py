"""Files of an identity: who may read them, what is refused, and with which words."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from autopilot.ground import directory
from autopilot.ground.directory import DirectoryError
from autopilot.trust import documents, pae
from autopilot.trust.documents import DocumentError, DocumentMalformed, DocumentUnsigned
from autopilot.trust.identity import IdentityError, load_identity, open_epoch
from autopilot.trust.keys import BoxKey, SealBroken, wrap
from autopilot.trust.window import ReplayWindow, TokenBucket
from events.schema.waypoint_pb2 import EpochBundle, IdentityToken, RevocationList, SignedDoc, TrustRoot
from tests.autopilot.trust.world import NOW_MS, people, seeded

SECRETS = ("device.sign", "device.box")


def check_refused(folder: Path, name: str, words: str, now_ms: int | None = NOW_MS) -> None:
    """Loading fails with an error that names the file and says `words`."""
    with pytest.raises(IdentityError, match=words) as caught:
        load_identity(folder, now_ms)
    assert str(folder / name) in str(caught.value)


@pytest.fixture
def alice(tmp_path: Path) -> Path:
    """A copy of Alice's folder that a test may spoil."""
    return Path(shutil.copytree(people().alice.folder, tmp_path / "alice"))


def test_an_identity_is_what_was_issued(alice: Path) -> None:
    loaded = load_identity(alice, NOW_MS)
    assert (loaded.principal_id, loaded.callsign, list(loaded.token.roles)) == ("alice", "ALICE", ["operator"])
    assert loaded.known_nodes == {
        "wasp-01": people().wasp.public_key,
        "hornet-02": people().hornet.public_key,
    }
    assert loaded.epochs[1].secret == people().wasp.epochs[1].secret
    assert loaded.epochs[1].secret.hex() not in repr(loaded)


def test_secrets_are_for_their_owner_only(alice: Path) -> None:
    folder = people().directory.folder
    secrets = [alice / name for name in SECRETS] + sorted(folder.glob("*.key")) + sorted(folder.glob("*.secret"))
    assert len(secrets) == 2 + 5 + 1
    assert {path.stat().st_mode & 0o777 for path in secrets} == {0o600}


@pytest.mark.parametrize("name", SECRETS)
@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o601])
def test_a_secret_that_others_may_touch_is_refused(alice: Path, name: str, mode: int) -> None:
    os.chmod(alice / name, mode)
    check_refused(alice, name, "chmod 600")


@pytest.mark.parametrize("name", ["device.sign", "device.box", "token", "trust_root", "revocations", "epoch"])
def test_a_missing_file_is_named(alice: Path, name: str) -> None:
    (alice / name).unlink()
    check_refused(alice, name, "No such file")


@pytest.mark.parametrize("name", ["token", "trust_root", "revocations", "epoch"])
def test_a_document_with_one_bit_changed_is_refused(alice: Path, name: str) -> None:
    data = bytearray((alice / name).read_bytes())
    data[len(data) // 2] ^= 1
    (alice / name).write_bytes(bytes(data))
    with pytest.raises(IdentityError):
        load_identity(alice, NOW_MS)


@pytest.mark.parametrize("name", ["token", "revocations", "epoch"])
def test_a_document_of_another_directory_is_refused(alice: Path, name: str) -> None:
    shutil.copy(people(2).alice.folder / name, alice / name)
    check_refused(alice, name, "signature")


def test_a_document_of_another_device_is_refused(alice: Path) -> None:
    shutil.copy(people().bob.folder / "token", alice / "token")
    check_refused(alice, "token", "other keys")
    shutil.copy(people().alice.folder / "token", alice / "token")
    shutil.copy(people().bob.folder / "epoch", alice / "epoch")
    check_refused(alice, "epoch", "another device")


def test_what_has_run_out_is_refused(alice: Path) -> None:
    check_refused(alice, "token", "expired", NOW_MS + 12 * 3_600_000 + 1)
    assert load_identity(alice, NOW_MS + 12 * 3_600_000).principal_id == "alice"


def test_a_root_that_has_run_out_is_refused(tmp_path: Path) -> None:
    directory.issue(
        people().directory,
        "old",
        tmp_path / "old",
        kind="service",
        roles=[],
        callsign="",
        now_ms=NOW_MS,
        random=seeded(1),
        hours=9000,
    )
    check_refused(tmp_path / "old", "trust_root", "expired", NOW_MS + 365 * 24 * 3_600_000)


def check_bundle(words: str, change: Callable[[EpochBundle], object]) -> None:
    """A bundle with one change, signed by the Directory, does not open for Alice."""
    made, alice = people().directory, people().alice
    bundle = documents.verify_epoch_bundle((alice.folder / "epoch").read_bytes(), made.trust)
    change(bundle)
    signed = documents.sign(pae.EPOCH_BUNDLE, bundle, [made.purpose_keys["epoch"]])
    verified = documents.verify_epoch_bundle(signed, made.trust)
    with pytest.raises(SealBroken, match=words):
        open_epoch(verified, alice.sign_key, alice.box_key)


def test_a_group_key_is_the_one_committed_to_and_for_this_device() -> None:
    check_bundle("committed", lambda bundle: setattr(bundle, "key_commitment", b"\x01" * 32))
    check_bundle("committed", lambda bundle: setattr(bundle, "epoch_id", 2))
    check_bundle("wrapped for another", lambda bundle: setattr(bundle, "recipient_device_key_id", b"\x01" * 16))


def test_a_token_must_fit_both_keys(alice: Path) -> None:
    for purpose in ("device_sign_pk", "device_box_pk"):
        token = IdentityToken()
        token.CopyFrom(people().alice.token)
        setattr(token, purpose, b"\x05" * 32)
        signed = documents.sign(pae.IDENTITY_TOKEN, token, [people().directory.purpose_keys["token"]])
        (alice / "token").write_bytes(signed)
        check_refused(alice, "token", "other keys")


def test_only_nodes_are_known_as_nodes(alice: Path) -> None:
    shutil.copy(people().bob.folder / "token", alice / "nodes" / "bob.token")
    assert set(load_identity(alice).known_nodes) == {"wasp-01", "hornet-02"}


def test_a_short_secret_is_refused(alice: Path) -> None:
    (alice / "device.box").write_bytes(b"short")
    check_refused(alice, "device.box", "5 bytes")


def test_the_same_chance_makes_the_same_directory(tmp_path: Path) -> None:
    made = []
    for name in ("a", "b"):
        first = directory.init(tmp_path / name, deployment_id="d", now_ms=NOW_MS, random=seeded(9))
        directory.issue(
            first, "n", tmp_path / name / "n", kind="node", roles=[], callsign="", now_ms=NOW_MS, random=seeded(10)
        )
        files = sorted(path for path in (tmp_path / name).rglob("*") if path.is_file())
        made.append([(path.relative_to(tmp_path / name), path.read_bytes()) for path in files])
    assert made[0] == made[1]


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    made = directory.init(tmp_path / "d", deployment_id="d", now_ms=NOW_MS, random=seeded(9))
    with pytest.raises(DirectoryError, match="holds a Directory already"):
        directory.init(tmp_path / "d", deployment_id="d", now_ms=NOW_MS, random=seeded(9))

    def issue(principal: str, out: str) -> None:
        directory.issue(
            made, principal, tmp_path / out, kind="node", roles=[], callsign="", now_ms=NOW_MS, random=seeded(1)
        )

    issue("n", "n")
    with pytest.raises(DirectoryError, match="holds an identity already"):
        issue("m", "n")
    with pytest.raises(DirectoryError, match="principal_id"):
        issue("No Name", "m")
    assert not (tmp_path / "m").exists()


TOKEN_FAULTS: dict[str, Callable[[IdentityToken], object]] = {
    "v": lambda t: setattr(t, "v", 2),
    "principal_id": lambda t: setattr(t, "principal_id", "a/b"),
    "kind": lambda t: t.ClearField("kind"),
    "device_sign_pk": lambda t: setattr(t, "device_sign_pk", bytes(32)),
    "device_box_pk": lambda t: setattr(t, "device_box_pk", b"\x01" * 31),
    "roles": lambda t: t.roles.extend(["a", "a"]),
    "roles: 1": lambda t: t.roles.extend(["r" * 33]),
    "not_after_ms": lambda t: setattr(t, "not_after_ms", t.not_before_ms),
    "token_id": lambda t: setattr(t, "token_id", b"\x01" * 15),
    "callsign": lambda t: setattr(t, "callsign", "A\nB"),
}


@pytest.mark.parametrize("name", TOKEN_FAULTS)
def test_a_signed_token_out_of_bounds_is_refused(name: str) -> None:
    made, token = people().directory, IdentityToken()
    token.CopyFrom(people().alice.token)
    token.ClearField("roles")
    TOKEN_FAULTS[name](token)
    signed = documents.sign(pae.IDENTITY_TOKEN, token, [made.purpose_keys["token"]])
    with pytest.raises(DocumentMalformed, match=f"IdentityToken: {name}"):
        documents.verify_token(signed, made.trust)


def test_a_signature_for_one_purpose_serves_no_other() -> None:
    made = people().directory
    for context, purpose in ((pae.REVOCATION_LIST, "token"), (pae.IDENTITY_TOKEN, "epoch")):
        signed = documents.sign(context, people().alice.token, [made.purpose_keys[purpose]])
        with pytest.raises(DocumentUnsigned):
            documents.verify_token(signed, made.trust)


def test_a_signer_counts_once_and_none_is_not_enough() -> None:
    made = people().directory
    key = made.purpose_keys["token"]
    for keys in ([key, key], []):
        with pytest.raises(DocumentUnsigned):
            documents.verify_token(documents.sign(pae.IDENTITY_TOKEN, people().alice.token, keys), made.trust)


ROOT_FAULTS: dict[str, Callable[[TrustRoot], object]] = {
    "threshold 0": lambda r: r.ClearField("threshold"),
    "threshold 2": lambda r: setattr(r, "threshold", 2),
    "the same root key twice": lambda r: r.root_keys.append(r.root_keys[0]),
    "a purpose missing": lambda r: r.keys.pop(),
    "a purpose with the root's key": lambda r: setattr(r.keys[0], "public_key", r.root_keys[0]),
    "two purposes with one key": lambda r: setattr(r.keys[0], "public_key", r.keys[1].public_key),
    "a version of 0": lambda r: r.ClearField("version"),
}


@pytest.mark.parametrize("name", ROOT_FAULTS)
def test_a_root_that_is_signed_but_wrong_is_refused(name: str) -> None:
    made = people().directory
    root = documents.parse(TrustRoot, documents.parse(SignedDoc, _root_file()).body)
    ROOT_FAULTS[name](root)
    with pytest.raises(DocumentError):
        documents.verify_trust_root(documents.sign(pae.TRUST_ROOT, root, [made.root_key]))


def _root_file() -> bytes:
    return (people().directory.folder / "trust_root").read_bytes()


def test_a_revocation_list_is_sorted_and_bounded() -> None:
    made = people().directory
    body = documents.parse(RevocationList, documents.parse(SignedDoc, (made.folder / "revocations").read_bytes()).body)
    body.principals.extend(["a", "b"])
    verify = documents.verify_revocations
    key = made.purpose_keys["revoke"]
    assert verify(documents.sign(pae.REVOCATION_LIST, body, [key]), made.trust).principals == {"a", "b"}
    body.principals.append("a")
    with pytest.raises(DocumentMalformed, match="sorted"):
        verify(documents.sign(pae.REVOCATION_LIST, body, [key]), made.trust)
    del body.principals[:]
    body.device_key_ids.extend(number.to_bytes(16, "big") for number in range(4097))
    with pytest.raises(DocumentMalformed, match="4096"):
        verify(documents.sign(pae.REVOCATION_LIST, body, [key]), made.trust)


def test_a_wrapped_key_opens_for_its_recipient_only() -> None:
    ours, others = BoxKey.from_secret(b"\x01" * 32), BoxKey.from_secret(b"\x02" * 32)
    wrapped = wrap(b"s" * 32, ours.public, seeded(4))
    assert len(wrapped) == 80
    assert ours.open(wrapped) == b"s" * 32
    for key, data in ((others, wrapped), (ours, wrapped[:-1]), (ours, b"")):
        with pytest.raises(SealBroken):
            key.open(data)


def test_a_window_never_evicts_the_living() -> None:
    window = ReplayWindow(per_device=2, total=3)
    for device, nonce in ((b"a", b"1"), (b"a", b"2"), (b"b", b"3")):
        assert window.has_room(device, 100)
        window.insert(device, nonce, 200)
    assert not window.has_room(b"c", 200)
    assert window.has_room(b"c", 201)
    assert not window.seen(b"a", b"1")
    assert len(window) == 0


def test_a_window_restores_only_what_is_alive() -> None:
    window = ReplayWindow()
    window.restore([(b"a", b"1", 1), (b"a", b"2", 0), (b"a", b"3", -1)], 100)
    assert [window.seen(b"a", nonce) for nonce in (b"1", b"2", b"3")] == [True, False, False]


def test_a_bucket_does_not_save_beyond_its_depth() -> None:
    bucket = TokenBucket(per_s=10, burst=2)
    assert bucket.take(0)
    assert [bucket.take(10**12) for _ in range(3)] == [True, True, False]
