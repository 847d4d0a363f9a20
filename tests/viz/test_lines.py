from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from yolino.types import Polylines, Segments
from yolino.viz import (
    HIT,
    PALETTE,
    direction_colors,
    draw_points,
    draw_polylines,
    draw_segments,
    find_junctions,
)
from yolino.viz.colors import luminance
from yolino.viz.heads import arrow_axes


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


def noise(height: int = 120, width: int = 160) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (height, width, 3)).astype(np.uint8)


BACKGROUNDS = {"black": canvas(), "gray": canvas(gray=100), "white": canvas(gray=255), "noise": noise()}


@pytest.mark.parametrize("background", BACKGROUNDS)
@pytest.mark.parametrize("thickness", [1, 3, 9])
@pytest.mark.parametrize("color_by", ["label", "score", "direction"])
def test_lines_show_on_any_background(background: str, thickness: int, color_by: str) -> None:
    """Across a line, the brightest pixel and the darkest differ, and one of them from what is around."""
    image = BACKGROUNDS[background]
    for k in range(12):
        way, middle = 50 * np.array([np.cos(k * np.pi / 6), np.sin(k * np.pi / 6)]), np.array([80.5, 60.5])
        line = Polylines.from_list([np.stack([middle - way, middle + way])], [k / 11], [k])
        drawn = draw_polylines(image, line, color_by=color_by, arrows=False, thickness=thickness)
        across = np.array([-way[1], way[0]]) / 50
        at = middle + np.arange(-thickness, thickness + 0.1, 0.5)[:, None] * across
        x, y = np.floor(at).astype(int).T
        seen = luminance(drawn[y, x]) + 0.05
        around = float(luminance(image).mean()) + 0.05
        assert seen.max() / seen.min() > 2.5
        assert max(seen.max() / around, around / seen.min()) > 2


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


def head_pixels(length: float, thickness: int) -> int:
    line = Polylines.from_list([[[30.0, 60.0], [30.0 + length, 60.0]]])
    plain = draw_polylines(canvas(), line, arrows=False, thickness=thickness)
    return int(changed(plain, draw_polylines(canvas(), line, thickness=thickness)).sum())


def test_heads_are_no_longer_than_half_of_a_short_line_and_do_not_clutter_it() -> None:
    """Thickness 3 has an outline to 5: no head below 5 px, so none on lines below 10 px."""
    assert head_pixels(9.0, 3) == 0
    assert 0 < head_pixels(12.0, 3) < head_pixels(30.0, 3) < head_pixels(100.0, 3)
    assert head_pixels(7.0, 1) > 0
    line = Polylines.from_list([[[30.0, 60.0], [60.0, 60.0]]])
    heads = changed(
        draw_polylines(canvas(), line, arrows=False, thickness=3), draw_polylines(canvas(), line, thickness=3)
    )
    columns = np.flatnonzero(heads.any(axis=0))
    assert columns.max() - columns.min() + 1 <= 15 + 8  # half of it, and the outline of the head


def test_heads_are_evenly_spaced_and_on_every_polyline() -> None:
    """Thickness 1 has heads of 10 px, one every 120 px: tips at (k + .5)/3 * 350 + 10 of a line of 360."""
    lines = Polylines.from_list([[[20.0, 30.0], [380.0, 30.0]], np.zeros((0, 2)), [[20.0, 80], [80, 80]]])
    axes, rows = arrow_axes(lines, 1)
    np.testing.assert_allclose(axes[:3, 1, 0], 20 + (np.arange(3) + 0.5) / 3 * 350 + 10)
    np.testing.assert_allclose(axes[3], [[45.0, 80.0], [55.0, 80.0]])
    np.testing.assert_array_equal(rows, [0, 0, 0, 1])
    np.testing.assert_allclose(axes[:, 1] - axes[:, 0], [[10.0, 0.0]] * 4)


def test_heads_follow_the_bends_of_a_polyline() -> None:
    bent = Polylines.from_list([[[0.0, 0.0], [0.0, 0.0], [9.0, 0.0], [9.0, 11.0]]])
    axes, rows = arrow_axes(bent, 1)
    np.testing.assert_allclose(axes, [[[5.0, 0.0], [9.0, 6.0]]])
    assert rows.tolist() == [2]


def test_thickness_follows_the_image() -> None:
    def width(height: int, columns: int) -> int:
        line = Polylines.from_list([[[0.0, height / 2], [float(columns), height / 2]]])
        image = canvas(height, columns, 128)
        return int(changed(image, draw_polylines(image, line, arrows=False))[:, columns // 2].sum())

    small, hd, huge = width(90, 160), width(720, 1280), width(2160, 3840)
    assert small <= 7
    assert small < hd <= 10
    assert 13 <= huge <= 24


def test_many_lines_are_drawn_thinner() -> None:
    """A square of 1800 px has lines of 6 px, 10 with the outline: sixty of them would cover a third."""
    image = canvas(1800, 1800, 128)

    def covered(count: int, **options: int) -> float:
        lines = Polylines.from_list(
            [[[0.0, y], [1800.0, y]] for y in (np.arange(count) + 0.5) * 1800 / count]
        )
        return float(changed(image, draw_polylines(image, lines, arrows=False, **options)).mean())

    assert 10 <= covered(1) * 1800 <= 15
    assert covered(60) < 0.6 * covered(60, thickness=6)


def fork() -> Polylines:
    """Two lines fork from a third at (60, 60); a fourth goes on where the third began."""
    return Polylines.from_list(
        [[[20, 60], [60, 60]], [[60, 60], [100, 30]], [[60, 60], [100, 90]], [[20, 20], [20, 60]]]
    )


def test_junctions_are_where_three_ways_of_several_lines_meet() -> None:
    np.testing.assert_array_equal(find_junctions(fork()), [[60, 60]])
    merged = Polylines.from_list([[[0, 0], [50, 0], [90, 0]], [[20, 30], [50, 0]]])
    np.testing.assert_array_equal(find_junctions(merged), [[50, 0]])
    eight = Polylines.from_list([[[0, 0], [5, 5], [10, 0], [5, 5], [0, 10]], np.zeros((0, 2)), [[7, 7]]])
    assert len(find_junctions(eight)) == 0
    assert find_junctions(Polylines.from_list([])).shape == (0, 2)


def test_lines_upon_each_other_have_no_junctions_but_where_others_join() -> None:
    way = np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 5.0], [30.0, 5.0]])
    assert len(find_junctions(Polylines.from_list([way, way[::-1]]))) == 0
    joined = Polylines.from_list([way, way[::-1], [[10.0, 20.0], [20.0, 5.0]]])
    np.testing.assert_array_equal(find_junctions(joined), [[20, 5]])


def test_junctions_are_marked_if_asked() -> None:
    plain = draw_polylines(canvas(), fork(), arrows=False)
    marked = draw_polylines(canvas(), fork(), arrows=False, junctions=True)
    y, x = np.nonzero(changed(plain, marked))
    assert np.hypot(x + 0.5 - 60, y + 0.5 - 60).max() < 5
    np.testing.assert_array_equal(marked[60, 60], [255, 255, 255])


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
    np.testing.assert_array_equal(drawn[80, 80], direction_colors(np.array([[0.0, -1.0]]))[0])
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
