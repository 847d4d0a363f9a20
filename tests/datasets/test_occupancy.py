from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.datasets.batch import Batch
from yolino.datasets.occupancy import Frame, occupancy
from yolino.datasets.report import Occupancy
from yolino.geometry import clip_polylines, fit_matrix, transform_points
from yolino.grid import Grid, discretize, surplus
from yolino.types import Polylines

SIZE = (60, 100)


def slow(batch: Batch, frame: Frame, stride: int, predictors: int) -> Occupancy:
    """Makes the segments of each image and counts them."""
    total = Occupancy(stride, predictors)
    for i, size in enumerate(batch.sizes):
        if size is None:
            continue
        lines = batch.lines[np.flatnonzero((batch.samples == i) & batch.finite)]
        if frame.size is None:
            lines = clip_polylines(lines, size)
            grid = Grid(tuple(-(-side // stride) * stride for side in size), stride)
        else:
            moved = transform_points(lines.vertices, frame.matrix(size))
            lines, grid = clip_polylines(lines.with_vertices(moved), frame.size), Grid(frame.size, stride)
        found = discretize(lines, grid, border=False)
        counts = np.unique(found.cells, axis=0, return_counts=True)[1]
        left = surplus(found, grid, predictors)
        total += Occupancy(stride, predictors, len(found), len(counts), int(counts.max(initial=0)), left)
    return total


def batch(*samples: list[object], sizes: list[tuple[int, int] | None] | None = None) -> Batch:
    polylines = [
        Polylines.from_list([np.array(line, float).reshape(-1, 2) for line in lines]) for lines in samples
    ]
    return Batch.of([str(i) for i in range(len(samples))], sizes or [SIZE] * len(samples), polylines)


def test_segments_are_counted_by_hand():
    lines = [[[1, y], [40, y]] for y in (1, 2, 3)]
    found = occupancy(batch(lines, lines), Frame(), (32, 16), 2)
    assert found == (Occupancy(32, 2, 12, 4, 3, 4), Occupancy(16, 2, 18, 6, 3, 6))


def test_visits_of_the_same_cell_count_each_time():
    there_and_back = [[[10, 10], [20, 10], [20, 12], [10, 12]]]  # 0 1 0, the vertices are no border
    assert occupancy(batch(there_and_back), Frame(), (16,), 1) == (Occupancy(16, 1, 3, 2, 2, 1),)


def test_images_of_unknown_size_and_vertices_that_are_no_numbers_do_not_count():
    line, broken = [[1, 1], [40, 1]], [[1, 1], [np.nan, 1]]
    found = occupancy(batch([line], [line, broken], sizes=[None, SIZE]), Frame(), (32,), 8)
    assert found == (Occupancy(32, 8, 2, 2, 1, 0),)


def test_nothing_is_zero():
    assert occupancy(batch(), Frame(), (32,), 8) == (Occupancy(32, 8),)
    assert occupancy(batch([], [[]], [[[1, 1]]]), Frame(), (32,), 8) == (Occupancy(32, 8),)


def test_occupancies_of_other_cells_do_not_add_up():
    assert Occupancy(8, 2, 1, 1, 5, 0) + Occupancy(8, 2, 2, 3, 4, 1) == Occupancy(8, 2, 3, 4, 5, 1)
    with pytest.raises(AssertionError):
        Occupancy(8, 2) + Occupancy(16, 2)


# Coordinates on, beside and far from the borders of cells of 4 and 16 pixels, inside and outside.
coordinate = st.one_of(
    st.integers(-3, 28).map(lambda i: 4.0 * i),
    st.integers(-3, 28).flatmap(
        lambda i: st.sampled_from([-1e-7, -3e-9, 3e-9, 1e-7]).map(lambda e: 4.0 * i + e)
    ),
    st.floats(-20, 120, width=32),
    st.floats(-1e4, 1e4),
)
line = st.lists(st.tuples(coordinate, coordinate), max_size=6)
samples = st.lists(st.lists(line, max_size=4), max_size=3)


@settings(max_examples=120, deadline=None)
@given(samples, st.sampled_from([(4, 16), (16,), (1,), (33,)]))
def test_counting_equals_making_the_segments(samples, strides):
    some = batch(*samples)
    found = occupancy(some, Frame(), strides, 1)
    assert found == tuple(slow(some, Frame(), stride, 1) for stride in strides)


@settings(max_examples=40, deadline=None)
@given(samples, st.sampled_from(["bottom", "letterbox", "stretch"]))
def test_counting_in_the_frame_of_the_network_equals_making_the_segments(samples, fit):
    sizes = [(60, 100), (100, 60), None]
    some = batch(*samples, sizes=[sizes[i % 3] for i in range(len(samples))])
    frame = Frame(lambda image: fit_matrix(image, (32, 64), fit), (32, 64))
    assert occupancy(some, frame, (8,), 2) == (slow(some, frame, 8, 2),)


def test_curves_of_thousands_of_vertices_are_counted_alike():
    rng = np.random.default_rng(0)
    walks = [np.cumsum(rng.normal(0, 2, (3000, 2)), axis=0) + 40 for _ in range(4)]
    some = batch(walks[:2], walks[2:])
    for stride in (4, 8, 32):
        assert occupancy(some, Frame(), (stride,), 3) == (slow(some, Frame(), stride, 3),)
