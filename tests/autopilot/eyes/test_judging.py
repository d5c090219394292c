"""What a detector may send, and the name under which everything else is counted."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.adapters.eyes.judging import Rejection, judged
from autopilot.wire.detections_pb2 import DetectionBatch
from tests.autopilot.eyes.tiny import batch

GOOD = ("person", 9000, 0, 0, 10_000, 10_000)


def check_rejected(sent: DetectionBatch, because: str) -> None:
    """Say why a batch is not used."""
    assert judged(sent.SerializeToString(), 1, 3) == Rejection(because)


def test_good_batches_pass() -> None:
    """Boxes up to the image's edges; nothing at all; an end without an image."""
    for good in (batch(GOOD, GOOD, GOOD), batch(), batch(ended_because="end of file", width_px=0, height_px=0)):
        assert judged(good.SerializeToString(), 1, 3) == good


@pytest.mark.parametrize(
    ("sent", "because"),
    [
        (batch(camera=2), "unknown_camera"),
        (batch(GOOD, GOOD, GOOD, GOOD), "too_many_detections"),
        (batch(model="x" * 65), "bad_model_name"),
        (batch(model="a\nb"), "bad_model_name"),
        (batch(ended_because="\x1b[2J"), "bad_reason"),
        (batch(ended_because="x" * 201), "bad_reason"),
        (batch(captured_ns=2**63), "bad_time"),
        (batch(frame_seq=2**64 - 1), "bad_time"),
        (batch(field_of_view_cdeg=17_001), "bad_field_of_view"),
        (batch(width_px=0), "bad_image_size"),
        (batch(height_px=65_536), "bad_image_size"),
        (batch(GOOD, ("", 1, 0, 0, 1, 1)), "bad_class_name"),
        (batch(("x" * 65, 1, 0, 0, 1, 1)), "bad_class_name"),
        (batch(("per\tson", 1, 0, 0, 1, 1)), "bad_class_name"),
        (batch(("dog", 10_001, 0, 0, 1, 1)), "bad_confidence"),
        (batch(("dog", 1, -1, 0, 1, 1)), "box_outside_image"),
        (batch(("dog", 1, 0, 0, 1, 10_001)), "box_outside_image"),
        (batch(("dog", 1, 5, 0, 5, 1)), "empty_box"),
        (batch(("dog", 1, 0, 9, 1, 3)), "empty_box"),
    ],
)
def test_each_fault_has_its_name(sent: DetectionBatch, because: str) -> None:
    """One fault, one name."""
    check_rejected(sent, because)


def test_names_in_other_scripts_are_names() -> None:
    """A class may be called what its people call it."""
    assert not isinstance(judged(batch(("лось", 1, 0, 0, 1, 1)).SerializeToString(), 1, 3), Rejection)


@given(st.binary(max_size=200))
def test_bytes_never_raise(payload: bytes) -> None:
    """Whatever comes, the answer is a batch or a name."""
    assert isinstance(judged(payload, 1, 3), DetectionBatch | Rejection)


def test_garbage_is_garbage() -> None:
    """Bytes that are no protobuf at all, and class names that are no UTF-8."""
    assert judged(b"\xff" * 20, 1, 3) == Rejection("garbage")
    assert judged(b"\x0a\x05ab", 1, 3) == Rejection("garbage")
