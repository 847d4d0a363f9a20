from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from yolino.types import Polylines, Segments
from yolino.viz import HIT, PALETTE, draw_points, draw_polylines, draw_segments


def canvas(height: int = 120, width: int = 160, gray: int = 0) -> np.ndarray:
    return np.full((height, width, 3), gray, np.uint8)


def changed(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    return (before != after).any(axis=2)


def straight(y: float = 60.0) -> Polylines:
    return Polylines.from_list([[[20.0, y], [140.0, y]]])


def test_the_image_is_not_changed_and_gray_is_accepted() -> None:
    image = canvas()
    draw_polylines(image, straight())
    draw_segments(image, Segments(straight().endpoints))
    draw_points(image, straight().vertices, HIT)
    assert not image.any()
    assert draw_polylines(image[:, :, 0], straight()).shape == (120, 160, 3)


def test_a_line_is_drawn_where_it_is() -> None:
    """At y = 60, the edge of two rows, both are colored alike; at y = 60.5 the middle of a row is."""
    between = draw_polylines(canvas(), straight(60.0), arrows=False, thickness=2)
    np.testing.assert_allclose(between[59, 40:120].astype(int), between[60, 40:120], atol=8)
    assert (np.abs(between[59:61, 80].astype(int) - PALETTE[0]) < 90).all()
    centered = draw_polylines(canvas(), straight(60.5), arrows=False, thickness=1)
    assert np.abs(centered[60, 80].astype(int) - PALETTE[0]).max() < 60
    rows = np.flatnonzero(changed(canvas(), centered)[:, 80])
    assert rows.min() == 120 - rows.max()
    assert len(rows) <= 7
    assert not changed(canvas(), centered)[:, :15].any()
    assert not changed(canvas(), centered)[:, 145:].any()


@pytest.mark.parametrize("gray", [0, 128, 255])
def test_lines_show_on_any_background(gray: int) -> None:
    drawn = draw_polylines(canvas(gray=gray), straight(), thickness=3).astype(int)
    column = drawn[50:70, 60]
    assert np.abs(column - np.array(PALETTE[0])).max(axis=1).min() < 10
    assert column.sum(axis=1).min() < 3 * 60


def test_arrow_heads_point_along_the_line() -> None:
    forth = changed(draw_polylines(canvas(), straight(), arrows=False), draw_polylines(canvas(), straight()))
    widths = forth.sum(axis=0)
    head = np.flatnonzero(widths)
    assert len(head) > 5
    middle = head.mean()
    assert widths[int(middle) - 3 : int(middle)].sum() > widths[int(middle) + 1 : int(middle) + 4].sum()
    flipped = Polylines.from_list([line[::-1] for line in straight()])
    back = changed(draw_polylines(canvas(), flipped, arrows=False), draw_polylines(canvas(), flipped))
    np.testing.assert_array_equal(np.sort(back.sum(axis=0))[-5:], np.sort(widths)[-5:])
    assert np.abs(back[:, ::-1].sum(axis=0).astype(int) - widths).max() <= 3
    plain = draw_polylines(canvas(), straight(), directed=False)
    np.testing.assert_array_equal(plain, draw_polylines(canvas(), straight(), arrows=False))


def test_every_line_that_is_long_enough_has_a_head() -> None:
    for length in (8.0, 20.0, 100.0):
        line = Polylines.from_list([[[30.0, 60.0], [30.0 + length, 60.0]]])
        assert (draw_polylines(canvas(), line) != draw_polylines(canvas(), line, arrows=False)).any()


def test_thickness_follows_the_image() -> None:
    def width(height: int, columns: int) -> int:
        line = Polylines.from_list([[[0.0, height / 2], [float(columns), height / 2]]])
        image = canvas(height, columns, 128)
        return int(changed(image, draw_polylines(image, line, arrows=False))[:, columns // 2].sum())

    small, hd, huge = width(90, 160), width(720, 1280), width(2160, 3840)
    assert small <= 7
    assert small < hd <= 10
    assert 13 <= huge <= 24


def test_the_best_score_lies_on_top() -> None:
    cross = Polylines.from_list([[[20.0, 60.5], [140, 60.5]], [[80.5, 10], [80.5, 110]]], scores=[0.9, 0.1])
    drawn = draw_polylines(canvas(), cross, arrows=False, thickness=5)
    np.testing.assert_array_equal(drawn[60, 80], PALETTE[0])
    turned = draw_polylines(
        canvas(), Polylines(cross.vertices, cross.offsets, [0.1, 0.9]), arrows=False, thickness=5
    )
    np.testing.assert_array_equal(turned[60, 80], PALETTE[1])


def test_colors_by_label_and_direction() -> None:
    lines = Polylines.from_list([[[20.0, 30.5], [140, 30.5]], [[140, 90.5], [20.0, 90.5]]], labels=[2, 2])
    by_label = draw_polylines(canvas(), lines, color_by="label", arrows=False, thickness=5)
    np.testing.assert_array_equal(by_label[30, 80], PALETTE[2])
    np.testing.assert_array_equal(by_label[90, 80], PALETTE[2])
    by_direction = draw_polylines(canvas(), lines, color_by="direction", arrows=False, thickness=5)
    np.testing.assert_array_equal(by_direction[30, 80], [255, 38, 38])
    np.testing.assert_array_equal(by_direction[90, 80], [38, 255, 255])


def test_segments_show_their_direction_as_a_hue() -> None:
    segments = Segments(np.array([[[20.0, 30.5], [140, 30.5]], [[80.5, 110], [80.5, 60]]]))
    drawn = draw_segments(canvas(), segments, thickness=5)
    np.testing.assert_array_equal(drawn[30, 80], [255, 38, 38])
    np.testing.assert_array_equal(drawn[80, 80], [147, 38, 255])
    assert (draw_segments(canvas(), segments, arrows=True) != draw_segments(canvas(), segments)).any()


@pytest.mark.parametrize("color_by", ["identity", "label", "direction", "score"])
def test_nothing_to_draw_is_fine(color_by: str) -> None:
    image = canvas(gray=7)
    np.testing.assert_array_equal(draw_polylines(image, Polylines.from_list([]), color_by=color_by), image)
    np.testing.assert_array_equal(
        draw_segments(image, Segments(np.zeros((0, 2, 2))), color_by=color_by), image
    )
    np.testing.assert_array_equal(draw_points(image, np.zeros((0, 2)), HIT), image)
    single = Polylines.from_list([[[5.0, 5.0]], np.zeros((0, 2)), [[3.0, 3.0], [3.0, 3.0]]])
    assert draw_polylines(image, single, color_by=color_by).shape == image.shape


def test_lines_far_outside_are_cut_off() -> None:
    line = Polylines.from_list([[[-1e5, 60.5], [1e5, 60.5]], [[1e9, 1e9], [2e9, 1e9]]])
    drawn = draw_polylines(canvas(), line, thickness=3)
    assert changed(canvas(), drawn)[60].all()


DRAW: list[Callable[[np.ndarray], np.ndarray]] = [
    lambda points: draw_polylines(canvas(), Polylines.from_list([points])),
    lambda points: draw_segments(canvas(), Segments(points[None])),
    lambda points: draw_points(canvas(), points, HIT),
]


@pytest.mark.parametrize("draw", DRAW)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_points_that_are_not_finite_are_refused(
    draw: Callable[[np.ndarray], np.ndarray], value: float
) -> None:
    with pytest.raises(ValueError, match="NaN or infinite"):
        draw(np.array([[1.0, 2.0], [3.0, value]]))


@pytest.mark.parametrize("thickness", [0, -1, 1001])
def test_an_impossible_thickness_is_refused(thickness: int) -> None:
    with pytest.raises(ValueError, match=f"thickness is {thickness}, but must be 'auto' or 1 to 1000"):
        draw_polylines(canvas(), straight(), thickness=thickness)


def test_an_unknown_coloring_is_refused() -> None:
    with pytest.raises(ValueError, match="color_by is 'length'"):
        draw_polylines(canvas(), straight(), color_by="length")


def test_an_image_of_floats_is_refused() -> None:
    with pytest.raises(ValueError, match="float64"):
        draw_polylines(np.zeros((5, 5, 3)), straight())


@settings(max_examples=30, deadline=None)
@given(
    vertices=arrays.arrays(np.float64, (6, 2), elements=st.floats(-1e4, 1e4)),
    size=st.tuples(st.integers(1, 60), st.integers(1, 60)),
)
def test_any_polyline_can_be_drawn_on_any_image(vertices: np.ndarray, size: tuple[int, int]) -> None:
    lines = Polylines.from_list([vertices[:4], vertices[4:]])
    for color_by in ("identity", "direction", "score"):
        assert draw_polylines(canvas(*size), lines, color_by=color_by).shape == (*size, 3)


def test_dots_are_round_and_centered() -> None:
    drawn = draw_points(canvas(), np.array([[50.5, 40.5]]), (10, 200, 30), radius=4)
    mask = changed(canvas(), drawn)
    y, x = np.nonzero(mask)
    assert (y.mean(), x.mean()) == (40, 50)
    np.testing.assert_array_equal(mask[20:61, 30:71], mask[20:61, 30:71].T)
    np.testing.assert_array_equal(drawn[40, 50], [10, 200, 30])
