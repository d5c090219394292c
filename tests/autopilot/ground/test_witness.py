"""The ground as a witness: what it keeps, what stays unproven, what it finds out, what it does not believe."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from autopilot.ground import witness as witness_module
from autopilot.ground.kept import EVIDENCE, EVIDENCE_MAX, FOLDER, Memory
from autopilot.ground.witness import WAITING_MAX, Outcome, Question, Standing, Witness
from autopilot.trust.notes import Checkpoint, NoteInvalid, sign_note
from events.schema.waypoint_pb2 import ConsistencyAnswer, NodeStatus
from events.tree import check_consistency
from tests.autopilot.ground.logs import KEY, NODE, Log
from tests.autopilot.trust.world import people

LOG = Log()
OTHER = Log(salt="other", forked_at=0)


def witness(folder: Path) -> Witness:
    """Return a witness; another one on the same folder is another process of the operator's."""
    return Witness(folder, "coast-watch")


def see(folder: Path, *statuses: NodeStatus) -> list[str]:
    """Return what witnesses, each a process of its own, say of these."""
    return [witness(folder).see(NODE, people().wasp.public_key, one) for one in statuses]


def ask(folder: Path) -> Question | None:
    """Return what the witness wants to be proved."""
    return witness(folder).question(NODE, people().wasp.public_key)


def tell(folder: Path, answer: Callable[[bytes], bytes]) -> Outcome:
    """Answer the question that is open; return what that was worth."""
    asked = ask(folder)
    assert asked is not None
    return witness(folder).answered(NODE, people().wasp.public_key, asked, answer(asked.request()))


def check_standing(folder: Path, proven: int, heard: int, flight: int = 3, since_ms: int | None = None) -> None:
    """Check what is shown of the node."""
    found = witness(folder).standing(NODE, people().wasp.public_key)
    assert found == Standing(flight_number=flight, proven_size=proven, heard_size=heard, waiting_since_ms=since_ms)


def evidence(folder: Path) -> list[dict[str, Any]]:
    """Return what lies there as evidence, newest last."""
    paths = sorted((folder / FOLDER / NODE).glob(f"{EVIDENCE}*"), key=lambda path: path.stat().st_mtime_ns)
    return [json.loads(path.read_text(encoding="utf-8")) for path in paths]


def check_found(folder: Path, before: Sequence[NodeStatus], after: NodeStatus, because: str) -> None:
    """Check that `after` contradicts what was heard before, which stays, and that both notes lie there as evidence."""
    *fits, wrong = see(folder, *before, after)
    assert (fits, because in wrong) == ([""] * len(before), True), (fits, wrong)
    (shown,) = evidence(folder)
    assert (shown["kept"]["checkpoint"], shown["said"]["checkpoint"]) == (
        before[-1].log_checkpoint,
        after.log_checkpoint,
    )
    kept = witness(folder).newest(NODE, people().wasp.public_key)
    assert kept is not None
    assert kept.newest.note == before[-1].log_checkpoint


def test_the_first_is_a_beginning_and_the_next_waits_for_its_proof(tmp_path: Path) -> None:
    """Nothing is proven by being heard; a proof moves it on, one checkpoint after the other."""
    see(tmp_path, LOG.status(5))
    check_standing(tmp_path, 5, 5)
    assert ask(tmp_path) is None
    assert see(tmp_path, LOG.status(9, 100_001), LOG.status(20, 100_002)) == ["", ""]
    check_standing(tmp_path, 5, 20, since_ms=100_001)
    assert tell(tmp_path, LOG.answer) is Outcome.PROVEN
    check_standing(tmp_path, 9, 20, since_ms=100_002)
    assert tell(tmp_path, LOG.answer) is Outcome.PROVEN
    check_standing(tmp_path, 20, 20)
    assert ask(tmp_path) is None


def test_a_silent_log_stays_proven(tmp_path: Path) -> None:
    """The same records, signed anew, need no proof; the newest text is kept."""
    said = [LOG.status(5), LOG.status(5, 110_000), LOG.status(8, 120_000), LOG.status(8, 130_000)]
    assert see(tmp_path, *said) == [""] * 4
    check_standing(tmp_path, 5, 8, since_ms=130_000)
    kept = witness(tmp_path).newest(NODE, people().wasp.public_key)
    assert kept is not None
    assert [one.note for one in (kept.proven, *kept.waiting)] == [said[1].log_checkpoint, said[3].log_checkpoint]


def test_a_repeat_costs_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same status again is not even opened."""
    one, key = witness(tmp_path), people().wasp.public_key
    one.see(NODE, key, LOG.status(5))
    monkeypatch.setattr(witness_module, "Memory", None)
    assert one.see(NODE, key, LOG.status(5)) == ""


def test_a_lie_is_said_each_time(tmp_path: Path) -> None:
    """Also to a process that has heard it before."""
    one, key = witness(tmp_path), people().wasp.public_key
    one.see(NODE, key, LOG.status(5))
    said = [one.see(NODE, key, LOG.status(4, 100_001)) for _ in range(2)]
    assert ["rolled back" in wrong for wrong in said] == [True, True]


def test_the_next_flight_begins_anew_and_the_last_is_still_asked_about(tmp_path: Path) -> None:
    """However short; what waits of the flight before is not forgotten."""
    following = Log(flight=4, flight_id=2)
    see(tmp_path, LOG.status(5), LOG.status(9, 100_001), following.status(1, 100_002), following.status(3, 100_003))
    check_standing(tmp_path, 1, 3, flight=4, since_ms=100_003)
    assert tell(tmp_path, following.answer) is Outcome.PROVEN
    check_standing(tmp_path, 3, 3, flight=4)
    assert tell(tmp_path, LOG.answer) is Outcome.PROVEN
    assert ask(tmp_path) is None


def test_what_comes_late_is_no_lie(tmp_path: Path) -> None:
    """An older status that was overtaken on its way."""
    assert see(tmp_path, LOG.status(9), LOG.status(5, 70_000)) == ["", ""]
    check_standing(tmp_path, 9, 9)


@pytest.mark.parametrize(
    ("after", "because"),
    [
        (LOG.status(4, 100_001), "now only 4: it was rolled back"),
        (LOG.status(4, 69_999), "rolled back"),
        (OTHER.status(5), "two logs of 5 records"),
        (Log(flight_id=2).status(9), "two flights 3"),
        (Log(flight=2).status(9), "back from flight 3 to flight 2"),
    ],
)
def test_what_contradicts_is_found(tmp_path: Path, after: NodeStatus, because: str) -> None:
    """Each way of going back behind what was signed."""
    check_found(tmp_path, [LOG.status(5)], after, because)


def test_a_roll_back_behind_what_is_not_proven_is_found_too(tmp_path: Path) -> None:
    """What was signed was signed."""
    check_found(tmp_path, [LOG.status(5), LOG.status(9, 100_001)], LOG.status(8, 100_002), "now only 8")


@pytest.mark.parametrize(("proven", "forked_at", "size"), [(8, 3, 20), (7, 6, 20), (16, 0, 17), (5, 4, 6), (1, 0, 2)])
def test_a_fork_behind_a_longer_log_is_found_by_its_proof(
    tmp_path: Path, proven: int, forked_at: int, size: int
) -> None:
    """Also where the older size is a power of two. The evidence stands by itself, and what was proven stays."""
    fork = Log(salt="fork", forked_at=forked_at)
    assert see(tmp_path, LOG.status(proven), fork.status(size, 100_001)) == ["", ""]
    check_standing(tmp_path, proven, size, since_ms=100_001)
    assert tell(tmp_path, fork.answer) is Outcome.CONTRADICTS
    check_standing(tmp_path, proven, proven)
    (shown,) = evidence(tmp_path)
    assert f"{size} records of flight 3 that do not begin with the {proven}" in shown["because"]
    check_evidence(tmp_path, shown)


def check_evidence(folder: Path, shown: dict[str, Any]) -> None:
    """Check that two signed notes and a path show a stranger that two histories were signed."""
    memory = Memory(folder, "coast-watch", NODE, people().wasp.public_key)
    old, new = memory.opened(shown["kept"]).checkpoint, memory.opened(shown["said"]).checkpoint
    claimed, path = bytes.fromhex(shown["proof"]["old_root"]), [bytes.fromhex(one) for one in shown["proof"]["path"]]
    check_consistency(old.size, claimed, new.size, new.root, path)
    assert claimed != old.root


def test_evidence_is_bounded_and_the_first_stays(tmp_path: Path) -> None:
    """A node that lies on does not fill the disk."""
    see(tmp_path, LOG.status(50))
    for size in range(1, 30):
        see(tmp_path, LOG.status(size, 100_001))
    assert len(evidence(tmp_path)) == EVIDENCE_MAX
    assert evidence(tmp_path)[0]["because"].endswith("now only 1: it was rolled back")
    see(tmp_path, LOG.status(1, 100_001))
    assert len(evidence(tmp_path)) == EVIDENCE_MAX


def changed(**values: Any) -> Callable[[bytes], bytes]:
    """Return a node that answers with something changed."""

    def answer(request: bytes) -> bytes:
        said = ConsistencyAnswer.FromString(LOG.answer(request))
        path = list(said.path)
        for name, value in values.items():
            said.ClearField(name)  # type: ignore[arg-type]
            made = value(path) if name == "path" else value
            getattr(said, name).extend(made) if name == "path" else setattr(said, name, made)
        return said.SerializeToString(deterministic=True)

    return answer


UNKIND: dict[str, Callable[[bytes], bytes]] = {
    "garbage": lambda _: b"\xff" * 200,
    "nothing": lambda _: b"",
    "unknown fields": lambda request: LOG.answer(request) + b"\xba\x01\x02\x08\x01",
    "another flight": changed(flight_number=4),
    "another old size": changed(old_size=6),
    "another new size": changed(new_size=21),
    "no path": changed(path=lambda _: []),
    "a hash less": changed(path=lambda path: path[:-1]),
    "a hash more": changed(path=lambda path: [*path, bytes(32)]),
    "a path without end": changed(path=lambda path: [*path, *[bytes(32)] * 200]),
    "hashes of another length": changed(path=lambda path: [path[0][:31], *path[1:]]),
    "another order": changed(path=lambda path: path[::-1]),
    "another root before": changed(old_root=bytes(32)),
    "a root of another length": changed(old_root=bytes(31)),
    "a fork that was not signed": OTHER.answer,
}


@pytest.mark.parametrize("name", UNKIND)
@pytest.mark.parametrize("proven", [5, 8])
def test_what_proves_nothing_changes_nothing(tmp_path: Path, name: str, proven: int) -> None:
    """It is no contradiction either, for anybody could have answered; and the question stays."""
    see(tmp_path, LOG.status(proven), LOG.status(20, 100_001))
    before = (tmp_path / FOLDER / NODE / "000003.json").read_bytes()
    assert tell(tmp_path, UNKIND[name]) is Outcome.NOTHING
    assert (tmp_path / FOLDER / NODE / "000003.json").read_bytes() == before
    assert (evidence(tmp_path), ask(tmp_path) is None) == ([], False)
    assert tell(tmp_path, LOG.answer) is Outcome.PROVEN


def test_nobody_can_make_a_contradiction(tmp_path: Path) -> None:
    """By moving the border between two hashes, under a parent that stays the same."""
    see(tmp_path, LOG.status(8), LOG.status(16, 100_001))
    root = LOG.grown(16).root(8)
    forged = changed(old_root=root[:31], path=lambda path: [root[31:] + path[0]])
    assert tell(tmp_path, forged) is Outcome.NOTHING
    assert tell(tmp_path, LOG.answer) is Outcome.PROVEN


def test_an_answer_to_what_is_no_longer_asked_changes_nothing(tmp_path: Path) -> None:
    """Another process had its proof before."""
    see(tmp_path, LOG.status(5), LOG.status(9, 100_001), LOG.status(12, 100_002))
    asked = ask(tmp_path)
    assert asked is not None
    tell(tmp_path, LOG.answer)
    answered = witness(tmp_path).answered(NODE, people().wasp.public_key, asked, LOG.answer(asked.request()))
    assert answered is Outcome.PROVEN
    check_standing(tmp_path, 9, 12, since_ms=100_002)


def test_what_waits_is_bounded(tmp_path: Path) -> None:
    """Then the newest takes the place of the last; a proof leads to it all the same."""
    sizes = range(5, 5 + WAITING_MAX + 10)
    see(tmp_path, *(LOG.status(size, 100_000 + size) for size in sizes))
    check_standing(tmp_path, 5, sizes[-1], since_ms=100_006)
    kept = witness(tmp_path).newest(NODE, people().wasp.public_key)
    assert kept is not None
    assert len(kept.waiting) == WAITING_MAX
    while ask(tmp_path) is not None:
        assert tell(tmp_path, LOG.answer) is Outcome.PROVEN
    check_standing(tmp_path, sizes[-1], sizes[-1])


def said(about: str, name: str) -> str:
    """Return a checkpoint about one log that the log's key signed under a name."""
    checkpoint = Checkpoint(f"waypoint/coast-watch/{about}", 5, bytes(32), 1)
    return sign_note(checkpoint.text(), f"waypoint/coast-watch/{name}", KEY)


def test_what_is_not_signed_is_not_kept(tmp_path: Path) -> None:
    """By the node's key the certificate, by the log's key the checkpoint, and both about this log."""
    good, other, wasp = LOG.status(5), Log(flight=4).status(7), people().wasp
    hornet = sign_note("x\n", "waypoint/coast-watch/wasp-01", people().hornet.sign_key)
    text = good.log_key.partition("\n\n")[0] + "\n"
    renamed = sign_note(text.replace("wasp-01/3", "hornet-02/3"), "waypoint/coast-watch/wasp-01", wasp.sign_key)
    foreign = sign_note(text, "waypoint/coast-watch/hornet-02", wasp.sign_key)
    bad = [
        NodeStatus(at_ms=1, log_checkpoint=good.log_checkpoint, log_key=other.log_key),
        NodeStatus(at_ms=1, log_checkpoint=good.log_checkpoint.replace("5", "6", 1), log_key=good.log_key),
        *(NodeStatus(at_ms=1, log_checkpoint=good.log_checkpoint, log_key=one) for one in (hornet, renamed, foreign)),
        NodeStatus(at_ms=1, log_checkpoint=good.log_checkpoint, log_key=""),
        NodeStatus(at_ms=1, log_checkpoint=said("hornet-02/3", "hornet-02/3"), log_key=renamed),
        NodeStatus(at_ms=1, log_checkpoint=said("wasp-01/4", "wasp-01/3"), log_key=good.log_key),
    ]
    assert [bool(wrong) for wrong in see(tmp_path, *bad)] == [True] * len(bad)
    assert see(tmp_path, NodeStatus(at_ms=1)) == [""]
    assert not (tmp_path / FOLDER / NODE).exists()
    assert witness(tmp_path).standing(NODE, wasp.public_key) is None


def test_a_damaged_memory_is_said_so(tmp_path: Path) -> None:
    """It is not taken for a clean sheet; an older flight's is left out."""
    see(tmp_path, LOG.status(5), Log(flight=4).status(5, 100_001))
    files = tmp_path / FOLDER / NODE
    (files / "000003.json").write_text("{}", encoding="utf-8")
    assert see(tmp_path, Log(flight=4).status(9, 100_002)) == [""]
    assert tell(tmp_path, Log(flight=4).answer) is Outcome.PROVEN
    assert ask(tmp_path) is None
    (files / "000004.json").write_text("{}", encoding="utf-8")
    assert "can't be read" in see(tmp_path, Log(flight=4).status(10))[0]
    with pytest.raises(NoteInvalid):
        ask(tmp_path)
