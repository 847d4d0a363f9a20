"""The order of segments is that of all their numbers, whatever order they came in."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.postprocess.sorting import sort_rows, sort_segments


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10**6), st.integers(0, 60), st.integers(1, 6))
def test_rows_are_sorted_like_words_and_stably(seed: int, n: int, columns: int) -> None:
    rows = np.random.default_rng(seed).integers(0, 3, (n, columns)).astype(float)
    np.testing.assert_array_equal(sort_rows(rows), np.lexsort(rows.T[::-1]))


def test_segments_are_sorted_with_all_that_belongs_to_them() -> None:
    rng = np.random.default_rng(0)
    endpoints, scores = rng.integers(0, 2, (40, 2, 2)).astype(float), rng.integers(0, 2, 40).astype(float)
    labels, votes = rng.integers(0, 2, 40), rng.random((40, 3))
    order = np.lexsort(np.column_stack([endpoints.reshape(40, 4), scores, labels]).T[::-1])
    for found, given_values in zip(
        sort_segments(endpoints, scores, labels, votes, 16.0), (endpoints / 16, scores, votes), strict=True
    ):
        np.testing.assert_array_equal(found, given_values[order])
