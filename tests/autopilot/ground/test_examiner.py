"""All flights of a node judged by each other and by a witness; what is genuine says nothing."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from autopilot.ground import examiner
from autopilot.ground.examiner import anchor_of, judge
from autopilot.ground.kept import Kept
from autopilot.ground.sealed import Judged
from autopilot.trust.documents import DocumentError
from autopilot.trust.identity import TOKEN_FILE
from events import encode
from events.schema.flight_pb2 import CLOSE_DISARMED, FlightOpened
from events.store import create_flight, flights_in
from tests.autopilot.ground.judging import ANCHOR, WASP, bodied, check_found, live_key, rewritten, sealed_with
from tests.autopilot.trust.world import people
from tests.torture.flying import Drone, nothing
from tests.torture.forging import logs_in


def test_what_is_genuine_says_nothing(root: Path, flown: tuple[Path, list[Kept]]) -> None:
    """Whatever a witness has kept of it, and also without one."""
    check_found(root, None)
    for kept in flown[1]:
        check_found(root, kept)
    assert judge(root) == []
    assert anchor_of(root, WASP.trust) == ANCHOR


def test_each_flight_is_held_against_the_next(root: Path) -> None:
    """Cut, gone on with, or written anew, with everything signed anew by a key that was copied in time.

    Where the one before is signed up to its end, the next one, whose word stands against a signature, is named too.
    """
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
        check_found(root, None, (2, 0, last, because), (3, 0, 0, "or it is wrong about flight 2"))
        bodied(log, 0, genuine)
        log.chain()
        log.write(head=True)


def test_a_flight_that_is_not_signed_up_to_its_end_is_the_one_to_doubt(root: Path) -> None:
    """The word of the next one stands against nothing."""
    log = logs_in(root)[1]
    log.checkpoints = {size: note for size, note in log.checkpoints.items() if size < len(log.rows)}
    log.write(head=True)
    after = logs_in(root)[2]
    manifest = FlightOpened.FromString(after.rows[0].body)
    manifest.previous_leaf = bytes(32)
    bodied(after, 0, encode(manifest))
    after.chain()
    after.checkpoints = {}
    sealed_with(after, live_key(root), len(after.rows))
    wrong = [one for one in judge(root, ANCHOR) if one.wrong]
    assert [(one.flight, one.first, one.last) for one in wrong] == [(2, 0, len(log.rows) - 1)], wrong


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
