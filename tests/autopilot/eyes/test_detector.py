"""The detector with a network of a few hundred bytes: what it answers, and which models it refuses."""

from pathlib import Path

import numpy as np
import pytest

from autopilot.adapters.eyes import coco
from autopilot.adapters.eyes.detector import Detector, ModelRefused
from tests.autopilot.eyes.tiny import CLASSES, answers, model_file, onnx


def check_refused(path: Path, *words: str, classes: tuple[str, ...] = CLASSES) -> None:
    """Say that a model is refused in one line that has these words."""
    with pytest.raises(ModelRefused) as refusal:
        Detector(str(path), classes, 0.4, 0.5, 1)
    text = str(refusal.value)
    assert text.startswith("[eyes] model: ")
    assert "\n" not in text
    assert [word for word in words if word not in text] == []


def test_what_it_sees(tmp_path: Path) -> None:
    """Names, scores and boxes as fractions of the image, whatever the image's shape."""
    detector = Detector(str(model_file(tmp_path)), CLASSES, 0.65, 0.5, 1)
    found = detector.detect(np.zeros((100, 300, 3), np.uint8))
    assert detector.name == "tiny.onnx"
    assert [(name, round(score, 3)) for name, score, _ in found] == [("person", 0.9), ("dog", 0.75)]
    assert found[1][2] == pytest.approx((0.25, 0.25, 0.25, 0.25))


def test_outputs_are_told_by_shape_whatever_their_order(tmp_path: Path) -> None:
    """Eight classes could be four distributions too, and stand first: they are scores all the same."""
    named = answers((32, 0, 1, 0.9, 0))
    wide = {name: np.pad(named[name], ((0, 0), (0, 0), (0, 6))) for name in named if name.startswith("c")}
    path = tmp_path / "wide.onnx"
    path.write_bytes(onnx((1, 3, 32, 32), wide | named | wide))
    detector = Detector(str(path), tuple("abcdefgh"), 0.4, 0.5, 1)
    ((name, _, box),) = detector.detect(np.zeros((9, 9, 3), np.uint8))
    assert name == "b"
    assert box == pytest.approx((0.5, 0.5, 0.5, 0.5))


def test_nothing_there(tmp_path: Path) -> None:
    """No cell is sure enough: an empty list, no trouble."""
    detector = Detector(str(model_file(tmp_path)), CLASSES, 0.95, 0.5, 1)
    assert detector.detect(np.zeros((48, 64, 3), np.uint8)) == []


def test_the_image_is_scaled_as_the_network_was_trained(tmp_path: Path) -> None:
    """Blue, green and red keep their order and get NanoDet's means and deviations, plane by plane."""
    seen: list[np.ndarray[tuple[int, ...], np.dtype[np.float32]]] = []
    detector = Detector(str(model_file(tmp_path)), CLASSES, 0.4, 0.5, 1)
    session = detector._session

    class Spy:
        def run(self, names: list[str], inputs: dict[str, np.ndarray[tuple[int, ...], np.dtype[np.float32]]]) -> object:
            seen.append(inputs["image"])
            return session.run(names, inputs)

    detector._session = Spy()
    detector.detect(np.full((10, 10, 3), (103, 0, 255), np.uint8))
    assert seen[0].shape == (1, 3, 32, 32)
    assert seen[0][0, :, 7, 9].tolist() == pytest.approx([-0.0092, -2.0357, 2.2497], abs=1e-3)


def test_models_that_are_none(tmp_path: Path) -> None:
    """No file, a folder, words instead of a model: the key and the path."""
    check_refused(tmp_path / "gone.onnx", "no file", "gone.onnx", "give the path")
    check_refused(tmp_path, "no file")
    words = tmp_path / "words.onnx"
    words.write_text("not a model at all, but long enough to be looked at")
    check_refused(words, "words.onnx", "is no ONNX model")


@pytest.mark.parametrize("shape", [(1, 3, 32), (1, 1, 32, 32), (3, 32), (1, 3, 0, 32)])
def test_inputs_that_do_not_fit(tmp_path: Path, shape: tuple[int, ...]) -> None:
    """The input must be one colour image of a fixed size; what it is instead is said."""
    path = tmp_path / "shape.onnx"
    path.write_bytes(onnx(shape, answers()))
    check_refused(path, "input is image", "1 x 3 x height x width")


def test_outputs_that_do_not_fit(tmp_path: Path) -> None:
    """Another network, or another number of classes: what it gives, what is needed, and the likely fix."""
    path = model_file(tmp_path)
    check_refused(path, "16 x 3 scores", "list them in [eyes] classes", classes=("a", "b", "c"))
    other = answers()
    del other["s16"]
    path.write_bytes(onnx((1, 3, 32, 32), other))
    check_refused(path, "stride 16")
    path.write_bytes(onnx((1, 3, 64, 64), answers()))
    check_refused(path, "64 x 2 scores")


def test_coco_has_80_names_in_order() -> None:
    """A few numbers that everybody knows."""
    assert len(coco.NAMES) == len(set(coco.NAMES)) == 80
    known = {0: "person", 2: "car", 16: "dog", 32: "sports ball", 39: "bottle", 61: "toilet", 79: "toothbrush"}
    assert {number: coco.NAMES[number] for number in known} == known
