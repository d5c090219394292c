"""Reads NanoDet's output: from class scores and distributions of box edges to boxes.

The network answers for each cell of a coarse grid over the image (strides 8, 16 and 32 pixels).
A cell has one score a class, already between 0 and 1, and for each of its four sides (left,
top, right, bottom) a distribution over distances 0, 1, 2, ... strides from the cell's centre,
given as logits; the distance is its expectation (Generalized Focal Loss, arXiv 2006.04388).

Pure numpy: no model and no image is seen here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

STRIDES = (8, 16, 32)

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Boxes:
    """Boxes in pixels of the network's input, best first."""

    corners: Floats  # n x 4: x_min, y_min, x_max, y_max
    scores: Floats  # n, 0 to 1
    classes: NDArray[np.intp]  # n, number of the class


def cells(width_px: int, height_px: int, stride: int) -> int:
    """Return how many cells the grid of this stride has over an image (edges rounded up)."""
    return -(-width_px // stride) * -(-height_px // stride)


def decode(
    scores: Sequence[Floats],
    sides: Sequence[Floats],
    width_px: int,
    height_px: int,
    confidence: float,
    overlap: float,
) -> Boxes:
    """Return the boxes from `confidence` up, overlapping ones of a class reduced to the best.

    `scores` and `sides` hold one array a stride: cells x classes, and cells x (4 x bins). Each
    cell speaks for its best class. Values that are not finite never become a box.
    """
    found = [
        _of_stride(score, side, stride, width_px, confidence)
        for score, side, stride in zip(scores, sides, STRIDES, strict=True)
    ]
    corners = np.concatenate([part.corners for part in found])
    corners = np.clip(corners, 0, np.array([width_px, height_px, width_px, height_px], dtype=np.float32))
    best = np.concatenate([part.scores for part in found])
    classes = np.concatenate([part.classes for part in found])
    kept = suppress(corners, best, classes, overlap)
    return Boxes(corners[kept], best[kept], classes[kept])


def _of_stride(scores: Floats, sides: Floats, stride: int, width_px: int, confidence: float) -> Boxes:
    """Return the boxes of one grid, not yet reduced."""
    classes = scores.argmax(axis=1)
    best = scores[np.arange(len(scores)), classes]
    cell = np.flatnonzero(best >= confidence)
    columns = -(-width_px // stride)
    centre_x = (cell % columns + 0.5) * stride
    centre_y = (cell // columns + 0.5) * stride
    reach = _expectation(sides[cell]) * stride
    corners = np.stack(
        [centre_x - reach[:, 0], centre_y - reach[:, 1], centre_x + reach[:, 2], centre_y + reach[:, 3]], axis=1
    ).astype(np.float32)
    finite = np.isfinite(corners).all(axis=1) & np.isfinite(best[cell])
    return Boxes(corners[finite], best[cell][finite], classes[cell][finite])


def _expectation(sides: Floats) -> Floats:
    """Return the expected distance of each side, in strides, from n x (4 x bins) logits."""
    logits = sides.reshape(len(sides), 4, sides.shape[1] // 4)
    weights = np.exp(logits - logits.max(axis=2, keepdims=True))
    expected: Floats = (weights @ np.arange(logits.shape[2], dtype=np.float32)) / weights.sum(axis=2)
    return expected


def suppress(corners: Floats, scores: Floats, classes: NDArray[np.intp], overlap: float) -> NDArray[np.intp]:
    """Return which boxes stay, best first: of two of a class with an IoU above `overlap`, the better one."""
    order = np.argsort(-scores, kind="stable")
    area = (corners[:, 2] - corners[:, 0]) * (corners[:, 3] - corners[:, 1])
    kept: list[int] = []
    while order.size:
        first, rest = order[0], order[1:]
        kept.append(int(first))
        low = np.maximum(corners[first, :2], corners[rest, :2])
        high = np.minimum(corners[first, 2:], corners[rest, 2:])
        shared = np.prod(np.clip(high - low, 0, None), axis=1)
        same = (classes[rest] == classes[first]) & (shared > overlap * (area[first] + area[rest] - shared))
        order = rest[~same]
    return np.array(kept, dtype=np.intp)
