"""Turned views of a window."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from striped_model import make_striped_model, striped_header
from yolino.inference import OnnxEngine, Predictor
from yolino.inference.rotations import join_views, turn, turn_back, turn_predictors
from yolino.types import Segments


@given(quarters=st.integers(0, 3), row=st.integers(0, 4), column=st.integers(0, 6))
def test_the_center_of_a_pixel_comes_back_from_every_turn(quarters: int, row: int, column: int) -> None:
    image = np.zeros((5, 7, 3), np.uint8)
    image[row, column] = 255
    ((y, x),) = np.argwhere(turn(image, quarters)[..., 0])
    points = np.array([[[x + 0.5, y + 0.5], [0.0, 0.0]]])
    assert turn_back(points, (5, 7), quarters)[0, 0].tolist() == [column + 0.5, row + 0.5]


def test_a_half_turn_by_hand() -> None:
    assert turn_back(np.array([[[1.0, 2.0], [10.0, 4.0]]]), (4, 10), 2).tolist() == [[[9.0, 2.0], [0.0, 0.0]]]


@given(quarters=st.integers(0, 3), predictor=st.integers(0, 2), cell=st.integers(0, 14))
def test_predictors_turn_with_their_cells(quarters: int, predictor: int, cell: int) -> None:
    chosen = np.zeros(45, np.bool_)
    chosen[3 * cell + predictor] = True
    (found,) = np.flatnonzero(turn_predictors(chosen, (3, 5), quarters))
    rows, columns = (3, 5) if quarters % 2 == 0 else (5, 3)
    place = np.array([[[found // 3 % columns + 0.5, found // 3 // columns + 0.5]] * 2])
    assert turn_back(place, (3, 5), quarters)[0, 0].tolist() == [cell % 5 + 0.5, cell // 5 + 0.5]
    assert found % 3 == predictor
    assert found // 3 < rows * columns


def test_views_are_joined_with_what_they_know() -> None:
    one = Segments(np.zeros((1, 2, 2)), np.array([0.5]), probabilities=np.array([[0.2, 0.8]]))
    two = Segments(np.ones((2, 2, 2)), np.array([0.1, 0.9]), probabilities=np.array([[1.0, 0.0], [0.0, 1.0]]))
    both = join_views([one, two])
    assert both.scores.tolist() == [0.5, 0.1, 0.9]
    assert both.labels.tolist() == [1, 0, 1]
    assert join_views([one]) is one


@pytest.mark.parametrize("rotations", [2, 4])
def test_every_view_finds_every_line_at_its_place(
    rotations: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The arithmetic model answers each cell alike in every view: each segment is there as often as views."""
    pytest.importorskip("onnx", reason="onnx builds the model of this test")
    header = striped_header(classes=("steep", "flat"))
    engine = OnnxEngine(make_striped_model(tmp_path_factory.mktemp("turned") / "a.onnx", header))
    image = np.zeros((300, 400, 3), np.uint8)
    image[40:44, 20:380] = image[100:280, 200:204] = 255
    once = Predictor(engine).segments(image)
    turned = Predictor(engine, replace(header, postprocess={**header.postprocess, "rotations": rotations}))
    found = turned.segments(image)
    assert len(found) == rotations * len(once)
    for middle in once.midpoints:
        assert (np.abs(found.midpoints - middle).max(axis=1) < 0.01).sum() == rotations
    assert len(turned(image)) == len(Predictor(engine)(image))


def test_only_windows_are_turned_and_only_squares_by_quarters(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    pytest.importorskip("onnx", reason="onnx builds the model of this test")
    header = striped_header(size=(128, 256))
    engine = OnnxEngine(make_striped_model(tmp_path_factory.mktemp("oblong") / "a.onnx", header))
    with pytest.raises(ValueError, match="no squares: use 2"):
        Predictor(engine, replace(header, postprocess={"rotations": 4}))
    with pytest.raises(ValueError, match="only windows are turned"):
        Predictor(engine, replace(header, fit="stretch", postprocess={"rotations": 2}))
    with pytest.raises(ValueError, match="rotations is 3, but must be 1, 2 or 4"):
        replace(header, postprocess={"rotations": 3})
