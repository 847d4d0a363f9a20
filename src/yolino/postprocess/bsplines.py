"""B-splines: their values, points of curves made of them, and how a curve's highest derivative jumps.

A curve of degree k with n coefficients has n + k + 1 knots that never decrease; the first k + 1 and the last
k + 1 lie at its ends. Source: C. de Boor, "A Practical Guide to Splines" (2001), chapters IX and X.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled


@compiled
@no_type_check
def evaluate_basis(knots, parameters, spans, values):
    """Writes the values of the k + 1 B-splines that are not 0 at each of increasing parameters.

    Row i of `values` is for the B-splines `spans[i] - k` to `spans[i]`; knots `spans[i]` and the next one
    enclose the parameter.
    """
    degree = values.shape[1] - 1
    span = degree
    for i in range(len(parameters)):
        u = parameters[i]
        while span < len(knots) - degree - 2 and knots[span + 1] <= u:
            span += 1
        spans[i], values[i, 0] = span, 1.0
        # Recurrence: a B-spline blends two of one degree less, so each hands a part of itself to the next.
        for level in range(1, degree + 1):
            carried = 0.0
            for j in range(level):
                low, high = knots[span + 1 + j - level], knots[span + 1 + j]
                part = values[i, j] / (high - low)
                values[i, j] = carried + (high - u) * part
                carried = (u - low) * part
            values[i, level] = carried


@compiled(inline=True)
@no_type_check
def curve_point(spans, values, i, coefficients):
    """Gives x and y of the curve where row i of `evaluate_basis` is for."""
    x = y = 0.0
    first = spans[i] - values.shape[1] + 1
    for j in range(values.shape[1]):
        x += values[i, j] * coefficients[first + j, 0]
        y += values[i, j] * coefficients[first + j, 1]
    return x, y


@compiled
@no_type_check
def derivative_jumps(knots, degree):
    """Gives for each inner knot how much each coefficient makes the k-th derivative jump there.

    Row i, of width k + 2, is for knot i + k + 1 and coefficients i to i + k + 1. A B-spline is a divided
    difference of truncated powers over its k + 2 knots, times the length they cover. So at one of them its
    k-th derivative jumps by that length over the product of the distances to the others, but for a factor
    that is the same for all. Lengths are in mean distances between knots: the jumps have no unit.
    """
    inner = len(knots) - 2 * degree - 2
    jumps = np.empty((inner, degree + 2))
    scale = (inner + 1) / (knots[-1] - knots[0])
    for i in range(inner):
        knot = i + degree + 1
        for first in range(i, knot + 1):
            jump = (knots[first + degree + 1] - knots[first]) * scale
            for other in range(first, first + degree + 2):
                if other != knot:
                    jump /= (knots[knot] - knots[other]) * scale
            jumps[i, first - i] = jump
    return jumps
