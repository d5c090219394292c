"""The Directory after the start: revoking, epochs, purpose keys, renewals, and folders brought up to date."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from autopilot.ground import directory, directory_folders
from autopilot.ground import directory_changes as changes
from autopilot.ground.directory import HOUR_MS, DirectoryError
from autopilot.ground.directory_changes import Changed, Removal
from autopilot.ground.directory_papers import EPOCH_LIFE_MS, list_body, signed_bundle, signed_token
from autopilot.trust import documents, roots
from autopilot.trust.documents import DocumentUnsigned
from autopilot.trust.identity import load_identity, open_epoch
from autopilot.trust.keys import SealBroken, digest
from autopilot.trust.limits import SKEW_MS
from tests.autopilot.ground.directories import World, changed_token, device_id, digests, world
from tests.autopilot.trust.world import NOW_MS

LIFE_MS = 12 * HOUR_MS


@pytest.fixture
def made(tmp_path: Path) -> World:
    """A Directory with a node and an operator."""
    return world(tmp_path)


def check_refused(words: str, act: object, *args: object, **kwargs: object) -> None:
    """Check that the Directory refuses, and says why."""
    assert callable(act)
    with pytest.raises(DirectoryError, match=words):
        act(*args, **kwargs)


def check_revoked(made: World, *, principals: tuple[str, ...] = (), devices: int = 0, tokens: int = 0) -> None:
    """Check who is on the newest list."""
    found = made.open().revoked
    counts = (len(found.device_key_ids), len(found.token_ids))
    assert (found.principals, counts) == (frozenset(principals), (devices, tokens))


def test_revoking_is_cumulative_and_begins_an_epoch(made: World) -> None:
    """Each list names the one before; who is out gets no bundle."""
    before = made.open().state.revocations
    assert made.revoke("alice") == Changed(root_version=1, list_version=2, epoch_id=2)
    assert list_body(made.open().state).prev_digest == digest(before)
    assert made.revoke("wasp-01") == Changed(1, 3, 3)
    check_revoked(made, principals=("alice", "wasp-01"))
    assert (made.folder / "revocations").read_bytes() == made.open().state.revocations
    assert made.live() == []
    assert [epoch.min_revocation_version for epoch in made.open().state.epochs] == [3]


def test_a_device_or_a_token_may_be_out_alone(made: World) -> None:
    """The principal's other device stays."""
    alice = made.identity("alice")
    shutil.move(made.root / "alice", made.root / "alice-1")
    second = made.issue("alice")
    made.revoke(removal=Removal(device_key_ids=[device_id(alice)]))
    assert made.live() == ["wasp-01", "alice"]
    made.revoke(removal=Removal(token_ids=[second.token.token_id]))
    check_revoked(made, devices=1, tokens=1)
    assert made.live() == ["wasp-01"]


def test_a_list_signed_anew_begins_no_epoch(made: World) -> None:
    """So a list may be kept fresh every day; what was revoked already is no removal."""
    assert made.revoke(at_ms=NOW_MS + 1) == Changed(1, 2, 1)
    body = list_body(made.open().state)
    assert (body.issued_at_ms, body.next_update_ms) == (NOW_MS + 1, NOW_MS + 1 + 72 * HOUR_MS)
    assert made.revoke("alice") == Changed(1, 3, 2)
    assert made.revoke("alice") == Changed(1, 4, 2)
    assert made.revoke(removal=Removal(principals=["wasp-01"], keep_epoch=True)) == Changed(1, 5, 2)


def test_a_misspelt_name_is_not_revoked(made: World) -> None:
    """Else somebody believes that it was done."""
    before = digests(made.folder)
    check_refused("alcie.*did you mean alice", made.revoke, "alcie")
    check_refused("directory list", made.revoke, removal=Removal(device_key_ids=[b"\x01" * 16]))
    check_refused("directory list", made.revoke, removal=Removal(token_ids=[b"\x01" * 16]))
    assert digests(made.folder) == before
    made.revoke(removal=Removal(principals=["who"], device_key_ids=[b"\x01" * 16], even_unknown=True))
    check_revoked(made, principals=("who",), devices=1)


def test_floors_only_grow(made: World) -> None:
    """A floor above the newest epoch would shut everybody out."""
    check_refused("newest epoch is 1", made.revoke, removal=Removal(min_epoch_id=2))
    made.revoke("alice")
    made.revoke(removal=Removal(min_epoch_id=2, min_policy_version=5))
    found = made.open().revoked
    assert (found.min_epoch_id, found.min_policy_version) == (2, 5)
    check_refused("is 2 already", made.revoke, removal=Removal(min_epoch_id=1))
    check_refused("is 5 already", made.revoke, removal=Removal(min_policy_version=4))
    assert made.issue("bob").token.policy_version == 5


def test_what_is_out_of_bounds_is_not_kept(made: World) -> None:
    """Neither in the state nor in a folder."""
    before = digests(made.root)
    check_refused("principal_id", made.issue, "No Name")
    assert digests(made.root) == before


@pytest.mark.parametrize("what", ["principal", "device", "token"])
def test_an_entry_goes_when_all_it_covers_has_expired(made: World, what: str) -> None:
    """Not a moment earlier, by the signer's own time, which the list tells to its readers."""
    alice = made.identity("alice")
    made.revoke(
        removal={
            "principal": Removal(principals=["alice"]),
            "device": Removal(device_key_ids=[device_id(alice)]),
            "token": Removal(token_ids=[alice.token.token_id]),
        }[what]
    )
    over_ms = alice.token.not_after_ms + SKEW_MS
    made.revoke(at_ms=over_ms)
    assert made.open().revoked.covers(alice.token)
    made.revoke(at_ms=over_ms + 1)
    assert not made.open().revoked.covers(alice.token)
    assert [token.principal_id for token in made.open().state.tokens] == ["wasp-01"]


def test_an_entry_stays_while_one_token_lives(made: World) -> None:
    """A second device keeps the name on the list; what covers nothing that is known stays for good."""
    first = made.identity("alice")
    shutil.move(made.root / "alice", made.root / "alice-1")
    made.issue("alice", at_ms=NOW_MS + HOUR_MS)
    made.revoke(removal=Removal(principals=["alice", "who"], even_unknown=True))
    made.revoke(at_ms=first.token.not_after_ms + SKEW_MS + 1)
    check_revoked(made, principals=("alice", "who"))
    made.revoke(at_ms=first.token.not_after_ms + HOUR_MS + SKEW_MS + 1)
    check_revoked(made, principals=("who",))


def test_who_is_revoked_gets_nothing_new(made: World) -> None:
    """Neither a token, nor a renewal, nor a folder."""
    alice = made.identity("alice")
    made.revoke("alice")
    shutil.move(made.root / "alice", made.root / "old")
    check_refused("is revoked", made.issue, "alice")
    check_refused("no live device", changes.renew, made.folder, device_id(alice), NOW_MS, made.random)
    check_refused("revoked or has expired", directory_folders.token_in, made.open(), made.root / "old", NOW_MS)
    check_refused("not the name", directory_folders.export, made.open(), "alice", made.root / "out", NOW_MS)


def test_an_epoch_is_new_random_and_grows(made: World) -> None:
    """The old secret is overwritten and gone; nobody's bundle holds it."""
    old = (made.folder / "epoch-1.secret").read_bytes()
    held = os.open(made.folder / "epoch-1.secret", os.O_RDONLY)  # the old file, whatever its name
    wasp = made.identity("wasp-01")
    assert changes.rotate_epoch(made.folder, NOW_MS, made.random).epoch_id == 2
    assert os.pread(held, 64, 0) == bytes(32)
    os.close(held)
    assert sorted(path.name for path in made.folder.glob("epoch-*.secret")) == ["epoch-2.secret"]
    opened = open_epoch(made.bundle(wasp), wasp.sign_key, wasp.box_key)
    assert (opened.epoch_id, opened.not_before_ms, opened.retire_at_ms) == (2, NOW_MS, NOW_MS + EPOCH_LIFE_MS)
    assert opened.secret not in (old, bytes(32))


def test_a_lead_gives_the_key_out_before_it_is_used(made: World) -> None:
    """Until then the old one is in use; after that it is dropped."""
    changes.rotate_epoch(made.folder, NOW_MS, made.random, lead_ms=60_000)
    assert made.open().epoch_at(NOW_MS + 59_999).epoch_id == 1
    assert made.open().epoch_at(NOW_MS + 60_000).epoch_id == 2
    changes.tidy(made.folder, NOW_MS + 59_999)
    assert len(list(made.folder.glob("epoch-*.secret"))) == 2
    changes.tidy(made.folder, NOW_MS + 60_000)
    assert [path.name for path in made.folder.glob("epoch-*.secret")] == ["epoch-2.secret"]
    check_refused("no epoch is in use", made.open().epoch_at, NOW_MS + 60_000 + EPOCH_LIFE_MS)
    assert changes.rotate_epoch(made.folder, NOW_MS + 99 * EPOCH_LIFE_MS, made.random).epoch_id == 3


def test_a_bundle_is_the_same_bytes_every_time(made: World) -> None:
    """Nobody sees two versions of one; another device's is another."""
    wasp, alice = made.identity("wasp-01"), made.identity("alice")
    assert made.bundle(wasp) == made.bundle(wasp)
    assert made.bundle(wasp).wrapped_key != made.bundle(alice).wrapped_key
    with pytest.raises(SealBroken):
        open_epoch(made.bundle(wasp), alice.sign_key, alice.box_key)


def test_a_stolen_box_key_forges_no_bundle(made: World) -> None:
    """Whoever holds a device's box key can read its bundle, and can wrap a key of his own; he can't sign it."""
    wasp, thief = made.identity("wasp-01"), world(made.root / "thief", seed=2)
    genuine = made.bundle(wasp)
    assert len(wasp.box_key.open(genuine.wrapped_key)) == 32
    forged = signed_bundle(thief.open(), thief.open().state.epochs[0], wasp.token)
    with pytest.raises(DocumentUnsigned):
        documents.verify_epoch_bundle(forged, made.open().trust)


@pytest.mark.parametrize("purpose", documents.PURPOSES)
def test_a_purpose_key_is_replaced_under_the_root(made: World, purpose: str) -> None:
    """The new root follows the pinned one; what the old key signs is worthless; the old key is overwritten."""
    pinned, old = made.open().state.trust_root, made.open()
    held = os.open(made.folder / f"{purpose}.key", os.O_RDONLY)
    assert made.rotate(purpose).root_version == 2
    assert os.pread(held, 64, 0) == bytes(32)
    os.close(held)
    trust = roots.verify_successor(made.open().state.trust_root, pinned)
    assert {name for name in documents.PURPOSES if trust.keys[name] != old.trust.keys[name]} == {purpose}
    assert sorted(path.name for path in made.folder.glob(f"{purpose}*.key")) == [f"{purpose}-2.key"]
    wasp = made.identity("wasp-01")
    documents.verify_token(signed_token(made.open(), wasp.token), trust)
    documents.verify_revocations(made.open().state.revocations, trust)
    documents.verify_epoch_bundle(signed_bundle(made.open(), made.open().state.epochs[0], wasp.token), trust)
    check_old_key_is_worthless(old, wasp.token_bytes, trust, purpose)


def check_old_key_is_worthless(old: directory.Directory, token: bytes, trust: documents.Trust, purpose: str) -> None:
    """Check that documents of the replaced purpose no longer verify, and the others do."""
    outcomes = {}
    for name, verify, data in (
        ("token", documents.verify_token, token),
        ("revoke", documents.verify_revocations, old.state.revocations),
    ):
        try:
            verify(data, trust)
            outcomes[name] = True
        except DocumentUnsigned:
            outcomes[name] = False
    assert outcomes == {name: name != purpose for name in ("token", "revoke")}


def test_a_list_goes_on_growing_under_a_new_key(made: World) -> None:
    """Recovery from a fast-forward: the thief's list of version 2^63 is not signed by the new key, and ours goes on."""
    made.revoke("alice")
    stolen = made.open()
    body = list_body(stolen.state)
    body.version = 1 << 63
    body.principals[:] = []
    forged = documents.sign(documents_context(), body, [stolen.purpose_keys["revoke"]])
    assert documents.verify_revocations(forged, stolen.trust).version == 1 << 63
    assert made.rotate("revoke") == Changed(2, 3, 2)
    trust = made.open().trust
    with pytest.raises(DocumentUnsigned):
        documents.verify_revocations(forged, trust)
    assert documents.verify_revocations(made.open().state.revocations, trust).principals == {"alice"}


def documents_context() -> bytes:
    """The context of a revocation list."""
    return b"waypoint/v1/RevocationList"


def test_a_token_is_renewed_in_the_second_half_of_its_life(made: World) -> None:
    """Before that the same one is given again; names and roles stay."""
    alice = made.identity("alice")
    renew = changes.renew
    before = (made.folder / "directory.state").stat().st_ino
    assert renew(made.folder, device_id(alice), NOW_MS + LIFE_MS // 2 - 1, made.random) == alice.token
    assert (made.folder / "directory.state").stat().st_ino == before
    fresh = renew(made.folder, device_id(alice), NOW_MS + LIFE_MS // 2, made.random)
    assert fresh.token_id != alice.token.token_id
    assert (fresh.not_before_ms, fresh.not_after_ms) == (NOW_MS + LIFE_MS // 2, NOW_MS + LIFE_MS // 2 + LIFE_MS)
    again = renew(made.folder, device_id(alice), NOW_MS + LIFE_MS // 2, made.random)
    assert again == fresh
    bare = changed_token(fresh, lambda token: token.CopyFrom(alice.token))
    assert changed_token(fresh, lambda token: _times(token, bare)) == bare
    check_refused("no live device", renew, made.folder, device_id(alice), fresh.not_after_ms + 1, made.random)


def _times(token: object, like: object) -> None:
    for name in ("token_id", "not_before_ms", "not_after_ms"):
        setattr(token, name, getattr(like, name))


def test_a_new_policy_renews_at_once(made: World) -> None:
    """Else everybody would be out until half of a life is over."""
    made.revoke(removal=Removal(min_policy_version=2))
    assert changes.renew(made.folder, device_id(made.identity("alice")), NOW_MS, made.random).policy_version == 2


def test_a_folder_is_brought_up_to_date(made: World) -> None:
    """By root, list, epoch and nodes; a copy without keys is enough to write to."""
    made.issue("hornet-02", "node")
    made.revoke("wasp-01")
    made.rotate("token")
    token = directory_folders.token_in(made.open(), made.root / "alice", NOW_MS)
    directory_folders.write_papers(made.open(), made.root / "alice", token, NOW_MS)
    alice = load_identity(made.root / "alice", NOW_MS)
    assert (alice.trust.version, alice.revocations.version, list(alice.epochs)) == (2, 2, [2])
    assert [path.name for path in (made.root / "alice" / "nodes").iterdir()] == ["hornet-02.token"]
    assert set(alice.known_nodes) == {"hornet-02"}
    directory_folders.export(made.open(), "alice", made.root / "export", NOW_MS)
    exported = digests(made.root / "export")
    assert exported == {name: found for name, found in digests(made.root / "alice").items() if "device." not in name}


def test_a_folder_of_another_directory_is_left_alone(made: World) -> None:
    """Its root is pinned to others."""
    other = world(made.root / "other", seed=2)
    before = digests(other.root / "alice")
    check_refused(
        "no identity of this Directory", directory_folders.token_in, made.open(), other.root / "alice", NOW_MS
    )
    check_refused("No such file", directory_folders.token_in, made.open(), made.root / "nowhere", NOW_MS)
    assert digests(other.root / "alice") == before


def test_one_device_of_several_is_exported_by_its_key_id(made: World) -> None:
    """A name alone is refused then, and the ids are told."""
    shutil.move(made.root / "alice", made.root / "alice-1")
    second = made.issue("alice")
    check_refused(device_id(second).hex(), directory_folders.export, made.open(), "alice", made.root / "out", NOW_MS)
    found = directory_folders.export(made.open(), device_id(second).hex(), made.root / "out", NOW_MS)
    assert found.device_sign_pk == second.public_key


def test_a_folder_that_others_may_read_is_refused(made: World) -> None:
    """The state holds enrolment keys; each secret is its owner's."""
    for name, words in (("directory.state", "others may read it"), ("token.key", "others may read this secret")):
        os.chmod(made.folder / name, 0o640)
        check_refused(words, made.open)
        os.chmod(made.folder / name, 0o600)
    assert {path.stat().st_mode & 0o077 for path in made.folder.glob("*.key")} == {0}


def test_a_damaged_folder_is_named(made: World) -> None:
    """And a key that is not the one the root names."""
    shutil.copy(made.folder / "time.key", made.folder / "token.key")
    check_refused("key for token is not the root's", made.open)
    (made.folder / "directory.state").write_bytes(b"\xff")
    check_refused("is damaged", made.open)
    (made.folder / "directory.state").write_bytes(b"\x08\x02")
    check_refused("format 2", made.open)
    (made.folder / "directory.state").unlink()
    check_refused("directory init", made.open)
    check_refused("directory init", made.revoke, "alice")


def test_each_command_needs_its_own_keys_only(made: World) -> None:
    """The root and the key for revocations may lie elsewhere while the Directory serves, issues and rotates."""
    (made.folder / "root.key").unlink()
    (made.folder / "revoke.key").rename(made.root / "revoke.key")
    directory.issue(
        directory.open_directory(made.folder, ()),
        "bob",
        made.root / "bob",
        kind="operator",
        roles=(),
        callsign="",
        now_ms=NOW_MS,
        random=made.random,
    )
    changes.rotate_epoch(made.folder, NOW_MS, made.random)
    check_refused("revoke.key.*signs with that key", made.revoke, "bob")
    (made.root / "revoke.key").rename(made.folder / "revoke.key")
    made.revoke("bob")
