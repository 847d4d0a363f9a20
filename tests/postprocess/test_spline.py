"""The spline is FITPACK's, and long chains take no longer per point than short ones."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import splev, splprep

from yolino.postprocess.spline import SmoothingSpline


def wave(seed: int, n: int, noise: float = 0.05) -> np.ndarray:
    rng = np.random.default_rng(seed)
    t = np.arange(n) * 0.9
    return np.column_stack([t, 3 * np.sin(t / 8)]) + rng.normal(0, noise, (n, 2))


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10**6), st.integers(3, 64), st.sampled_from([0.0, 0.01, 0.05, 1.0]), st.integers(2, 5))
def test_samples_are_those_of_splprep_and_splev(seed: int, n: int, smoothing: float, degree: int) -> None:
    points = wave(seed, n)
    (tck, _), *_ = splprep(points.T, k=min(degree, n - 1), s=smoothing, full_output=1)
    samples = SmoothingSpline(smoothing, 0.5, degree=degree)(points)
    expected = np.stack(splev(np.linspace(0, 1, len(samples)), tck), axis=1)
    np.testing.assert_allclose(samples, expected, atol=1e-7)


def test_the_sum_of_squared_distances_stays_within_the_bound() -> None:
    points = wave(0, 30)
    for smoothing in (0.01, 0.05):
        at = np.linalg.norm(points[:, None] - SmoothingSpline(smoothing, 0.001)(points), axis=2).min(axis=1)
        assert (at**2).sum() <= smoothing * 1.01
        assert (at**2).sum() > smoothing * 0.5


def test_two_points_give_a_line_and_three_a_parabola() -> None:
    line = SmoothingSpline(0.05, 1.0)(np.array([[0.0, 0.0], [3.0, 4.0]]))
    np.testing.assert_allclose(line, np.linspace((0, 0), (3, 4), 6))
    bow = SmoothingSpline(0.05, 0.01)(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 0.0]]))
    assert np.linalg.norm(bow - (1, 1), axis=1).min() < 0.01
    assert np.abs(np.diff(bow, 3, axis=0)).max() < 1e-9


@pytest.mark.parametrize("n", [65, 200, 1000])
def test_long_chains_are_as_smooth_where_windows_meet(n: int) -> None:
    points = wave(1, n, 0.03)
    samples = SmoothingSpline()(points)
    clean = np.interp(samples[:, 0], *wave(1, n, 0.0).T)
    assert np.abs(samples[:, 1] - clean).max() < 0.15
    steps = np.diff(samples, axis=0)
    assert np.linalg.norm(steps, axis=1).max() < 0.6
    turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    assert np.abs(turns).max() < 0.2


@pytest.mark.parametrize("spacing", [0.05, 0.5, 3.0])
def test_samples_are_at_most_the_spacing_apart(spacing: float) -> None:
    samples = SmoothingSpline(0.0, spacing)(wave(2, 40, 0.0))
    assert np.linalg.norm(np.diff(samples, axis=0), axis=1).max() <= spacing * 1.001


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"smoothing": -1.0}, "smoothing is -1.0"),
        ({"smoothing": np.nan}, "smoothing is nan"),
        ({"spacing": 0.0}, "spacing is 0.0"),
        ({"degree": 6}, "degree is 6"),
    ],
)
def test_bad_parameters_are_named(arguments: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SmoothingSpline(**arguments)
