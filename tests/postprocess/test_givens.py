"""The rotations solve banded least squares as numpy does, in whatever order equations of a column come."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yolino.postprocess.givens import rotate_in, solve


def banded(seed: int, rows: int, columns: int, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gives the coefficients of equations in a band, the column of each where it begins, and right sides."""
    rng = np.random.default_rng(seed)
    extra = rng.integers(0, columns - width + 1, max(rows - columns, 0))
    firsts = np.sort(np.concatenate([np.minimum(np.arange(columns), columns - width), extra]))
    return rng.normal(size=(len(firsts), width)), firsts, rng.normal(size=(len(firsts), 2))


def triangle_of(
    band: np.ndarray, firsts: np.ndarray, sides: np.ndarray, weights: np.ndarray, columns: int
) -> np.ndarray:
    triangle = np.zeros((columns, band.shape[1] + 2))
    for row, first, side, weight in zip(band, firsts, sides, weights, strict=True):
        rotate_in(np.concatenate([row, side]), float(weight), int(first), triangle)
    return triangle


def dense(band: np.ndarray, firsts: np.ndarray, columns: int) -> np.ndarray:
    matrix = np.zeros((len(band), columns))
    for i, first in enumerate(firsts):
        matrix[i, first : first + band.shape[1]] = band[i]
    return matrix


def test_one_unknown_is_the_weighted_mean() -> None:
    triangle = np.zeros((1, 3))
    rotate_in(np.array([1.0, 2.0, 10.0]), 1.0, 0, triangle)
    rotate_in(np.array([1.0, 6.0, 30.0]), 3.0, 0, triangle)
    np.testing.assert_allclose(triangle, [[4.0, 5.0, 25.0]])
    np.testing.assert_allclose(solve(triangle), [[5.0, 25.0]])


@settings(deadline=None, max_examples=80)
@given(st.integers(0, 10**6), st.integers(6, 30), st.integers(0, 40), st.integers(1, 6))
def test_the_solution_is_that_of_numpy(seed: int, columns: int, more: int, width: int) -> None:
    band, firsts, sides = banded(seed, columns + more, columns, width)
    weights = np.random.default_rng(seed).uniform(0.1, 3, len(band))
    found = solve(triangle_of(band, firsts, sides, weights, columns))
    matrix, root = dense(band, firsts, columns), np.sqrt(weights)[:, None]
    condition = np.linalg.cond(matrix * root)
    if condition < 1e7:
        expected = np.linalg.lstsq(matrix * root, sides * root, rcond=None)[0]
        np.testing.assert_allclose(
            found, expected, rtol=0, atol=1e-14 * condition**2 * np.abs(expected).max()
        )


@pytest.mark.parametrize("width", [2, 4])
def test_the_triangle_is_the_cholesky_factor_of_the_normal_equations(width: int) -> None:
    band, firsts, sides = banded(3, 30, 12, width)
    triangle = triangle_of(band, firsts, sides, np.ones(len(band)), 12)
    unit = np.eye(12)
    for j in range(12):
        for q in range(1, min(width, 12 - j)):
            unit[j, j + q] = triangle[j, q]
    matrix = dense(band, firsts, 12)
    np.testing.assert_allclose(unit.T * triangle[:, 0] @ unit, matrix.T @ matrix, atol=1e-10)


def test_the_order_of_equations_that_begin_together_does_not_matter() -> None:
    band, firsts, sides = banded(5, 40, 10, 4)
    order = np.lexsort([np.random.default_rng(0).random(len(band)), firsts])
    one = triangle_of(band, firsts, sides, np.ones(len(band)), 10)
    other = triangle_of(band[order], firsts[order], sides[order], np.ones(len(band)), 10)
    np.testing.assert_allclose(one, other, atol=1e-9)
