"""Candidates to segments: what numpy's own indexing gives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.postprocess.thresholding import segments_above


@settings(deadline=None)  # it is compiled at the first call
@given(
    st.integers(0, 10**6),
    st.integers(0, 40),
    st.integers(0, 3),
    st.sampled_from([0.0, 0.3, 0.49, 0.5, 0.9, 1.0]),
)
def test_it_is_an_index_and_a_cast(seed: int, n: int, classes: int, threshold: float) -> None:
    rng = np.random.default_rng(seed)
    endpoints = rng.normal(100, 50, (n, 2, 2)).astype(np.float32)
    scores = rng.choice(np.array([0.0, 0.3, 0.49, 0.5, 0.9, 1.0], np.float32), n)
    probabilities = rng.random((n, classes)).astype(np.float32) if classes else None
    found = segments_above(endpoints, scores, probabilities, threshold)
    kept = np.flatnonzero(scores >= threshold)
    np.testing.assert_array_equal(found.endpoints, endpoints[kept].astype(np.float64))
    np.testing.assert_array_equal(found.scores, scores[kept].astype(np.float64))
    if probabilities is None:
        assert found.probabilities is None
    else:
        np.testing.assert_array_equal(found.probabilities, probabilities[kept].astype(np.float64))
        np.testing.assert_array_equal(found.labels, probabilities[kept].argmax(axis=1))


def test_end_points_must_be_finite_only_where_they_are_used() -> None:
    endpoints = np.zeros((3, 2, 2), np.float32)
    endpoints[1, 0, 1] = np.inf
    scores = np.array([0.9, 0.2, 0.8], np.float32)
    assert len(segments_above(endpoints, scores, None, 0.5)) == 2
    with pytest.raises(ValueError, match="not finite"):
        segments_above(endpoints, scores, None, 0.1)


def test_class_probabilities_must_be_finite_too() -> None:
    shares = np.full((2, 3), 0.3, np.float32)
    shares[1, 2] = np.nan
    scores = np.array([0.9, 0.2], np.float32)
    assert len(segments_above(np.zeros((2, 2, 2), np.float32), scores, shares, 0.5)) == 1
    with pytest.raises(ValueError, match="not finite"):
        segments_above(np.zeros((2, 2, 2), np.float32), scores, shares, 0.1)


@pytest.mark.parametrize("threshold", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_scores_that_are_no_numbers_are_told(place: int, threshold: float) -> None:
    endpoints = np.zeros((3, 2, 2), np.float32)
    for wrong in (np.nan, -np.nan, np.inf):
        scores = np.array([0.9, 0.2, 0.8], np.float32)
        scores[place] = wrong
        with pytest.raises(ValueError, match="gave end points, scores or class probabilities that"):
            segments_above(endpoints, scores, None, threshold)


def test_predictors_that_are_masked_are_no_mistake() -> None:
    scores = np.array([-1, 0.7, -1], np.float32)
    assert segments_above(np.zeros((3, 2, 2), np.float32), scores, None, 0.5).scores == pytest.approx([0.7])
    assert len(segments_above(np.zeros((3, 2, 2), np.float32), np.full(3, -1, np.float32), None, 0.0)) == 0
