"""The node's side, with a source and a clock that the test holds: states, retries, rejections, backpressure."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest
from google.protobuf.message import Message

from autopilot.adapters.eyes import Eyes, model_sha256
from autopilot.adapters.eyes.sources import Lost, Refused
from autopilot.geo import Origin
from autopilot.ports.config import EyesSection
from autopilot.ports.edges import InputClass
from autopilot.wire.detections_pb2 import DetectionBatch
from events.schema.eyes_pb2 import EyesChanged, FrameObserved
from tests.autopilot.eyes.tiny import Inbox, Script, Watch, batch, stream

FILE = {"source": "file", "path": "v", "model": "m"}
EXTERNAL = {"source": "external", "endpoint": "127.0.0.1:1"}
FAST = {**FILE, "pace": "fast"}
END = batch(ended_because="end of file", width_px=0)


def said(inbox: Inbox) -> list[str]:
    """Return what was offered, in words."""
    words = []
    for input_class, observation in inbox.taken:
        match observation:
            case EyesChanged():
                assert input_class is InputClass.OUTCOME
                words.append(" ".join(filter(None, (observation.state, observation.because, observation.model))))
            case FrameObserved():
                assert input_class is InputClass.FRAME
                words.append(f"frame {observation.frame_seq}")
    return words


def check_eyes(
    source: Script,
    expected: list[str],
    *,
    settings: dict[str, str] | None = None,
    sleeps: int = 0,
    inbox: Inbox | None = None,
    room: Callable[[], bool] = lambda: True,
    watch: Watch | None = None,
) -> tuple[Eyes, list[float]]:
    """Run until the source has ended or the eyes have slept `sleeps` times; say what was offered."""
    inbox = inbox or Inbox()
    slept: list[float] = []
    enough = asyncio.Event()

    async def sleep(seconds: float) -> None:
        slept.append(seconds)
        if len(slept) == sleeps:
            enough.set()
            await asyncio.Event().wait()

    async def run() -> Eyes:
        section = EyesSection.model_validate({"empty_frame_period_s": 0, **(settings or FILE), "silence_s": 0.01})
        eyes = Eyes(
            section,
            inbox,
            watch or Watch(),
            Origin(),
            None,
            groups={"person": ("person",)},
            room=room,
            source=source,
            sleep=sleep,
        )
        await eyes.start()
        waiting = enough if sleeps else eyes.ended
        await asyncio.wait_for(waiting.wait(), 5)
        await eyes.stop()
        return eyes

    eyes = asyncio.run(run())
    assert said(inbox) == expected
    assert source.opened == source.closed
    return eyes, slept


def test_a_file_from_its_beginning_to_its_end() -> None:
    """Running, its frames, ended; and no new try."""
    source = Script(stream(batch(), batch(frame_seq=1), END))
    eyes, slept = check_eyes(source, ["running m", "frame 0", "frame 1", "ended end of file"])
    assert (eyes.refusal, eyes.rejected, slept, source.opened) == (None, {}, [], 1)


def test_a_crash_is_said_once_and_tried_again() -> None:
    """Lost with the reason; running again with the next batch; the wait doubles up to its longest."""
    crash = stream(batch())
    source = Script(crash, None, None, None, None, None, None, stream(batch(frame_seq=9), END))
    _, slept = check_eyes(
        source,
        ["running m", "frame 0", "lost gone", "lost not there", "running m", "frame 9", "ended end of file"],
    )
    assert slept == [0.5, 1, 2, 4, 8, 10, 10]


def test_a_long_run_earns_a_short_wait() -> None:
    """Only what ran longer than the longest wait begins anew at the shortest."""
    watch = Watch()

    class Running(Script):
        async def why(self) -> Lost:
            watch.at_ns += 11_000_000_000 * (self.opened == 3)
            return Lost("gone")

    crash = stream(batch())
    expected = ["running m", "frame 0", "lost gone"] * 4
    _, slept = check_eyes(Running(crash, crash, crash, crash), expected, sleeps=4, watch=watch)
    assert slept == [0.5, 1, 0.5, 1]


def test_what_can_never_work_is_not_tried_again() -> None:
    """The refusal names the key, and whoever waits for the end need not wait for ever."""
    source = Script(b"", reason=Refused("[eyes] model: no file x"))
    eyes, slept = check_eyes(source, ["lost [eyes] model: no file x"])
    assert eyes.refusal == "[eyes] model: no file x"
    assert (slept, source.opened) == ([], 1)


@pytest.mark.parametrize(
    ("sent", "reason"),
    [
        (b"\xff\xff\xff\xff garbage", "oversized"),
        (b"\x00\x04\x00\x01", "oversized"),  # one byte more than the limit
        (b"\x00\x00\x00\x04\xff\xff\xff\xff", "garbage"),
        (b"\x00\x00\x00\x00", "unknown_camera"),
        (stream(batch(("dog", 1, -5, 0, 1, 1))), "box_outside_image"),
        (stream(batch(("dog", 10_001, 0, 0, 1, 1))), "bad_confidence"),
    ],
)
def test_what_cannot_be_used_is_counted_and_the_source_opened_again(sent: bytes, reason: str) -> None:
    """The name in `rejected`, the words in the record; the next source is heard as if nothing had been."""
    expected = [f"lost the detector sent what cannot be used: {reason.replace('_', ' ')}"]
    expected += ["running m", "frame 0", "ended end of file"]
    eyes, _ = check_eyes(Script(sent, stream(batch(), END)), expected)
    assert eyes.rejected == {reason: 1}


@pytest.mark.parametrize("sent", [stream(batch())[:-3], b"\x00\x00"])
def test_an_end_inside_a_message_is_counted_and_has_the_source_s_reason(sent: bytes) -> None:
    """A process that dies while it writes: what it died of says more than the broken message."""
    expected = ["lost gone", "running m", "frame 0", "ended end of file"]
    eyes, _ = check_eyes(Script(sent, stream(batch(), END)), expected)
    assert eyes.rejected == {"cut_short": 1}


def test_silence_is_a_loss() -> None:
    """A source that says nothing is opened afresh."""
    check_eyes(Script(), ["lost nothing heard from the detector for 0.01 s"], sleeps=1)


def test_an_external_detector_may_come_back_after_its_end() -> None:
    """Its end is no reason to stop listening for its next run."""
    source = Script(stream(batch(), END), stream(batch(), END))
    run = ["running m", "frame 0", "ended end of file"]
    eyes, _ = check_eyes(source, run + run, settings=EXTERNAL, sleeps=2)
    assert eyes.ended.is_set()


def test_a_fast_file_waits_for_room() -> None:
    """Nothing is offered that would push something else out."""
    free = iter([False, False, False, True, True])
    _, slept = check_eyes(
        Script(stream(batch(), batch(frame_seq=1), END)),
        ["running m", "frame 0", "frame 1", "ended end of file"],
        settings=FAST,
        room=lambda: next(free),
    )
    assert len(slept) == 3


def test_real_time_does_not_wait() -> None:
    """A camera's frames are offered at once; the inbox knows what to drop."""
    check_eyes(Script(stream(batch(), END)), ["running m", "frame 0", "ended end of file"], room=lambda: False)


def test_a_refused_change_is_offered_again() -> None:
    """Changes of state are never lost to a full inbox."""
    _, slept = check_eyes(
        Script(stream(batch(), END)), ["running m", "frame 0", "ended end of file"], inbox=Inbox(refusals=2)
    )
    assert len(slept) == 2


def test_a_batch_without_a_time_was_taken_when_it_came() -> None:
    """An external detector on another machine leaves the time out."""
    inbox, sent = Inbox(), batch()
    sent.ClearField("captured_ns")
    check_eyes(Script(stream(sent, END)), ["running m", "frame 0", "ended end of file"], inbox=inbox)
    (captured,) = [frame.captured_ns for _, frame in inbox.taken if isinstance(frame, FrameObserved)]
    assert captured == Watch().at_ns


def test_nothing_starts_without_a_source() -> None:
    """With source = "none" there is no task and stopping is free."""

    async def run() -> None:
        eyes = Eyes(EyesSection(), Inbox(), Watch(), Origin(), None, groups={}, source=Script())
        await eyes.start()
        await eyes.stop()
        await eyes.stop()

    asyncio.run(run())


def test_a_mistake_of_ours_is_not_hidden() -> None:
    """What ends the task by mistake comes out of stop."""
    offered = asyncio.Event()

    def broken(input_class: InputClass, observation: Message) -> bool:
        offered.set()
        raise RuntimeError("ours")

    async def run() -> None:
        eyes = Eyes(
            EyesSection.model_validate(FILE),
            broken,
            Watch(),
            Origin(),
            None,
            groups={},
            source=Script(stream(DetectionBatch(camera=1, width_px=1, height_px=1))),
        )
        await eyes.start()
        await asyncio.wait_for(offered.wait(), 5)
        await eyes.stop()

    with pytest.raises(RuntimeError, match="ours"):
        asyncio.run(run())


def test_model_digest(tmp_path: pytest.TempPathFactory) -> None:
    """SHA-256 of the bytes (FIPS 180-4's example)."""
    path = f"{tmp_path}/abc"
    with open(path, "wb") as file:
        file.write(b"abc")
    assert model_sha256(path).hex() == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


def test_what_the_self_test_asks() -> None:
    """The newest frame counts, also an empty one that is not recorded; before the first nothing is known."""
    watch = Watch()
    for frames, told in (([], (None, None)), ([batch(latency_us=7), batch(frame_seq=1)], (2_000, 7))):
        expected = ["running m", "frame 0"] if frames else []
        seldom = {**FILE, "empty_frame_period_s": "60"}
        eyes, _ = check_eyes(
            Script(stream(*frames, END)), [*expected, "ended end of file"], settings=seldom, watch=watch
        )
        watch.at_ns += 2_000_999_999
        assert eyes.facts() == told


def test_a_frame_that_is_not_recorded_is_one() -> None:
    """The age counts from it."""
    watch = Watch()

    class Later(Script):
        async def why(self) -> Lost:
            watch.at_ns += 5_000_000_000
            return Lost("gone")

    streams = stream(batch(("person", 5_000, 0, 0, 9, 9))), stream(batch(frame_seq=1), batch(frame_seq=2), END)
    expected = ["running m", "frame 0", "lost gone", "running m", "frame 1", "ended end of file"]
    eyes, _ = check_eyes(Later(*streams), expected, settings={**FILE, "empty_frame_period_s": "60"}, watch=watch)
    assert eyes.facts().frame_ms_ago == 0
