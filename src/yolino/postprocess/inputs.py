"""What comes in: segments as the arrays that kernels take, and numbers that must be in range."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from yolino.types import Segments

_NO_CLASSES = np.empty((0, 0))

# Pixels. A polyline out there would have millions of vertices.
FARTHEST = 1e7


class SegmentArrays(NamedTuple):
    """The fields of `Segments`, writable and in C order: numba compiles a kernel anew for every other kind.

    Attributes:
        endpoints: `(n, 2, 2)`.
        scores: `(n,)`.
        labels: `(n,)`.
        probabilities: `(n, c)`; where there are none, an array without rows and columns.
    """

    endpoints: NDArray[np.float64]
    scores: NDArray[np.float64]
    labels: NDArray[np.int64]
    probabilities: NDArray[np.float64]


def segment_arrays(segments: Segments) -> SegmentArrays:
    """Gives the arrays of `segments`, copied only where they are not writable or not in C order."""
    given = segments.probabilities
    return SegmentArrays(
        _plain(segments.endpoints),
        _plain(segments.scores),
        _plain(segments.labels),
        _NO_CLASSES if given is None else _plain(given),
    )


def _plain(array: NDArray[Any]) -> NDArray[Any]:
    return array if array.flags.carray else array.copy("C")


def check_segments(segments: Segments) -> None:
    """Raises a ValueError if end points or scores are not finite, or a score is negative."""
    if not (np.isfinite(segments.endpoints).all() and np.isfinite(segments.scores).all()):
        raise ValueError("endpoints or scores hold NaN or infinity; drop those segments first.")
    if np.abs(segments.endpoints).max(initial=0.0) > FARTHEST:
        raise ValueError(
            f"endpoints lie farther than {FARTHEST:.0e} pixels from the origin; drop those segments first."
        )
    if segments.scores.min(initial=0.0) < 0:
        raise ValueError("scores must be at least 0; drop the other segments first.")


def check_positive(**numbers: float | int) -> None:
    """Raises a ValueError that names the first number which is not finite and above 0."""
    for name, value in numbers.items():
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} is {value}, but a finite number above 0 is needed.")


def check_not_negative(**numbers: float | int) -> None:
    """Raises a ValueError that names the first number which is not finite or below 0."""
    for name, value in numbers.items():
        if not (math.isfinite(value) and value >= 0):
            raise ValueError(f"{name} is {value}, but a finite number from 0 on is needed.")
