"""Least squares of banded equations with two right sides, by Givens rotations without square roots.

Equations are taken in one by one. Together they come to a unit upper triangle of weighted equations: row j
of `triangle` holds the weight, then the coefficients of the columns behind column j, then the right sides. A
row of zeros is free.

Source: W. M. Gentleman, "Least squares computations by Givens transformations without square roots", Journal
of the Institute of Mathematics and its Applications 12 (1973).
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled


@compiled
@no_type_check
def rotate_in(equation, weight, first, triangle):
    """Takes in an equation: its coefficients from column `first` on, then its right sides.

    It is overwritten. No equation before may reach beyond its last column.
    """
    width = len(equation) - 2
    for i in range(width):
        pivot, j = equation[i], first + i
        if pivot == 0.0:
            continue
        before = triangle[j, 0]
        after = before + weight * pivot * pivot
        kept, taken = before / after, weight * pivot / after
        triangle[j, 0] = after
        weight *= kept
        for q in range(1, width - i):
            upper, lower = triangle[j, q], equation[i + q]
            triangle[j, q], equation[i + q] = kept * upper + taken * lower, lower - pivot * upper
        for q in range(width, width + 2):
            upper, lower = triangle[j, q], equation[q]
            triangle[j, q], equation[q] = kept * upper + taken * lower, lower - pivot * upper
        if weight == 0.0:  # the row was free: nothing is left of the equation
            return


@compiled
@no_type_check
def solve(triangle):
    """Gives the solution for both right sides, from the last row upwards."""
    width, solution = triangle.shape[1] - 2, np.empty((len(triangle), 2))
    for j in range(len(triangle) - 1, -1, -1):
        x, y = triangle[j, width], triangle[j, width + 1]
        for q in range(1, min(width, len(triangle) - j)):
            x -= triangle[j, q] * solution[j + q, 0]
            y -= triangle[j, q] * solution[j + q, 1]
        solution[j, 0], solution[j, 1] = x, y
    return solution
