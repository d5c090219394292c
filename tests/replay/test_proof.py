"""Proofs of decisions: what is proved, how small it is, and that nothing of the file can be changed."""

from __future__ import annotations

import base64
import json
import random
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from autopilot.cli import export, verify
from autopilot.ground import asked, consistency, ordered, verifier
from autopilot.ground import papers as papers_module
from autopilot.ground.verifier import ANSWERS, ProofRefused, check
from autopilot.node.sealing import CERTIFICATE_FILE
from autopilot.trust import documents, pae
from autopilot.trust.identity import ROOT_FILE, TOKEN_FILE
from autopilot.trust.keys import SignKey
from autopilot.trust.notes import Checkpoint, LogKey, StateMark, sign_note
from events import KINDS
from events.records import NO_CAUSE, Record, Stored
from events.schema.waypoint_pb2 import IdentityToken, PrincipalKind, PurposeKey, SignedDoc, TrustRoot
from events.store import MemoryStore
from events.tree import Tree
from replay.causes import chain
from replay.proof import NotSealed, Papers, prove
from replay.verdict import Outcome
from tests.autopilot.cli.flown import run
from tests.autopilot.trust.world import people
from tests.flights import FLIGHT_ID, SECRET, story
from tests.house import source_of
from tests.replay.changes import check_ends
from tests.replay.sealed import sealed_story

LOG_KEY = SignKey.from_seed(bytes(range(32)))
STORY = story()


def log_key(**values: Any) -> LogKey:
    """Return what the node certifies."""
    given: dict[str, Any] = {
        "deployment_id": "coast-watch",
        "node": "wasp-01",
        "flight_number": 3,
        "flight_id": FLIGHT_ID,
    }
    return LogKey(**(given | {"public_key": LOG_KEY.public} | values))


def papers(signer: SignKey | None = None, name: str = "", **values: Any) -> Papers:
    """Return the papers of a flight of wasp-01."""
    wasp, certified = people().wasp, log_key(**values)
    note = sign_note(certified.text(), name or certified.signer, signer or wasp.sign_key)
    return Papers(log_key=note, token=wasp.token_bytes, trust_root=(wasp.folder / ROOT_FILE).read_bytes())


def sealed(
    size: int | None = None,
    signer: SignKey = LOG_KEY,
    name: str = "",
    records: Sequence[Record] = STORY.records,
    **values: Any,
) -> MemoryStore:
    """Return the story, or other records, with one checkpoint over its first records."""
    store = MemoryStore(FLIGHT_ID, SECRET)
    store.append(records)
    leaves = [stored.leaf for stored in store.stored(0, size)]
    said: dict[str, Any] = {
        "origin": "waypoint/coast-watch/wasp-01/3",
        "size": len(leaves),
        "root": Tree(leaves).root(),
    }
    checkpoint = Checkpoint(**(said | {"flight_ns": 7} | values))
    store.add_checkpoint(len(leaves), sign_note(checkpoint.text(), name or checkpoint.origin, signer))
    return store


def check_proves(data: bytes, *seqs: int) -> None:
    """Check that a proof holds, and for which records."""
    proved = check(data)
    assert [one.seq for one in proved.records] == list(seqs)
    for one in proved.records:
        record = STORY.records[one.seq]
        assert (one.body, one.kind, one.cause) == (record.body, record.kind.number, record.cause)
    assert len(data) < 10_000


def check_refused(data: bytes, because: str) -> None:
    """Check that a proof is refused for a reason."""
    with pytest.raises(ProofRefused, match=because):
        check(data)


def changed(data: bytes, change: Callable[[dict[str, Any]], object]) -> bytes:
    """Return a proof with a change, written as a proof is."""
    proof = json.loads(data)
    change(proof)
    return json.dumps(proof, sort_keys=True, indent=1).encode() + b"\n"


def test_every_record_of_a_flight_can_be_proved() -> None:
    """Each with the chain that `replay why` shows."""
    store = sealed()
    for record in STORY.records:
        check_proves(prove(store, record.seq, papers()), *(line.seq for line in chain(store, record.seq)))


def test_a_proof_says_what_it_proves_and_what_not() -> None:
    """In one sentence, with everything that can be compared."""
    data = prove(sealed(), 114, papers())
    proved = check(data, (people().wasp.folder / ROOT_FILE).read_bytes())
    words = proved.words()
    assert words.count(".") == 1
    for part in ("record 114 and what led to it, back to record 104", "flight 3 of node wasp-01", "coast-watch"):
        assert part in words
    assert (proved.trust_root in words, "not proved: that what was recorded is true" in words) == (True, True)
    assert (proved.size, proved.signed_flight_ns, proved.flight_id) == (len(STORY.records), 7, FLIGHT_ID)


def test_a_checkpoint_with_a_state_proves_as_one_without() -> None:
    """The proof rests on the root; the line must be written as it is to be all the same."""
    mark = StateMark(bytes(4), bytes(range(32)))
    check_proves(prove(sealed(state=mark), 104, papers()), 104)
    store = sealed()
    size, note = store.checkpoints()[0]
    text = f"{note.rpartition(chr(10) * 2)[0]}\n"
    digest = base64.b64encode(bytes(range(32))).decode()
    for bad in (f"state 0000000 {digest}", f"state 00000000 {digest[:-1]}", f"state  0000000 {digest}"):
        origin = text.partition("\n")[0]
        store.add_checkpoint(size, sign_note(f"{text}{bad}\n", origin, LOG_KEY))
        check_refused(prove(store, 104, papers()), "does not say what it is to say")


def test_no_bit_of_a_proof_can_be_changed() -> None:
    """A sample of bits over the whole file, and every byte of the short parts at its ends."""
    data = prove(sealed(), 104, papers())
    chance = random.Random(3)
    bits = {*chance.sample(range(len(data) * 8), 1500), *range(64), *range(len(data) * 8 - 64, len(data) * 8)}
    for bit in sorted(bits):
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        check_refused(bytes(flipped), ".")


def test_no_byte_can_be_cut_added_or_doubled() -> None:
    """Also where JSON would not mind."""
    data = prove(sealed(), 104, papers())
    for bad in (
        data[:-1],
        data + b"\n",
        data.replace(b"{\n", b"{ \n", 1),
        data.replace(b' "boot"', b' "boot": 1,\n   "boot"'),
    ):
        check_refused(bad, "not written as a proof is")
    check_refused(b"[" * 100_000, "not JSON")
    check_refused(b" " * (verifier.BYTES_MAX + 1), "more than")
    check_refused(b'{"format": "other"}', "not of format")


@pytest.mark.parametrize(
    ("change", "because"),
    [
        (lambda p: p.update(extra=""), "other parts"),
        (lambda p: p.update(token=1), "no text"),
        (lambda p: p.update(records=[]), "no records"),
        (lambda p: p["records"].pop(), "record 104 led to it and is not shown"),
        (lambda p: p["records"].append(p["records"][1]), "did not lead to"),
        (lambda p: p["records"].reverse(), "did not lead to"),
        (lambda p: p["records"][0].update(seq=True), "not written as it is to be"),
        (lambda p: p["records"][0].update(seq=1.0), "not written as it is to be"),
        (lambda p: p["records"][0].update(seq=-1), "does not fit"),
        (lambda p: p["records"][0].update(seq=10_000), "not among"),
        (lambda p: p["records"][0].update(inclusion=None), "not written as it is to be"),
        (lambda p: p["records"][0]["inclusion"].pop(), "not what the log holds"),
        (lambda p: p["records"][0]["inclusion"].append(p["records"][0]["salt"]), "32"),
        (lambda p: p["records"][0].update(wall_ns=1), "not what the log holds"),
        (lambda p: p["records"][0].update(body=""), "not what the log holds"),
        (lambda p: p["records"][0].update(body="AB=="), "another way"),
    ],
)
def test_a_changed_proof_is_refused(change: Callable[[dict[str, Any]], object], because: str) -> None:
    """Each part for its own reason."""
    check_refused(changed(prove(sealed(), 114, papers()), change), because)


def test_only_the_right_keys_are_believed() -> None:
    """Node, flight and log are bound to each other by name and key."""
    other = SignKey.from_seed(b"o" * 32)
    check_refused(prove(sealed(), 9, papers(signer=other)), "signed by another key")
    check_refused(prove(sealed(signer=other), 9, papers()), "signed by another key")
    check_refused(prove(sealed(), 9, papers(node="hornet-02")), "not signed under this name")
    check_refused(prove(sealed(), 9, papers(flight_number=4)), "not signed under this name")
    check_refused(prove(sealed(), 9, papers(flight_id=bytes(16))), "not what the log holds")
    check_refused(prove(sealed(root=bytes(32)), 9, papers()), "not what the log holds")
    check_refused(prove(sealed(size=8), 7, papers(deployment_id="inland")), "not signed under this name")
    name, other_log = log_key().signer, "waypoint/coast-watch/wasp-01/4"
    check_refused(prove(sealed(), 9, papers(name=name, node="hornet-02")), "certified for another node")
    check_refused(
        prove(sealed(origin=other_log, name=f"{name}/3"), 9, papers()), "of another log than its key may sign"
    )
    hornet = base64.b64encode(people().hornet.token_bytes).decode()
    alice = base64.b64encode(people().alice.token_bytes).decode()
    stranger = base64.b64encode((people(2).wasp.folder / ROOT_FILE).read_bytes()).decode()
    good = prove(sealed(), 9, papers())
    check_refused(changed(good, lambda proof: proof.update(token=hornet)), "hornet-02")
    check_refused(changed(good, lambda proof: proof.update(token=alice)), "not a node's")
    check_refused(changed(good, lambda proof: proof.update(trust_root=stranger)), "key that is not known")
    with pytest.raises(ProofRefused, match="another trust root"):
        check(good, (people(2).wasp.folder / ROOT_FILE).read_bytes())


def test_documents_are_held_to_what_they_ask_for() -> None:
    """As many root signatures as the root asks for; a token of the same deployment; fields once and in order."""
    one, two = SignKey.from_seed(b"1" * 32), SignKey.from_seed(b"2" * 32)
    keys = [PurposeKey(purpose="token", public_key=LOG_KEY.public)]
    root = TrustRoot(deployment_id="coast-watch", threshold=2, root_keys=[one.public, two.public], keys=keys)
    check_document(documents.sign(pae.TRUST_ROOT, root, [one]), "fewer keys than it needs")
    check_document(documents.sign(pae.TRUST_ROOT, root, [one, one]), "not known, or twice")
    whole = documents.sign(pae.TRUST_ROOT, root, [one, two])
    assert papers_module.trust_root_of(whole) == ("coast-watch", LOG_KEY.public)
    check_document(whole + whole[:2], "order|ends within")
    signed = SignedDoc.FromString(whole)
    first, *rest = signed.sigs
    turned = SignedDoc(sigs=[first]).SerializeToString() + SignedDoc(body=signed.body, sigs=rest).SerializeToString()
    check_document(turned, "out of order")
    token = IdentityToken(deployment_id="inland", principal_id="wasp-01", kind=PrincipalKind.NODE)
    with pytest.raises(ProofRefused, match="of another deployment"):
        papers_module.principal_of(
            documents.sign(pae.IDENTITY_TOKEN, token, [one]), "coast-watch", one.public, kinds=(papers_module.NODE,)
        )
    assert verifier._root_from(bytes(32), 0, 2, []) is None


def check_document(document: bytes, because: str) -> None:
    """Check that a trust root is refused for a reason."""
    with pytest.raises(ProofRefused, match=because):
        papers_module.trust_root_of(document)


def test_what_nobody_signed_has_no_proof() -> None:
    """Records behind the newest checkpoint, flights without one, and a log that was cut."""
    store = sealed(size=54)
    check_proves(prove(store, 52, papers()), 52, 49)
    with pytest.raises(NotSealed, match="newest covers 54"):
        prove(store, 54, papers())
    with pytest.raises(LookupError, match="no record 1000"):
        prove(store, 1000, papers())
    store.add_checkpoint(500, "later")
    with pytest.raises(NotSealed, match="it was cut"):
        prove(store, 9, papers())


def test_replay_holds_the_log_against_its_checkpoints() -> None:
    """Another history under a signed size, and a log shorter than what was signed."""
    store = sealed(size=54, root=bytes(32))
    check_ends(store, Outcome.BROKEN, 53, "first 54 records are not those that were signed")
    store = sealed()
    store.add_checkpoint(500, "later")
    check_ends(store, Outcome.BROKEN, len(STORY.records), "500 records were signed")


def test_the_verifier_stands_alone() -> None:
    """It imports the standard library and one verification; and it knows every kind that answers an effect."""
    found = set[str]()
    for module in (verifier, papers_module, consistency, ordered, asked):
        source = source_of("verifier.py", Path(module.__file__ or "").read_text(encoding="utf-8"))
        lines = [line for line in source.text.splitlines() if line.startswith(("import ", "from "))]
        found |= {line.split()[1] for line in lines if line.split()[1].split(".")[0] not in sys.stdlib_module_names}
    own = {f"autopilot.ground.{name}" for name in ("papers", "ordered", "asked")}
    assert found == {"nacl.exceptions", "nacl.signing"} | own
    fields = {kind.number: kind.message.DESCRIPTOR.fields_by_name.get("effect_seq") for kind in KINDS}
    assert {number: field.number for number, field in fields.items() if field is not None} == ANSWERS
    assert PrincipalKind.NODE == papers_module.NODE


def test_an_answer_is_bound_to_its_effect() -> None:
    """The link through the world is in the body, and the body is under the hash."""
    store = sealed()
    answers = [one for one in store.stored() if one.kind_number in ANSWERS and one.cause == NO_CAUSE]
    for answer in answers:
        _check_link(store, answer)
    assert len(answers) > 4


def _check_link(store: MemoryStore, answer: Stored) -> None:
    data = prove(store, answer.seq, papers())
    shown = json.loads(data)["records"]
    if len(shown) > 1:
        check_refused(changed(data, lambda proof: proof["records"].pop(1)), "led to|lead to")


def test_the_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From a flight's folder to a sentence; refusals with their codes."""
    folder, out = sealed_story(tmp_path).flight.folder, tmp_path / "proof.json"
    words = ["export", "proof", str(folder), "--seq", "114", str(out)]
    assert run(export, words) == 0
    assert f"{len(out.read_bytes())} bytes" in capsys.readouterr().err
    root = str(people().wasp.folder / ROOT_FILE)
    assert run(verify, ["verify", str(out), "--root", root]) == 0
    told = capsys.readouterr().out
    assert (told.splitlines()[0], "send_ack" in told) == (check(out.read_bytes()).words(), True)
    assert run(verify, ["verify", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["records"] == [114, 104]
    assert run(verify, ["verify", str(out), "--root", str(folder / TOKEN_FILE)]) == 65
    assert run(verify, ["verify", str(tmp_path / "none")]) == 66
    out.write_bytes(out.read_bytes()[:-1])
    assert run(verify, ["verify", str(out)]) == 65
    assert "refused" in capsys.readouterr().err
    assert run(export, [*words[:4], "121", str(out)]) == 65
    assert "no record 121" in capsys.readouterr().err
    (folder / CERTIFICATE_FILE).unlink()
    assert run(export, words) == 65
    assert "nobody signed this flight" in capsys.readouterr().err
