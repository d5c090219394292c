"""The real child process with a tiny network and video: what it sends, how it fails, how it is kept going."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from google.protobuf.message import Message

from autopilot.adapters.eyes import Eyes
from autopilot.adapters.eyes.framing import LENGTH
from autopilot.adapters.eyes.sources import CHILD, Child
from autopilot.geo import Origin
from autopilot.ports.config import EyesSection
from autopilot.ports.edges import InputClass
from autopilot.wire.detections_pb2 import DetectionBatch
from events.schema.eyes_pb2 import EyesChanged, FrameObserved
from tests.autopilot.eyes.tiny import CLASSES, Inbox, Watch, batch, model_file, stream, video_file

pytestmark = pytest.mark.whole

TIMEOUT_S = 60


def section(folder: Path, **settings: object) -> EyesSection:
    """Return settings for the tiny video and network."""
    base = {"source": "file", "path": str(folder / "tiny.avi"), "model": str(folder / "tiny.onnx")}
    return EyesSection.model_validate({**base, "classes": CLASSES, "pace": "fast", **settings})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with a video of six frames and a network."""
    video_file(tmp_path)
    model_file(tmp_path)
    return tmp_path


def run_child(settings: EyesSection) -> tuple[int, list[DetectionBatch], str]:
    """Run the child to its end; return its code, its batches and its words."""
    told = json.dumps({**settings.model_dump(mode="json"), "camera": 3}) + "\n"
    done = subprocess.run(CHILD, input=told.encode(), capture_output=True, timeout=TIMEOUT_S, check=False)
    batches, rest = [], done.stdout
    while rest:
        (length,) = LENGTH.unpack(rest[:4])
        batches.append(DetectionBatch.FromString(rest[4 : 4 + length]))
        rest = rest[4 + length :]
    return done.returncode, batches, done.stderr.decode()


def check_fails(settings: EyesSection, code: int, words: str) -> None:
    """Say that the child ends with this code and one line that begins with these words."""
    ended, batches, said = run_child(settings)
    assert (ended, batches) == (code, [])
    assert said.startswith(words)
    assert said.count("\n") == 1


def test_a_whole_file(folder: Path) -> None:
    """A batch a frame, then the end; the boxes in 1e-4 of the image, what has no extent left out."""
    code, batches, said = run_child(section(folder, frames=3, field_of_view_deg=70.5))
    assert (code, said) == (0, "")
    assert [(one.camera, one.frame_seq, one.ended_because) for one in batches] == [
        (3, 0, ""),
        (3, 1, ""),
        (3, 2, ""),
        (3, 3, "frame limit"),
    ]
    first, second = batches[:2]
    assert second.captured_ns - first.captured_ns == 100_000_000
    assert (first.width_px, first.height_px, first.field_of_view_cdeg, first.model) == (64, 48, 7050, "tiny.onnx")
    (box,) = first.detections  # cell 5 of the finest grid, one stride to each side; the other two are points
    assert (box.class_name, box.confidence_e4) == ("person", 6000)
    assert (box.x_min_e4, box.y_min_e4, box.x_max_e4, box.y_max_e4) == (1250, 1250, 6250, 6250)


def test_the_end_of_the_file_is_said(folder: Path) -> None:
    """Without a limit the file ends by itself."""
    _, batches, _ = run_child(section(folder))
    assert (len(batches), batches[-1].ended_because, batches[-1].frame_seq) == (7, "end of file", 6)


def test_what_can_never_work(folder: Path) -> None:
    """One line that names the key, and code 78."""
    check_fails(section(folder, model=str(folder / "no.onnx")), 78, "[eyes] model: no file ")
    check_fails(section(folder, classes=("a", "b", "c")), 78, "[eyes] model: outputs are ")
    check_fails(section(folder, path=str(folder / "no.avi")), 78, "[eyes] path: no file ")
    check_fails(section(folder, path=str(folder / "tiny.onnx")), 78, "[eyes] path: ")
    check_fails(section(folder, source="device", device=97), 69, "[eyes] device: camera 97 ")


def test_nobody_reads_on(folder: Path) -> None:
    """Where the node is gone the child goes too, without a word."""
    told = json.dumps({**section(folder, at_end="loop").model_dump(mode="json"), "camera": 1}) + "\n"
    pipe = subprocess.PIPE
    with subprocess.Popen(CHILD, stdin=pipe, stdout=pipe, stderr=pipe) as child:
        assert child.stdin is not None
        assert child.stdout is not None
        assert child.stderr is not None
        child.stdin.write(told.encode())
        child.stdin.close()
        assert len(child.stdout.read(4)) == 4
        child.stdout.close()
        assert child.wait(TIMEOUT_S) == 0
        assert child.stderr.read() == b""


def run_eyes(
    settings: EyesSection, act: Callable[[Eyes, int], None] | None = None, until: int = 0, source: Child | None = None
) -> tuple[Eyes, list[Message]]:
    """Run eyes to their end, or until `until` observations have come; `act` is called after each with their number."""
    inbox, enough = Inbox(), asyncio.Event()

    async def run() -> Eyes:
        def offer(input_class: InputClass, observation: Message) -> bool:
            taken = inbox(input_class, observation)
            if act is not None:
                act(eyes, len(inbox.taken))
            if len(inbox.taken) == until:
                enough.set()
            return taken

        eyes = Eyes(settings, offer, Watch(), Origin(), None, groups={"all": CLASSES}, source=source)
        await eyes.start()
        waiting = enough if until else eyes.ended
        await asyncio.wait_for(waiting.wait(), TIMEOUT_S)
        await eyes.stop()
        return eyes

    return asyncio.run(run()), [observation for _, observation in inbox.taken]


def test_from_file_to_observations(folder: Path) -> None:
    """Every frame of a fast file arrives, in order, between running and ended."""
    eyes, seen = run_eyes(section(folder))
    assert (eyes.rejected, eyes.refusal) == ({}, None)
    changes = [(one.state, one.because, one.model) for one in seen if isinstance(one, EyesChanged)]
    assert changes == [("running", "", "tiny.onnx"), ("ended", "end of file", "")]
    assert [one.frame_seq for one in seen if isinstance(one, FrameObserved)] == list(range(6))


def test_a_refusal_reaches_the_node(folder: Path) -> None:
    """The child's line is the reason, in the record and for whoever asks."""
    eyes, seen = run_eyes(section(folder, model=str(folder / "no.onnx")))
    (change,) = seen
    assert isinstance(change, EyesChanged)
    assert change.because == eyes.refusal == f"[eyes] model: no file {folder}/no.onnx; give the path of an ONNX file"


def test_a_killed_child_is_started_again(folder: Path) -> None:
    """The kernel takes the child away: lost, with its signal; then running again from a new one."""
    source = Child(section(folder, at_end="loop"), 1)

    def kill(_eyes: Eyes, offered: int) -> None:
        if offered == 3:
            assert source.pid is not None
            os.kill(source.pid, signal.SIGKILL)

    settings = section(folder, at_end="loop", retry_first_s=0.01)
    # Two pipes of 64 KiB may hold more than a thousand batches of a child that is gone already.
    _, seen = run_eyes(settings, kill, until=5000, source=source)
    changes = [(one.state, one.because) for one in seen if isinstance(one, EyesChanged)]
    assert changes == [("running", ""), ("lost", "the detector's process ended with code -9"), ("running", "")]


def test_an_external_detector(folder: Path) -> None:
    """Over TCP, twice: after garbage the connection is dropped and made again."""

    async def run() -> tuple[Eyes, Inbox]:
        inbox = Inbox()
        answers = [b"GET / HTTP/1.1\r\n\r\n", stream(batch(), batch(ended_because="landed"))]

        async def serve(_reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            writer.write(answers.pop(0) if answers else b"")
            writer.close()

        server = await asyncio.start_server(serve, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        settings = EyesSection(source="external", endpoint=f"127.0.0.1:{port}", retry_first_s=0.01)
        eyes = Eyes(settings, inbox, Watch(), Origin(), None, groups={})
        await eyes.start()
        await asyncio.wait_for(eyes.ended.wait(), TIMEOUT_S)
        await eyes.stop()
        server.close()
        await server.wait_closed()
        return eyes, inbox

    eyes, inbox = asyncio.run(run())
    assert eyes.rejected == {"oversized": 1}
    states = [one.state for _, one in inbox.taken if isinstance(one, EyesChanged)]
    assert states == ["lost", "running", "ended"]


def test_a_child_that_does_not_hear_is_killed(folder: Path) -> None:
    """Stopping ends a child that ignores SIGTERM."""
    deaf = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('x', flush=True); signal.pause()"

    async def run() -> int | None:
        source = Child(section(folder), 1, (sys.executable, "-c", deaf), patience_s=0.05)
        reader = await source.open()
        await asyncio.wait_for(reader.readline(), TIMEOUT_S)
        pid = source.pid
        await source.close()
        return pid

    pid = asyncio.run(run())
    assert pid is not None
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
