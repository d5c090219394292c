"""Cosigned proofs and consistency proofs: what is exported, what the verifier says of it, and what it refuses."""

from __future__ import annotations

import base64
import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from autopilot.cli import export, verify
from autopilot.ground.consistency import check_consistent, is_consistency
from autopilot.ground.papers import Cosigner
from autopilot.ground.verifier import ProofRefused, check
from autopilot.node.sealing import CERTIFICATE_FILE
from autopilot.trust.cosignatures import cosign, cosigned, parted
from autopilot.trust.identity import ROOT_FILE, TOKEN_FILE
from autopilot.trust.keys import SignKey
from autopilot.trust.notes import sign_note
from events.store import SqliteStore, read_flight
from events.tree import Tree
from replay.proof import NotSealed, Papers, prove, prove_consistency
from replay.verify import verify as verify_replay
from tests.autopilot.cli.flown import run
from tests.autopilot.trust.world import people
from tests.replay.cosigned import AT_S, COSIGNED_SIZE, cosigned_story

Change = Callable[[dict[str, Any]], object]
WHOLE = COSIGNED_SIZE + 3


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a flight that Alice and Vic cosigned."""
    return cosigned_story(tmp_path, "alice", "viewer").flight.folder


def papers(folder: Path) -> Papers:
    """Read what lies beside the log."""
    return Papers(
        log_key=(folder / CERTIFICATE_FILE).read_text(encoding="utf-8"),
        token=(folder / TOKEN_FILE).read_bytes(),
        trust_root=(folder / ROOT_FILE).read_bytes(),
    )


def proof(folder: Path, seq: int) -> bytes:
    """Return the proof of a record."""
    reader = read_flight(folder)
    try:
        return prove(reader, seq, papers(folder))
    finally:
        reader.close()


def grown(folder: Path, old: int = COSIGNED_SIZE, new: int | None = None) -> bytes:
    """Return the proof that the log only grew."""
    reader = read_flight(folder)
    try:
        return prove_consistency(reader, old, new, papers(folder))
    finally:
        reader.close()


def changed(data: bytes, change: Change) -> bytes:
    """Return a proof with a change, written as a proof is."""
    made = json.loads(data)
    change(made)
    return json.dumps(made, sort_keys=True, indent=1).encode() + b"\n"


def check_refused(check_it: Callable[[bytes], object], data: bytes, because: str) -> None:
    """Check that a file is refused for a reason."""
    with pytest.raises(ProofRefused, match=because):
        check_it(data)


def test_a_proof_rests_on_the_newest_cosigned_checkpoint(folder: Path) -> None:
    """It says by whom and when, and stays small; what came later rests on the node's word alone."""
    proved = check(proof(folder, 114))
    assert proved.cosigners == (Cosigner("alice", "ALICE", AT_S), Cosigner("vic", "VIC", AT_S))
    assert proved.size == COSIGNED_SIZE
    assert "cosigned by alice at 2026-09-21 " in proved.words()
    assert len(proof(folder, 114)) < 10_000
    later = check(proof(folder, COSIGNED_SIZE))
    assert (later.size, later.cosigners, "cosigned" in later.words()) == (WHOLE, (), False)
    reader = read_flight(folder)
    assert verify_replay(reader).holds
    reader.close()


def test_witnesses_whose_token_is_gone_are_left_out(folder: Path) -> None:
    """The line proves nothing without it."""
    store = SqliteStore(folder / "flight.db")
    size, note = store.checkpoints()[0]
    text, bare, lines = parted(note)
    bob = cosign(text, "waypoint/coast-watch/bob", people().bob.sign_key, AT_S)
    store.add_checkpoint(size, cosigned(bare, [bob, *lines]))
    store.close()
    assert [one.principal for one in check(proof(folder, 114)).cosigners] == ["alice", "vic"]


def _alice(note: str, key: SignKey | None = None, name: str = "alice", time_s: int = AT_S) -> str:
    text, bare, (_, vic) = parted(note)
    own = cosign(text, f"waypoint/coast-watch/{name}", key or people().alice.sign_key, time_s)
    return cosigned(bare, [own, vic])


def _token(who: str) -> str:
    return base64.b64encode(getattr(people(), who).token_bytes).decode()


def _swap(made: dict[str, Any], **changes: Any) -> None:
    made.update({name: change(made[name]) for name, change in changes.items()})


BAD_COSIGNATURES: dict[str, tuple[str, Change]] = {
    "a token less": ("not each of its witnesses", lambda p: p["witnesses"].pop()),
    "a line less": ("not each", lambda p: _swap(p, checkpoint=lambda note: parted(note)[1])),
    "turned": ("not under this name", lambda p: p["witnesses"].reverse()),
    "no texts": ("no texts", lambda p: p.update(witnesses=[1, 2])),
    "no list": ("no texts", lambda p: p.update(witnesses="alice")),
    "a node": ("not a witness's", lambda p: p["witnesses"].__setitem__(0, _token("hornet"))),
    "somebody else": ("not under this name", lambda p: p["witnesses"].__setitem__(0, _token("bob"))),
    "another key": ("by another key", lambda p: _swap(p, checkpoint=lambda n: _alice(n, people().bob.sign_key))),
    "another name": ("not under this name", lambda p: _swap(p, checkpoint=lambda n: _alice(n, name="alicia"))),
    "no time": ("time of the cosignature", lambda p: _swap(p, checkpoint=lambda n: _alice(n, time_s=1 << 60))),
    "twice": (
        "signed it twice",
        lambda p: _swap(p, checkpoint=_twice, witnesses=lambda tokens: [tokens[0], *tokens]),
    ),
    "another directory": (
        "key that is not known",
        lambda p: p["witnesses"].__setitem__(0, base64.b64encode(people(2).alice.token_bytes).decode()),
    ),
}


def _twice(note: str) -> str:
    _, bare, (alice, vic) = parted(note)
    return cosigned(bare, [alice, alice, vic])


@pytest.mark.parametrize("name", BAD_COSIGNATURES)
def test_a_bad_cosignature_spoils_the_proof(folder: Path, name: str) -> None:
    because, change = BAD_COSIGNATURES[name]
    check_refused(check, changed(proof(folder, 114), change), because)


def test_a_cosignature_can_not_be_moved_in_time(folder: Path) -> None:
    """The time is under the signature."""

    def later(note: str) -> str:
        _, bare, (alice, vic) = parted(note)
        return cosigned(bare, [type(alice)(alice.name, alice.key_id, AT_S + 1, alice.signature), vic])

    data = changed(proof(folder, 114), lambda made: _swap(made, checkpoint=later))
    check_refused(check, data, "waypoint/coast-watch/alice: the signature does not match")


def test_a_log_that_grew_is_proved(folder: Path) -> None:
    """Between two signed checkpoints; without a size up to the newest."""
    data = grown(folder)
    proved = check_consistent(data, papers(folder).trust_root)
    assert (proved.old.size, proved.new.size, proved.log.node) == (COSIGNED_SIZE, WHOLE, "wasp-01")
    assert [one.principal for one in proved.old.cosigners] == ["alice", "vic"]
    words = proved.words()
    assert f"over {WHOLE} records, begins with the {COSIGNED_SIZE} records" in words
    assert (words.count("cosigned by"), is_consistency(data), is_consistency(proof(folder, 9))) == (1, True, False)
    assert grown(folder, COSIGNED_SIZE, WHOLE) == data


def test_any_two_sizes_are_followed() -> None:
    """The verifier's own walk, against every pair of sizes of a small log and seeded ones of a larger."""
    from autopilot.ground.consistency import _grows
    from autopilot.ground.papers import Head

    tree, chance = Tree([number.to_bytes(32, "big") for number in range(1, 701)]), random.Random(4)
    pairs = [(old, new) for new in range(2, 34) for old in range(1, new)]
    pairs += [(old, new) for old, new in (sorted(chance.sample(range(1, 701), 2)) for _ in range(200))]
    for old, new in pairs:
        one, other = Head(old, tree.root(old), 0, ()), Head(new, tree.root(new), 0, ())
        path = tree.consistency(old, new)
        assert _grows(one, other, path)
        assert not _grows(one, other, path[:-1])
        assert not _grows(one, other, [*path, bytes(32)])
        assert not _grows(Head(old, bytes(32), 0, ()), other, path)
        assert not _grows(one, Head(new, bytes(32), 0, ()), path)
        assert not _grows(one, other, [bytes(32), *path[1:]])
        assert not _grows(one, other, [])


BAD_GROWTH: dict[str, tuple[str, Change]] = {
    "another path": ("does not begin with", lambda p: p["path"].reverse()),
    "a hash less": ("does not begin with", lambda p: p["path"].pop()),
    "a short hash": ("has 31 bytes", lambda p: p.update(path=[base64.b64encode(bytes(31)).decode()])),
    "no path": ("no texts", lambda p: p.update(path=None)),
    "turned": (
        "not in their order",
        lambda p: p.update(
            old_checkpoint=p["new_checkpoint"], new_checkpoint=p["old_checkpoint"],
            old_witnesses=p["new_witnesses"], new_witnesses=p["old_witnesses"],
        ),
    ),
    "the same twice": (
        "not in their order",
        lambda p: p.update(new_checkpoint=p["old_checkpoint"], new_witnesses=p["old_witnesses"], path=[]),
    ),
    "no older witnesses": ("not each of its witnesses", lambda p: p.update(old_witnesses=[])),
    "more witnesses": ("not each of its witnesses", lambda p: p.update(new_witnesses=p["old_witnesses"])),
    "another part": ("other parts", lambda p: p.update(records=[])),
    "another format": ("not of format", lambda p: p.update(format="autopilot-proof/1")),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_GROWTH)
def test_a_changed_consistency_proof_is_refused(folder: Path, name: str) -> None:
    because, change = BAD_GROWTH[name]
    check_refused(check_consistent, changed(grown(folder), change), because)


def test_no_bit_of_it_can_be_changed(folder: Path) -> None:
    """A sample of bits over the whole file."""
    data = grown(folder)
    for bit in sorted(random.Random(3).sample(range(len(data) * 8), 400)):
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        check_refused(check_consistent, bytes(flipped), ".")


def test_another_root_is_noticed(folder: Path) -> None:
    with pytest.raises(ProofRefused, match="another trust root"):
        check_consistent(grown(folder), (people(2).wasp.folder / ROOT_FILE).read_bytes())


@pytest.mark.parametrize(
    ("old", "new", "because"),
    [
        (7, None, f"no checkpoint over 7 records was signed; near it: {COSIGNED_SIZE}"),
        (COSIGNED_SIZE, WHOLE + 1, "no checkpoint over"),
        (WHOLE, COSIGNED_SIZE, "does not go on from"),
        (WHOLE, WHOLE, "does not go on from"),
    ],
)
def test_sizes_that_nobody_signed(folder: Path, old: int, new: int | None, because: str) -> None:
    with pytest.raises(NotSealed, match=because):
        grown(folder, old, new)


def test_the_commands(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Export, verify; and a flight whose key was another one when it was cosigned."""
    out = tmp_path / "grown.json"
    words = ["export", "consistency", str(folder), "--from", str(COSIGNED_SIZE), str(out)]
    assert run(export, words) == 0
    assert f"from {COSIGNED_SIZE} to {WHOLE} records" in capsys.readouterr().err
    assert run(verify, ["verify", str(out)]) == 0
    assert capsys.readouterr().out == check_consistent(out.read_bytes()).words() + "\n"
    assert run(verify, ["verify", str(out), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["old_records"], said["new_records"], len(said["old_cosigners"])) == (COSIGNED_SIZE, WHOLE, 2)
    out.write_bytes(out.read_bytes()[:-1])
    assert run(verify, ["verify", str(out)]) == 65
    assert run(export, [*words[:4], "7", str(out)]) == 65
    assert run(export, ["export", "proof", str(folder), "--seq", "114", str(out)]) == 0
    assert run(verify, ["verify", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["cosigners"][0] == {
        "principal": "alice", "callsign": "ALICE", "time_s": AT_S,
    }  # fmt: skip


def test_a_cosigned_checkpoint_of_a_lost_key_is_passed_over(folder: Path, tmp_path: Path) -> None:
    """The newest signed one is shown then, as if nobody had cosigned."""
    store = SqliteStore(folder / "flight.db")
    size, note = store.checkpoints()[0]
    text, _, lines = parted(note)
    lost = sign_note(text, text.split("\n")[0], SignKey.from_seed(b"lost" * 8))
    store.add_checkpoint(size, cosigned(lost, lines))
    store.close()
    out = tmp_path / "proof.json"
    assert run(export, ["export", "proof", str(folder), "--seq", "114", str(out)]) == 0
    assert check(out.read_bytes()).size == WHOLE
