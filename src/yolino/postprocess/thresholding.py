"""The first step after the seam: the segments of an image whose score reaches the threshold, compiled.

One call instead of a dozen of numpy's: after the network has run, the processor's caches are cold, and each
call costs ten times what it costs in a loop.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from jaxtyping import Float32

from yolino.compiled import compiled
from yolino.types import Segments

_NO_CLASSES = np.zeros((0, 0), np.float32)


def segments_above(
    endpoints: Float32[np.ndarray, "n 2 2"],
    scores: Float32[np.ndarray, " n"],
    probabilities: Float32[np.ndarray, "n c"] | None,
    threshold: float,
) -> Segments:
    """Gives the segments with at least the threshold, in the order of the predictors.

    Only these become float64.

    Args:
        endpoints: Start and end points, in pixels.
        scores: Scores.
        probabilities: Class probabilities, or None.
        threshold: Lowest score.

    Raises:
        ValueError: End points or probabilities of such a segment are not finite, or any score is NaN.
    """
    given = _NO_CLASSES if probabilities is None else probabilities
    points, kept, labels, shares, finite = _above(endpoints, scores, given, threshold)
    if not finite:
        raise ValueError(
            "The network gave end points, scores or class probabilities that are not finite: its file is "
            "damaged or its precision too low."
        )
    return Segments.trusted(points, kept, labels, None if probabilities is None else shares)


@compiled
@no_type_check
def _above(endpoints, scores, probabilities, threshold):
    """Gives end points, scores, likeliest labels and probabilities, and whether all are finite."""
    # As numpy compares: in the precision of the scores, so that a score of .9 reaches the threshold .9.
    least, below, count = np.float32(threshold), 0, 0
    for i in range(len(scores)):
        below += scores[i] < least
    chosen = np.empty(len(scores) - below + 1, np.int64)
    for i in range(len(scores)):  # without branches, which the processor would guess wrong
        chosen[count] = i
        count += scores[i] >= least
    points, kept, labels = np.empty((count, 2, 2)), np.empty(count), np.zeros(count, np.int64)
    shares = np.empty((count, probabilities.shape[1]))
    total = 0.0 if count + below == len(scores) else np.inf  # NaN is neither
    for at in range(count):
        i = chosen[at]
        kept[at] = scores[i]
        total += kept[at]
        for k in range(4):
            points[at, k >> 1, k & 1] = endpoints[i, k >> 1, k & 1]
            total += abs(points[at, k >> 1, k & 1])
        for k in range(probabilities.shape[1]):
            shares[at, k] = probabilities[i, k]
            total += abs(shares[at, k])
            if shares[at, k] > shares[at, labels[at]]:
                labels[at] = k
    return points, kept, labels, shares, np.isfinite(total)


__all__ = ["segments_above"]
