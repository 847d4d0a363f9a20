from __future__ import annotations

from pathlib import Path

import numpy as np

from yolino.evaluate.worst import WorstImages
from yolino.io import read_image
from yolino.metrics import PointMetric
from yolino.types import Polylines, Sample
from yolino.viz import FALSE_ALARM, MISS


def near(image: np.ndarray, color: tuple[int, int, int]) -> np.ndarray:
    return np.asarray(np.abs(image.astype(int) - color).sum(axis=2) < 120)


def write(folder: Path, edge: int, found: Polylines, truth: Polylines) -> tuple[np.ndarray, np.ndarray]:
    worst, size = WorstImages(1), (edge, edge)
    sample = Sample("a.png", np.full((edge, edge, 3), 90, np.uint8), truth, (), size)
    worst.add(sample, PointMetric().match(found, truth, size))
    (bad,) = worst.write(folder)
    return read_image(bad.picture), read_image(folder / "worst.png")


def test_lines_of_a_large_image_are_thin_and_yet_on_the_sheet(tmp_path: Path) -> None:
    edge = 3000
    found = Polylines.from_list([[[1500.0, 400.0], [1500.0, 2900.0]]])
    truth = Polylines.from_list([[[900.0, 400.0], [900.0, 2900.0]]])
    picture, sheet = write(tmp_path, edge, found, truth)
    assert picture.shape == (edge, edge, 3)
    assert (picture[1500, 1400:1600] != 90).any(axis=1).sum() <= 10
    for color in (FALSE_ALARM, MISS):
        assert near(sheet[100:], color).any(axis=1).sum() > 150


def test_a_tiny_image_is_enlarged(tmp_path: Path) -> None:
    found = Polylines.from_list([[[20.0, 2.0], [20.0, 38.0]]])
    truth = Polylines.from_list([[[30.0, 2.0], [30.0, 38.0]]])
    picture, _ = write(tmp_path, 40, found, truth)
    assert picture.shape == (480, 480, 3)
    assert near(picture[:, 230:250], FALSE_ALARM).any()
    assert near(picture[:, 350:370], MISS).any()
