"""All flights of a node judged: every rule shown a breach, and where it lies; what is genuine says nothing."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from autopilot.ground import examiner, sealed
from autopilot.ground.examiner import anchor_of, judge
from autopilot.ground.kept import Kept
from autopilot.ground.sealed import Anchor, Judged, judge_flight
from autopilot.node.sealing import CERTIFICATE_FILE, KEY_FILE
from autopilot.trust.documents import DocumentError
from autopilot.trust.identity import TOKEN_FILE
from autopilot.trust.keys import SignKey
from autopilot.trust.notes import Checkpoint, LogKey, sign_note
from autopilot.trust.replayed import VERDICT_FILE, SignedVerdict
from events import encode
from events.schema.flight_pb2 import CLOSE_DISARMED, FlightOpened, LogKeyCertified, SealRefused
from events.store import create_flight, flights_in
from events.tree import Tree
from tests.autopilot.trust.world import people
from tests.flights import position
from tests.torture.attacks import kept_by_a_witness
from tests.torture.flying import Drone, nothing
from tests.torture.forging import CERTIFIED, Log, bodied, logs_in

WASP = people().wasp
ANCHOR = Anchor(WASP.deployment_id, WASP.principal_id, WASP.public_key)
Change = Callable[[list[Log]], object]
Expected = tuple[int, int, int, str]


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Kept]]:
    """Two flights that are over, and an open one, longer than what may stay unsigned."""
    work = tmp_path_factory.mktemp("flown")
    drone = Drone(work / "flights", 5)
    for _ in range(2):
        drone.fly(6)
        drone.end()
    drone.fly(6)
    for number, after_ms in enumerate((30_000, 100, 12_000, 100), start=1):
        drone.tell(position(number, 1), after_ms=after_ms)
    drone.session.store.close()
    return work / "flights", kept_by_a_witness(work, drone)


@pytest.fixture
def root(flown: tuple[Path, list[Kept]], tmp_path: Path) -> Path:
    """Return a copy of the flights to spoil."""
    return shutil.copytree(flown[0], tmp_path / "flights", ignore=shutil.ignore_patterns("reserve"))


def check_found(root: Path, kept: Kept | None, *expected: Expected, wrong: bool = True) -> None:
    """Check what is found, in its order: flight, first and last record, part of the reason."""
    found = judge(root, ANCHOR, kept)
    words = [f"{one.flight}, {one.words()}" for one in found]
    assert [one[:3] for one in found] == [one[:3] for one in expected], words
    assert [part in one.because for one, (*_, part) in zip(found, expected, strict=True)] == [True] * len(found), words
    assert {one.wrong for one in found} <= {wrong}, words


def rewritten(root: Path, number: int, change: Callable[[Log], object]) -> Log:
    """Change a log as somebody can who holds the disk; head file and chain are made to fit."""
    log = logs_in(root)[number - 1]
    change(log)
    log.chain()
    log.write(head=True)
    return log


def live_key(root: Path) -> SignKey:
    """Return the log key of the open flight."""
    return SignKey.from_seed((flights_in(root)[-1].folder / KEY_FILE).read_bytes())


def sealed_with(log: Log, key: SignKey, size: int, origin: str = "", name: str = "") -> None:
    """Sign the first records as they are now."""
    own = f"{ANCHOR.signer}/{log.flight.number}"
    text = Checkpoint(origin or own, size, Tree(row.leaf for row in log.rows[:size]).root(), 1).text()
    log.checkpoints[size] = sign_note(text, name or own, key)
    log.write(head=True)


def test_what_is_genuine_says_nothing(root: Path, flown: tuple[Path, list[Kept]]) -> None:
    """Whatever a witness has kept of it, and also without one."""
    check_found(root, None)
    for kept in flown[1]:
        check_found(root, kept)
    assert judge(root) == []
    assert anchor_of(root, WASP.trust) == ANCHOR


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


def test_each_flight_is_held_against_the_next(root: Path) -> None:
    """Cut, gone on with, or written anew, with everything signed anew by a key that was copied in time."""
    kept = logs_in(root)[1]
    count = len(kept.rows)
    for name, value, last, because in (
        ("previous_seq", count, count, f"that it ended with record {count}"),
        ("previous_seq", count - 3, count - 2, "ended before record"),
        ("previous_leaf", bytes(32), count - 1, "last leaf was another"),
    ):
        log = logs_in(root)[2]
        manifest = FlightOpened.FromString(log.rows[0].body)
        genuine = log.rows[0].body
        setattr(manifest, name, value)
        bodied(log, 0, encode(manifest))
        log.chain()
        log.checkpoints = {}
        sealed_with(log, live_key(root), len(log.rows))
        check_found(root, None, (2, 0, last, because))
        bodied(log, 0, genuine)
        log.chain()
        log.write(head=True)


def test_flights_that_are_gone(root: Path) -> None:
    """One in the middle is missed; of those at the beginning it is told, for a node makes room."""
    one, two, three = flights_in(root)
    count = len(logs_in(root)[0].rows)
    moved = two.folder.rename(root / "elsewhere")
    check_found(root, None, (2, 0, 0, "flight 3 follows"))
    moved.rename(two.folder)
    shutil.rmtree(one.folder)
    check_found(root, None, (1, 0, count - 1, "the flights before it are not here"), wrong=False)
    three.folder.rename(root / "000004-00000000")
    assert "by its manifest it is 000003" in " ".join(found.because for found in judge(root, ANCHOR))
    shutil.rmtree(two.folder)
    shutil.rmtree(root / "000004-00000000")
    assert judge(root, ANCHOR) == []


@pytest.mark.parametrize(("number", "before", "told"), [(1, b"", 0), (1, b"b", 1), (2, b"", 1), (2, b"b", 1)])
def test_what_came_before_the_first(number: int, before: bytes, told: int) -> None:
    """A number or a name of a flight before is enough."""
    first = Judged(number, Path(), manifest=FlightOpened(previous_flight_id=before, previous_seq=7))
    found = list(examiner._first([first]))
    assert [(one.flight, one.last, one.wrong) for one in found] == [(number - 1, 7, False)] * told


def test_a_start_that_was_cut_short_is_no_flight(tmp_path: Path) -> None:
    """Its folder holds an empty log; the next flight follows the one before it."""
    root = tmp_path / "flights"
    drone = Drone(root, 1)
    drone.fly(4)
    drone._flights.close(drone.session, CLOSE_DISARMED, nothing)
    drone.session.store.close()
    create_flight(root, 2, bytes(16), bytes(32))[1].close()
    Drone(root, 2, clock=drone.clock).session.store.close()
    assert [flight.number for flight in flights_in(root)] == [1, 2, 3]
    check_found(root, None, (1, 0, 0, "no verdict beside it"), wrong=False)


def test_what_a_witness_knows(root: Path, flown: tuple[Path, list[Kept]]) -> None:
    """Rolled back, forked, cut, exchanged, or without the checkpoint that was published."""
    newest = flown[1][-1]
    size, number = newest.checkpoint.size, newest.log_key.flight_number
    assert (number, size) == (3, max(logs_in(root)[2].checkpoints))
    other = replace(newest, checkpoint=replace(newest.checkpoint, root=bytes(32)))
    check_found(root, other, (3, 0, size - 1, "they are not these"))
    other = replace(newest, log_key=replace(newest.log_key, flight_id=bytes(16)))
    check_found(root, other, (3, 0, 0, "another flight of this number"))
    other = replace(newest, checkpoint=replace(newest.checkpoint, size=size + 9))
    check_found(root, other, (3, 0, len(logs_in(root)[2].rows), "the log holds"))
    rewritten(root, 3, lambda log: log.checkpoints.pop(size))
    check_found(root, newest, (3, size, size, "does not lie beside the log"))
    for flight in flights_in(root)[1:]:
        shutil.rmtree(flight.folder)
    check_found(root, newest, (3, 0, 0, "the flight is not here"))
    shutil.rmtree(flights_in(root)[0].folder)
    check_found(root, newest, (3, 0, 0, "the flight is not here"))


def test_what_was_deleted_to_make_room_is_told_of(root: Path, flown: tuple[Path, list[Kept]]) -> None:
    """A witness of an old flight that is not here any more."""
    first = next(kept for kept in flown[1] if kept.log_key.flight_number == 1)
    shutil.rmtree(flights_in(root)[0].folder)
    found = judge(root, ANCHOR, first)
    assert [(one.flight, one.wrong) for one in found] == [(1, False), (1, False)]


def test_what_can_not_be_read_is_said(root: Path) -> None:
    """A log that is none, and a manifest that is another flight's."""
    log = logs_in(root)[2]
    log.rows[0], log.rows[4] = log.rows[4]._replace(seq=0), log.rows[0]._replace(seq=4)
    log.chain()
    log.checkpoints = {}
    log.write(head=True)
    assert (judge(root, ANCHOR)[0][:3], "manifest" in judge(root, ANCHOR)[0].because) == ((3, 0, 0), True)
    flights_in(root)[2].database.write_bytes(b"no database" * 1000)
    assert [one[:3] for one in judge(root, ANCHOR)] == [(3, 0, 0)]
    flights_in(root)[2].database.unlink()
    (root / flights_in(root)[1].folder.name.replace("000002", "000003") / "flight.db").mkdir(parents=True)
    assert [one[:3] for one in judge(root, ANCHOR)] == [(3, 0, 0)]


def test_whose_flights_they_are(root: Path) -> None:
    """By the newest token that the Directory signed for a node."""
    folders = [flight.folder for flight in flights_in(root)]
    (folders[2] / TOKEN_FILE).write_bytes(people().hornet.token_bytes)
    assert anchor_of(root, WASP.trust).node == "hornet-02"
    (folders[2] / TOKEN_FILE).unlink()
    (folders[1] / TOKEN_FILE).write_bytes(people().alice.token_bytes)
    assert anchor_of(root, WASP.trust) == ANCHOR
    (folders[0] / TOKEN_FILE).write_bytes(people(2).wasp.token_bytes)
    with pytest.raises(DocumentError):
        anchor_of(root, WASP.trust)
    for folder in folders[:2]:
        (folder / TOKEN_FILE).unlink()
    with pytest.raises(DocumentError, match="has a token beside it"):
        anchor_of(root, WASP.trust)
