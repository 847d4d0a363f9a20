"""Segments as the arrays that the kernels take."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from yolino.types import Segments


class SegmentArrays(NamedTuple):
    """The fields of `Segments`, writable and in C order: numba compiles a kernel anew for every other kind.

    Attributes:
        endpoints: `(n, 2, 2)`.
        scores: `(n,)`.
        labels: `(n,)`.
        probabilities: `(n, c)`; without columns where there are none.
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
        np.empty((len(segments), 0)) if given is None else _plain(given),
    )


def _plain(array: NDArray[Any]) -> NDArray[Any]:
    flags = array.flags
    return array if flags.c_contiguous and flags.writeable else array.copy("C")


def check_segments(segments: Segments) -> None:
    """Raises a ValueError if end points or scores are not finite, or a score is negative."""
    if not (np.isfinite(segments.endpoints).all() and np.isfinite(segments.scores).all()):
        raise ValueError("endpoints or scores hold NaN or infinity; drop those segments first.")
    if segments.scores.min(initial=0.0) < 0:
        raise ValueError("scores must be at least 0; drop the other segments first.")
