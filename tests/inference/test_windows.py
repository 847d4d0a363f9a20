from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from striped_model import striped_header
from yolino.inference.windows import (
    Window,
    WindowPlan,
    drop_invalid,
    join_segments,
    owned_predictors,
    plan_windows,
)
from yolino.types import Segments


def test_a_plan_by_hand() -> None:
    """400 pixels, windows of 256 that share 64: the second begins at 160 instead of 192, moved inwards."""
    plan = WindowPlan((100, 400), (256, 256), 64)
    assert list(plan) == [Window(0, 0, (0, 0, 192, 128)), Window(160, 0, (192, 0, 416, 128))]
    assert plan[1] == list(plan)[1]
    with pytest.raises(IndexError):
        plan[2]


@st.composite
def plans(draw: st.DrawFn) -> WindowPlan:
    window = tuple(draw(st.integers(1, 9)) * 32 + draw(st.sampled_from([0, 16])) for _ in range(2))
    steps = [edge // 32 for edge in window]
    overlap = draw(st.integers(0, min(steps) - 1))
    offset = tuple(draw(st.integers(0, step - overlap - 1)) * 32 for step in steps)
    extent = draw(st.integers(1, 900)), draw(st.integers(1, 900))
    return WindowPlan(extent, window, 32 * overlap, offset)


@given(plans())
@settings(deadline=None)
def test_each_cell_of_the_scene_is_owned_once_by_a_window_that_shows_it(plan: WindowPlan) -> None:
    header = dataclasses.replace(striped_header(), size=plan.window, predictors=2)
    rows, columns = (-(-edge // 16) for edge in plan.extent)
    owners = np.zeros((rows + 40, columns + 40), np.int64)
    for window in plan:
        owned = owned_predictors(window, header).reshape(plan.window[0] // 16, plan.window[1] // 16, 2)
        assert (owned[:, :, 0] == owned[:, :, 1]).all()
        for row, column in np.argwhere(owned[:, :, 0]):
            y, x = window.top // 16 + row, window.left // 16 + column
            assert y >= 0
            assert x >= 0
            owners[y, x] += 1
    assert (owners[:rows, :columns] == 1).all()


@given(plans())
@settings(deadline=None)
def test_neighbors_share_the_overlap_and_lie_on_the_grid(plan: WindowPlan) -> None:
    for axis, edge in ((0, plan.window[1]), (1, plan.window[0])):
        starts = sorted({window[axis] for window in plan})
        assert all(start % 32 == 0 for start in starts)
        assert all(b > a and a + edge - b >= plan.overlap for a, b in pairwise(starts))
        assert starts[-1] + edge >= plan.extent[1 - axis] or len(starts) == 1


def test_inner_cores_keep_half_the_overlap_away_from_the_edges() -> None:
    for window in WindowPlan((2000, 2000), (512, 512), 128):
        left, top, right, bottom = window.core
        assert left == 0 or left - window.left >= 64
        assert top == 0 or top - window.top >= 64
        assert right >= 2000 or window.left + 512 - right >= 64
        assert bottom >= 2000 or window.top + 512 - bottom >= 64


def test_the_scale_and_the_default_overlap() -> None:
    header = striped_header((512, 512), scale=0.5)
    plan = plan_windows((1000, 3), header)
    assert (plan.extent, plan.overlap) == ((500, 2), 128)
    assert plan_windows((9, 9), striped_header((2048, 1024))).overlap == 256
    assert plan_windows((9, 9), striped_header((2048, 2048))).overlap == 256
    assert plan_windows((1001, 4), header).extent == (501, 2)
    assert plan_windows((9, 9), striped_header((64, 640))).overlap == 0
    assert plan_windows((9, 9), striped_header((256, 256))).overlap == 64
    tenth = plan_windows((30_000, 10), striped_header((256, 256), scale=0.1))
    assert tenth.extent == (3000, 1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((9, 9), (128, 128), 100), "multiple of 32 from 0 to 96"),
        (((9, 9), (128, 128), 128), "from 0 to 96"),
        (((9, 9), (128, 128), -32), "from 0 to 96"),
        (((9, 0), (128, 128), 0), "must be positive"),
        (((9, 9), (16, 128), 0), "too small"),
        (((9, 9), (128, 128), 32, (96, 0)), "less than a step"),
        (((9, 9), (128, 128), 32, (0, 7)), "multiples of 32"),
    ],
)
def test_what_does_not_fit_is_refused(arguments: tuple, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        WindowPlan(*arguments)


def test_segments_are_joined_in_one_order_and_those_beyond_the_scene_dropped() -> None:
    header = striped_header(scale=0.5)
    rng = np.random.default_rng(0)
    every = Segments(rng.uniform(-10, 60, (50, 2, 2)), rng.uniform(size=50))
    joined = join_segments([every[:20], every[20:]], (100, 80), header)
    again = join_segments([every[35:], every[:0], every[:35]], (100, 80), header)
    np.testing.assert_array_equal(joined.endpoints, again.endpoints)
    np.testing.assert_array_equal(joined.scores, again.scores)
    inside = [0 <= x <= 40 and 0 <= y <= 50 for x, y in every.midpoints]
    assert sorted(joined.scores) == sorted(every.scores[inside])
    assert len(join_segments([], (5, 5), header)) == 0


def test_probabilities_are_joined() -> None:
    header = striped_header(classes=("a", "b"))
    shares = np.array([[0.9, 0.1], [0.2, 0.8]])
    parts = [
        Segments([[[5, 5], [6, 6]]], probabilities=shares[:1]),
        Segments(np.zeros((0, 2, 2))),
        Segments([[[1, 1], [2, 2]]], probabilities=shares[1:]),
    ]
    joined = join_segments(parts, (9, 9), header)
    np.testing.assert_array_equal(
        joined.probabilities, shares[[1, 0]] if joined.starts[0, 0] == 1 else shares
    )
    assert sorted(joined.labels) == [0, 1]
    assert join_segments([], (9, 9), header).probabilities.shape == (0, 2)
    with pytest.raises(ValueError, match="no class probabilities"):
        join_segments([Segments([[[1, 1], [2, 2]]])], (9, 9), header)


def test_segments_without_valid_pixels_are_dropped() -> None:
    valid = np.zeros((10, 20), np.bool_)
    valid[:, :8] = True
    segments = Segments([[[2, 3], [4, 5]], [[8, 0], [9, 1]], [[-3, 2], [-1, 2]], [[19, 19], [25, 25]]])
    np.testing.assert_array_equal(drop_invalid(segments, valid).starts, [[2, 3], [-3, 2]])
    assert drop_invalid(segments, None) is segments
