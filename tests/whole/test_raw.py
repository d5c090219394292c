"""Raw files of a node that is killed and one that is stopped, as processes; the vehicle is a simulated one."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink import mavutil

from autopilot.ground import directory
from autopilot.trust.clock import HostClock, wall_ms
from events.schema.link_pb2 import RawSegmentClosed
from tests.autopilot.trust.world import seeded
from tests.whole.daemons import ended, log, started, wait_for, write_config
from tests.whole.relays import free_datagram_port

pytestmark = pytest.mark.whole


@pytest.fixture
def config(tmp_path: Path) -> Iterator[Path]:
    """A node's configuration, beside an aircraft that flies."""
    random, now_ms = seeded(1), wall_ms(HostClock())
    ours = directory.init(tmp_path / "d", deployment_id="test", now_ms=now_ms, random=random)
    directory.issue(ours, "n", tmp_path / "keys", kind="node", roles=(), callsign="", now_ms=now_ms, random=random)
    port = free_datagram_port()
    words = ["--mavlink-port", str(port), "--eyes-port", "0"]
    aircraft = subprocess.Popen(
        [sys.executable, "-m", "autopilot.sim.process", *words], stdout=subprocess.PIPE, text=True
    )
    assert aircraft.stdout is not None
    assert aircraft.stdout.readline() == "ready\n"
    try:
        yield write_config(
            tmp_path, tmp_path / "keys", vehicle={"connect": f"udp://127.0.0.1:{port}", "raw_min_free_mib": 0}
        )
    finally:
        aircraft.kill()
        aircraft.communicate()


def closed(folder: Path) -> list[RawSegmentClosed]:
    """Return what the log says of raw files."""
    return [record.message for record in log(folder) if isinstance(record.message, RawSegmentClosed)]


def kinds(folder: Path) -> set[str]:
    """Return which kinds the log holds."""
    return {record.kind.name for record in log(folder)}


def check_file(folder: Path, told: RawSegmentClosed) -> None:
    """The file is as it was recorded, and another tool reads both directions in it."""
    path = folder / "flights" / told.name
    data = path.read_bytes()
    assert (hashlib.sha256(data).digest(), len(data)) == (told.sha256, told.size_bytes)
    read = mavutil.mavlogfile(str(path))
    senders: list[tuple[int, int]] = []
    while (message := read.recv_msg()) is not None:
        assert message.get_type() != "BAD_DATA"
        senders.append((message.get_srcSystem(), message.get_srcComponent()))
    read.close()
    assert len(senders) == told.frames
    assert set(senders) == {(1, 1), (1, 191)}


def test_what_went_over_the_link_is_in_files_whose_digests_are_in_the_log(config: Path) -> None:
    """Also of the file that a process left open when it was killed."""
    folder = config.parent
    child = started(config)
    wait_for(lambda: "vehicle_identified" in kinds(folder), "what the autopilot is")
    wait_for(lambda: any(path.stat().st_size > 1_000 for path in folder.glob("flights/*/raw/*")), "a raw file")
    child.kill()
    child.communicate()
    assert [path.suffixes for path in folder.glob("flights/*/raw/*")] == [[".tlog", ".open"]]

    child = started(config)
    wait_for(lambda: [one.found for one in closed(folder)] == [True], "the file of the process that was killed")
    wait_for(lambda: len(list(folder.glob("flights/*/raw/*.open"))) == 1, "a file of its own")
    wait_for(lambda: "position_reported" in kinds(folder), "a position")
    code, words = ended(child)
    assert code == 0, words
    told = closed(folder)
    assert [(one.name.partition("/")[2], one.found) for one in told] == [
        ("raw/0001.tlog", True),
        ("raw/0002.tlog", False),
    ]
    for one in told:
        check_file(folder, one)
    assert sorted(path.name for path in folder.glob("flights/*/raw/*")) == ["0001.tlog", "0002.tlog"]
