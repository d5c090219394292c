"""Starts from a snapshot: the same session as from the first record, and from there where no snapshot can be used."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest

from autopilot.node import flights as flights_module
from autopilot.node import restoring
from autopilot.node.flights import Flights, Session
from autopilot.node.sealing import CERTIFICATE_FILE
from autopilot.trust.notes import read_log_key, sign_note
from events.schema.flight_pb2 import CLOSE_STOPPED, InputsDropped
from events.store import Flight, SqliteStore, flights_in, read_flight
from events.store.snapshots import NAME, Snapshots, SnapshotWriter
from replay.verify import verify
from statecharts import LOGIC
from statecharts.digest import digest_of
from statecharts.snapshot import pack, unpack
from tests.autopilot.node.nodes import BOOT, FakeClock, of_kind
from tests.autopilot.node.restored import SOFTWARE, Begin, Shown, busy, starts
from tests.autopilot.trust.world import people
from tests.checks import check_equal, check_same


@pytest.fixture
def begin(tmp_path: Path, clock: FakeClock, monkeypatch: pytest.MonkeyPatch) -> Begin:
    return starts(tmp_path, clock, monkeypatch)


def opened(node: Shown) -> tuple[Shown, Session]:
    """Return a start of the node as far as its newest flight is loaded, without anything recorded."""
    session, _ = node.flights._last(flights_in(node.root), node.hear)
    assert session is not None
    return node, session


def copied(node: Shown, to: Path) -> Path:
    """Return a copy of the node's folder without snapshots."""
    shutil.copytree(node.root, to, ignore=shutil.ignore_patterns(NAME))
    return to


def check_alike(begin: Begin, node: Shown, to: Path, *, from_snapshot: bool = True) -> Session:
    """Check that a start on the folder of a killed node is, but for what it heard, one that reads everything."""
    zero, expected = opened(begin(root=copied(node, to)))
    again, session = opened(begin())
    check_equal(session.known is not None, from_snapshot)
    check_equal((expected.known, len(zero.heard)), (None, len(node.log())))
    check_equal(again.heard, zero.heard[session.known.size if session.known else 0 :])
    check_same(session.state, expected.state)
    check_equal(digest_of(session.state), digest_of(expected.state))
    same = [field.name for field in fields(Session) if field.name in ("due", "closed", "kept", "started", "last")]
    same += ["logic", "arming"]
    check_equal([getattr(session, name) for name in same], [getattr(expected, name) for name in same])
    check_equal(again.board.folded, zero.board.folded)
    check_equal(session.clock.boot, expected.clock.boot)
    expected.store.close()
    session.store.close()
    return session


def check_goes_on(begin: Begin, to: Path, starts: int) -> None:
    """Check that the next start goes on with the flight, signs it, and that it all replays."""
    node = begin().start()
    busy(node, 3)
    check_equal(node.kinds().count("node_started"), starts)
    reader = read_flight(node.session.flight.folder)
    check_equal(verify(reader).words().startswith("identical"), True)
    check_equal(len(reader.checkpoints()) > 2, True)
    reader.close()
    node.kill()
    check_alike(begin, node, to)


def test_a_start_from_a_snapshot_is_a_start_from_zero(begin: Begin, tmp_path: Path) -> None:
    """State, deadline, what was noted on the way, and what people see; and so again after going on."""
    node = begin().start()
    busy(node)
    base_of = Snapshots(node.session.flight.folder).base_of()
    first, second, third, fourth, fifth, sixth, *_ = base_of
    rests_on = {first: 0, second: first, third: 0, fourth: third, fifth: fourth, sixth: third}
    check_equal({size: base_of[size] for size in rests_on}, rests_on)
    node.kill()
    session = check_alike(begin, node, tmp_path / "zero")
    assert session.known is not None
    check_equal(session.known.size, max(base_of))
    check_goes_on(begin, tmp_path / "one", 2)
    check_goes_on(begin, tmp_path / "two", 3)
    check_equal(set(base_of) <= set(Snapshots(node.session.flight.folder).base_of()), True)


@pytest.mark.parametrize("boot_id", [BOOT, "boot-2"])
def test_what_a_closed_flight_hands_over(
    begin: Begin, tmp_path: Path, boot_id: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The next flight begins with the same bytes, read from a snapshot or from zero."""
    node = begin().start()
    busy(node)
    node.flights.close(node.session, CLOSE_STOPPED, node.hear)
    node.kill()
    before = copied(node, tmp_path / "zero")
    monkeypatch.setattr(restoring, "EVERY_RECORDS", 10_000)
    after = begin(boot_id="boot-9").start()
    after.kill()
    zero = begin(root=before, boot_id="boot-9").start()
    check_equal(len(zero.heard) - len(after.heard), len(node.log(0)))
    bodies = [[one.body for one in each.log() if one.kind.name == "baseline_carried"] for each in (after, zero)]
    check_equal(bodies[0], bodies[1])
    check_equal(len(bodies[0][0]) > 500, True)
    zero.kill()
    again, session = opened(begin(boot_id=boot_id))
    check_equal((session.closed, session.known), (False, None))
    session.store.close()
    for path in flights_in(again.root)[1].folder.iterdir():
        path.unlink()
    again, session = opened(begin(boot_id=boot_id))
    check_equal((session.closed, session.known is not None, again.heard), (True, True, []))
    session.store.close()


def rewrite(flight: Flight, change: Callable[[Any], Any]) -> None:
    """Change every chunk of a flight as whoever holds the disk can, with checksums that fit."""
    found = Snapshots(flight.folder)
    chunks = [unpack(found.read(size)) for size in found.places]
    writer = SnapshotWriter(flight.folder, 0)
    for chunk in chunks:
        writer.append(chunk.size, chunk.base, pack(change(chunk)))


def _remove(flight: Flight) -> None:
    (flight.folder / NAME).unlink()


def _replace_by_folder(flight: Flight) -> None:
    _remove(flight)
    (flight.folder / NAME).mkdir()


def _flip(flight: Flight) -> None:
    places = Snapshots(flight.folder).places
    content = bytearray((flight.folder / NAME).read_bytes())
    for place in places.values():
        content[place.start + 9] ^= 1
    (flight.folder / NAME).write_bytes(content)


def _unsign(flight: Flight) -> None:
    (flight.folder / CERTIFICATE_FILE).unlink()


def _of_another(flight: Flight) -> None:
    path = flight.folder / CERTIFICATE_FILE
    own = read_log_key(path.read_text("utf-8").rpartition("\n\n")[0] + "\n")
    other = replace(own, flight_id=bytes(16))
    path.write_text(sign_note(other.text(), other.signer, people().wasp.sign_key), "utf-8")


def _in_the_log(statement: str) -> Callable[[Flight], None]:
    def change(flight: Flight) -> None:
        store = SqliteStore(flight.database)
        store._connection.execute(statement)
        store.close()

    return change


def _chunk(**values: Any) -> Callable[[Flight], None]:
    return lambda flight: rewrite(flight, lambda chunk: chunk._replace(**values))


def _table(name: str) -> Callable[[Flight], None]:
    return lambda flight: rewrite(
        flight, lambda chunk: chunk._replace(tables={one: rows for one, rows in chunk.tables.items() if one != name})
    )


@pytest.mark.parametrize(
    ("harm", "because"),
    [
        (_remove, ""),
        (_replace_by_folder, "directory"),
        (_flip, "is damaged"),
        (_unsign, "nothing vouches"),
        (_of_another, "nothing vouches"),
        (_in_the_log("DELETE FROM checkpoint"), "nothing vouches"),
        (_in_the_log("UPDATE checkpoint SET note = replace(note, 'state ', 'state  ')"), "nothing vouches"),
        (_in_the_log("UPDATE checkpoint SET size = size + 1000"), "nothing vouches"),
        (_in_the_log("UPDATE checkpoint SET note = (SELECT note FROM checkpoint LIMIT 1)"), "nothing vouches"),
        (_chunk(software=bytes(32)), "another logic"),
        (_chunk(leaf=bytes(32)), "another leaf"),
        (_chunk(side=b"\x90"), "not started from"),
        (_table("nonces"), "not the one that was signed"),
        (_table("orders"), "not the one that was signed"),
    ],
)
def test_a_snapshot_that_can_not_be_used_is_not(
    begin: Begin,
    tmp_path: Path,
    harm: Callable[[Flight], None],
    because: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Whatever is wrong with it, the start is right, says why it took longer, and snapshots come again."""
    node = begin().start()
    busy(node)
    node.kill()
    harm(flights_in(node.root)[0])
    check_alike(begin, node, tmp_path / "zero", from_snapshot=False)
    check_equal(because in capsys.readouterr().err, True)


def test_after_a_snapshot_that_was_not_used_others_come(begin: Begin, tmp_path: Path) -> None:
    """The file is begun anew, with everything in its first chunk."""
    node = begin().start()
    busy(node)
    node.kill()
    rewrite(flights_in(node.root)[0], lambda chunk: chunk._replace(software=bytes(32)))
    again = begin().start()
    check_equal(again.session.known, None)
    busy(again, 2)
    base_of = Snapshots(again.session.flight.folder).base_of()
    check_equal((min(base_of) > len(node.heard), base_of[min(base_of)]), (True, 0))
    again.kill()
    check_alike(begin, again, tmp_path / "zero")


def test_an_older_snapshot_where_the_newest_is_torn(begin: Begin, tmp_path: Path) -> None:
    """As a power cut leaves the file: it was never synced."""
    node = begin().start()
    busy(node)
    node.kill()
    path = node.session.flight.folder / NAME
    sizes = sorted(Snapshots(path.parent).places)
    path.write_bytes(path.read_bytes()[:-1])
    session = check_alike(begin, node, tmp_path / "zero")
    assert session.known is not None
    check_equal(session.known.size, sizes[-2])
    check_goes_on(begin, tmp_path / "one", 2)


def test_the_log_may_be_shorter_than_a_snapshot(begin: Begin, tmp_path: Path) -> None:
    """What was cut from the log takes the snapshots of it along; the seal refuses, as from zero."""
    node = begin().start()
    busy(node)
    node.kill()
    flight = flights_in(node.root)[0]
    sizes = sorted(Snapshots(flight.folder).places)
    _in_the_log(f"DELETE FROM record WHERE seq >= {sizes[-2]}")(flight)
    (flight.folder / "head").unlink()
    session = check_alike(begin, node, tmp_path / "zero")
    assert session.known is not None
    check_equal(session.known.size, sizes[-2])
    again = begin().start()
    assert again.session.sealing is not None
    check_equal("records were signed, and the log holds" in again.session.sealing.refusal, True)
    again.turn(after_ms=20_000)
    check_equal(again.session.sealing.refusal != "", True)


@pytest.mark.parametrize(("software", "logic"), [("0.2.0", 0), (SOFTWARE, 1)])
def test_an_update_reads_the_whole_log(
    begin: Begin, tmp_path: Path, software: str, logic: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What another version kept is not believed."""
    node = begin().start()
    busy(node)
    node.kill()
    monkeypatch.setattr(restoring, "LOGIC", LOGIC + logic)
    _, session = opened(begin(software=software))
    check_equal(session.known, None)
    session.store.close()


def test_the_logic_of_the_newest_start_is_remembered(begin: Begin, tmp_path: Path) -> None:
    """Not that of the manifest, where it was replaced in the air."""
    with patch.object(flights_module, "LOGIC", LOGIC + 5):
        begin().start().kill()
    node = begin()
    with patch.object(Flights, "_why_not_go_on", lambda _self, _session: None):
        node.start()
    busy(node)
    node.kill()
    check_equal(check_alike(begin, node, tmp_path / "zero").logic, LOGIC)


def test_damage_behind_a_snapshot_is_damage(begin: Begin) -> None:
    """The flight that follows names the last record that holds, and knows what that one knew."""
    node = begin().start()
    busy(node)
    node.tell(*[InputsDropped(input_class="frame", count=1)] * 3)
    node.turn(after_ms=200)
    node.kill()
    flight = flights_in(node.root)[0]
    size = max(Snapshots(flight.folder).places)
    last = len(node.log()) - 1
    check_equal(last > size, True)
    _in_the_log(f"UPDATE record SET body = x'00' WHERE seq = {last}")(flight)
    again = begin().start()
    manifest = next(of_kind(again.log(), "flight_opened"))
    check_equal((again.session.flight.number, manifest.previous_seq), (2, last - 1))
    check_equal(len(again.session.state.orders), 12)
