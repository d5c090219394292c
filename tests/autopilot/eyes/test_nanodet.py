"""NanoDet's numbers become boxes: the grid, the distributions, the reduction of overlapping boxes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.adapters.eyes import nanodet
from tests.autopilot.eyes.tiny import CELLS, SIDE_PX, Floats, answers


def check_boxes(
    found: tuple[tuple[int, int, int, float, int], ...], expected: list[tuple[int, float, list[float]]]
) -> None:
    """Say which boxes come of what the network found: class, score, corners in pixels."""
    boxes = decoded(answers(*found))
    assert boxes.classes.tolist() == [number for number, _, _ in expected]
    assert boxes.scores.tolist() == pytest.approx([score for _, score, _ in expected])
    for corners, (_, _, wanted) in zip(boxes.corners.tolist(), expected, strict=True):
        assert corners == pytest.approx(wanted, abs=1e-3)


def decoded(outputs: dict[str, Floats], confidence: float = 0.4) -> nanodet.Boxes:
    """Decode with an IoU of 0.5."""
    scores = [outputs[f"c{stride}"][0] for stride in CELLS]
    sides = [outputs[f"s{stride}"][0] for stride in CELLS]
    return nanodet.decode(scores, sides, SIDE_PX, SIDE_PX, confidence, 0.5)


def test_cells_count_the_edges_too() -> None:
    """The real network: 416 pixels make 52, 26 and 13 cells a side; a broken cell counts whole."""
    assert [nanodet.cells(416, 416, stride) for stride in nanodet.STRIDES] == [2704, 676, 169]
    assert nanodet.cells(33, 32, 8) == 20


def test_a_cell_of_each_stride() -> None:
    """Centre (i + 0.5) x stride, row by row; a reach of one bin is one stride."""
    check_boxes(((8, 6, 0, 0.9, 1),), [(0, 0.9, [12, 4, 28, 20])])  # cell 6 of 4 x 4: column 2, row 1
    check_boxes(((16, 2, 1, 0.5, 1),), [(1, 0.5, [0, 8, 24, 32])])  # clipped at the left and at the bottom
    check_boxes(((32, 0, 0, 0.4, 1),), [(0, 0.4, [0, 0, 32, 32])])


def test_below_the_confidence_nothing() -> None:
    """0.39 is not 0.4."""
    check_boxes(((8, 6, 0, 0.39, 1),), [])


def test_best_first_and_one_box_for_one_thing() -> None:
    """Neighbouring cells that mean the same thing leave the better one; another class stays."""
    check_boxes(
        ((8, 5, 0, 0.5, 2), (8, 6, 0, 0.8, 2), (8, 10, 1, 0.6, 2)),
        [(0, 0.8, [4, 0, 32, 28]), (1, 0.6, [4, 4, 32, 32])],
    )


def test_distance_is_the_expectation_of_the_distribution() -> None:
    """Two equal bins, 1 and 2, make 1.5 strides; each side has a distribution of its own."""
    outputs = answers((8, 5, 0, 0.9, 0))
    sides = outputs["s8"][0][5].reshape(4, -1)
    sides[2] = 0
    sides[2, 1] = sides[2, 2] = 60
    (corners,) = decoded(outputs).corners.tolist()
    assert corners == pytest.approx([12, 12, 24, 12], abs=1e-3)


@pytest.mark.parametrize("poison", [np.nan, np.inf])
def test_what_is_not_finite_is_no_box(poison: float) -> None:
    """A network that overflows sees nothing there; its other boxes stand."""
    outputs = answers((8, 5, 0, 0.9, 1), (32, 0, 1, 0.7, 0))
    outputs["s8"][0][5, 3] = poison
    with np.errstate(invalid="ignore"):
        assert decoded(outputs).classes.tolist() == [1]
    outputs["c32"][0][0, 1] = poison
    with np.errstate(invalid="ignore"):
        assert decoded(outputs).classes.tolist() == []


@given(
    st.lists(st.tuples(*[st.integers(0, 40)] * 4, st.integers(0, 1), st.floats(0, 1)), max_size=25), st.floats(0.1, 0.9)
)
def test_suppression_keeps_the_best_and_leaves_no_two_alike(
    rows: list[tuple[int, int, int, int, int, float]], overlap: float
) -> None:
    """No two boxes of a class that stay overlap more than allowed, and each that went had a better one that stayed."""
    corners = np.array([[x, y, x + w + 1, y + h + 1] for x, y, w, h, _, _ in rows], np.float32).reshape(-1, 4)
    classes = np.array([row[4] for row in rows], np.intp)
    scores = np.array([row[5] for row in rows], np.float32)
    kept = nanodet.suppress(corners, scores, classes, overlap).tolist()

    def alike(a: int, b: int) -> bool:
        low, high = np.maximum(corners[a, :2], corners[b, :2]), np.minimum(corners[a, 2:], corners[b, 2:])
        shared = float(np.prod(np.clip(high - low, 0, None)))
        areas = [float(np.prod(corners[i, 2:] - corners[i, :2])) for i in (a, b)]
        return bool(classes[a] == classes[b]) and shared > overlap * (sum(areas) - shared) + 1e-3

    assert not any(alike(a, b) for a in kept for b in kept if a != b)
    gone = set(range(len(rows))) - set(kept)
    assert all(any(classes[k] == classes[g] and scores[k] >= scores[g] for k in kept) for g in gone)
