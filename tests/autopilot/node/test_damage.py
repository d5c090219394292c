"""Starts that find a log torn or damaged: what goes on, what is kept, and what the log is told of it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import apsw
import pytest

from autopilot.node.attachments import Attachments
from events import read_record
from events.schema.flight_pb2 import LogDamaged, LogRecovered
from events.schema.mission_pb2 import MissionProgressReported, MissionUploaded
from events.schema.vehicle_pb2 import VehicleLinkChanged
from events.store import StoreFailed, flights_in
from events.store.head import NAME
from events.store.recovery import KeptLog, examine
from statecharts import State, carry_over, restore, steps_of
from tests import flying
from tests.autopilot.node.histories import Begin, check_history, check_history_of_newest, fly
from tests.autopilot.node.nodes import FakeClock, Node, config, of_kind, vehicle_state
from tests.flights import answered

Change = Callable[[Path], None]


def cut_power(node: Node) -> Path:
    """End a node as a power cut does, everything since its start still in the WAL; return its flight's folder."""
    folder = node.session.flight.folder
    shutil.copytree(folder, folder.parent / "left", ignore=shutil.ignore_patterns("*-shm", "reserve"))
    node.kill()
    shutil.rmtree(folder)
    (folder.parent / "left").rename(folder)
    return folder


def flown(begin: Begin) -> Path:
    """Fly, and cut the power."""
    node = begin().start()
    fly(node)
    return cut_power(node)


def digests(folder: Path) -> dict[str, str]:
    """Return the digests of what lies in a flight's folder and is a log."""
    names = ("flight.db", "flight.db-wal", NAME)
    content = {name: (folder / name).read_bytes() for name in names if (folder / name).exists()}
    return {name: sha256(file).hexdigest() for name, file in content.items() if file}


def spoil(file: Path, at: int, content: bytes = b"spoilt") -> None:
    """Write over a part of a file; a negative place counts from its end."""
    changed = bytearray(file.read_bytes())
    at %= len(changed)
    changed[at : at + len(content)] = content
    file.write_bytes(bytes(changed))


def test_a_power_cut_leaves_nothing_to_say(begin: Begin, tmp_path: Path) -> None:
    """What was committed is there, the flight goes on, and nobody is told anything."""
    flown(begin)
    again = begin().start()
    assert "log_recovered" not in again.kinds()
    check_history(tmp_path, (2, ""))


def test_a_torn_tail_is_cut_and_told(begin: Begin, tmp_path: Path) -> None:
    """The flight goes on after the last whole commit, and says what was found, once."""
    folder = flown(begin)
    with (folder / "flight.db-wal").open("ab") as wal:
        wal.write((folder / "flight.db-wal").read_bytes()[32:][:3000])
    last = examine(folder).end
    again = begin().start()
    (told,) = of_kind(again.log(), "log_recovered")
    assert isinstance(told, LogRecovered)
    assert (told.flight_id, told.last_seq, told.last_leaf) == (again.session.store.flight_id, *last)
    assert "the WAL is torn after commit" in told.found
    # The move is of the aim: what is measured dies with a process.
    assert again.kinds()[last.seq + 1 : last.seq + 4] == ["node_started", "moved", "log_recovered"]
    check_history(tmp_path, (2, ""))
    again.kill()
    assert begin().start().kinds().count("log_recovered") == 1
    check_history(tmp_path, (3, ""))


def test_a_closed_flight_with_a_torn_tail_is_told_in_the_next(begin: Begin, tmp_path: Path) -> None:
    """The old one stays closed; the new one names it."""
    node = begin().start()
    fly(node)
    node.turn(after_ms=181_000)
    node.kill()
    first, second = flights_in(tmp_path)
    shutil.rmtree(second.folder)
    (first.folder / NAME).unlink()
    again = begin().start()
    (told,) = of_kind(again.log(), "log_recovered")
    assert told.flight_id == examine(first.folder).flight_id
    assert "no head file" in told.found
    check_history(tmp_path, (1, "CLOSE_DISARMED"), (1, ""))


def wal_in_the_middle(folder: Path) -> None:
    """One rotten place, with commits after it."""
    spoil(folder / "flight.db-wal", (folder / "flight.db-wal").stat().st_size // 2)


def wal_at_its_end(folder: Path) -> None:
    """One rotten place in the last commit, which looks like a torn tail."""
    spoil(folder / "flight.db-wal", -20)


def wal_gone(folder: Path) -> None:
    """Everything since the last checkpoint is gone."""
    (folder / "flight.db-wal").unlink()


def record_edited(folder: Path) -> None:
    """Somebody who holds the disk changes what was said."""
    connection = apsw.Connection(str(folder / "flight.db"))
    connection.execute("UPDATE record SET body = x'08' WHERE seq = 5")
    connection.close()


@pytest.mark.parametrize("change", [wal_in_the_middle, wal_at_its_end, record_edited])
def test_a_damaged_log_is_kept_and_another_flight_names_its_head(begin: Begin, tmp_path: Path, change: Change) -> None:
    """Untouched byte for byte, at this start and the next; the new flight carries what its readable part holds."""
    folder = flown(begin)
    change(folder)
    before, finding = digests(folder), examine(folder)
    again = begin().start()
    assert digests(folder) == before
    assert [flight.folder.name for flight in flights_in(tmp_path)] == [folder.name, again.session.flight.folder.name]
    (told,) = of_kind(again.log(), "log_damaged")
    assert isinstance(told, LogDamaged)
    assert (told.flight_id, told.folder, told.found) == (finding.flight_id, folder.name, finding.words())
    assert finding.head_file is not None
    assert (told.last_seq, told.last_leaf) == finding.end
    assert (told.head_file_seq, told.head_file_leaf) == finding.head_file.head
    check_carried_on(again, folder)
    check_history_of_newest(tmp_path)
    again.kill()
    third = begin().start()
    assert third.kinds().count("log_damaged") == 1
    assert third.kinds().count("node_started") == 2
    assert digests(folder) == before


def check_carried_on(again: Node, folder: Path) -> None:
    """Check that the newest flight begins with what holds of a damaged one, and names its end."""
    finding = examine(folder)
    kept = KeptLog(finding)
    records = list(map(read_record, kept.stored()))
    kept.close()
    state = State()
    for step in steps_of(records):
        restore(state, step)
    manifest = next(of_kind(again.log(), "flight_opened"))
    assert (manifest.previous_flight_id, manifest.previous_seq, manifest.previous_leaf) == (
        finding.flight_id,
        *finding.end,
    )
    assert next(of_kind(again.log(), "baseline_carried")).state == carry_over(state, records[-1].at.flight_ns)


def test_a_log_of_which_nothing_can_be_read(begin: Begin, clock: FakeClock, tmp_path: Path) -> None:
    """The baseline comes from the flight before it, and the new flight says what is lost."""
    node = begin().start()
    fly(node)
    node.turn(after_ms=181_000)
    folder = cut_power(node)
    wal_gone(folder)
    spoil(folder / "flight.db", 0, bytes(100))
    before = digests(folder)
    again = begin().start()
    (told,) = of_kind(again.log(), "log_damaged")
    assert (told.flight_id, told.folder, told.HasField("last_seq")) == (b"", folder.name, False)
    assert told.head_file_seq > 0
    manifest = next(of_kind(again.log(), "flight_opened"))
    assert (manifest.flight_number, manifest.previous_flight_id) == (
        3,
        examine(flights_in(tmp_path)[0].folder).flight_id,
    )
    assert digests(folder) == before


def test_a_damaged_first_flight_of_which_nothing_can_be_read(begin: Begin, tmp_path: Path) -> None:
    """There is nothing to carry over: a first flight's baseline, and the damage told."""
    folder = flown(begin)
    wal_gone(folder)
    spoil(folder / "flight.db", 0, bytes(100))
    again = begin().start()
    assert again.kinds() == ["flight_opened", "baseline_carried", "node_started", "log_damaged"]
    assert next(of_kind(again.log(), "baseline_carried")).ByteSize() == 2


def test_a_log_that_can_not_be_read_now_is_left_alone(begin: Begin, tmp_path: Path) -> None:
    """The disk says no: nothing is known of the log, so nothing is begun in its place."""
    folder = flown(begin)
    wal = folder / "flight.db-wal"
    wal.unlink()
    wal.mkdir()
    with pytest.raises(StoreFailed, match=folder.name):
        begin().start()
    assert [flight.folder for flight in flights_in(tmp_path)] == [folder]


FLYING: dict[str, dict[str, Any]] = {
    "mission": {"enabled": True, "begin": "alone", "file": "mission.json"},
    "vehicle": {"listen": "127.0.0.1:14550"},
}


def flying_a_mission(begin: Begin) -> tuple[Path, bytes]:
    """Fly a mission, and cut the power in the air; return the flight's folder and the mission as it came."""
    node, mission = begin(settings=config(**FLYING)).start(), b"the mission as it came"
    attachments = Attachments()
    attachments.attend(node.session.flight.folder)
    attachments.keep(sha256(mission).hexdigest(), mission)
    plan = flying.planned(json_sha256=sha256(mission).digest())
    node.tell(VehicleLinkChanged(vehicle=1, up=True), vehicle_state(armed=False), plan)
    node.tell(flying.reported(node.log(), "pass"), after_ms=200)
    node.tell(MissionUploaded(effect_seq=flying.newest(node.log(), "upload_mission"), items=4), after_ms=200)
    for mode in ("guided", "guided", "mission"):
        node.tell(flying.state(mode), after_ms=200)
    node.tell(answered(flying.newest(node.log(), "start_mission")), after_ms=200)
    node.tell(MissionProgressReported(vehicle=1, current_item=2), after_ms=200)
    node.turn(after_ms=200)
    node.tell(flying.state("mission", landed=2), after_ms=200)  # what a damaged end loses
    node.turn(after_ms=200)
    return cut_power(node), mission


def test_a_flight_that_begins_in_the_air_goes_on_with_the_mission(begin: Begin) -> None:
    """In the place of one whose log is damaged; the mission's file lies in its folder too, unless it is damaged."""
    for spoilt in (False, True):
        folder, mission = flying_a_mission(begin)
        name = sha256(mission).hexdigest()
        wal_at_its_end(folder)
        if spoilt:
            (folder / "evidence" / name).write_bytes(b"another")
        again = begin(settings=config(**FLYING)).start()
        now = again.session.state.missions[1]
        assert (now.state, now.next_item, now.held_seq > now.plan_seq) == ("flying", 2, True)
        found = again.session.flight.folder / "evidence" / name
        assert found.exists() is not spoilt
        assert spoilt or found.read_bytes() == mission
        again.tell(VehicleLinkChanged(vehicle=1, up=True), flying.state("mission"), after_ms=200)
        again.tell(flying.state("mission", armed=False), after_ms=200)
        again.turn(after_ms=200)
        assert again.session.state.missions[1].state == "landed"
        again.kill()
        shutil.rmtree(folder)
        shutil.rmtree(again.session.flight.folder)
