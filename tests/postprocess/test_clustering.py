"""The clusters are those of scikit-learn, whatever the points, the weights and the density."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.cluster import DBSCAN

from yolino.postprocess.clustering import dbscan

seeds = st.integers(0, 10**6)


def same(a: np.ndarray, b: np.ndarray) -> bool:
    """Tells whether labels agree up to numbering; noise must be noise."""
    pairs = set(zip(a.tolist(), b.tolist(), strict=True))
    return len(pairs) == len({p for p, _ in pairs}) == len({q for _, q in pairs}) and (-1, -1) in pairs | {
        (-1, -1)
    }


def check(
    points: np.ndarray, epsilon: float, min_samples: int, weights: np.ndarray | None = None
) -> np.ndarray:
    expected = DBSCAN(eps=epsilon, min_samples=min_samples).fit(points, sample_weight=weights).labels_
    labels = dbscan(points, epsilon, min_samples, weights)
    np.testing.assert_array_equal(labels == -1, expected == -1)
    assert same(labels, expected)
    return labels


@settings(deadline=None, max_examples=150)
@given(seeds, st.integers(1, 120), st.integers(1, 6), st.integers(1, 8), st.sampled_from([1, 2, 5, 20]))
def test_clusters_on_a_lattice_with_duplicates_and_exact_distances(
    seed: int, n: int, d: int, min_samples: int, extent: int
) -> None:
    points = np.random.default_rng(seed).integers(0, extent + 1, (n, d)).astype(float)
    check(points, 1.0 if seed % 2 else 2.0, min_samples)


@settings(deadline=None, max_examples=150)
@given(seeds, st.integers(1, 300), st.integers(1, 6), st.integers(1, 8), st.floats(0.02, 3))
def test_clusters_of_dense_blobs_and_noise(
    seed: int, n: int, d: int, min_samples: int, spread: float
) -> None:
    rng = np.random.default_rng(seed)
    centers = rng.uniform(0, 10, (max(n // 60, 1), d))
    points = centers[rng.integers(len(centers), size=n)] + rng.normal(0, spread, (n, d))
    check(np.concatenate([points, rng.uniform(0, 10, (n // 10, d))]), 1.0, min_samples)


@settings(deadline=None, max_examples=150)
@given(
    seeds,
    st.integers(1, 200),
    st.integers(1, 5),
    st.integers(1, 6),
    st.sampled_from(["any", "few", "negative"]),
)
def test_clusters_with_weights(seed: int, n: int, d: int, min_samples: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    weights = {
        "any": rng.uniform(0, 2, n) ** 10,
        "few": rng.integers(0, 5, n) / 4,
        "negative": rng.integers(-4, 9, n) / 4,
    }[kind]
    weights[0] = weights[0] or 1.0  # scikit-learn refuses weights that are all zero
    check(rng.normal(0, rng.uniform(0.1, 2), (n, d)), 0.7, min_samples, weights)


def test_a_border_point_belongs_to_the_cluster_whose_first_core_point_comes_first() -> None:
    left, right = [[-2.0], [-1.75], [-1.5], [-1.0]], [[1.0], [1.5], [1.75], [2.0]]
    border = [[0.0]]
    for points in (
        left + right + border,
        right + left + border,
        border + right + left,
        border + left + right,
    ):
        labels = check(np.array(points), 1.0, 4)
        assert labels.max() == 1
        assert labels[points.index([0.0])] == 0


def test_points_exactly_epsilon_apart_are_neighbors() -> None:
    assert dbscan(np.array([[0.0, 0.0], [3.0, 4.0]]), 5.0, 2).tolist() == [0, 0]
    assert dbscan(np.array([[0.0, 0.0], [3.0, 4.0]]), np.nextafter(5.0, 0), 2).tolist() == [-1, -1]


@pytest.mark.parametrize("min_samples", [2, 5])
def test_thousands_of_points_within_one_radius(min_samples: int) -> None:
    rng = np.random.default_rng(0)
    heap = np.concatenate([rng.normal(0, 0.1, (2000, 5)), rng.normal((0, 0, 0, 0, 1.5), 0.1, (2000, 5))])
    labels = check(heap, 0.5, min_samples)
    assert labels.max() >= 1


def test_points_far_from_the_origin_and_tiny_radii() -> None:
    rng = np.random.default_rng(0)
    check(rng.integers(0, 30, (200, 2)) / 2**20 + 2.0**20, 2.0**-20, 2)


def test_no_points_and_one_point() -> None:
    assert dbscan(np.zeros((0, 3)), 1.0, 1).tolist() == []
    assert dbscan(np.zeros((1, 3)), 1.0, 1).tolist() == [0]
    assert dbscan(np.zeros((1, 3)), 1.0, 2).tolist() == [-1]
    assert dbscan(np.zeros((1, 3)), 1.0, 2, np.array([2.0])).tolist() == [0]
    assert dbscan(np.zeros((3, 0)), 1.0, 3).tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    ("points", "epsilon", "min_samples", "weights", "message"),
    [
        ([[0.0]], 0.0, 1, None, "epsilon is 0.0"),
        ([[0.0]], np.nan, 1, None, "epsilon is nan"),
        ([[0.0]], 1.0, 0, None, "min_samples is 0"),
        ([[np.nan]], 1.0, 1, None, "NaN or infinity"),
        ([[0.0]], 1.0, 1, [np.inf], "NaN or infinity"),
        ([[0.0], [1e300]], 1.0, 1, None, "choose a larger one"),
    ],
)
def test_bad_input_is_named(
    points: list, epsilon: float, min_samples: int, weights: list | None, message: str
) -> None:
    given_weights = None if weights is None else np.array(weights)
    with pytest.raises(ValueError, match=message):
        dbscan(np.array(points), epsilon, min_samples, given_weights)
