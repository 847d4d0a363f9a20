"""Smooth curves: the paper's smoothing B-spline through the points of chains (paper, appendix)."""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int

from yolino.compiled import compiled
from yolino.postprocess.bsplines import curve_point, evaluate_basis
from yolino.postprocess.fitting import fit_spline
from yolino.postprocess.inputs import check_not_negative, check_positive

_WINDOW, _OVERLAP = 64, 16  # points
_FAR = 4.0  # spacings


class SmoothingSpline:
    """Gives evenly sampled points of the smoothing B-spline that FITPACK (`scipy.interpolate.splprep`) fits.

    The spline has as few knots as keep the sum of its squared distances to the points within `smoothing`. A
    chain of fewer than `degree + 1` points takes the highest degree it allows; of two points the line is
    left. Chains of more than 64 points are fitted in windows, each blended into the next. Where the curve
    leaves the box around its points by more than four spacings, the straight pieces between the points are
    taken.

    Args:
        smoothing: Bound of the sum of squared distances, in the squared unit of the points (the paper's s =
            0.05, in cells). 0 interpolates.
        spacing: Largest distance between samples, in the unit of the points.
        degree: Degree of the spline, 1 to 5.

    Attributes:
        rule: Spacing, degree and smoothing, as kernels take them.

    Raises:
        ValueError: If an argument is out of range.
    """

    def __init__(self, smoothing: float = 0.05, spacing: float = 0.5, *, degree: int = 3) -> None:
        check_not_negative(smoothing=smoothing)
        check_positive(spacing=spacing)
        if degree not in (1, 2, 3, 4, 5):
            raise ValueError(f"degree is {degree}, but 1, 2, 3, 4 or 5 is needed.")
        self.rule = float(spacing), int(degree), float(smoothing)

    def __call__(self, points: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "v 2"]:
        """Gives the samples, from the first point's end of the curve to the last one's.

        Args:
            points: At least two points; consecutive ones differ.

        Raises:
            ValueError: If there are fewer, or consecutive ones are the same, or one is not finite.
        """
        chain = np.array(points, np.float64, order="C")
        steps = np.abs(np.diff(chain, axis=0)).sum(axis=1)
        if len(steps) == 0 or not (np.isfinite(steps) & (steps > 0)).all():
            raise ValueError("points must be at least two, all of them finite, each unlike the one before.")
        return self.smooth(chain, np.array([0, len(chain)]), np.zeros(1, np.int64))[0]

    def smooth(
        self,
        points: Float[np.ndarray, "p 2"],
        offsets: Int[np.ndarray, " n_plus_1"],
        chosen: Int[np.ndarray, " c"],
    ) -> tuple[Float[np.ndarray, "v 2"], Int[np.ndarray, " c_plus_1"]]:
        """Gives the samples of several chains, one after the other, and where those of each begin.

        Nothing is checked, and numba compiles anew for arrays that are read-only or not in C order.

        Args:
            points: Points of all chains, at least two in each; consecutive ones differ.
            offsets: Where the points of each chain begin, and the last end.
            chosen: Indices of the chains to smooth.
        """
        curves, starts = smooth_chains(points, offsets, chosen, self.rule)
        return curves, starts


@compiled
@no_type_check
def smooth_chains(points, offsets, chosen, rule):
    """Does what `SmoothingSpline.smooth` does, with the spacing, degree and bound of the spline as rule."""
    spacing = rule[0]
    at, starts = np.zeros(len(points)), np.zeros(len(chosen) + 1, np.int64)
    for c in range(len(chosen)):
        first, stop = offsets[chosen[c]], offsets[chosen[c] + 1]
        for i in range(first + 1, stop):
            dx, dy = points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]
            at[i] = at[i - 1] + np.sqrt(dx * dx + dy * dy)
        starts[c + 1] = starts[c] + 1 + max(int(np.ceil(at[stop - 1] / spacing - 1e-9)), 1)
    curves, even = np.empty((starts[-1], 2)), np.empty(starts[-1])
    for c in range(len(chosen)):
        first, stop = offsets[chosen[c]], offsets[chosen[c] + 1]
        begin, end = starts[c], starts[c + 1]
        for i in range(begin, end):
            even[i] = at[stop - 1] * ((i - begin) / (end - begin - 1))
        _smooth_chain(at[first:stop], points[first:stop], even[begin:end], curves[begin:end], rule)
        if _leaves(points[first:stop], curves[begin:end], _FAR * spacing):
            _walk(at[first:stop], points[first:stop], even[begin:end], curves[begin:end])
    return curves, starts


@compiled
@no_type_check
def _leaves(points, curve, margin):
    """Tells whether a curve leaves the box around its points by more than the margin, or is not finite.

    A bound that is small against the noise puts knots at nearly every point from one end on; between them
    nothing holds the curve.
    """
    for k in range(2):
        low = high = points[0, k]
        for i in range(len(points)):
            low, high = min(low, points[i, k]), max(high, points[i, k])
        for i in range(len(curve)):
            if not low - margin <= curve[i, k] <= high + margin:
                return True
    return False


@compiled
@no_type_check
def _walk(at, points, even, curve):
    """Writes the places at the arc lengths `even` on the straight pieces between the points."""
    i = 1
    for j in range(len(even)):
        while i < len(at) - 1 and at[i] < even[j]:
            i += 1
        share = (even[j] - at[i - 1]) / (at[i] - at[i - 1])
        for k in range(2):
            curve[j, k] = points[i - 1, k] + share * (points[i, k] - points[i - 1, k])


@compiled(inline=True)
@no_type_check
def _smooth_chain(at, points, even, curve, rule):
    """Writes the samples at the arc lengths `even` of one chain, whose points are at the arc lengths `at`.

    The time of a fit grows faster than its points: a long chain is fitted in windows that overlap.
    """
    _, degree, smoothing = rule
    first = last = low = high = 0
    while last < len(at):
        last = len(at) if len(at) - first <= _WINDOW else first + _WINDOW
        while even[low] < at[first]:
            low += 1
        filled = high
        while high < len(even) and (last == len(at) or even[high] <= at[last - 1]):
            high += 1
        knots, coefficients = fit_spline(
            at[first:last], points[first:last], min(degree, last - first - 1), smoothing
        )
        _blend(knots, coefficients, even[low:high], curve[low:high], filled - low)
        first = last - _OVERLAP


@compiled(inline=True)
@no_type_check
def _blend(knots, coefficients, parameters, curve, shared):
    """Writes the points of a spline; the `shared` ones that there are already fade over to them."""
    spans = np.empty(len(parameters), np.int64)
    values = np.empty((len(parameters), len(knots) - len(coefficients)))
    evaluate_basis(knots, parameters, spans, values)
    for i in range(len(parameters)):
        x, y = curve_point(spans, values, i, coefficients)
        if i < shared:
            fade = (i + 1) / (shared + 1)
            x, y = curve[i, 0] + fade * (x - curve[i, 0]), curve[i, 1] + fade * (y - curve[i, 1])
        curve[i, 0], curve[i, 1] = x, y
