"""Small things for the tests of the eyes: a network of a few bytes, a video of a few frames, a scripted source.

The network is written by hand in ONNX's wire format (onnx.proto, field numbers beside each
part): it takes a 1 x 3 x 32 x 32 image and answers constants, so a test knows every box.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from google.protobuf.message import Message
from numpy.typing import NDArray

from autopilot.adapters.eyes.framing import framed
from autopilot.adapters.eyes.sources import Lost
from autopilot.ports.edges import InputClass
from autopilot.wire.detections_pb2 import DetectionBatch

SIDE_PX = 32
CELLS = {8: 16, 16: 4, 32: 1}
CLASSES = ("person", "dog")
BINS = 8

Floats = NDArray[np.float32]


def _varint(value: int) -> bytes:
    parts = []
    while value > 127:
        parts.append(value & 127 | 128)
        value >>= 7
    return bytes([*parts, value])


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _part(field: int, value: bytes | str) -> bytes:
    data = value.encode() if isinstance(value, str) else value
    return _varint(field << 3 | 2) + _varint(len(data)) + data


def _value_info(name: str, shape: Sequence[int]) -> bytes:
    dims = b"".join(_part(1, _number(1, size)) for size in shape)  # TensorShapeProto.dim.dim_value
    tensor = _number(1, 1) + _part(2, dims)  # elem_type FLOAT, shape
    return _part(1, name) + _part(2, _part(1, tensor))  # name, type.tensor_type


def _tensor(name: str, values: Floats) -> bytes:
    dims = b"".join(_number(1, size) for size in values.shape)
    return dims + _number(2, 1) + _part(8, name) + _part(9, values.astype("<f4").tobytes())  # FLOAT, name, raw_data


def onnx(input_shape: Sequence[int], outputs: dict[str, Floats]) -> bytes:
    """Return a model that takes one image and answers constants."""
    graph = b"".join(_part(1, _part(1, f"c_{name}") + _part(2, name) + _part(4, "Identity")) for name in outputs)
    graph += _part(2, "tiny")
    graph += b"".join(_part(5, _tensor(f"c_{name}", values)) for name, values in outputs.items())
    graph += _part(11, _value_info("image", input_shape))
    graph += b"".join(_part(12, _value_info(name, values.shape)) for name, values in outputs.items())
    return _number(1, 8) + _part(7, graph) + _part(8, _number(2, 13))  # ir_version, graph, opset_import.version


def answers(*found: tuple[int, int, int, float, int]) -> dict[str, Floats]:
    """Return NanoDet outputs in which these are found: (stride, cell, class, score, reach in strides on each side)."""
    scores = {stride: np.zeros((cells, len(CLASSES)), np.float32) for stride, cells in CELLS.items()}
    sides = {stride: np.zeros((cells, 4 * BINS), np.float32) for stride, cells in CELLS.items()}
    for stride, cell, number, score, reach in found:
        scores[stride][cell, number] = score
        sides[stride][cell].reshape(4, BINS)[:, reach] = 50
    # Sides first and the strides backwards, as converters like to do it.
    named = {f"s{stride}": sides[stride][None] for stride in reversed(CELLS)}
    return named | {f"c{stride}": scores[stride][None] for stride in CELLS}


def model_file(folder: Path, input_shape: Sequence[int] = (1, 3, SIDE_PX, SIDE_PX)) -> Path:
    """Write a network that sees one person in the middle of every image and one dog in its first cell."""
    path = folder / "tiny.onnx"
    path.write_bytes(onnx(input_shape, answers((32, 0, 0, 0.9, 0), (16, 0, 1, 0.75, 0), (8, 5, 0, 0.6, 1))))
    return path


def video_file(folder: Path, frames: int = 6, hz: float = 10) -> Path:
    """Write a video of grey frames, each a little brighter than the one before."""
    path = folder / "tiny.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), hz, (64, 48))
    for number in range(frames):
        writer.write(np.full((48, 64, 3), 20 * number, np.uint8))
    writer.release()
    return path


def batch(*boxes: tuple[str, int, int, int, int, int], **fields: int | str) -> DetectionBatch:
    """Return a good batch with these boxes: class, confidence, left, top, right, bottom (all numbers in 1e-4)."""
    names = ("class_name", "confidence_e4", "x_min_e4", "y_min_e4", "x_max_e4", "y_max_e4")
    whole: dict[str, int | str] = {"camera": 1, "captured_ns": 1000, "model": "m", "width_px": 1000, "height_px": 500}
    made = DetectionBatch()
    for box in boxes:
        _set(made.detections.add(), dict(zip(names, box, strict=True)))
    _set(made, whole | fields)
    return made


def _set(message: Message, values: Mapping[str, int | str]) -> None:
    for name, value in values.items():
        setattr(message, name, value)


class Watch:
    """A clock that goes on when told."""

    def __init__(self) -> None:
        self.at_ns = 5_000_000_000

    def mono_ns(self) -> int:
        return self.at_ns

    def wall_ns(self) -> int:
        return self.at_ns


class Inbox:
    """Takes what is offered; refuses outcomes as often as it is told to."""

    def __init__(self, refusals: int = 0) -> None:
        self.taken: list[tuple[InputClass, Message]] = []
        self._refusals = refusals

    def __call__(self, input_class: InputClass, observation: Message) -> bool:
        if input_class is InputClass.OUTCOME and self._refusals:
            self._refusals -= 1
            return False
        self.taken.append((input_class, observation))
        return True


class Script:
    """A source that gives, each time it is opened, the next of these streams; None: it cannot be opened."""

    def __init__(self, *streams: bytes | None, reason: Lost | None = None) -> None:
        self.opened = self.closed = 0
        self._streams = streams
        self._reason = reason or Lost("gone")

    async def open(self) -> asyncio.StreamReader:
        """Open the next stream; after the last one nothing ever comes."""
        reader = asyncio.StreamReader()
        stream = self._streams[self.opened] if self.opened < len(self._streams) else b""
        ending = self.opened < len(self._streams)
        self.opened += 1
        if stream is None:
            raise Lost("not there")
        reader.feed_data(stream)
        if ending:
            reader.feed_eof()
        return reader

    async def why(self) -> Lost:
        """Return the reason that was given."""
        return self._reason

    async def close(self) -> None:
        """Count."""
        self.closed += 1


def stream(*batches: DetectionBatch) -> bytes:
    """Return the batches as they travel."""
    return b"".join(framed(one.SerializeToString()) for one in batches)
