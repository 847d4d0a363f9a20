from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from yolino.cli.views import VIEWS, find_view
from yolino.header import Header
from yolino.inference import Predictor, open_engine
from yolino.io import read_image
from yolino.viz import PALETTE, draw_legend, draw_polylines

from .conftest import Run

Make = Callable[..., Path]
NAMES = sorted(VIEWS)


def bright(height: int = 256, width: int = 256) -> np.ndarray:
    return np.full((height, width, 3), 200, np.uint8)


def draw(name: str, path: Path, image: np.ndarray, threshold: float | None = None) -> np.ndarray:
    predictor = Predictor(open_engine(path), threshold=threshold)
    return VIEWS[name](image, predictor.stages(image), predictor)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("size", [(256, 256), (720, 1280), (9, 14)])
def test_every_view_draws_what_is_found_and_leaves_the_image(
    model: Path, name: str, size: tuple[int, int]
) -> None:
    image = bright(*size)
    drawn = draw(name, model, image)
    assert drawn.dtype == np.uint8
    assert (image == 200).all()
    assert (drawn != 200).any()
    if name == "stages":
        assert drawn.shape[1] > 2 * 480
    else:
        assert drawn.shape[0] % size[0] == 0
        assert drawn.shape[0] // size[0] == drawn.shape[1] // size[1] >= 1
        assert drawn.shape[:2] == size or name == "cells" or max(size) < 240


@pytest.mark.parametrize("name", NAMES)
def test_every_view_draws_an_image_without_lines(model: Path, name: str) -> None:
    black = np.zeros((90, 160, 3), np.uint8)
    assert draw(name, model, black).ndim == 3
    assert draw(name, model, bright(90, 160), threshold=0.95).ndim == 3


@pytest.mark.parametrize("name", NAMES)
def test_every_view_draws_more_classes_than_there_are_base_colors(
    make_model: Make, tmp_path: Path, header: Header, name: str
) -> None:
    classes = tuple(f"class {i}" for i in range(40))
    many = make_model(
        tmp_path / "many.onnx",
        header=dataclasses.replace(header, classes=classes),
        outputs=("endpoints", "scores", "probabilities"),
    )
    assert draw(name, many, bright(400, 400)).ndim == 3


@pytest.mark.parametrize("name", NAMES)
def test_every_view_draws_undirected_lines(
    make_model: Make, tmp_path: Path, header: Header, name: str
) -> None:
    path = make_model(tmp_path / "undirected.onnx", header=dataclasses.replace(header, directed=False))
    undirected, directed = draw(name, path, bright()), draw(name, make_model(tmp_path / "d.onnx"), bright())
    assert (undirected != directed).any()


@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("cells", "stages")])
@pytest.mark.parametrize(("edge", "zoom"), [(16, 30), (40, 12), (240, 2), (241, 1)])
def test_tiny_images_are_enlarged_by_a_whole_factor(model: Path, name: str, edge: int, zoom: int) -> None:
    drawn = draw(name, model, bright(edge, edge))
    assert drawn.shape == (edge * zoom, edge * zoom, 3)
    assert (drawn == 200).all(axis=2).mean() > 0.5


def test_lines_on_a_tiny_image_are_where_they_are_in_it(model: Path) -> None:
    predictor = Predictor(open_engine(model))
    lines = predictor(bright(40, 40))
    wanted = draw_polylines(bright(480, 480), lines.with_vertices(lines.vertices * 12))
    np.testing.assert_array_equal(draw("lines", model, bright(40, 40)), wanted)


def test_the_lines_are_those_of_before(model: Path) -> None:
    predictor = Predictor(open_engine(model))
    wanted = draw_polylines(bright(), predictor(bright()))
    np.testing.assert_array_equal(draw("lines", model, bright()), wanted)


def test_lines_of_several_classes_have_the_names_of_those_that_are_there(class_model: Path) -> None:
    predictor = Predictor(open_engine(class_model))
    found = predictor(bright())
    drawn = draw_polylines(bright(), found, color_by="label")
    assert set(found.labels.tolist()) < set(range(len(predictor.header.classes)))
    wanted = draw_legend(drawn, predictor.header.classes, labels=found.labels)
    np.testing.assert_array_equal(draw("lines", class_model, bright()), wanted)
    assert (wanted != drawn).any()


def test_cells_show_the_predictors_of_the_network(make_model: Make, tmp_path: Path, header: Header) -> None:
    """Two predictors in each cell of 32 px: one goes along the top of its cell, one along the bottom."""
    cells = np.stack(np.meshgrid(np.arange(4), np.arange(2)), axis=-1).reshape(-1, 1, 1, 2) * 32
    ways = np.array([[[2, 4], [30, 4]], [[2, 28], [30, 28]]])
    path = make_model(
        tmp_path / "two.onnx",
        header=dataclasses.replace(header, stride=32, predictors=2),
        endpoints=(cells + ways).reshape(-1, 2, 2).astype(np.float32),
    )
    drawn = draw("cells", path, bright(128, 256))[: 64 * 2]  # cells of 64 px
    assert drawn.shape == (128, 256, 3)
    for row, color in ((8, PALETTE[0]), (56, PALETTE[1])):
        near = drawn[row - 2 : row + 2, 208:220].reshape(-1, 3).astype(int)
        assert np.abs(near - color).sum(axis=1).min() < 150


def test_cells_show_what_the_mirrored_image_gives(make_model: Make, tmp_path: Path, header: Header) -> None:
    """The line of a cell is high in the left half of the image, low in the right one; mirrored, it is not."""
    cells = np.stack(np.meshgrid(np.arange(4), np.arange(2)), axis=-1).reshape(-1, 1, 2) * 32.0
    height = np.where(cells[:, 0, 0] < 64, 4.0, 28.0)
    ways = np.stack([np.stack([np.full(8, x), height], axis=-1) for x in (2.0, 30.0)], axis=1)
    for flip, seen in ((False, [False, True]), (True, [True, True])):
        path = make_model(
            tmp_path / f"{flip}.onnx",
            header=dataclasses.replace(
                header, stride=32, predictors=1, postprocess={**header.postprocess, "flip": flip}
            ),
            endpoints=(cells + ways).astype(np.float32),
        )
        drawn = draw("cells", path, bright(128, 256))
        near = [drawn[row - 2 : row + 2, 208:220].reshape(-1, 3).astype(int) for row in (8, 56)]
        assert [bool(np.abs(part - PALETTE[0]).sum(axis=1).min() < 150) for part in near] == seen
        assert draw("stages", path, bright(128, 256)).ndim == 3


def test_cells_of_a_window_model_cover_the_image(make_model: Make, tmp_path: Path, header: Header) -> None:
    """Each cell of 16 px has a line from left to right; nine windows are needed."""
    cells = np.stack(np.meshgrid(np.arange(8), np.arange(4)), axis=-1).reshape(-1, 1, 2) * 16.0
    path = make_model(
        tmp_path / "window.onnx",
        header=dataclasses.replace(header, fit="window"),
        endpoints=(cells + np.array([[2.0, 8.0], [14.0, 8.0]])).astype(np.float32),
    )
    drawn = draw("cells", path, bright(96, 200))
    assert drawn.shape == (96 * 4, 200 * 4, 3)
    for row in range(6):
        for column in range(12):
            near = drawn[64 * row + 28 : 64 * row + 38, 64 * column + 12 : 64 * column + 24].astype(int)
            assert np.abs(near - PALETTE[0]).sum(axis=2).min() < 40
    assert draw("stages", path, bright(96, 200)).ndim == 3


def test_a_view_that_is_unknown_is_refused() -> None:
    with pytest.raises(ValueError, match=r"The view 'celsl' is unknown; use one of lines, orientation, "):
        find_view("celsl")


@pytest.mark.parametrize("name", NAMES)
def test_every_view_can_be_asked_for(run: Run, model: Path, photo: Path, name: str) -> None:
    code, out, err = run("predict", photo, "--model", model, "--view", name)
    assert (code, err) == (0, "")
    assert "1 image, 2 polylines" in out
    shown = draw(name, model, read_image(photo))
    np.testing.assert_array_equal(read_image("yolino-out/photo.png"), shown)


def test_a_wrong_view_is_told_before_anything_is_written(run: Run, model: Path, photo: Path) -> None:
    code, out, err = run("predict", photo, "--model", model, "--view", "cell")
    assert (code, out) == (2, "")
    assert err.startswith("Error: The view 'cell' is unknown; use one of lines, orientation, identity, ")
    assert err.count("\n") == 1
    assert not Path("yolino-out").exists()


def test_the_help_names_every_view(run: Run) -> None:
    help_text: Any = run("predict", "--help")[1]
    assert all(re.search(rf"\b{name}\b", help_text) for name in VIEWS)
