"""Frames of a file with a clock that the test holds: paces, loops, limits, files that are none."""

from pathlib import Path

import pytest

from autopilot.adapters.eyes.video import SourceLost, SourceRefused, frames
from autopilot.ports.config import EyesSection
from tests.autopilot.eyes.tiny import video_file

START_NS = 7_000_000_000


class Hands:
    """A clock whose sleeps are instant and whose work takes as long as the test says."""

    def __init__(self) -> None:
        self.at_ns = START_NS

    def now(self) -> int:
        return self.at_ns

    def sleep(self, seconds: float) -> None:
        self.at_ns += round(seconds * 1e9)


def check_frames(
    path: Path, expected: list[tuple[int, int]], work_ms: int = 0, most: int = 100, **settings: str | int
) -> Hands:
    """Say which frames come, as (number, milliseconds after the start), where each takes `work_ms` to look at."""
    section = EyesSection.model_validate({"source": "file", "path": str(path), "model": "m", **settings})
    hands = Hands()
    seen = []
    for frame in frames(section, hands.now, hands.sleep):
        seen.append((frame.seq, (frame.captured_ns - START_NS) // 1_000_000))
        hands.at_ns += work_ms * 1_000_000
        if len(seen) == most:
            break
    assert seen == expected
    return hands


def test_fast_gives_every_frame_at_once(tmp_path: Path) -> None:
    """Times are the file's own and no time passes."""
    hands = check_frames(video_file(tmp_path, 4), [(0, 0), (1, 100), (2, 200), (3, 300)], pace="fast")
    assert hands.at_ns == START_NS


def test_real_waits_for_each_frame(tmp_path: Path) -> None:
    """At ten frames a second the fourth comes after 300 ms."""
    hands = check_frames(video_file(tmp_path, 4), [(0, 0), (1, 100), (2, 200), (3, 300)], work_ms=30)
    assert hands.at_ns - START_NS == 330_000_000


def test_real_skips_what_comes_too_late(tmp_path: Path) -> None:
    """A detector that takes 250 ms sees every third frame or so, numbered as in the file, and never falls behind."""
    check_frames(video_file(tmp_path, 10), [(0, 0), (2, 200), (5, 500), (7, 700)], work_ms=250)


def test_a_fast_detector_is_not_slowed_by_the_last_frames(tmp_path: Path) -> None:
    """Every frame is looked at even where all of them are late."""
    check_frames(video_file(tmp_path, 3), [(0, 0), (1, 100), (2, 200)], work_ms=900, pace="fast")


def test_frame_limit(tmp_path: Path) -> None:
    """The limit counts the source's frames."""
    check_frames(video_file(tmp_path, 4), [(0, 0), (1, 100)], pace="fast", frames=2)
    check_frames(video_file(tmp_path, 10), [(0, 0), (2, 200)], work_ms=250, frames=5)


def test_loop_goes_on_counting(tmp_path: Path) -> None:
    """Numbers and times never go back where the file begins again."""
    looped = [(0, 0), (1, 100), (2, 200), (3, 300), (4, 400)]
    check_frames(video_file(tmp_path, 2), looped, pace="fast", at_end="loop", most=5)
    check_frames(video_file(tmp_path, 2), looped[:3], pace="fast", at_end="loop", frames=3)


def test_a_file_at_its_end(tmp_path: Path) -> None:
    """A shorter file than the limit just ends."""
    check_frames(video_file(tmp_path, 2), [(0, 0), (1, 100)], pace="fast", frames=50)


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "no file"), (b"", "no video"), (b"RIFF....AVI LIST" + bytes(200), "[eyes] path")],
)
def test_files_that_are_no_video(tmp_path: Path, content: bytes | None, words: str) -> None:
    """The key, the path, and what to do."""
    path = tmp_path / "odd.avi"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SourceRefused) as refusal:
        check_frames(path, [])
    assert words in str(refusal.value)
    assert str(refusal.value).startswith(f"[eyes] path: {'no file ' * (content is None)}{path}")


def test_a_video_without_a_frame_does_not_loop_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A container that opens and has nothing that can be decoded is refused, also where it would loop."""

    class Empty:
        def __init__(self, path: str) -> None:
            self.path = path

        def get(self, _what: int) -> float:
            return 10.0

        def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
            return True

        def grab(self) -> bool:
            return False

        def release(self) -> None: ...

    monkeypatch.setattr("cv2.VideoCapture", Empty)
    path = video_file(tmp_path)
    section = EyesSection(source="file", path=str(path), model="m", at_end="loop", frames=1)
    with pytest.raises(SourceRefused, match="holds no frame that can be decoded"):
        next(frames(section))


def test_a_camera_that_is_not_there() -> None:
    """It may be plugged in later: lost, not refused."""
    section = EyesSection(source="device", device=97, model="m")
    with pytest.raises(SourceLost, match="camera 97 gives no frame"):
        next(frames(section))
