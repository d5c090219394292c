"""A real video and a real detector through the whole daemon, with an operator who answers what is asked.

300 frames, as fast as the machine goes. Whoever is asked must be able to answer in time on any machine: so the
process that looks is held (SIGSTOP) from the moment a question is seen until its answer is in.
"""

from __future__ import annotations

import math
import os
import signal
import socket
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import psutil
import pytest

from autopilot.cli.demonstration.cast import NODE, make_cast
from autopilot.cli.demonstration.stage import Process
from autopilot.ground import compose
from autopilot.ground.issuer import Issuer
from events import Record
from events.schema.eyes_pb2 import FrameObserved
from events.schema.findings_pb2 import ItemIgnored, PoiOpened
from events.schema.flight_pb2 import CLOSE_INPUT_ENDED
from events.schema.waypoint_pb2 import PoiStatus
from events.store import flights_in, read_flight
from replay.verify import verify
from statecharts import State, restore, steps_of
from tests.whole import daemons

DATA = os.environ.get("AUTOPILOT_TEST_DATA", "")
FRAMES = 300
CLOTH_PX = (348, 468)
WIDTH_PX, HEIGHT_PX = 768, 576
BALL, PERSON = "ball", "person"
SAME_POI_M = 15

pytestmark = [
    pytest.mark.whole,
    pytest.mark.skipif(not DATA, reason="AUTOPILOT_TEST_DATA does not name the folder with vtest.avi and the model"),
]

# The example's camera (examples/video.toml): people come out as tall as they are, 10 to 40 m away.
POSE = {"latitude_deg": 47.3977, "longitude_deg": 8.5456, "altitude_m": 414, "height_m": 6, "yaw_deg": 0}


@dataclass(frozen=True, slots=True)
class Watched:
    """What came of the video."""

    folder: Path
    code: int
    words: str
    confirmed: str
    declined: str


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watched]:
    """Run the daemon on the video once."""
    folder = tmp_path_factory.mktemp("video")
    with socket.create_server(("127.0.0.1", 0)) as free:
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    router = Process(
        "router",
        [sys.executable, "-m", "autopilot.sim.router", "--listen", endpoint],
        folder / "router.log",
        ready="ready",
    )
    cast = make_cast(folder)
    config = daemons.write_config(
        folder / "node",
        folder / "node" / "keys",
        command={"enabled": True, "camera_roles": ["operator"]},
        mesh={"connect": [endpoint], "reconnect_ms": 100, "status_period_s": 0.1},
        eyes={
            "source": "file",
            "path": f"{DATA}/vtest.avi",
            "model": f"{DATA}/nanodet_g_416.onnx",
            "pace": "fast",
            "at_end": "stop",
            "frames": FRAMES,
            "field_of_view_deg": 55,
            "range_max_m": 150,
            "silence_s": 120,
            "pose": POSE | {"pitch_deg": -24},
        },
        flight={"origin": [47.3977, 8.5456, 408]},
        # Many questions a minute: the cloth must not wait behind people for longer than the video takes.
        find={
            "same_object_m": 4,
            "same_poi_m": SAME_POI_M,
            "asks_per_minute": 60,
            "groups": {PERSON: ["person"], "vehicle": ["car", "truck"], BALL: ["sports ball"]},
        },
    )
    router.start()
    try:
        with Issuer(cast.first, [endpoint], reconnect_ms=100) as issuer:
            issuer.watch(NODE)
            daemons.wait_for(issuer.linked, "the operator's link")
            node = daemons.started(config)
            confirmed = _answer(issuer, node, "person", confirmed=True)
            declined = _answer(issuer, node, "sports ball", confirmed=False)
            _, words = node.communicate(timeout=120)
            yield Watched(folder / "node", node.returncode, words, confirmed, declined)
    finally:
        router.stop()


def _answer(issuer: Issuer, node: subprocess.Popen[str], class_name: str, *, confirmed: bool) -> str:
    """Judge the first question about a class; nothing more is looked at until the answer is in."""

    def question() -> PoiStatus | None:
        seen = issuer.status(NODE)
        return next((poi for poi in seen.status.pois if poi.class_name == class_name), None) if seen else None

    if issuer.wait_status(NODE, lambda status: any(poi.class_name == class_name for poi in status.pois), 60) is None:
        raise TimeoutError(f"nobody was asked about a {class_name}")
    looking = [
        child for child in psutil.Process(node.pid).children() if "autopilot.adapters.eyes.child" in child.cmdline()
    ]
    for child in looking:
        child.send_signal(signal.SIGSTOP)
    try:
        poi = question()
        assert poi is not None
        answer = issuer.wait(issuer.send(NODE, compose.judge(poi.poi_id, confirmed=confirmed)))
        assert answer.result == "accepted", answer
        return poi.poi_id
    finally:
        for child in looking:
            child.send_signal(signal.SIGCONT)


@pytest.fixture(scope="module")
def log(watched: Watched) -> list[Record]:
    """Return the flight's records."""
    assert watched.code == 0, watched.words
    return daemons.log(watched.folder)


@pytest.fixture(scope="module")
def state(log: list[Record]) -> State:
    """Return the state at the flight's end."""
    state = State()
    for step in steps_of(log):
        restore(state, step)
    return state


def frames(log: list[Record]) -> list[FrameObserved]:
    """Return the frames that were observed."""
    return [record.message for record in log if isinstance(record.message, FrameObserved)]


def test_every_frame_was_looked_at_and_the_flight_ended_with_them(log: list[Record]) -> None:
    """`fast` waits for the node instead of dropping; the end of the input is the reason of the end."""
    assert [frame.frame_seq for frame in frames(log)] == list(range(FRAMES))
    assert "inputs_dropped" not in {record.kind.name for record in log}
    ends = [record.message for record in log if record.kind.name == "flight_closed"]
    assert [end.reason for end in ends] == [CLOSE_INPUT_ENDED]  # type: ignore[attr-defined]


def test_real_people_are_found_and_few_questions_are_asked(log: list[Record], state: State) -> None:
    """At most one point of interest to ten detections of a person."""
    people = sum(one.class_name == "person" for frame in frames(log) for one in frame.detections)
    asked = [record.message for record in log if isinstance(record.message, PoiOpened)]
    about = Counter(poi.class_group for poi in asked)
    assert people > FRAMES
    assert 1 <= about[PERSON] <= people / 10
    assert sum(thing.class_group == PERSON for thing in state.objects.values()) >= 3


def test_the_operators_word_stands(watched: Watched, state: State) -> None:
    """One confirmed, one declined, nothing else decided by anybody."""
    decided = {poi_id: poi.state for poi_id, poi in state.pois.items() if poi.state in ("confirmed", "declined")}
    assert decided == {watched.confirmed: "confirmed", watched.declined: "declined"}


def test_the_declined_cloth_stays_quiet(watched: Watched, log: list[Record], state: State) -> None:
    """What it takes for a ball is the yellow cloth; after the decline it is seen, counted, and never asked about."""
    opened = {record.seq: record.message for record in log if isinstance(record.message, PoiOpened)}
    (declined,) = [one for one in opened.values() if state.pois[watched.declined].opened_ns and one.class_group == BALL]
    frame = next(one for one in frames(log) if one.frame_seq == declined.frame_seq)
    centres = [
        ((one.x_min_e4 + one.x_max_e4) / 2e4 * WIDTH_PX, (one.y_min_e4 + one.y_max_e4) / 2e4 * HEIGHT_PX)
        for one in frame.detections
        if one.class_name == "sports ball"
    ]
    assert min(math.dist(centre, CLOTH_PX) for centre in centres) < 25
    decline = next(record.seq for record in log if isinstance(record.message, ItemIgnored))
    assert [seq for seq in opened if seq > decline and opened[seq].class_group == BALL] == []
    assert state.ignored[watched.declined].muted > 10


def test_the_log_replays_identically(watched: Watched, log: list[Record]) -> None:
    """Every decision, byte for byte."""
    (flight,) = flights_in(watched.folder / "flights")
    reader = read_flight(flight.folder)
    try:
        verdict = verify(reader)
    finally:
        reader.close()
    assert verdict.words().startswith("identical")
    assert verdict.records == len(log)
