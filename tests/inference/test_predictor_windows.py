from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from striped_model import make_striped_model, striped_header
from yolino.inference import OnnxEngine, Predictor, load
from yolino.inference.windows import WindowPlan, plan_windows
from yolino.io import read_image
from yolino.metrics import PointMetric
from yolino.types import Polylines

LINES = np.array([[[30, 40], [730, 400]], [[60, 360], [740, 110]], [[500, 20], [520, 440]]], np.float64)
SIZE = (460, 770)
REPOSITORY = Path(__file__).parents[2]


class ShiftedPredictor(Predictor):
    """Begins with the windows before the image."""

    offset = (0, 0)

    def plan(self, size: tuple[int, int]) -> WindowPlan:
        return plan_windows(size, self.header, overlap=self.overlap, offset=self.offset)


def draw(lines: np.ndarray, size: tuple[int, int] = SIZE) -> np.ndarray:
    """White lines on black; OpenCV puts (0, 0) at the center of the first pixel."""
    image = np.zeros((*size, 3), np.uint8)
    for ends in ((lines - 0.5) * 16).round().astype(int).tolist():
        cv2.line(image, ends[0], ends[1], (255, 255, 255), 3, cv2.LINE_AA, 4)
    return image


def f1(found: Polylines, truth: Polylines, size: tuple[int, int], *, directed: bool = False) -> float:
    metric = PointMetric(directed=directed)
    metric.update(found, truth, size)
    return float(metric.compute()["f1"])


@pytest.fixture(scope="module")
def striped(tmp_path_factory: pytest.TempPathFactory) -> OnnxEngine:
    pytest.importorskip("onnx", reason="onnx builds the model of this test")
    return OnnxEngine(make_striped_model(tmp_path_factory.mktemp("striped") / "a.onnx", striped_header()))


def test_lines_through_many_windows_are_whole(striped: OnnxEngine) -> None:
    image = draw(LINES)
    predictor = Predictor(striped)
    assert len(predictor.plan(SIZE)) > 20
    polylines = predictor(image)
    long = polylines[polylines.lengths > 100]
    assert f1(long, Polylines.from_list(list(LINES)), SIZE) > 0.98
    assert polylines.lengths.max() > 400


@pytest.mark.parametrize(
    ("overlap", "offset"), [(0, (0, 0)), (64, (0, 0)), (0, (0, 96)), (32, (32, 32)), (64, (32, 0))]
)
def test_neither_overlap_nor_place_of_the_windows_change_the_lines(
    striped: OnnxEngine, overlap: int, offset: tuple[int, int]
) -> None:
    image = draw(LINES)
    wanted = Predictor(striped).stages(image)
    predictor = ShiftedPredictor(striped, overlap=overlap)
    predictor.offset = offset
    found = predictor.stages(image)
    assert len(found.candidates) == len(wanted.candidates)
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one.scores, other.scores, atol=1e-4)
    np.testing.assert_allclose(found.polylines.vertices, wanted.polylines.vertices, atol=1e-2)
    np.testing.assert_array_equal(found.polylines.offsets, wanted.polylines.offsets)


def test_the_network_sees_another_scale(striped: OnnxEngine) -> None:
    """An image twice as large, seen at half its size, gives the same lines, twice as large."""
    image = draw(LINES)
    small = Predictor(striped)(image)
    header = dataclasses.replace(striped.header, scale=0.5)
    large = Predictor(striped, header)(np.repeat(np.repeat(image, 2, axis=0), 2, axis=1))
    np.testing.assert_allclose(large.vertices, small.vertices * 2, atol=1e-2)


@pytest.mark.parametrize("size", [(1, 1), (20, 300), (128, 128), (129, 127)])
def test_images_of_any_size_work(striped: OnnxEngine, size: tuple[int, int]) -> None:
    predictor = Predictor(striped)
    assert len(predictor(np.zeros((*size, 3), np.uint8))) == 0
    lit = draw(np.array([[[0, 10.5], [size[1], 10.5]]], np.float64), size)
    found = predictor.segments(lit)
    assert ((found.midpoints >= 0) & (found.midpoints <= size[::-1])).all()
    if size[1] > 100:
        (line,) = predictor(lit)
        assert np.ptp(line[:, 0]) > size[1] - 20
        np.testing.assert_allclose(found.midpoints[:, 1], 10.5, atol=0.1)


def test_a_list_of_images_is_one_run_of_batches(striped: OnnxEngine) -> None:
    predictor = Predictor(striped, batch_size=3)
    images = [draw(LINES), np.zeros((50, 60), np.uint8), draw(LINES[:1], (300, 400))]
    together = predictor(images)
    for image, lines in zip(images, together, strict=True):
        np.testing.assert_allclose(predictor(image).vertices, lines.vertices, atol=1e-3)
    assert [len(lines) > 0 for lines in together] == [True, False, True]
    assert predictor([]) == []


def test_classes_pass_through(tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason="onnx builds the model of this test")
    header = striped_header(classes=("steep", "flat"))
    predictor = load(make_striped_model(tmp_path / "a.onnx", header))
    predictor.warm_up()
    lines = predictor(draw(np.array([[[20, 200], [600, 230]], [[300, 20], [320, 180]]], np.float64)))
    flat = [abs(line[-1] - line[0])[0] > 100 for line in lines]
    assert lines.labels.tolist() == [int(each) for each in flat]
    assert set(flat) == {True, False}
    assert len(predictor(np.zeros((9, 9, 3), np.uint8))) == 0


def test_a_network_that_contradicts_its_header_is_refused(striped: OnnxEngine) -> None:
    header = dataclasses.replace(striped.header, predictors=2)
    with pytest.raises(ValueError, match=r"gives 64 segments, but its header says 128"):
        Predictor(striped, header)(np.zeros((9, 9, 3), np.uint8))


def test_an_overlap_that_does_not_fit_is_refused_at_once(striped: OnnxEngine) -> None:
    with pytest.raises(ValueError, match="multiple of 32"):
        Predictor(striped, overlap=50)


def test_a_trained_model_finds_the_same_lines_with_other_windows() -> None:
    """Numbers of a real network and a real tile, where both are there."""
    model = REPOSITORY / "models" / "aerial_lanes.onnx"
    data = Path(os.environ.get("YOLINO_DATA") or REPOSITORY.parent / "shared" / "data")
    tiles = sorted((data / "aerial_lanes" / "images").glob("*.jpg"))
    if not model.is_file() or not tiles:
        pytest.skip(f"{model} or the tiles in {data}/aerial_lanes are missing; set YOLINO_DATA")
    engine = OnnxEngine(model)
    scale = engine.header.scale
    side = int(1500 / scale)
    image = read_image(tiles[0])[:side, :side]
    wanted = Predictor(engine)(image)
    assert len(wanted) > 0
    for overlap, offset in ((64, (0, 0)), (160, (0, 0)), (128, (96, 64))):
        predictor = ShiftedPredictor(engine, overlap=overlap)
        predictor.offset = offset
        assert f1(predictor(image), wanted, image.shape[:2], directed=engine.header.directed) > 0.95
