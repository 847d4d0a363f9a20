"""Results in the frame of the image: what `transform_points` gives, for any matrix."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.geometry import transform_points
from yolino.postprocess.mapping import map_polylines, map_segments
from yolino.types import Polylines, Segments

MATRICES = {
    "scaled and moved": np.array([[2.0, 0.0, 3.5], [0.0, 1.9, 80.25], [0.0, 0.0, 1.0]]),
    "times a number": np.array([[3.0, 0.0, 5.0], [0.0, 4.0, 7.0], [0.0, 0.0, 7.0]]),
    "turned": np.array([[0.0, -1.0, 10.0], [1.0, 0.0, 2.0], [0.0, 0.0, 1.0]]),
    "in perspective": np.array([[1.0, 0.1, 3.0], [0.2, 1.5, 4.0], [0.001, 0.002, 1.0]]),
}


@pytest.mark.parametrize("name", MATRICES)
@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 10**6), n=st.integers(0, 20))
def test_places_are_those_of_transform_points_and_nothing_else_changes(name: str, seed: int, n: int) -> None:
    rng, matrix = np.random.default_rng(seed), MATRICES[name]
    segments = Segments(rng.uniform(-50, 700, (n, 2, 2)), rng.random(n), rng.integers(3, size=n))
    mapped = map_segments(segments, matrix)
    np.testing.assert_array_equal(mapped.endpoints, transform_points(segments.endpoints, matrix))
    np.testing.assert_array_equal(mapped.scores, segments.scores)
    np.testing.assert_array_equal(mapped.labels, segments.labels)
    lines = Polylines(rng.uniform(-50, 700, (3 * n, 2)), np.arange(n + 1) * 3, probabilities=np.ones((n, 1)))
    moved = map_polylines(lines, matrix)
    np.testing.assert_array_equal(moved.vertices, transform_points(lines.vertices, matrix))
    np.testing.assert_array_equal(moved.offsets, lines.offsets)
    np.testing.assert_array_equal(moved.probabilities, lines.probabilities)


def test_points_may_be_read_only_and_in_any_order_in_memory() -> None:
    points = np.asfortranarray(np.arange(12.0).reshape(3, 2, 2))
    points.flags.writeable = False
    mapped = map_segments(Segments(points), MATRICES["scaled and moved"])
    np.testing.assert_array_equal(mapped.endpoints, transform_points(points, MATRICES["scaled and moved"]))
