"""The B-splines and the jumps of their derivatives are those of scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from yolino.postprocess.bsplines import curve_point, derivative_jumps, evaluate_basis

DEGREES = [1, 2, 3, 4, 5]


def knots_of(seed: int, degree: int, inner: int) -> np.ndarray:
    places = np.sort(np.random.default_rng(seed).uniform(0.1, 6.9, inner))
    return np.concatenate([np.zeros(degree + 1), places, np.full(degree + 1, 7.0)])


def basis_of(knots: np.ndarray, at: np.ndarray, degree: int) -> tuple[np.ndarray, np.ndarray]:
    spans, values = np.empty(len(at), np.int64), np.empty((len(at), degree + 1))
    evaluate_basis(knots, at, spans, values)
    return spans, values


def test_between_two_knots_the_hats_are_straight() -> None:
    spans, values = basis_of(np.array([0.0, 0.0, 2.0, 3.0, 3.0]), np.array([0.5, 2.0, 3.0]), 1)
    np.testing.assert_array_equal(spans, [1, 2, 2])
    np.testing.assert_allclose(values, [[0.75, 0.25], [1.0, 0.0], [0.0, 1.0]])


@pytest.mark.parametrize("degree", DEGREES)
def test_the_values_are_those_of_scipy(degree: int) -> None:
    knots = knots_of(degree, degree, 9)
    at = np.sort(np.concatenate([knots[degree : -degree - 1], np.linspace(0, 7, 60)]))
    spans, values = basis_of(knots, at, degree)
    found = np.zeros((len(at), len(knots) - degree - 1))
    for i, span in enumerate(spans):
        found[i, span - degree : span + 1] = values[i]
    np.testing.assert_allclose(found, BSpline.design_matrix(at, knots, degree).toarray(), atol=1e-14)
    np.testing.assert_allclose(found.sum(axis=1), 1)


@pytest.mark.parametrize("degree", DEGREES)
def test_points_are_those_of_scipys_curve(degree: int) -> None:
    knots, at = knots_of(degree, degree, 6), np.linspace(0, 7, 31)
    coefficients = np.random.default_rng(degree).normal(size=(degree + 7, 2))
    spans, values = basis_of(knots, at, degree)
    points = [curve_point(spans, values, i, coefficients) for i in range(len(at))]
    np.testing.assert_allclose(points, BSpline(knots, coefficients, degree)(at), atol=1e-13)


@pytest.mark.parametrize("degree", DEGREES)
def test_jumps_are_proportional_to_those_of_the_highest_derivative(degree: int) -> None:
    knots = knots_of(degree + 10, degree, 7)
    jumps = derivative_jumps(knots, degree)
    assert jumps.shape == (7, degree + 2)
    expected = np.zeros_like(jumps)
    for row in range(7):
        knot = knots[degree + 1 + row]
        for column in range(degree + 2):
            coefficients = np.eye(degree + 8)[row + column]
            derivative = BSpline(knots, coefficients, degree).derivative(degree)
            expected[row, column] = derivative(knot + 1e-9) - derivative(knot - 1e-9)
    np.testing.assert_allclose(jumps / jumps[0, 0], expected / expected[0, 0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("degree", DEGREES)
def test_jumps_have_no_unit_and_polynomials_have_none(degree: int) -> None:
    knots = knots_of(degree, degree, 5)
    jumps = derivative_jumps(knots, degree)
    np.testing.assert_allclose(derivative_jumps(knots * 1000, degree), jumps, rtol=1e-9)
    line = np.array([knots[i + 1 : i + degree + 1].mean() for i in range(degree + 6)])  # of u -> u
    for row in range(5):
        assert abs(jumps[row] @ line[row : row + degree + 2]) < 1e-9 * np.abs(jumps[row]).max()
