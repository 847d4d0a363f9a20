from __future__ import annotations

import numpy as np
import pytest

from yolino.viz import PALETTE, direction_colors, draw_legend, draw_scale, draw_wheel, palette, score_colors
from yolino.viz.strokes import Canvas
from yolino.viz.text import draw_text, text_width


def shown_colors(image: Canvas, colors: np.ndarray) -> np.ndarray:
    """Tells of each color whether some pixel has nearly it."""
    pixels = np.unique(image.reshape(-1, 3), axis=0).astype(int)
    return np.array([np.abs(pixels - color).sum(axis=1).min() < 40 for color in colors.astype(int)])


def test_the_legend_has_a_line_per_class_in_its_color() -> None:
    image = np.full((200, 300, 3), 128, np.uint8)
    shown = draw_legend(image, ["solid", "dashed"])
    changed = np.flatnonzero((shown != 128).any(axis=(1, 2)))
    assert changed.max() == 199
    assert changed.min() >= 150
    upper, lower = shown[changed.min() : 180].reshape(-1, 3), shown[185:].reshape(-1, 3)
    for part, color in ((upper, PALETTE[0]), (lower, PALETTE[1])):
        assert np.abs(part.astype(int) - color).sum(axis=1).min() < 60


def test_a_legend_names_what_occurs() -> None:
    image = np.full((300, 400, 3), 128, np.uint8)
    shown = draw_legend(image, ["a", "b", "c"], labels=np.array([2, 0, 2, 9]))
    alone = draw_legend(image, ["a", "c", "class 9"])
    np.testing.assert_array_equal((shown != 128).any(axis=2), (alone != 128).any(axis=2))
    assert shown_colors(shown, palette(np.array([0, 2, 9]))).all()
    assert not shown_colors(shown, palette(np.array([1]))).any()
    np.testing.assert_array_equal(draw_legend(image, []), image)
    np.testing.assert_array_equal(draw_legend(image, ["a"], labels=np.zeros(0, np.int64)), image)


@pytest.mark.parametrize("count", [8, 30, 64])
def test_more_classes_than_colors_or_rows_are_named_in_columns(count: int) -> None:
    image = np.full((400, 600, 3), 128, np.uint8)
    shown = draw_legend(image, [f"class {i}" for i in range(count)])
    assert shown_colors(shown, palette(np.arange(count))).all()
    assert (shown[:, 400:] == 128).all()


def test_what_finds_no_place_is_counted() -> None:
    image = np.full((60, 300, 3), 128, np.uint8)
    shown = draw_legend(image, [f"class {i}" for i in range(64)])
    assert shown.shape == image.shape
    assert (shown[0] != 128).any()


def test_the_wheel_has_each_direction_where_it_leads() -> None:
    """A square of 800 px has a ring of 80 px, 6 px from the corner: its middle is (754, 46)."""
    image = np.full((800, 800, 3), 128, np.uint8)
    for directed in (True, False):
        drawn = draw_wheel(image, directed=directed)
        y, x = np.nonzero((drawn != 128).any(axis=2))
        assert (x.min(), x.max(), y.min(), y.max()) == (714, 793, 6, 85)
        for k in range(16):
            way = np.array([np.cos(k * np.pi / 8), np.sin(k * np.pi / 8)])
            x, y = np.floor(np.array([754, 46]) + 0.66 * 40 * way).astype(int)
            color = direction_colors(np.array([[x + 0.5 - 754, y + 0.5 - 46]]), directed=directed)[0]
            np.testing.assert_array_equal(drawn[y, x], color)
    assert (image == 128).all()


def test_the_scale_goes_from_zero_to_one() -> None:
    image = np.full((300, 600, 3), 128, np.uint8)
    drawn = draw_scale(image)
    assert shown_colors(drawn, score_colors(np.array([0.0, 0.25, 0.5, 0.75, 1.0]))).all()
    assert (drawn[20:] == 128).all()
    assert (drawn[:, :300] == 128).all()


@pytest.mark.parametrize("size", [(1, 1), (3, 2000), (2000, 3), (5, 5), (40, 30)])
def test_keys_can_be_drawn_on_any_image(size: tuple[int, int]) -> None:
    image = np.full(size, 7, np.uint8)
    for drawn in (draw_wheel(image), draw_scale(image), draw_legend(image, ["one", "two"])):
        assert drawn.shape == (*size, 3)
        assert drawn.dtype == np.uint8
    assert (image == 7).all()


def test_keys_that_would_cover_more_than_a_quarter_are_left_out() -> None:
    """The smallest wheel has 24 px: on 47 px it would cover 26 %, on 48 px it covers 25 %."""
    tiny = np.full((47, 47, 3), 7, np.uint8)
    for drawn in (draw_wheel(tiny), draw_scale(tiny), draw_legend(tiny, ["one", "two", "three"])):
        np.testing.assert_array_equal(drawn, tiny)
    assert (draw_wheel(np.full((48, 48, 3), 7, np.uint8)) != 7).any()
    for edge in range(40, 400, 30):
        image = np.full((edge, edge, 3), 7, np.uint8)
        names = [f"class {i}" for i in range(20)]
        for drawn in (draw_wheel(image), draw_scale(image), draw_legend(image, names)):
            assert (drawn != 7).any(axis=2).mean() <= 0.27  # "+ 3 more" lies beside the columns


def test_text_is_cut_to_the_room_there_is_and_grows_with_its_height() -> None:
    canvas = np.zeros((40, 100, 3), np.uint8)
    assert draw_text(canvas, "short", (0, 0), (255, 255, 255), 20) < 100
    assert draw_text(canvas, "very much longer than that", (0, 20), (255, 255, 255), 20) <= 100
    assert text_width("width", 80) > 3.5 * text_width("width", 20)
    assert text_width("é", 20) == text_width("e", 20)
    assert text_width("路", 20) == text_width("?", 20)
