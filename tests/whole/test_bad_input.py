"""Bad input against a running daemon: it is counted by name and the daemon goes on, or it says what is wrong and ends.

Exit codes are those of sysexits: 69 unavailable, 74 I/O, 77 not permitted, 78 configuration.
"""

from __future__ import annotations

import math
import os
import random
import resource
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import apsw
import pytest
from pymavlink.dialects.v20 import common as dialect

from autopilot.cli.demonstration.cast import NODE, make_cast
from autopilot.cli.demonstration.stage import Stage
from autopilot.ground import compose
from autopilot.ground.issuer import Issuer
from autopilot.trust.limits import ENVELOPE_BYTES_MAX
from autopilot.wire.keys import order_key
from events import Chain, Moment
from events.schema.eyes_pb2 import EyesChanged
from events.schema.flight_pb2 import CLOSE_INPUT_ENDED, CLOSE_STOPPED, FlightClosed, LogDamaged, SamplesRejected
from events.store import flights_in
from tests.autopilot.eyes.tiny import CLASSES, model_file, video_file
from tests.torture.middle import Middle
from tests.whole import daemons

pytestmark = pytest.mark.whole

COMMAND_ID = "0b7c5e2a-6f0e-4d3a-9a51-3f1f5a0c9d11"
ORDER_LIFE_S = 10.0
GARBAGE = random.Random(1).randbytes(300)


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a node's keys."""
    folder = tmp_path_factory.mktemp("cast")
    make_cast(folder)
    return folder / "node" / "keys"


# --- on the wires of a running daemon --------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Flying:
    """A node in the air, a man in the middle of its MAVLink link, an operator and a forger."""

    stage: Stage
    middle: Middle
    operator: Issuer
    forger: Issuer


@pytest.fixture(scope="module")
def flying(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Flying]:
    """Fly while the tests of this module look for trouble; afterwards the daemon must still end well."""
    stage = Stage(tmp_path_factory.mktemp("flying"), 300, 3)
    middle = Middle(stage.ports.mavlink)
    aircraft, between = f"127.0.0.1:{stage.ports.mavlink}", f"127.0.0.1:{middle.port}"
    stage.config.write_text(stage.config.read_text().replace(aircraft, between))
    middle.start()
    people = [Issuer(who, [stage.endpoint], reconnect_ms=100) for who in (stage.cast.first, stage.cast.forger)]
    try:
        with stage, people[0], people[1]:
            if people[0].wait_status(NODE, lambda status: status.HasField("latitude_e7"), 30) is None:
                raise TimeoutError("the node did not come up")
            yield Flying(stage, middle, *people)
            assert stage.node.stop() == 0
    finally:
        middle.stop()


def check_alive(flying: Flying) -> None:
    """Check that the node still does what it is told."""
    order = flying.operator.send(NODE, compose.point_at_angles(-30, 10), ORDER_LIFE_S)
    assert flying.operator.wait(order).result == "accepted"


def check_counted(flying: Flying, reason: str) -> None:
    """Check that the node says that it dropped something for this reason, and then still takes orders."""

    def counted(status: Any) -> bool:
        return any(each.reason == reason and each.count > 0 for each in status.dropped)

    assert flying.operator.wait_status(NODE, counted, 10) is not None
    check_alive(flying)


def test_garbage_is_counted(flying: Flying) -> None:
    """No envelope at all."""
    flying.operator.publish_raw(order_key(NODE, COMMAND_ID), GARBAGE)
    check_counted(flying, "parse_env")


def test_an_oversized_sample_is_counted(flying: Flying) -> None:
    """Refused by its length, unread."""
    flying.operator.publish_raw(order_key(NODE, COMMAND_ID), bytes(ENVELOPE_BYTES_MAX + 1))
    flying.operator.publish_raw(order_key(NODE, COMMAND_ID), bytes(500_000))
    check_counted(flying, "size")


def test_a_wrong_key_is_counted(flying: Flying) -> None:
    """Well made, by somebody whom another Directory calls k-1."""
    flying.forger.know_node(NODE, flying.operator.send(NODE, compose.release(), ORDER_LIFE_S).node_key)
    flying.forger.send(NODE, compose.point_at_angles(-90, 0), 1)
    check_counted(flying, "token_sig")


def test_mavlink_garbage_and_nan_change_nothing(flying: Flying) -> None:
    """From the vehicle's own address: noise, a cut message, one with NaN. Rejected by name, and recorded as counts."""
    link = dialect.MAVLink(None, 1, 1)
    nan = dialect.MAVLink_attitude_message(1, math.nan, 0, 0, 0, 0, 0).pack(link)
    attitude = dialect.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 0).pack(link)
    for datagram in (GARBAGE[:200], b"\x00" * 50, bytes(nan), bytes(attitude)[:-4], b"\xfd"):
        flying.middle.say(datagram)
    check_alive(flying)


def test_what_was_rejected_is_in_the_log(flying: Flying) -> None:
    """Gate and vehicle, each reason with its count; everything is said here again, so the test stands alone."""
    for bad_input in (
        test_garbage_is_counted,
        test_an_oversized_sample_is_counted,
        test_a_wrong_key_is_counted,
        test_mavlink_garbage_and_nan_change_nothing,
    ):
        bad_input(flying)

    def told() -> set[str]:
        log = daemons.log(flying.stage.folder / "node")
        messages = [record.message for record in log if isinstance(record.message, SamplesRejected)]
        return {each.reason for message in messages for each in message.rejected}

    expected = {"parse_env", "size", "token_sig", "vehicle: garbage", "vehicle: truncated", "vehicle: not finite"}
    daemons.wait_for(lambda: expected <= told(), "a record of what was rejected")


# --- a configuration, keys, files that can't be used -----------------------------------------------------------------


def eyes(folder: Path, **changes: Any) -> dict[str, Any]:
    """Return eyes that look at a small video with a network of a few bytes."""
    pose = {"latitude_deg": 47.0, "longitude_deg": 8.0, "height_m": 6.0, "pitch_deg": -30.0}
    given = {"source": "file", "path": str(video_file(folder)), "pace": "fast", "at_end": "stop", "pose": pose}
    return given | {"model": str(model_file(folder)), "classes": list(CLASSES)} | changes


def check_refused(config: Path, code: int, *words: str) -> None:
    """Check that the daemon does not run, with this exit code and these words."""
    run = daemons.run(config)
    assert run.returncode == code, run.stderr
    assert [word for word in words if word not in run.stderr] == [], run.stderr
    assert "Traceback" not in run.stderr


def test_a_typo_is_named_with_its_line(tmp_path: Path, keys: Path) -> None:
    """And what was probably meant."""
    config = daemons.write_config(tmp_path, keys, command={"enabld": True})
    line = config.read_text().splitlines().index('"enabld" = true') + 1
    check_refused(config, os.EX_CONFIG, f"config.toml:{line}: command.enabld", "enabled")
    assert flights_in(tmp_path / "flights") == []


def test_a_model_of_the_wrong_shape_is_refused(tmp_path: Path, keys: Path) -> None:
    """A network that takes four channels: the key is named, and the flight that never saw anything is closed."""
    config = daemons.write_config(tmp_path, keys, eyes=eyes(tmp_path, at_end="go_on"))
    model_file(tmp_path, (1, 4, 32, 32))
    check_refused(config, os.EX_CONFIG, "[eyes] model")
    ends = [record.message for record in daemons.log(tmp_path) if isinstance(record.message, FlightClosed)]
    assert [end.reason for end in ends] == [CLOSE_STOPPED]


def test_keys_that_others_may_read_are_refused(tmp_path: Path, keys: Path) -> None:
    """77, and the file is named."""
    shutil.copytree(keys, tmp_path / "keys")
    (tmp_path / "keys" / "device.sign").chmod(0o644)
    check_refused(daemons.write_config(tmp_path, tmp_path / "keys"), os.EX_NOPERM, "device.sign")


def test_a_second_daemon_is_refused(tmp_path: Path, keys: Path) -> None:
    """Two writers of one log would be two histories."""
    config = daemons.write_config(tmp_path, keys)
    first = daemons.started(config)
    check_refused(config, os.EX_UNAVAILABLE, "another autopilot records")
    code, words = daemons.ended(first)
    assert (code, words) == (0, "")


def test_a_video_that_ends_is_no_end(tmp_path: Path, keys: Path) -> None:
    """at_end = go_on: it is said that the input ended, and the node goes on until it is asked to stop."""
    config = daemons.write_config(tmp_path, keys, eyes=eyes(tmp_path, at_end="go_on"))
    child = daemons.started(config)

    def states() -> list[str]:
        return [record.message.state for record in daemons.log(tmp_path) if isinstance(record.message, EyesChanged)]

    daemons.wait_for(lambda: "ended" in states(), "the end of the video")
    assert child.poll() is None
    code, _ = daemons.ended(child)
    ends = [record.message for record in daemons.log(tmp_path) if isinstance(record.message, FlightClosed)]
    assert (code, [end.reason for end in ends]) == (0, [CLOSE_STOPPED])


def test_a_video_that_ends_may_be_the_end(tmp_path: Path, keys: Path) -> None:
    """at_end = stop: the flight is closed because the input ended."""
    run = daemons.run(daemons.write_config(tmp_path, keys, eyes=eyes(tmp_path)))
    ends = [record.message for record in daemons.log(tmp_path) if isinstance(record.message, FlightClosed)]
    assert (run.returncode, [end.reason for end in ends]) == (0, [CLOSE_INPUT_ENDED])


def recorded(tmp_path: Path, keys: Path) -> tuple[Path, Path]:
    """Record a short flight; return configuration and log."""
    config = daemons.write_config(tmp_path, keys)
    assert daemons.ended(daemons.started(config))[0] == 0
    return config, flights_in(tmp_path / "flights")[-1].database


@pytest.mark.parametrize("what", ["cut", "foreign"])
def test_a_log_that_is_none_is_kept(tmp_path: Path, keys: Path, what: str) -> None:
    """Cut in the middle, or another file under its name: it stays as it is, and the next flight says so."""
    config, log = recorded(tmp_path, keys)
    for beside in log.parent.glob("flight.db-*"):
        beside.unlink()
    broken = {"cut": log.read_bytes()[:5000], "foreign": b"These are my notes." * 300}[what]
    log.write_bytes(broken)
    assert daemons.ended(daemons.started(config))[0] == 0
    assert log.read_bytes() == broken
    (told,) = [record.message for record in daemons.log(tmp_path) if isinstance(record.message, LogDamaged)]
    assert (told.folder, len(flights_in(tmp_path / "flights"))) == (log.parent.name, 2)


def test_a_log_of_a_newer_version_is_left_alone(tmp_path: Path, keys: Path) -> None:
    """A kind of record that this software does not know: said in one line, and nothing is added to it."""
    config, log = recorded(tmp_path, keys)
    connection = apsw.Connection(str(log))
    rows: Any = connection.execute("SELECT name, value FROM meta").fetchall()
    meta = dict(rows)
    last: Any = connection.execute("SELECT seq, leaf FROM record ORDER BY seq DESC LIMIT 1").fetchone()
    seq, leaf = last
    newer = (seq + 1, -1, *Moment(1 << 40, 0, 1, 0, 2), 60_000, 1, b"newer")
    sealed = Chain(meta["flight_id"], meta["secret"], leaf).extend(
        seq + 1, -1, Moment(1 << 40, 0, 1, 0, 2), 60_000, 1, b"newer"
    )
    connection.execute(f"INSERT INTO record VALUES ({', '.join('?' * 11)})", (*newer, sealed))
    connection.close()
    check_refused(config, os.EX_DATAERR, "no event kind has number 60000")
    assert len(flights_in(tmp_path / "flights")) == 1


def test_a_full_disk_ends_the_daemon(tmp_path: Path, keys: Path) -> None:
    """A write that fails ends it at once; what was durable before is there at the next start."""
    config = daemons.write_config(tmp_path, keys, eyes=eyes(tmp_path, at_end="loop", frames=20_000))
    limit = 200_000  # bytes a file may have; the log's WAL is there after some hundred frames
    run = daemons.run(config, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))
    assert run.returncode == os.EX_IOERR, run.stderr
    assert "the log failed, nothing more is recorded" in run.stderr
    before = daemons.log(tmp_path)
    assert len(before) > 50
    again = daemons.write_config(tmp_path, keys)
    assert daemons.ended(daemons.started(again))[0] == 0
    assert daemons.log(tmp_path)[: len(before)] == before
