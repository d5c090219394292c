"""Sealing a flight: when it is signed, by which key, what is never signed, and what is left when it is over."""

from __future__ import annotations

import stat
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from autopilot.node.board import Board
from autopilot.node.flights import Flights
from autopilot.node.sealing import CERTIFICATE_FILE, EVERY_RECORDS, KEY_FILE, Sealer
from autopilot.trust.identity import ROOT_FILE, TOKEN_FILE
from autopilot.trust.notes import Checkpoint, LogKey, open_note, read_checkpoint, read_log_key, sign_note
from events.schema.flight_pb2 import CLOSE_STOPPED, InputsDropped
from events.store import SqliteStore, StoreFailed, flights_in, read_flight
from events.tree import Tree
from replay.verify import verify
from tests.autopilot.node.histories import fly
from tests.autopilot.node.nodes import BOOT, FakeClock, Node, chance, heard_vehicle, identity, of_kind, vehicle_state
from tests.autopilot.trust.world import people

Start = Callable[..., Node]


@pytest.fixture
def start(tmp_path: Path, clock: FakeClock, monkeypatch: pytest.MonkeyPatch) -> Start:
    """Return what makes the next start of a daemon whose flights are sealed."""
    random = chance()

    def made(boot_id: str = BOOT) -> Node:
        node = Node(tmp_path, clock, monkeypatch, random=random, boot_id=boot_id)
        sealer = Sealer(people().wasp, clock, random)
        node.loop._flights = node.flights = Flights(tmp_path, identity(boot_id), clock, random, sealer)
        return node.start()

    return made


def signed(folder: Path) -> list[Checkpoint]:
    """Return a flight's checkpoints, each of which its certified key has signed over what the log holds."""
    reader = read_flight(folder)
    leaves = [stored.leaf for stored in reader.stored()]
    notes, tree = reader.checkpoints(), Tree(leaves)
    assert verify(reader).holds
    reader.close()
    log_key = certified(folder)
    found = [read_checkpoint(open_note(note, log_key.origin, log_key.public_key)) for _, note in notes]
    assert [(one.origin, one.size, one.root) for one in found] == [
        (log_key.origin, size, tree.root(size)) for size, _ in notes
    ]
    return found


def certified(folder: Path) -> LogKey:
    """Return the log key that the node vouches for."""
    wasp = people().wasp
    note = (folder / CERTIFICATE_FILE).read_text(encoding="utf-8")
    return read_log_key(open_note(note, "waypoint/coast-watch/wasp-01", wasp.public_key))


def check_signed(node: Node, *sizes: int) -> None:
    """Check how many records the checkpoints of the newest flight cover, and that the newest is what is published."""
    folder = flights_in(node.root)[-1].folder
    found = signed(folder)
    assert [one.size for one in found] == list(sizes)
    sealing = node.session.sealing
    assert sealing is not None
    assert read_checkpoint(open_note(sealing.newest, found[-1].origin, certified(folder).public_key)) == found[-1]


def test_a_flight_begins_with_a_certified_key(start: Start) -> None:
    """The certificate is the fourth record, the key is the owner's alone, and strangers find whose it is."""
    node = start()
    folder = node.session.flight.folder
    assert node.kinds() == ["flight_opened", "baseline_carried", "node_started", "log_key_certified"]
    note = next(of_kind(node.log(), "log_key_certified")).certificate
    assert note == (folder / CERTIFICATE_FILE).read_text(encoding="utf-8")
    log_key = certified(folder)
    assert (log_key.flight_number, log_key.flight_id) == (1, node.session.store.flight_id)
    assert stat.S_IMODE((folder / KEY_FILE).stat().st_mode) == 0o600
    assert (folder / TOKEN_FILE).read_bytes() == people().wasp.token_bytes
    assert (folder / ROOT_FILE).read_bytes() == (people().wasp.folder / ROOT_FILE).read_bytes()
    node.turn()
    check_signed(node, 4)


def test_when_a_flight_is_signed(start: Start) -> None:
    """At arm and disarm, every so many records, and also where nothing happens."""
    node = start()
    node.turn()
    node.tell(*heard_vehicle())
    node.turn(after_ms=200)
    check_signed(node, 4, 7)
    node.tell(vehicle_state(armed=False), after_ms=1000)
    node.turn(after_ms=200)
    check_signed(node, 4, 7, 8)
    before = signed(node.session.flight.folder)[-1]
    node.turn(after_ms=9_000)
    assert signed(node.session.flight.folder)[-1] == before
    node.turn(after_ms=1_000)
    after = signed(node.session.flight.folder)[-1]
    assert (after.size, after.root) == (before.size, before.root)
    assert after.flight_ns - before.flight_ns >= 10_000_000_000
    for _ in range(EVERY_RECORDS // 20):
        node.tell(*[InputsDropped(input_class="frame", count=1)] * 20, after_ms=1)
        node.turn(after_ms=101)
    sizes = [one.size for one in signed(node.session.flight.folder)]
    assert EVERY_RECORDS + 4 <= sizes[-1] <= EVERY_RECORDS + 8
    assert len(sizes) == 4


def test_nothing_is_signed_before_it_is_durable(start: Start) -> None:
    """What waits to be committed is under no checkpoint."""
    node = start()
    node.turn(after_ms=60_000)
    node.tell(InputsDropped(input_class="frame", count=1))
    node.turn(after_ms=50)
    check_signed(node, 4)


def test_a_closed_flight_is_signed_whole_and_its_key_is_gone(start: Start) -> None:
    """Whoever takes the disk can sign no other past; the next flight has a key of its own."""
    node = start()
    fly(node)
    folder, seed = node.session.flight.folder, (node.session.flight.folder / KEY_FILE).read_bytes()
    node.turn(after_ms=181_000)
    count = len(node.log(0))
    assert [signed(folder)[-1].size, node.kinds(0)[-1]] == [count, "flight_closed"]
    assert not (folder / KEY_FILE).exists()
    following = node.session.flight.folder
    assert (following / KEY_FILE).read_bytes() != seed
    assert certified(following).flight_number == 2
    assert [path.name for path in folder.iterdir() if seed in path.read_bytes()] == []


def test_a_restart_goes_on_from_what_was_signed(start: Start, clock: FakeClock) -> None:
    """With the same key, and on top of the newest checkpoint."""
    node = start()
    node.turn()
    node.tell(*heard_vehicle())
    node.turn(after_ms=200)
    key = (node.session.flight.folder / KEY_FILE).read_bytes()
    node.kill()
    clock.pass_ms(3_000)
    again = start()
    assert (again.session.flight.folder / KEY_FILE).read_bytes() == key
    assert again.kinds()[-2:] == ["node_started", "log_key_certified"]
    check_signed(again, 4, 7)  # published at once
    again.turn()
    check_signed(again, 4, 7, 9)


def test_another_boot_signs_the_end_of_the_flight_before(start: Start) -> None:
    """The key lay beside it; with its last checkpoint it goes."""
    node = start()
    node.turn()
    folder = node.session.flight.folder
    node.kill()
    start("boot-2")
    assert [one.size for one in signed(folder)] == [4, 5]
    assert not (folder / KEY_FILE).exists()


def test_a_lost_key_is_replaced_while_the_flight_is_open_only(start: Start) -> None:
    """A fresh one is certified and recorded; a flight that is only closed gets none."""
    node = start()
    folder = node.session.flight.folder
    (folder / KEY_FILE).chmod(0o644)  # others could read it: it counts as lost
    first = certified(folder)
    node.kill()
    again = start()
    assert certified(folder).public_key != first.public_key
    assert len(list(of_kind(again.log(), "log_key_certified"))) == 2
    (folder / KEY_FILE).unlink()
    again.kill()
    start("boot-2")
    assert signed(folder) == []
    assert not (folder / KEY_FILE).exists()


def test_a_certificate_of_another_flight_is_not_taken(start: Start) -> None:
    """Key and certificate fit each other, but not this log."""
    node = start()
    folder, wasp = node.session.flight.folder, people().wasp
    other = replace(certified(folder), flight_number=2)
    (folder / CERTIFICATE_FILE).write_text(sign_note(other.text(), other.signer, wasp.sign_key), encoding="utf-8")
    node.kill()
    again = start()
    assert certified(folder).flight_number == 1
    assert certified(folder).public_key != other.public_key
    again.turn()
    check_signed(again, 6)


def check_refused(start: Start, node: Node, because: str) -> None:
    """Check that a changed log is not signed by the next start, which says so in the log."""
    store = SqliteStore(node.session.flight.database)
    before = store.checkpoints()
    store.close()
    again = start()
    again.turn(after_ms=60_000)
    assert because in next(of_kind(again.log(), "seal_refused")).because
    again.flights.close(again.session, CLOSE_STOPPED, again.heard.extend)
    assert again.session.store.checkpoints() == before
    assert not (node.session.flight.folder / KEY_FILE).exists()
    board = Board(lambda: 5)
    board.follow(again.session)
    assert (board.node_status().log_checkpoint, board.node_status().log_key) == ("", "")


def test_a_cut_log_is_not_signed(start: Start) -> None:
    """More was signed than there is."""
    node = start()
    node.tell(*heard_vehicle())
    node.turn(after_ms=200)
    node.session.store._connection.execute("DELETE FROM record WHERE seq > 4")  # type: ignore[attr-defined]
    node.kill()
    (node.session.flight.folder / "head").unlink()
    check_refused(start, node, "7 records were signed, and the log holds 5")


def test_no_key_outlives_a_damaged_flight(start: Start) -> None:
    """It can't be closed; the next one begins, and there is one key on the disk."""
    node = start()
    node.tell(*heard_vehicle())
    node.turn(after_ms=200)
    node.session.store._connection.execute("DELETE FROM record WHERE seq > 4")  # type: ignore[attr-defined]
    node.kill()
    again = start()
    assert again.session.flight.number == 2
    assert [path.parent for path in node.root.glob(f"*/{KEY_FILE}")] == [again.session.flight.folder]


def test_a_log_that_was_written_again_is_not_signed(start: Start) -> None:
    """Its first records have another root."""
    node = start()
    node.turn()
    note = node.session.store.checkpoints()[0][1].split("\n")
    note[2] = note[2][:40].swapcase() + note[2][40:]  # its last digits can't all be others
    node.session.store.add_checkpoint(4, "\n".join(note))
    node.kill()
    check_refused(start, node, "first 4 records are not those that were signed")


def test_a_checkpoint_that_is_none_is_not_followed(start: Start) -> None:
    """Damage is damage."""
    node = start()
    node.turn()
    node.session.store.add_checkpoint(4, "nothing")
    node.kill()
    check_refused(start, node, "can't be read")


def test_the_status_carries_the_newest_checkpoint(start: Start) -> None:
    """With its key's certificate, so that the ground can keep it."""
    node = start()
    board = Board(lambda: 5)
    board.follow(node.session)
    assert board.node_status().log_checkpoint == ""
    node.turn()
    said = board.node_status()
    sealing = node.session.sealing
    assert sealing is not None
    assert (said.log_checkpoint, said.log_key) == (sealing.newest, sealing.certificate)


def test_a_checkpoint_that_can_not_be_stored_is_not_published(start: Start) -> None:
    """Store, then publish; and the loop ends, as for any write that fails."""
    node = start()
    node.turn()
    sealing = node.session.sealing
    assert sealing is not None
    before = sealing.newest
    node.session.store.close()
    with pytest.raises(StoreFailed):
        node.turn(after_ms=11_000)
    assert sealing.newest == before
