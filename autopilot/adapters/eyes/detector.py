"""The detector: an ONNX network run by onnxruntime on the processor, one image at a time.

The model is judged when it is loaded, not at the first frame: file, input and outputs must be
what `[eyes] output` says. How its numbers become boxes is `nanodet`'s business. Runs in the
child process only.
"""

from __future__ import annotations

import os
from collections.abc import Sequence

import cv2
import numpy as np
import onnxruntime
from cv2.typing import MatLike

from autopilot.adapters.eyes import nanodet

_MEAN_BGR = np.array([103.53, 116.28, 123.675], dtype=np.float32)
_SCALE_BGR = 1 / np.array([57.375, 57.12, 58.395], dtype=np.float32)


class ModelRefused(Exception):
    """The model cannot be used; the text names the key and the fix."""


class Detector:
    """A loaded NanoDet. Raises `ModelRefused` where the file is no such network."""

    def __init__(self, path: str, classes: Sequence[str], confidence: float, overlap: float, threads: int) -> None:
        self.name = os.path.basename(path)
        self._classes = tuple(classes)
        self._confidence, self._overlap = confidence, overlap
        self._session = _opened(path, threads)
        self._input, self._width_px, self._height_px = _input_of(self._session)
        self._scores, self._sides = _outputs_of(self._session, len(classes), self._width_px, self._height_px)

    def detect(self, image: MatLike) -> list[tuple[str, float, tuple[float, float, float, float]]]:
        """Return class, confidence (0 to 1) and box (x_min, y_min, x_max, y_max, each 0 to 1) of what is seen.

        Best first. The image (height x width x BGR) is stretched to the network's input, so
        boxes are fractions of the whole image whatever its shape.
        """
        small = cv2.resize(image, (self._width_px, self._height_px)).astype(np.float32)
        planes = np.ascontiguousarray(((small - _MEAN_BGR) * _SCALE_BGR).transpose(2, 0, 1)[None])
        outputs = self._session.run([*self._scores, *self._sides], {self._input: planes})
        flat = [output.reshape(-1, output.shape[-1]) for output in outputs]
        boxes = nanodet.decode(
            flat[: len(self._scores)],
            flat[len(self._scores) :],
            self._width_px,
            self._height_px,
            self._confidence,
            self._overlap,
        )
        size = np.array([self._width_px, self._height_px] * 2, dtype=np.float32)
        return [
            (self._classes[number], score, (box[0], box[1], box[2], box[3]))
            for number, score, box in zip(
                boxes.classes.tolist(), boxes.scores.tolist(), (boxes.corners / size).tolist(), strict=True
            )
        ]


def _opened(path: str, threads: int) -> onnxruntime.InferenceSession:
    """Load the file; threads that wait sleep instead of spinning, for the node shares the processor."""
    if not os.path.isfile(path):
        raise ModelRefused(f"[eyes] model: no file {path}; give the path of an ONNX file")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    try:
        return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's exceptions share no other base
        words = " ".join(str(error).split())[:200]
        raise ModelRefused(f"[eyes] model: {path} is no ONNX model that onnxruntime loads ({words})") from error


def _input_of(session: onnxruntime.InferenceSession) -> tuple[str, int, int]:
    """Return name, width and height of the one input."""
    inputs = session.get_inputs()
    shape = inputs[0].shape if len(inputs) == 1 else None
    fits = (
        shape is not None
        and len(shape) == 4
        and shape[1] == 3
        and all(isinstance(size, int) and size > 0 for size in shape)
        and inputs[0].type == "tensor(float)"
    )
    if shape is None or not fits:
        got = "; ".join(f"{one.name} {one.type} {one.shape}" for one in inputs)
        raise ModelRefused(f"[eyes] model: input is {got}, needed is one float32 of 1 x 3 x height x width, fixed")
    return inputs[0].name, shape[3], shape[2]


def _outputs_of(
    session: onnxruntime.InferenceSession, classes: int, width_px: int, height_px: int
) -> tuple[list[str], list[str]]:
    """Return the names of the score outputs and of the side outputs, by stride.

    Converters rename and reorder outputs, so they are told by shape: rows say the stride, the
    last dimension says which is which.
    """
    shapes = {output.name: output.shape for output in session.get_outputs()}
    scores: list[str] = []
    sides: list[str] = []
    for stride in nanodet.STRIDES:
        rows = nanodet.cells(width_px, height_px, stride)
        here = [name for name, shape in shapes.items() if len(shape) >= 2 and shape[-2] == rows]
        of_scores = [name for name in here if shapes[name][-1] == classes]
        of_sides = [name for name in here if name not in of_scores[:1] and _is_sides(shapes[name][-1])]
        if not (of_scores and of_sides):
            got = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
            raise ModelRefused(
                f"[eyes] model: outputs are {got}; nanodet needs {rows} x {classes} scores and {rows} x 4*bins sides "
                f"for stride {stride}; if the model has other classes, list them in [eyes] classes"
            )
        scores.append(of_scores[0])
        sides.append(of_sides[0])
    return scores, sides


def _is_sides(size: object) -> bool:
    """Say whether a last dimension can be four distributions."""
    return isinstance(size, int) and size >= 8 and size % 4 == 0
