from __future__ import annotations

import numpy as np
import pytest

from yolino.grid import Grid
from yolino.types import Segments
from yolino.viz import PALETTE, cell_edge, draw_cells, readable_zoom

GRID = Grid((96, 128), 32)
NONE = Segments(np.zeros((0, 2, 2)))


def plain(value: int, size: tuple[int, int] = (96, 128)) -> np.ndarray:
    return np.full((*size, 3), value, np.uint8)


def pair() -> Segments:
    return Segments([[[2.0, 16.5], [30.0, 16.5]], [[66.0, 80.5], [94.0, 80.5]]])


@pytest.mark.parametrize("value", [0, 60, 128, 255])
def test_the_grid_differs_from_any_background(value: int) -> None:
    changed = np.abs(draw_cells(plain(value), NONE, GRID).astype(int) - value)
    rows = np.flatnonzero(changed.all(axis=(1, 2)))
    columns = np.flatnonzero(changed.all(axis=(0, 2)))
    np.testing.assert_array_equal(rows, [31, 63, 95])
    np.testing.assert_array_equal(columns, [31, 63, 95, 127])
    assert changed.max() == 45
    assert changed[rows].min() == 45


def test_the_grid_is_brighter_all_over_a_dark_image_but_where_it_is_bright() -> None:
    image = plain(60)
    image[:, 64:] = 140
    drawn = draw_cells(image, NONE, GRID)
    assert (drawn[31, [10, 110], 0] == [105, 185]).all()
    image[:, 100:] = 250
    assert (draw_cells(image, NONE, GRID)[31, [10, 120], 0] == [105, 205]).all()


@pytest.mark.parametrize("value", [0, 255])
def test_cells_with_segments_are_shaded(value: int) -> None:
    drawn = draw_cells(plain(value), pair(), GRID).astype(int)
    inside = np.abs(drawn - value)
    assert (inside[2:8, 4:30] == 40).all()
    assert (inside[66:72, 68:94] == 40).all()
    assert (inside[4:28, 36:60] == 0).all()


def test_segments_have_the_color_of_their_predictor() -> None:
    drawn = draw_cells(plain(128), pair(), GRID, predictors=np.array([4, 1]), directed=False, thickness=3)
    np.testing.assert_array_equal(drawn[16, 10], PALETTE[4])
    np.testing.assert_array_equal(drawn[80, 74], PALETTE[1])
    by_direction = draw_cells(plain(128), pair(), GRID, thickness=3)
    np.testing.assert_array_equal(by_direction[16, 8], [255, 38, 38])


def test_cells_lie_where_the_matrix_puts_them() -> None:
    """The network sees the lower 192 rows of 200, halved: cells of 64 px, from row 8 on."""
    matrix = np.array([[2.0, 0.0, 0.0], [0.0, 2.0, 8.0], [0.0, 0.0, 1.0]])
    drawn = draw_cells(plain(0, (200, 256)), NONE, GRID, matrix=matrix)
    rows = np.flatnonzero(drawn.all(axis=(1, 2)))
    assert (drawn[:7] == 0).all()
    np.testing.assert_allclose(rows, np.array([8, 72, 136, 200])[: len(rows)], atol=1)
    assert cell_edge(GRID, matrix) == 64
    held = draw_cells(plain(0, (200, 256)), Segments([[[70.0, 80.0], [120.0, 80.0]]]), GRID, matrix=matrix)
    assert (held[100:130, 70:120] == 40).all()
    assert (held[20:60, 70:120] == 0).all()


def test_small_images_are_enlarged() -> None:
    image = np.arange(8 * 8 * 3, dtype=np.uint8).reshape(8, 8, 3)
    drawn = draw_cells(image, NONE, Grid((8, 8), 8), zoom=8)
    assert drawn.shape == (64, 64, 3)
    assert np.abs(drawn[20:24, 20:24].astype(int) - image[2, 2]).max() == 0
    assert readable_zoom((64, 64), 4.0) == 16
    assert readable_zoom((64, 64), 100.0) == 1
    assert readable_zoom((2000, 10), 4.0) == 2
    assert readable_zoom((9000, 10), 4.0) == 1


def test_the_image_stays_and_gray_is_accepted() -> None:
    image = np.full((96, 128), 200, np.uint8)
    drawn = draw_cells(image, pair(), GRID)
    assert drawn.shape == (96, 128, 3)
    assert drawn.dtype == np.uint8
    assert (image == 200).all()


@pytest.mark.parametrize("size", [(1, 1), (3, 300), (300, 3)])
def test_images_of_any_size_and_segments_outside_can_be_drawn(size: tuple[int, int]) -> None:
    far = Segments([[[-1e6, 4.0], [1e6, 4.0]], [[500.0, 500.0], [600.0, 600.0]]])
    assert draw_cells(plain(0, size), far, GRID).shape == (*size, 3)


def test_impossible_arguments_are_refused() -> None:
    with pytest.raises(ValueError, match="got zoom 0 and no predictors of 2 segments"):
        draw_cells(plain(0), pair(), GRID, zoom=0)
    with pytest.raises(ValueError, match="1 predictors of 2 segments"):
        draw_cells(plain(0), pair(), GRID, predictors=np.array([3]))
    with pytest.raises(ValueError, match="NaN or infinite"):
        draw_cells(plain(0), Segments([[[0.0, 1.0], [np.nan, 2.0]]]), GRID)
