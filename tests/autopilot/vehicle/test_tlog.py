"""Files of the link: read by another tool, without secrets, closed and named in order, and the first to stop."""

from __future__ import annotations

import hashlib
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from google.protobuf.message import Message
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as dialect

from autopilot.adapters.vehicle.rawlog import LAST_NS, LOOK_NS, MIB, SETTLE_NS, RawLog, Recorder
from autopilot.adapters.vehicle.tlog import close_found, record_of
from autopilot.ports.config import VehicleSection
from autopilot.ports.edges import InputClass
from autopilot.trust.clock import HostClock
from events.schema.link_pb2 import RawChanged, RawSegmentClosed
from tests.autopilot.vehicle.vehicles import S, attitude, framed, heartbeat, packed, position, signed

AT_US = 1_790_000_000_123_456
KEY = b"the secret of a link, 32 bytes ."


class Log:
    """Takes what is offered, unless told not to."""

    def __init__(self) -> None:
        self.taken: list[Message] = []
        self.refuses = False

    def offer(self, input_class: InputClass, observation: Message) -> bool:
        assert input_class is InputClass.OUTCOME
        self.taken += [observation] * (not self.refuses)
        return not self.refuses

    def of(self, kind: type[Message]) -> list[Any]:
        return [one for one in self.taken if isinstance(one, kind)]


class Desk:
    """A recorder in a folder, with time and the disk in a test's hand."""

    def __init__(self, root: Path, **settings: Any) -> None:
        self.root, self.log, self.now_ns, self.free_mib = root / "flights", Log(), 0, 10_000
        self.recorder = Recorder(VehicleSection(**settings), self.log.offer, lambda _: self.free_mib * MIB)

    def fly(self, name: str) -> Path:
        flight = self.root / name
        flight.mkdir(parents=True, exist_ok=True)
        self.recorder.record_in(self.now_ns, flight)
        return flight / "raw"

    def note(self, *frames: bytes) -> None:
        for frame in frames:
            record = record_of(AT_US + self.now_ns // 1_000, frame)
            if record is not None:
                self.recorder.note(self.now_ns, record)

    def wait(self, ns: int) -> None:
        self.now_ns += ns
        self.recorder.turn(self.now_ns)


def read(path: Path) -> list[tuple[str, float]]:
    """Return type and time of each message in a file, as mavutil reads it."""
    log = mavutil.mavlogfile(str(path))
    found = []
    while (message := log.recv_msg()) is not None:
        found.append((message.get_type(), message._timestamp))
    log.close()
    return found


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def setup_signing() -> bytes:
    return packed(dialect.MAVLink_setup_signing_message(1, 1, KEY, 0))


def check_closed(told: RawSegmentClosed, root: Path, ending: str = "") -> None:
    """What was recorded of a file is so."""
    data = Path(f"{root / told.name}{ending}").read_bytes()
    assert (told.sha256, told.size_bytes) == (hashlib.sha256(data).digest(), len(data))


def test_the_usual_tools_read_it(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    raw = desk.fly("000001-a")
    frames = [
        heartbeat(),
        attitude(5, 10),
        signed(position(7), KEY, 9),
        packed(dialect.MAVLink_statustext_message(4, b"hi")),
    ]
    for frame in frames:
        desk.note(frame)
        desk.now_ns += S
    assert desk.recorder.end(desk.now_ns)
    kinds = ["HEARTBEAT", "ATTITUDE", "GLOBAL_POSITION_INT", "STATUSTEXT"]
    found = read(raw / "0001.tlog")
    assert [kind for kind, _ in found] == kinds
    assert [at_s for _, at_s in found] == pytest.approx([AT_US / 1e6 + second for second in range(4)], abs=1e-3)
    (told,) = desk.log.of(RawSegmentClosed)
    assert (told.name, told.frames, told.found) == ("000001-a/raw/0001.tlog", 4, False)
    assert (told.first_us, told.last_us) == (AT_US, AT_US + 3_000_000)
    check_closed(told, desk.root)


def test_no_secret_and_no_signature_is_in_it(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    raw = desk.fly("000001-a")
    frame = signed(framed(444_444, b"who knows"), KEY, 0x123456789ABC)
    desk.note(setup_signing(), signed(setup_signing(), KEY, 9), frame, heartbeat()[:-1] + b"\x00")
    desk.recorder.end(0)
    data = (raw / "0001.tlog").read_bytes()
    assert data == AT_US.to_bytes(8, "big") + framed(444_444, b"who knows")


@pytest.mark.parametrize("settings", [{"raw_segment_s": 10.0}, {"raw_segment_mib": 1}])
def test_files_are_closed_at_their_age_and_at_their_size(tmp_path: Path, settings: dict[str, Any]) -> None:
    desk = Desk(tmp_path, **settings)
    raw = desk.fly("000001-a")
    big = framed(444_444, b"\x01" * 255)
    while len(desk.log.of(RawSegmentClosed)) < 2:
        desk.note(*[big] * 200)
        desk.wait(S)
    first, second = desk.log.of(RawSegmentClosed)
    lasted_us = first.last_us - first.first_us
    by_age = "raw_segment_s" in settings
    assert (lasted_us == 9_000_000) == by_age
    assert (MIB <= first.size_bytes < MIB + 300) != by_age
    assert [first.name, second.name] == ["000001-a/raw/0001.tlog", "000001-a/raw/0002.tlog"]
    check_closed(first, desk.root)
    assert names(raw)[0] == "0001.tlog"


def test_a_file_gets_its_name_when_its_digest_is_durable(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    raw = desk.fly("000001-a")
    desk.note(heartbeat())
    desk.log.refuses = True
    desk.fly("000002-b")
    desk.wait(10 * S)
    assert names(raw) == ["0001.tlog.open"]
    desk.log.refuses = False
    desk.wait(0)
    assert len(desk.log.of(RawSegmentClosed)) == 1
    assert names(raw) == ["0001.tlog.open"]
    desk.wait(SETTLE_NS - 1)
    assert names(raw) == ["0001.tlog.open"]
    desk.wait(1)
    assert names(raw) == ["0001.tlog"]


def test_another_flight_begins_files_of_its_own(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    desk.note(heartbeat())  # no flight is open yet
    for name in ("000001-a", "000002-b"):
        desk.fly(name)
        desk.note(heartbeat())
    desk.recorder.end(0)
    assert [one.name for one in desk.log.of(RawSegmentClosed)] == ["000001-a/raw/0001.tlog", "000002-b/raw/0001.tlog"]


def test_a_start_on_the_same_flight_goes_on_numbering(tmp_path: Path) -> None:
    for number in (1, 2, 3):
        desk = Desk(tmp_path)
        raw = desk.fly("000001-a")
        desk.note(heartbeat())
        desk.recorder.end(0)
        assert names(raw)[-1] == f"000{number}.tlog"


def test_what_a_process_left_open_is_closed_by_the_next_start(tmp_path: Path) -> None:
    """In whichever flight it lies: cut behind the last whole record, digested, told, named."""
    killed = Desk(tmp_path)
    raw = killed.fly("000001-a")
    killed.note(heartbeat(), attitude(5, 10))
    killed.wait(S)
    with (raw / "0001.tlog.open").open("ab") as file:
        file.write(record_of(AT_US, position(9))[:-1])  # type: ignore[index]
    again = Desk(tmp_path)
    again.fly("000002-b")
    again.wait(SETTLE_NS)
    (told,) = again.log.of(RawSegmentClosed)
    assert (told.name, told.frames, told.found) == ("000001-a/raw/0001.tlog", 2, True)
    assert (told.first_us, told.last_us) == (AT_US, AT_US)
    check_closed(told, again.root)
    assert [kind for kind, _ in read(raw / "0001.tlog")] == ["HEARTBEAT", "ATTITUDE"]


@pytest.mark.parametrize("left", [b"", bytes(4_096), b"\xff" * 9, record_of(1, heartbeat())[:9]])  # type: ignore[index]
def test_what_holds_nothing_whole_is_cut_to_nothing(tmp_path: Path, left: bytes) -> None:
    path = tmp_path / "f" / "raw" / "0001.tlog.open"
    path.parent.mkdir(parents=True)
    path.write_bytes(left)
    told = close_found(path)
    assert (told.frames, told.size_bytes, path.read_bytes()) == (0, 0, b"")
    assert told.sha256 == hashlib.sha256().digest()


def test_raw_stops_first_on_a_short_disk_says_so_and_goes_on(tmp_path: Path) -> None:
    desk = Desk(tmp_path, raw_min_free_mib=100)
    raw = desk.fly("000001-a")
    desk.note(heartbeat())
    desk.free_mib = 99
    desk.wait(LOOK_NS - 1)
    assert desk.recorder.stopped == ""
    desk.wait(1)
    assert desk.recorder.stopped == "less than 100 MiB free"
    desk.note(heartbeat())
    for desk.free_mib in (99, 98, 109):
        desk.wait(LOOK_NS)
        assert desk.recorder.stopped
    desk.free_mib = 110
    desk.wait(LOOK_NS)
    assert desk.recorder.stopped == ""
    desk.note(heartbeat())
    desk.recorder.end(desk.now_ns)
    assert desk.log.of(RawChanged) == [
        RawChanged(recording=False, because="less than 100 MiB free"),
        RawChanged(recording=True),
    ]
    assert [one.frames for one in desk.log.of(RawSegmentClosed)] == [1, 1]
    assert names(raw) == ["0001.tlog", "0002.tlog"]


def test_a_disk_that_fails_stops_raw_and_nothing_else(tmp_path: Path) -> None:
    """The folder can't be made here; later it can."""
    desk = Desk(tmp_path)
    raw = desk.fly("000001-a")
    raw.write_text("a file where the folder should be")
    desk.note(heartbeat(), heartbeat())
    assert "exists" in desk.recorder.stopped
    raw.unlink()
    desk.wait(LOOK_NS)
    assert desk.recorder.stopped
    desk.wait(6 * LOOK_NS)
    desk.note(heartbeat())
    desk.recorder.end(desk.now_ns)
    assert [one.recording for one in desk.log.of(RawChanged)] == [False, True]
    assert names(raw) == ["0001.tlog"]


def test_the_end_waits_for_the_log_as_long_as_it_says(tmp_path: Path) -> None:
    """What the log did not take is found by the next start."""
    desk = Desk(tmp_path)
    raw = desk.fly("000001-a")
    desk.note(heartbeat())
    desk.log.refuses = True
    assert not desk.recorder.end(0)
    assert not desk.recorder.end(LAST_NS)
    assert names(raw) == ["0001.tlog.open"]
    desk.log.refuses = False
    assert desk.recorder.end(LAST_NS)
    assert names(raw) == ["0001.tlog"]


@pytest.mark.whole
def test_a_thread_writes_what_it_is_given_and_ends(tmp_path: Path) -> None:
    log, counts = Log(), Counter[str]()
    raw = RawLog(VehicleSection(raw_min_free_mib=0), log.offer, HostClock(), counts)
    flight = tmp_path / "000001-a"
    flight.mkdir()
    raw.record_in(flight)
    raw.start()
    for number in range(100):
        raw.note(attitude(number, 10))
    raw.stop()
    assert [kind for kind, _ in read(flight / "raw" / "0001.tlog")] == ["ATTITUDE"] * 100
    assert (raw.stopped, counts) == ("", {})
    (told,) = log.of(RawSegmentClosed)
    assert told.frames == 100


def test_what_comes_faster_than_the_disk_takes_it_is_dropped_and_counted() -> None:
    counts = Counter[str]()
    raw = RawLog(VehicleSection(), Log().offer, HostClock(), counts)
    for _ in range(4_100):
        raw.note(heartbeat())
    assert counts == {"raw dropped": 4}
    raw.stop()
