"""The smoothing spline of P. Dierckx, "Curve and Surface Fitting with Splines" (1993), chapter 5, compiled.

The sum of its squared distances to the points has a bound, and its highest derivative jumps as little as that
allows. First knots are added until the curve nearest to the points (least squares) is within the bound. Then
the jumps are weighed against the distances such that the bound is just met.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled
from yolino.postprocess.bsplines import curve_point, derivative_jumps, evaluate_basis
from yolino.postprocess.givens import rotate_in, solve
from yolino.postprocess.knots import choose_number, insert_knot, place_knots, sum_intervals

_NEAR = 1e-3  # times the bound: a sum of squares that near to it is good enough
_STEPS = 20  # of the search for the weight of the jumps


# What has one caller is inlined (also in `knots` and `spline`): compiling takes a quarter less time.
@compiled(inline=True)
@no_type_check
def fit_spline(at, points, degree, smoothing):
    """Gives the knots and the coefficients of the smoothing spline.

    Args:
        at: Increasing parameters of the points.
        points: More than `degree` points `(x, y)`.
        degree: Degree k, 1 to 5.
        smoothing: Bound of the sum of squared distances; 0 interpolates.
    """
    most, least, near = len(at), degree + 1, _NEAR * smoothing
    knots, inside, sums = np.empty(most + least), np.zeros(most, np.int64), np.empty(most)
    data = points, np.empty(most, np.int64), np.empty((most, least)), np.empty(most)
    count, inside[0] = most if smoothing == 0 else least, most - 2
    place_knots(at, degree, count, knots)
    added, before, first = np.int64(0), 0.0, 0.0
    while True:
        used = knots[: count + least]
        evaluate_basis(used, at, data[1], data[2])
        triangle = _triangulate(data, count)
        coefficients = solve(triangle)
        excess = _measure(data, coefficients) - smoothing
        if count == least:
            first = excess
        if abs(excess) < near or (count == least and excess < 0) or (count == most and not excess < 0):
            break
        if excess < 0:
            system = triangle, derivative_jumps(used, degree)
            coefficients = _smooth(data, system, (first, excess, smoothing))
            break
        added, before = choose_number(added, excess, before - excess, near), excess
        sum_intervals(data[3], data[1], degree, sums)
        for _ in range(min(added, most - count)):
            insert_knot(knots, count, at, (inside, sums))
            count += 1
        if count == most:
            place_knots(at, degree, count, knots)
    return used, coefficients


@compiled
@no_type_check
def _triangulate(data, count):
    """Gives the triangle whose solution are the `count` coefficients of the curve nearest to the points."""
    points, spans, values, _ = data
    width = values.shape[1]
    triangle, equation = np.zeros((count, width + 2)), np.empty(width + 2)
    for i in range(len(points)):
        for q in range(width):
            equation[q] = values[i, q]
        equation[width], equation[width + 1] = points[i, 0], points[i, 1]
        rotate_in(equation, 1.0, spans[i] - width + 1, triangle)
    return triangle


@compiled
@no_type_check
def _measure(data, coefficients):
    """Writes the squared distance of each point to the curve at its parameter, and gives their sum."""
    points, spans, values, squares = data
    total = 0.0
    for i in range(len(points)):
        x, y = curve_point(spans, values, i, coefficients)
        x, y = points[i, 0] - x, points[i, 1] - y
        squares[i] = x * x + y * y
        total += squares[i]
    return total


@compiled
@no_type_check
def _smooth(data, system, limits):
    """Gives the coefficients of the curve that meets the bound with the smallest jumps.

    The less the jumps weigh (see `_weigh`), the smaller is the sum of squares: F(p) falls from the
    polynomial's (p = 0: no jumps) to the nearest curve's (p infinite). It looks like (u p + v) / (p + w), so
    the next p comes from the function of this form through three points of F; of those, one to either side of
    the bound is always kept.

    Args:
        data: Points, the B-splines at them, and a place for squared distances.
        system: Triangle of the nearest curve, and `derivative_jumps`.
        limits: How far F(0) and F(infinity) are above the bound, and the bound.
    """
    above, below, bound = limits
    near = _NEAR * bound
    low, high, has_low, has_high = 0.0, np.inf, False, False
    p = _first_weight(system[0])
    for _ in range(_STEPS):
        coefficients = _weigh(system, p)
        excess = _measure(data, coefficients) - bound
        if abs(excess) < near:
            break
        if not has_high and excess - below <= near:  # as good as infinite
            high, below, p = p, excess, p * 0.04
            if p <= low:
                p = 0.9 * low + 0.1 * high
            continue
        has_high = has_high or excess < 0
        if not has_low and above - excess <= near:  # as good as 0
            low, above, p = p, excess, p / 0.04
            if p >= high:
                p = 0.1 * low + 0.9 * high
            continue
        has_low = has_low or excess > 0
        if not below < excess < above:  # F falls no more: what is left is rounding
            break
        tried, p = p, _find_root((low, above), (p, excess), (high, below))
        if excess < 0:
            high, below = tried, excess
        else:
            low, above = tried, excess
    return coefficients


@compiled(inline=True)
@no_type_check
def _first_weight(triangle):
    """Gives one over the mean diagonal element that the triangle has if its equations weigh 1."""
    total = 0.0
    for j in range(len(triangle)):
        total += np.sqrt(triangle[j, 0])
    return len(triangle) / total


@compiled(inline=True)
@no_type_check
def _find_root(a, b, c):
    """Gives where the function (u p + v) / (p + w) through three points is 0; c may be infinitely far."""
    (pa, fa), (pb, fb), (pc, fc) = a, b, c
    if pc == np.inf:
        return (pa * (fa - fc) * fb - pb * (fb - fc) * fa) / ((fa - fb) * fc)
    wa, wb, wc = fa * (fb - fc), fb * (fc - fa), fc * (fa - fb)
    return -(pb * pc * wa + pc * pa * wb + pa * pb * wc) / (pa * wa + pb * wb + pc * wc)


@compiled
@no_type_check
def _weigh(system, p):
    """Gives the coefficients with the least sum of squared distances and of squared jumps over p^2.

    The equations of the triangle stand for those of the points. They and those of the jumps are taken in by
    their first column: then each meets few others.
    """
    triangle, jumps = system
    width = jumps.shape[1]
    joint, equation = np.zeros((len(triangle), width + 2)), np.empty(width + 2)
    for j in range(len(triangle)):
        equation[0], equation[width - 1] = 1.0, 0.0
        for q in range(1, width - 1):
            equation[q] = triangle[j, q]
        for q in range(2):
            equation[width + q] = triangle[j, width - 1 + q]
        rotate_in(equation, triangle[j, 0], j, joint)
        if j < len(jumps):
            for q in range(width):
                equation[q] = jumps[j, q]
            equation[width] = equation[width + 1] = 0.0
            rotate_in(equation, 1 / (p * p), j, joint)
    return solve(joint)
