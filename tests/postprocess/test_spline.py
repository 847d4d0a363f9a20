"""The spline is FITPACK's, one chain or many at once, and long chains are blended from windows of it."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import splev, splprep

from yolino.postprocess.spline import SmoothingSpline


def wave(seed: int, n: int, noise: float = 0.05) -> np.ndarray:
    rng = np.random.default_rng(seed)
    t = np.arange(n) * 0.9
    return np.column_stack([t, 3 * np.sin(t / 8)]) + rng.normal(0, noise, (n, 2))


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10**6), st.integers(3, 24), st.sampled_from([0.0, 0.05, 1.0]), st.integers(1, 5))
def test_samples_are_those_of_splprep_and_splev(seed: int, n: int, smoothing: float, degree: int) -> None:
    points = wave(seed, n)
    (tck, _), *_ = splprep(points.T, k=min(degree, n - 1), s=smoothing, full_output=1)
    samples = SmoothingSpline(smoothing, 0.5, degree=degree)(points)
    expected = np.stack(splev(np.linspace(0, 1, len(samples)), tck), axis=1)
    assume((np.abs(expected - np.clip(expected, points.min(axis=0), points.max(axis=0))) < 2).all())
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


def windows_twin(points: np.ndarray, spacing: float) -> np.ndarray:
    """Gives splprep's curves through each 64 points, 16 of them shared, and fades where they overlap."""
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    even = np.linspace(0, at[-1], int(np.ceil(at[-1] / spacing)) + 1)
    total, weights = np.zeros((len(even), 2)), np.zeros((len(even), 1))
    for first in range(0, len(points) - 16, 48):
        last = min(first + 64, len(points))
        (tck, _), *_ = splprep(points[first:last].T, u=at[first:last], s=0.05, full_output=1)
        inside = np.flatnonzero((even >= at[first]) & (even <= at[last - 1]))
        shared = np.count_nonzero(weights[inside])
        fade = np.ones((len(inside), 1))
        fade[:shared, 0] = np.arange(1, shared + 1) / (shared + 1)
        weights[inside] = 1
        total[inside] = total[inside] * (1 - fade) + fade * np.stack(splev(even[inside], tck), axis=1)
    return total


@pytest.mark.parametrize("spacing", [0.2, 0.5, 3.0, 40.0])
@pytest.mark.parametrize("n", [64, 65, 80, 112, 113, 300])
def test_long_chains_are_splines_of_windows_that_fade_into_each_other(n: int, spacing: float) -> None:
    points = wave(n, n, 0.04)
    samples = SmoothingSpline(0.05, spacing)(points)
    np.testing.assert_allclose(samples, windows_twin(points, spacing), atol=1e-6)


def test_many_chains_at_once_are_as_one_by_one() -> None:
    chains = [wave(seed, n) for seed, n in enumerate([2, 150, 3, 4, 64, 65, 20])]
    offsets = np.cumsum([0, *(len(chain) for chain in chains)])
    chosen = np.array([6, 0, 1, 2, 4, 5])
    spline = SmoothingSpline()
    samples, starts = spline.smooth(np.concatenate(chains), offsets, chosen)
    assert starts[0] == 0
    assert starts[-1] == len(samples)
    for i, index in enumerate(chosen):
        np.testing.assert_array_equal(samples[starts[i] : starts[i + 1]], spline(chains[index]))


def test_no_chain_has_no_samples() -> None:
    samples, starts = SmoothingSpline().smooth(wave(0, 9), np.array([0, 9]), np.zeros(0, np.int64))
    assert samples.shape == (0, 2)
    np.testing.assert_array_equal(starts, [0])


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


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 2)),
        np.ones((1, 2)),
        np.ones((2, 2)),
        np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [2.0, 0.0]]),
        np.array([[0.0, 0.0], [np.nan, 0.0], [2.0, 0.0]]),
        np.array([[0.0, 0.0], [np.inf, 0.0]]),
    ],
)
def test_points_that_make_no_chain_are_refused(points: np.ndarray) -> None:
    with pytest.raises(ValueError, match="points must be at least two"):
        SmoothingSpline()(points)


def test_points_may_be_read_only_and_in_any_order_in_memory() -> None:
    points = wave(3, 20)
    expected = SmoothingSpline()(points)
    for other in (np.asfortranarray(points), np.repeat(points, 2, axis=0)[::2]):
        other.flags.writeable = False
        np.testing.assert_array_equal(SmoothingSpline()(other), expected)


def test_linking_loads_no_interpolation_of_scipy() -> None:
    code = (
        "import sys, yolino.postprocess; print([name for name in sys.modules if name.startswith('scipy.i')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_curve_that_shoots_away_is_replaced_by_the_straight_pieces() -> None:
    """With this much noise FITPACK's knots leave a part of the curve to nothing."""
    replaced = 0
    for seed in range(150):
        points = wave(seed, 40, noise=0.2)
        (tck, _), *_ = splprep(points.T, s=0.05, full_output=1)
        samples = SmoothingSpline(0.05, 0.5)(points)
        expected = np.stack(splev(np.linspace(0, 1, len(samples)), tck), axis=1)
        low, high = points.min(axis=0) - 2, points.max(axis=0) + 2
        assert ((samples >= low) & (samples <= high)).all()
        if ((expected < low) | (expected > high)).any():
            replaced += 1
            at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
            even = np.linspace(0, at[-1], len(samples))
            straight = np.stack([np.interp(even, at, column) for column in points.T], axis=1)
            np.testing.assert_allclose(samples, straight, atol=1e-9)
    assert replaced > 0
