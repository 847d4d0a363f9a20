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
        ValueError: End points of such a segment are not finite.
    """
    given = _NO_CLASSES if probabilities is None else probabilities
    # As numpy compares: in the precision of the scores, so that a score of .9 reaches the threshold .9.
    points, kept, shares, finite = _above(endpoints, scores, given, np.float32(threshold))
    if not finite:
        raise ValueError(
            "The network gave end points that are not finite: its file is damaged or its precision too low."
        )
    return Segments(points, kept, probabilities=None if probabilities is None else shares)


@compiled
@no_type_check
def _above(endpoints, scores, probabilities, threshold):
    """Gives end points, scores and probabilities, and whether all end points are finite."""
    count = 0
    for i in range(len(scores)):
        count += scores[i] >= threshold
    points, kept = np.empty((count, 2, 2)), np.empty(count)
    shares = np.empty((count, probabilities.shape[1]))
    total, at = 0.0, 0
    for i in range(len(scores)):
        if scores[i] >= threshold:
            kept[at] = scores[i]
            for k in range(4):
                value = np.float64(endpoints[i, k >> 1, k & 1])
                points[at, k >> 1, k & 1] = value
                total += abs(value)
            for k in range(probabilities.shape[1]):
                shares[at, k] = probabilities[i, k]
            at += 1
    return points, kept, shares, np.isfinite(total)


__all__ = ["segments_above"]
