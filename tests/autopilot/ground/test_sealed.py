"""One flight held against what was signed of it: every rule shown a breach, and where it lies."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from autopilot.ground import sealed
from autopilot.ground.examiner import judge
from autopilot.ground.sealed import Anchor, judge_flight
from autopilot.node.sealing import CERTIFICATE_FILE
from autopilot.trust.notes import Checkpoint, LogKey, sign_note
from autopilot.trust.replayed import VERDICT_FILE, SignedVerdict
from events import encode
from events.schema.flight_pb2 import LogKeyCertified, SealRefused
from events.store import flights_in
from events.tree import Tree
from tests.autopilot.ground.judging import ANCHOR, WASP, bodied, check_found, live_key, rewritten, sealed_with
from tests.autopilot.trust.world import people
from tests.flights import position
from tests.torture.flying import Drone
from tests.torture.forging import CERTIFIED, logs_in


def test_a_record_that_was_changed(root: Path) -> None:
    """Without its chain at the very record; with it between the checkpoints around it."""
    log = logs_in(root)[2]
    sizes = sorted(log.checkpoints)
    seq = sizes[1] + 1
    assert sizes[1] < seq < sizes[2]
    log.rows[seq] = log.rows[seq]._replace(body=b"")
    log.write(head=False)
    check_found(root, None, (3, seq, seq, "its leaf is not the hash"))
    rewritten(root, 3, lambda _: None)
    signed = [(3, sizes[1], size - 1, f"first {size} records are not those that were signed") for size in sizes[2:]]
    tail = (3, sizes[1], len(log.rows) - 1, "more follows the newest checkpoint")
    check_found(root, None, *signed, tail)


def test_behind_a_gap_nothing_is_judged(root: Path) -> None:
    """What follows a missing record is known to be damaged; once is enough."""
    log = logs_in(root)[2]
    seq = sorted(log.checkpoints)[2]
    del log.rows[seq]
    log.write(head=False)
    check_found(root, None, (3, seq, seq, f"record {seq} is missing"))


def test_a_head_file_of_another_history(root: Path) -> None:
    """The change may lie anywhere before it."""
    log = logs_in(root)[2]
    log.write_head()
    last = len(log.rows) - 1
    log.rows[last] = log.rows[last]._replace(body=b"")
    log.chain()
    log.checkpoints.pop(last + 1, None)
    log.write(head=False)
    log.checkpoints.clear()
    check_found(root, None, (3, 0, last, "another leaf"))


def test_only_the_keys_of_the_node_are_believed(root: Path) -> None:
    """A certificate by another device, of another flight, or one that is none; a node that is not asked for."""
    genuine = logs_in(root)
    key = next(seq for seq, row in enumerate(genuine[2].rows) if row.kind_number == CERTIFIED)
    log_key = LogKey(
        deployment_id=WASP.deployment_id,
        node=WASP.principal_id,
        flight_number=9,
        flight_id=bytes(16),
        public_key=bytes(32),
    )
    same_number = replace(log_key, flight_number=3)
    same_id = replace(log_key, flight_id=genuine[2].flight_id)
    for body, because in (
        (
            encode(LogKeyCertified(certificate=sign_note("x\n", ANCHOR.signer, people().hornet.sign_key))),
            "not for wasp",
        ),
        (
            encode(LogKeyCertified(certificate=sign_note(log_key.text(), ANCHOR.signer, WASP.sign_key))),
            "log key of flight 9",
        ),
        (
            encode(LogKeyCertified(certificate=sign_note(same_number.text(), ANCHOR.signer, WASP.sign_key))),
            "log key of flight 3",
        ),
        (
            encode(LogKeyCertified(certificate=sign_note(same_id.text(), ANCHOR.signer, WASP.sign_key))),
            "log key of flight 9",
        ),
        (b"\xff", "can't be read"),
    ):
        rewritten(root, 3, lambda log, body=body: bodied(log, key, body))  # type: ignore[misc]
        found = [one for one in judge(root, ANCHOR) if (one.first, one.last) == (key, key)]
        assert [because in one.because for one in found] == [True]
        assert "no key that the node vouches for" in " ".join(one.because for one in judge(root, ANCHOR))
    hornet = Anchor(WASP.deployment_id, "hornet-02", people().hornet.public_key)
    assert "names another node" in judge(root, hornet)[0].because


def test_checkpoints_are_held_to_their_key(root: Path) -> None:
    """Signed before the key was certified, about another log, by another key, or over more than there is."""
    log, key = logs_in(root)[2], live_key(root)
    count, genuine = len(log.rows), dict(log.checkpoints)
    least = min(genuine)
    for size, origin, signer, because, first in (
        (2, "", key, "no key was certified before it", 0),
        (least + 1, f"{ANCHOR.signer}/2", key, "about another log", least),
        (least + 1, "", people().hornet.sign_key, "signed by another key", least),
    ):
        log.checkpoints = dict(genuine)
        sealed_with(log, signer, size, origin)
        check_found(root, None, (3, first, size - 1, because))
    text = Checkpoint(f"{ANCHOR.signer}/3", least + 2, Tree(row.leaf for row in log.rows[: least + 1]).root(), 1).text()
    log.checkpoints = {**genuine, least + 1: sign_note(text, f"{ANCHOR.signer}/3", key)}
    log.write(head=True)
    check_found(root, None, (3, least, least, f"first {least + 1} records are not those"))
    for size in (0, count + 1):
        log.checkpoints = {**genuine, size: genuine[least]}
        log.write(head=True)
        check_found(root, None, (3, max(genuine), count, f"{size} records were signed, and the log holds {count}"))


def test_what_nobody_signed(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No more than a node leaves unsigned may follow the newest checkpoint; the end of a closed flight is told of."""
    log = logs_in(root)[2]
    genuine, last = dict(log.checkpoints), len(log.rows) - 1
    sizes = sorted(genuine)
    log.checkpoints = {sizes[0]: genuine[sizes[0]]}
    log.write(head=True)
    check_found(root, None, (3, sizes[0], last, "more follows the newest checkpoint"))
    log.checkpoints = {}
    log.write(head=True)
    check_found(root, None, (3, 0, last, "more follows the newest checkpoint"))
    log.checkpoints = {size: genuine[size] for size in sizes[:-1]}
    log.write(head=True)
    check_found(root, None)
    monkeypatch.setattr(sealed, "UNSIGNED_RECORDS", last - sizes[-2])
    check_found(root, None, (3, sizes[-2], last, "more follows the newest checkpoint"))
    monkeypatch.setattr(sealed, "UNSIGNED_RECORDS", last + 1 - sizes[-2])
    check_found(root, None)


def test_the_end_of_a_closed_flight_is_signed(root: Path) -> None:
    """A kill between the two leaves it unsigned, so it is told, and not wrong."""
    log = rewritten(root, 2, lambda log: log.checkpoints.pop(max(log.checkpoints)))
    check_found(root, None, (2, max(log.checkpoints), len(log.rows) - 1, "its end was not signed"), wrong=False)


def test_a_node_that_refused_to_sign_has_said_so(tmp_path: Path) -> None:
    """Its log says why there is nothing more."""
    drone = Drone(tmp_path / "flights", 1)
    drone.tell(SealRefused(because="for a test"))
    drone.tell(position(1, 1), after_ms=60_000)
    drone.session.store.close()
    rewritten(tmp_path / "flights", 1, lambda log: log.checkpoints.clear())
    check_found(tmp_path / "flights", None)


def test_a_flight_that_nobody_signed(root: Path) -> None:
    """Told where nothing claims otherwise; wrong where an anchor says that there is a node who signs."""
    for flight in flights_in(root)[:2]:
        shutil.rmtree(flight.folder)
    log = logs_in(root)[0]
    key = next(seq for seq, row in enumerate(log.rows) if row.kind_number == CERTIFIED)
    log.rows, log.checkpoints = log.rows[:key], {}
    log.write(head=True)
    assert [one.wrong for one in judge_flight(flights_in(root)[0]).found] == [False]
    found = judge_flight(flights_in(root)[0], ANCHOR).found
    assert [(one[:3], one.wrong) for one in found] == [((3, 0, key), True)]


def test_the_papers_are_those_of_the_log(root: Path) -> None:
    """Certificate and verdict: gone, another flight's, another log's, by another key."""
    one, two, _ = (flight.folder for flight in flights_in(root))
    count = len(logs_in(root)[0].rows)
    certificate, verdict = (one / CERTIFICATE_FILE).read_text("utf-8"), (one / VERDICT_FILE).read_text("utf-8")
    for text in ("", (two / CERTIFICATE_FILE).read_text("utf-8")):
        (one / CERTIFICATE_FILE).write_text(text, encoding="utf-8")
        check_found(root, None, (1, 0, count - 1, "is not the certificate"))
    (one / CERTIFICATE_FILE).unlink()
    check_found(root, None, (1, 0, count - 1, "is not the certificate"))
    (one / CERTIFICATE_FILE).write_text(certificate, encoding="utf-8")
    said = SignedVerdict(
        origin=f"{ANCHOR.signer}/1",
        flight_id=logs_in(root)[0].flight_id.hex(),
        seq=count - 1,
        leaf=logs_in(root)[0].rows[-1].leaf.hex(),
        software="0.1.0",
        verdict="REPLAYS",
    )
    assert said.text() == verdict.rpartition("\n\n")[0] + "\n"
    for other in (
        replace(said, origin=f"{ANCHOR.signer}/2"),
        replace(said, flight_id="00" * 16),
        replace(said, leaf="00" * 32),
        replace(said, seq=count - 2),
        replace(said, seq=count),
    ):
        (one / VERDICT_FILE).write_text(sign_note(other.text(), ANCHOR.signer, WASP.sign_key), encoding="utf-8")
        check_found(root, None, (1, 0, other.seq, "the verdict is about another log"))
    (one / VERDICT_FILE).write_text(sign_note(said.text(), ANCHOR.signer, live_key(root)), encoding="utf-8")
    check_found(root, None, (1, 0, count - 1, "the verdict is not to be believed"))
    (one / VERDICT_FILE).unlink()
    check_found(root, None, (1, 0, 0, "no verdict beside it"), wrong=False)
