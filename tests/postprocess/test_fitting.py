"""The smoothing spline is that of FITPACK: the same knots and coefficients as `scipy.interpolate.splprep`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline, splprep

from yolino.postprocess.fitting import fit_spline

KINDS = ("walk", "line", "noisy line", "noisy arc", "wave")
BOUNDS = (0.0, 0.001, 0.05, 1.0, 100.0)


def chain_of(kind: str, rng: np.random.Generator, n: int) -> np.ndarray:
    if kind == "walk":
        return np.cumsum(rng.normal(0, 1, (n, 2)), axis=0)
    if kind == "wave":
        t = np.cumsum(rng.uniform(0.3, 1.3, n))
        return np.column_stack([t, 3 * np.sin(t / rng.uniform(1, 8))]) + rng.normal(0, 0.05, (n, 2))
    if kind == "noisy arc":
        angle = np.linspace(0, rng.uniform(0.1, 6), n)
        circle = rng.uniform(1, 20) * np.column_stack([np.cos(angle), np.sin(angle)])
        return circle + rng.normal(0, 0.08, (n, 2))
    line = np.linspace(0, 1, n)[:, None] * rng.normal(0, 20, 2)
    return line if kind == "line" else line + rng.normal(0, 0.05, (n, 2))


def arc_lengths(points: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def twin(at: np.ndarray, points: np.ndarray, degree: int, smoothing: float) -> tuple[np.ndarray, np.ndarray]:
    (tck, _), *_ = splprep(points.T, u=at, k=degree, s=smoothing, full_output=1)
    return tck[0], np.stack(tck[1], axis=1)


def is_twin(at: np.ndarray, points: np.ndarray, degree: int, smoothing: float) -> bool:
    knots, coefficients = fit_spline(at, points, degree, smoothing)
    knots2, coefficients2 = twin(at, points, degree, smoothing)
    if len(knots) != len(knots2) or not np.allclose(knots, knots2, rtol=1e-12, atol=0):
        return False
    return bool(np.abs(coefficients - coefficients2).max() <= 1e-8 * np.abs(coefficients2).max())


def sum_of_squares(at: np.ndarray, points: np.ndarray, degree: int, smoothing: float) -> float:
    curve = BSpline(*fit_spline(at, points, degree, smoothing), degree)(at)
    return float(((curve - points) ** 2).sum())


def near_the_bound(at: np.ndarray, points: np.ndarray, degree: int, smoothing: float) -> bool:
    """Says whether another branch, taken because of rounding, led to a curve as good as scipy's."""
    knots, coefficients = twin(at, points, degree, smoothing)
    theirs = float(((BSpline(knots, coefficients, degree)(at) - points) ** 2).sum())
    return sum_of_squares(at, points, degree, smoothing) <= max(1.0011 * smoothing, 1.0001 * theirs)


@settings(deadline=None, max_examples=150)
@given(
    st.sampled_from(KINDS),
    st.integers(0, 10**6),
    st.integers(2, 24),
    st.sampled_from(BOUNDS),
    st.integers(1, 5),
)
def test_short_chains_get_scipys_knots_and_coefficients(
    kind: str, seed: int, n: int, smoothing: float, degree: int
) -> None:
    points = chain_of(kind, np.random.default_rng(seed), n)
    at, degree = arc_lengths(points), min(degree, n - 1)
    assert is_twin(at, points, degree, smoothing) or near_the_bound(at, points, degree, smoothing)


def test_almost_all_of_many_chains_get_scipys_knots_and_coefficients() -> None:
    rng = np.random.default_rng(0)
    others = 0
    for i in range(2000):
        points = chain_of(KINDS[i % len(KINDS)], rng, int(rng.integers(4, 65)))
        at, degree = arc_lengths(points), min(int(rng.integers(1, 6)), len(points) - 1)
        smoothing = float(rng.choice(BOUNDS))
        if not is_twin(at, points, degree, smoothing):
            others += 1
            assert near_the_bound(at, points, degree, smoothing)
    assert others <= 10


@pytest.mark.parametrize("share", [0.9985, 0.995, 0.9])
def test_a_bound_just_below_the_polynomials_sum_is_met_as_scipy_meets_it(share: float) -> None:
    rng = np.random.default_rng(1)
    others = 0
    for i in range(300):
        points = chain_of(KINDS[i % len(KINDS)], rng, int(rng.integers(4, 40)))
        at, degree = arc_lengths(points), min(int(rng.integers(1, 6)), len(points) - 1)
        bound = share * sum_of_squares(at, points, degree, 1e9)
        if bound > 1e-6:
            others += not is_twin(at, points, degree, bound)
    assert others <= 3


def test_real_lane_markings_get_scipys_knots_and_coefficients(tusimple_root: Path) -> None:
    lines = (tusimple_root / "label_data_0313.json").read_text().splitlines()[:40]
    count = 0
    for frame in map(json.loads, lines):
        for lane in frame["lanes"]:
            rows = [(x, y) for x, y in zip(lane, frame["h_samples"], strict=True) if x >= 0]
            points = np.array(rows, float).reshape(-1, 2) / 16
            if len(points) > 3:
                for smoothing in (0.0, 0.05):
                    assert is_twin(arc_lengths(points), points, 3, smoothing)
                    count += 1
    assert count > 100


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
def test_without_smoothing_the_curve_passes_through_all_points(degree: int) -> None:
    points = chain_of("wave", np.random.default_rng(degree), 30)
    assert sum_of_squares(arc_lengths(points), points, degree, 0.0) < 1e-20


@pytest.mark.parametrize("smoothing", [0.01, 0.05, 0.5])
def test_the_sum_of_squares_is_the_bound_to_a_thousandth(smoothing: float) -> None:
    points = chain_of("wave", np.random.default_rng(1), 40)
    assert abs(sum_of_squares(arc_lengths(points), points, 3, smoothing) / smoothing - 1) < 1e-3


def test_a_loose_bound_leaves_the_best_polynomial() -> None:
    points = chain_of("wave", np.random.default_rng(2), 20)
    at = arc_lengths(points)
    knots, coefficients = fit_spline(at, points, 3, 1e6)
    assert len(knots) == 8
    for k in range(2):
        expected = np.polynomial.Polynomial.fit(at, points[:, k], 3)(at)
        np.testing.assert_allclose(BSpline(knots, coefficients[:, k], 3)(at), expected, atol=1e-10)


def test_turning_moving_and_scaling_the_points_does_the_same_to_the_curve() -> None:
    points = chain_of("wave", np.random.default_rng(3), 30)
    turn, scale, move = np.array([[0.6, 0.8], [-0.8, 0.6]]), 7.0, np.array([30.0, -4.0])
    at = arc_lengths(points)
    knots, coefficients = fit_spline(at, points, 3, 0.05)
    other = points @ turn * scale + move
    knots2, coefficients2 = fit_spline(at * scale, other, 3, 0.05 * scale**2)
    np.testing.assert_allclose(knots2, knots * scale, rtol=1e-12)
    np.testing.assert_allclose(coefficients2, coefficients @ turn * scale + move, rtol=1e-7)


def test_points_that_are_not_finite_end_the_search() -> None:
    points = chain_of("wave", np.random.default_rng(4), 12)
    points[5, 0] = np.nan
    assert np.isnan(fit_spline(np.arange(12.0), points, 3, 0.05)[1]).any()
