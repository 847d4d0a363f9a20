"""Smooth curves: the paper's smoothing B-spline through the points of a chain (paper, appendix)."""

from __future__ import annotations

from typing import cast, no_type_check

import numpy as np
from jaxtyping import Float
from numba import njit
from numpy.typing import NDArray
from scipy.interpolate import splprep

from yolino.postprocess.inputs import check_not_negative, check_positive

_WINDOW, _OVERLAP = 64, 16  # points
_Fit = tuple[NDArray[np.float64], list[NDArray[np.float64]], int]


class SmoothingSpline:
    """Gives evenly sampled points of the smoothing B-spline that FITPACK (`scipy.interpolate.splprep`) fits.

    The spline has as few knots as keep the sum of its squared distances to the points within `smoothing`. A
    chain of fewer than `degree + 1` points takes the highest degree it allows; of two points the line is
    left.

    Args:
        smoothing: Bound of the sum of squared distances, in the squared unit of the points (the paper's s =
            0.05, in cells). 0 interpolates.
        spacing: Largest distance between samples, in the unit of the points.
        degree: Degree of the spline, 1 to 5.

    Raises:
        ValueError: If an argument is out of range.
    """

    def __init__(self, smoothing: float = 0.05, spacing: float = 0.5, *, degree: int = 3) -> None:
        check_not_negative(smoothing=smoothing)
        check_positive(spacing=spacing)
        if degree not in (1, 2, 3, 4, 5):
            raise ValueError(f"degree is {degree}, but 1, 2, 3, 4 or 5 is needed.")
        self._smoothing, self._spacing, self._degree = float(smoothing), float(spacing), int(degree)

    def __call__(self, points: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "v 2"]:
        """Gives the samples, from the first point's end of the curve to the last one's.

        Args:
            points: At least two points; consecutive ones differ.
        """
        at, even = _parameters(points, self._spacing)
        if len(points) <= _WINDOW:
            return self._fit(points, at, even)
        # The time of a fit grows with the cube of its points: a long chain is fitted in windows that overlap.
        result, first = np.empty((0, 2)), 0
        while len(result) < len(even):
            last = len(points) if len(points) - first <= _WINDOW else first + _WINDOW
            inside = slice(
                np.searchsorted(even, at[first]), np.searchsorted(even, at[last - 1], side="right")
            )
            piece = self._fit(points[first:last], at[first:last], even[inside])
            shared = len(result) - inside.start
            fade = np.linspace(0.0, 1.0, shared + 2)[1:-1, None]
            blend = result[inside.start :] * (1 - fade) + piece[:shared] * fade
            result = np.concatenate([result[: inside.start], blend, piece[shared:]])
            first = last - _OVERLAP
        return result

    def _fit(
        self, points: NDArray[np.float64], at: NDArray[np.float64], samples: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Gives one spline, through points at the arc lengths `at`, at the arc lengths `samples`."""
        degree = min(self._degree, len(points) - 1)
        x, y = points[:, 0], points[:, 1]
        if degree == 1:
            return np.stack([np.interp(samples, at, column) for column in (x, y)], axis=1)
        # full_output: FITPACK warns when it ends near the bound instead of at it, which is no fault of the
        # caller.
        fitted = splprep([x, y], u=at, k=degree, s=self._smoothing, full_output=1)
        knots, coefficients, _ = cast(_Fit, fitted[0][0])
        return np.asarray(_sample(knots, *coefficients, degree, samples))


@njit(cache=True, error_model="numpy")
@no_type_check
def _parameters(points, spacing):
    """Gives the arc length at each point, and even ones from end to end, at most `spacing` apart."""
    at = np.zeros(len(points))
    for i in range(1, len(points)):
        dx, dy = points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]
        at[i] = at[i - 1] + np.sqrt(dx * dx + dy * dy)
    count = int(np.ceil(at[-1] / spacing - 1e-9)) + 1
    even = np.empty(count)
    for i in range(count):
        even[i] = at[-1] * (i / (count - 1))
    return at, even


@njit(cache=True, error_model="numpy")
@no_type_check
def _sample(knots, xs, ys, degree, parameters):
    """Gives the spline at increasing parameters (de Boor's algorithm)."""
    samples = np.empty((len(parameters), 2))
    x, y = np.empty(degree + 1), np.empty(degree + 1)
    span = degree
    for i in range(len(parameters)):
        u = parameters[i]
        while span < len(knots) - degree - 2 and knots[span + 1] <= u:
            span += 1
        for j in range(degree + 1):
            x[j], y[j] = xs[span - degree + j], ys[span - degree + j]
        for level in range(1, degree + 1):
            for j in range(degree, level - 1, -1):
                low = knots[span - degree + j]
                share = (u - low) / (knots[span + 1 + j - level] - low)
                x[j], y[j] = x[j - 1] + share * (x[j] - x[j - 1]), y[j - 1] + share * (y[j] - y[j - 1])
        samples[i, 0], samples[i, 1] = x[degree], y[degree]
    return samples
