from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from striped_model import make_striped_model, striped_header
from yolino.inference import OnnxEngine, Predictor
from yolino.inference.scene import link, scan
from yolino.inference.scene_store import SceneStore
from yolino.inference.views import Box, ImageRaster, Pixels

SIZE = (420, 650)


class PatchyRaster(ImageRaster):
    """A scene with parts that cannot be read or say nothing."""

    def __init__(self, image: np.ndarray, broken: Box = (0, 0, 0, 0), empty: Box = (0, 0, 0, 0)) -> None:
        super().__init__(image)
        self.broken, self.empty, self.reads = broken, empty, 0

    def read(self, box: Box) -> Pixels:
        self.reads += 1
        left, top, right, bottom = self.broken
        if box[0] < right and box[2] > left and box[1] < bottom and box[3] > top:
            raise ValueError("block 7 is damaged")
        valid = np.ones(SIZE, np.bool_)
        valid[self.empty[1] : self.empty[3], self.empty[0] : self.empty[2]] = False
        return Pixels(super().read(box).rgb, valid[box[1] : box[3], box[0] : box[2]])


@pytest.fixture(scope="module")
def predictor(tmp_path_factory: pytest.TempPathFactory) -> Predictor:
    pytest.importorskip("onnx", reason="onnx builds the model of this test")
    path = make_striped_model(tmp_path_factory.mktemp("striped") / "a.onnx", striped_header())
    return Predictor(OnnxEngine(path))


@pytest.fixture(scope="module")
def image() -> np.ndarray:
    image = np.zeros((*SIZE, 3), np.uint8)
    for y in (40, 130, 333):
        cv2.line(image, (5, y), (640, y + 60), (255, 255, 255), 3, cv2.LINE_AA)
    return image


def test_a_scanned_scene_has_the_lines_of_the_image(
    predictor: Predictor, image: np.ndarray, tmp_path: Path
) -> None:
    store, told = SceneStore(tmp_path / "a", {}), []
    done = scan(predictor, ImageRaster(image), store, advance=told.append)
    assert (done.windows, done.resumed, done.empty, done.failures) == (len(predictor.plan(SIZE)), 0, 0, [])
    assert sum(told) == done.windows
    found, wanted = link(predictor, ImageRaster(image), store), predictor(image)
    assert len(wanted) == 3
    np.testing.assert_allclose(found.vertices, wanted.vertices, atol=1e-3)


def test_an_interrupted_scan_goes_on_and_ends_the_same(
    predictor: Predictor, image: np.ndarray, tmp_path: Path
) -> None:
    def interrupt(_: int) -> None:
        if len(seen) == 3:
            raise KeyboardInterrupt
        seen.append(1)

    seen: list[int] = []
    with pytest.raises(KeyboardInterrupt):
        scan(predictor, ImageRaster(image), SceneStore(tmp_path / "a", {}), advance=interrupt)
    store, raster = SceneStore(tmp_path / "a", {}), PatchyRaster(image)
    assert len(store.done) == 4 * predictor.batch_size
    done = scan(predictor, raster, store)
    assert (done.resumed, raster.reads) == (16, done.windows - 16)
    np.testing.assert_allclose(link(predictor, raster, store).vertices, predictor(image).vertices, atol=1e-3)
    assert scan(predictor, raster, store).resumed == done.windows


def test_windows_that_cannot_be_read_are_reported_and_tried_again(
    predictor: Predictor, image: np.ndarray, tmp_path: Path
) -> None:
    store = SceneStore(tmp_path / "a", {})
    done = scan(predictor, PatchyRaster(image, broken=(630, 400, 640, 410)), store)
    assert 1 <= len(done.failures) < done.windows
    assert all(failure.reason == "block 7 is damaged" for failure in done.failures)
    for left, top, right, bottom in (failure.box for failure in done.failures):
        assert left <= 630 < right <= 650
        assert top <= 400 < bottom <= 420
    assert len(store.done) == done.windows - len(done.failures)
    again = scan(predictor, PatchyRaster(image), store)
    assert (again.resumed, again.failures) == (done.windows - len(done.failures), [])
    np.testing.assert_allclose(
        link(predictor, ImageRaster(image), store).vertices, predictor(image).vertices, atol=1e-3
    )


def test_windows_without_data_are_skipped_and_segments_there_dropped(
    predictor: Predictor, image: np.ndarray, tmp_path: Path
) -> None:
    store, raster = SceneStore(tmp_path / "a", {}), PatchyRaster(image, empty=(300, 0, 650, 420))
    done = scan(predictor, raster, store)
    assert 0 < done.empty < done.windows
    segments = np.concatenate([chunk.segments.midpoints for chunk in store.chunks])
    assert len(segments) > 0
    assert segments[:, 0].max() < 300
    assert len(store.done) == done.windows


def test_a_scene_without_lines_has_none(predictor: Predictor, tmp_path: Path) -> None:
    raster, store = ImageRaster(np.zeros((300, 300, 3), np.uint8)), SceneStore(tmp_path / "a", {})
    scan(predictor, raster, store)
    assert len(link(predictor, raster, store)) == 0
