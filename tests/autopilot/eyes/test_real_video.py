"""A real detector on a real video, where they are: AUTOPILOT_TEST_DATA names the folder."""

from __future__ import annotations

import asyncio
import math
import os
from pathlib import Path

import pytest

from autopilot.adapters.eyes import Eyes
from autopilot.cli.configuration import load
from autopilot.geo import Origin
from events.schema.eyes_pb2 import FrameObserved
from tests.autopilot.eyes.tiny import Inbox, Watch

DATA = os.environ.get("AUTOPILOT_TEST_DATA", "")
EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "video.toml"

pytestmark = [
    pytest.mark.whole,
    pytest.mark.skipif(not DATA, reason="AUTOPILOT_TEST_DATA does not name the folder with vtest.avi and the model"),
]


def test_people_on_a_square() -> None:
    """People in every frame, as far away and as wide as the example's pose makes plausible, and the yellow cloth."""
    config = load(str(EXAMPLE), {}, inputs=False)
    data = {"path": f"{DATA}/vtest.avi", "model": f"{DATA}/nanodet_g_416.onnx", "pace": "fast", "frames": 20}
    settings = config.eyes.model_copy(update=data)
    inbox, origin = Inbox(), Origin()
    assert config.flight.origin is not None
    origin.set(*config.flight.origin)

    async def run() -> None:
        eyes = Eyes(settings, inbox, Watch(), origin, None, groups=config.find.groups)
        await eyes.start()
        await asyncio.wait_for(eyes.ended.wait(), 120)
        await eyes.stop()
        assert (eyes.refusal, eyes.rejected) == (None, {})

    asyncio.run(run())
    frames = [one for _, one in inbox.taken if isinstance(one, FrameObserved)]
    assert [frame.frame_seq for frame in frames] == list(range(20))
    people = [[one for one in frame.detections if one.class_name == "person"] for frame in frames]
    assert min(map(len, people)) >= 1
    placed = [one for frame in people for one in frame if one.HasField("place")]
    assert len(placed) >= 0.9 * sum(map(len, people))
    distances_m = sorted(math.hypot(one.place.east_mm, one.place.north_mm) / 1000 for one in placed)
    assert 8 < distances_m[len(placed) // 2] < 40
    widths_mm = sorted(one.width_mm for one in placed)
    assert 300 < widths_mm[len(placed) // 2] < 1500
    balls = [one for frame in frames for one in frame.detections if one.class_name == "sports ball"]
    centres = [((one.x_min_e4 + one.x_max_e4) / 2e4 * 768, (one.y_min_e4 + one.y_max_e4) / 2e4 * 576) for one in balls]
    assert any(math.dist(centre, (348, 468)) < 25 for centre in centres)
