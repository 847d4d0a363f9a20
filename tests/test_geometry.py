from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.geometry import (
    clip_polylines,
    clip_segments,
    cumulative_length,
    distance_to_segments,
    resample,
    sample_segments,
    transform_points,
)
from yolino.types import Polylines

SIZE = (10, 20)
point = st.tuples(st.floats(-30, 50), st.floats(-30, 40))


def test_transform_points_divides_by_the_third_coordinate():
    matrix = np.array([[2.0, 0.0, 3.0], [0.0, 1.0, -1.0], [0.1, 0.0, 1.0]])
    np.testing.assert_allclose(transform_points(np.array([10.0, 4.0]), matrix), [23 / 2, 3 / 2])
    points = np.arange(12.0).reshape(2, 3, 2)
    expected = [[transform_points(p, matrix) for p in row] for row in points]
    np.testing.assert_allclose(transform_points(points, matrix), expected)


def test_transform_points_and_its_inverse_cancel():
    matrix = np.array([[0.5, 0.1, 3.0], [-0.2, 0.7, -40.0], [1e-4, 2e-4, 1.0]])
    points = np.random.default_rng(0).uniform(0, 700, (50, 2))
    back = transform_points(transform_points(points, matrix), np.linalg.inv(matrix))
    np.testing.assert_allclose(back, points, atol=1e-8)


def test_cumulative_length():
    assert cumulative_length(np.array([[0.0, 0], [3, 4], [3, 4], [3, 10]])).tolist() == [0, 5, 5, 11]
    assert cumulative_length(np.zeros((0, 2))).tolist() == []


def test_resample_keeps_the_ends_and_the_spacing():
    found = resample(np.array([[0.0, 0], [3, 4], [3, 10]]), 1.0)
    assert len(found) == 12
    np.testing.assert_allclose(found[[0, 5, -1]], [[0, 0], [3, 4], [3, 10]])
    np.testing.assert_allclose(np.hypot(*np.diff(found, axis=0).T), 1.0)


def test_resample_rounds_the_spacing_down():
    np.testing.assert_allclose(np.diff(resample(np.array([[0.0, 0], [10, 0]]), 3.0)[:, 0]), 2.5)


def test_resample_of_a_polyline_without_length_is_its_place():
    assert resample(np.array([[2.0, 3]]), 1.0).tolist() == [[2, 3]]
    assert resample(np.array([[2.0, 3], [2, 3]]), 1.0).tolist() == [[2, 3]]


@pytest.mark.parametrize(
    ("vertices", "spacing"), [(np.zeros((0, 2)), 1.0), (np.zeros((2, 2)), 0.0), (np.zeros((2, 2)), -1.0)]
)
def test_resample_names_what_it_cannot_do(vertices, spacing):
    with pytest.raises(ValueError, match=r"vertex|positive"):
        resample(vertices, spacing)


def test_clip_segments_cuts_at_all_four_borders():
    segments = np.array([[[-5.0, 5], [25, 5]], [[10, 20], [10, -20]], [[-5, 0], [5, 10]], [[3, 3], [4, 4]]])
    parts, index = clip_segments(segments, SIZE)
    expected = [[[0, 5], [20, 5]], [[10, 10], [10, 0]], [[0, 5], [5, 10]], [[3, 3], [4, 4]]]
    np.testing.assert_allclose(parts, expected)
    assert index.tolist() == [0, 1, 2, 3]


def test_clip_segments_drops_what_lies_outside_or_only_touches():
    outside = np.array([[[-5.0, -1], [25, -1]], [[-5, 5], [5, -5]], [[21, 2], [21, 8]], [[-5, 5], [0, 5]]])
    assert len(clip_segments(outside, SIZE)[0]) == 0


def test_clip_segments_keeps_what_runs_along_a_border():
    along = np.array([[[-5.0, 0], [25, 0]], [[20, 10], [20, 2]]])
    np.testing.assert_array_equal(clip_segments(along, SIZE)[0], [[[0, 0], [20, 0]], [[20, 10], [20, 2]]])


@settings(deadline=None)
@given(st.lists(st.tuples(point, point), min_size=1, max_size=5))
def test_clip_segments_agrees_with_dense_sampling(segments):
    segments = np.array(segments)
    parts, index = clip_segments(segments, SIZE)
    t = np.linspace(0, 1, 2001)[:, None]
    for i, (start, end) in enumerate(segments):
        points = start + t * (end - start)
        inside = np.all((points >= 0) & (points <= (SIZE[1], SIZE[0])), axis=1)
        row = np.flatnonzero(index == i)
        # What is shorter than clipping can divide by is a point to it.
        if inside.sum() > 1 and np.abs(end - start).max() > 1e-290:
            step = np.hypot(*(end - start)) / 2000
            first, last = points[inside][[0, -1]]
            np.testing.assert_allclose(parts[row[0]], [first, last], atol=step + 1e-9)
        elif not inside.any() and len(row):
            assert np.hypot(*(parts[row[0], 1] - parts[row[0], 0])) <= np.hypot(*(end - start)) / 1000


def test_clip_polylines_splits_where_a_polyline_leaves_and_keeps_score_and_label():
    polylines = Polylines.from_list(
        [[[-4, -4], [-2, -4]], [[1, 5], [8, 5], [8, -5], [12, -5], [12, 5], [15, 5]], [[1, 1], [2, 2]]],
        scores=[0.1, 0.5, 0.9],
        labels=[0, 1, 2],
    )
    found = clip_polylines(polylines, SIZE)
    assert [p.tolist() for p in found] == [
        [[1, 5], [8, 5], [8, 0]],
        [[12, 0], [12, 5], [15, 5]],
        [[1, 1], [2, 2]],
    ]
    assert found.labels.tolist() == [1, 1, 2]
    assert found.scores.tolist() == [0.5, 0.5, 0.9]
    assert found.probabilities is None
    shares = [[1.0, 0.0], [0.2, 0.8], [0.4, 0.6]]
    known = Polylines(polylines.vertices, polylines.offsets, polylines.scores, polylines.labels, shares)
    assert clip_polylines(known, SIZE).probabilities.tolist() == [shares[1], shares[1], shares[2]]


def test_clip_polylines_drops_what_has_no_length_inside():
    none = Polylines.from_list([[], [[3, 3]], [[3, 3], [3, 3]], [[-1, 5], [0, 5]], [[30, 30], [40, 40]]])
    assert len(clip_polylines(none, SIZE)) == 0
    assert len(clip_polylines(Polylines.from_list([]), SIZE)) == 0


def test_sample_segments_stand_for_their_length():
    points, weights = sample_segments(
        np.array([[[0.0, 0], [3, 0]], [[5, 5], [5, 5]], [[0, 1], [0, 1.5]]]), 1.0
    )
    np.testing.assert_allclose(points, [[0.5, 0], [1.5, 0], [2.5, 0], [5, 5], [0, 1.25]])
    np.testing.assert_allclose(weights, [1, 1, 1, 0, 0.5])


def test_distance_to_segments_equals_a_loop_over_dense_points():
    rng = np.random.default_rng(1)
    points, segments = rng.uniform(0, 50, (40, 2)), rng.uniform(0, 50, (30, 2, 2))
    segments[0, 1] = segments[0, 0]
    dense = segments[:, :1] + np.linspace(0, 1, 4001)[:, None] * (segments[:, 1:] - segments[:, :1])
    expected = [np.hypot(*(dense.reshape(-1, 2) - p).T).min() for p in points]
    np.testing.assert_allclose(distance_to_segments(points, segments), expected, atol=0.01)
    assert distance_to_segments(points[:2], segments[:0]).tolist() == [np.inf, np.inf]


def test_distance_to_segments_is_the_same_in_blocks(monkeypatch):
    rng = np.random.default_rng(2)
    points, segments = rng.uniform(0, 50, (40, 2)), rng.uniform(0, 50, (30, 2, 2))
    whole = distance_to_segments(points, segments)
    monkeypatch.setattr("yolino.geometry._PAIRS", 100)
    np.testing.assert_array_equal(distance_to_segments(points, segments), whole)


@pytest.mark.parametrize("shape", [(2,), (5, 2), (3, 2, 2), (0, 2)])
def test_scaling_and_moving_is_a_homography_too(shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(6)
    points = rng.normal(100, 50, shape)
    for w in (1.0, 2.5):
        matrix = np.array([[0.5, 0.0, 30.0], [0.0, 3.0, -7.0], [0.0, 0.0, w]])
        padded = np.concatenate([points, np.ones((*shape[:-1], 1))], axis=-1) @ matrix.T
        np.testing.assert_allclose(transform_points(points, matrix), padded[..., :2] / padded[..., 2:])
