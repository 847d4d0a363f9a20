"""What comes in and goes out: segments as arrays that kernels take, what they give, numbers in range."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, no_type_check

import numpy as np
from numpy.typing import NDArray

from yolino.compiled import compiled
from yolino.types import Polylines, Segments

_NO_CLASSES = np.empty((0, 0))

# Pixels. A polyline out there would have millions of vertices.
FARTHEST = 1e7
_TOO_FAR = f"endpoints lie farther than {FARTHEST:.0e} pixels from the origin; drop those segments first."


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
        plain(segments.endpoints),
        plain(segments.scores),
        plain(segments.labels),
        _NO_CLASSES if given is None else plain(given),
    )


def traced_lines(found: tuple[NDArray[Any], ...], segments: Segments) -> Polylines:
    """Gives the polylines that a linker's kernel found: vertices, offsets, scores, labels and class shares.

    Where the segments have no class probabilities, the shares are dropped.
    """
    vertices, offsets, scores, labels, shares = found
    return Polylines.trusted(
        vertices, offsets, scores, labels, None if segments.probabilities is None else shares
    )


def plain(array: NDArray[Any]) -> NDArray[Any]:
    """Gives the array if it is writable and in C order, else a copy that is."""
    return array if array.flags.carray else array.copy("C")


@compiled
@no_type_check
def check_segments(endpoints, scores):
    """Raises a ValueError if end points or scores are not finite, far away, or a score is negative."""
    finite, farthest, lowest = True, 0.0, 0.0
    for i in range(len(scores)):
        for k in range(4):
            value = endpoints[i, k >> 1, k & 1]
            finite &= np.isfinite(value)
            farthest = max(farthest, abs(value))
        finite &= np.isfinite(scores[i])
        lowest = min(lowest, scores[i])
    if not finite:
        raise ValueError("endpoints or scores hold NaN or infinity; drop those segments first.")
    if farthest > FARTHEST:
        raise ValueError(_TOO_FAR)
    if lowest < 0:
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
