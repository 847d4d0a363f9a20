"""Chains of segments to polylines: points, score and label of each, and the smooth curve through them."""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from numpy.typing import NDArray

from yolino.compiled import compiled
from yolino.postprocess.spline import SmoothingSpline
from yolino.types import Polylines

_PROGRESS = 0.1  # cells that a midpoint must lie ahead of the one before
_SAME = 1e-6  # cells


def class_votes(
    labels: NDArray[np.int64], probabilities: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Gives the labels there are, and how much each segment is for each of them; a label alone is certain."""
    if probabilities.shape[1]:
        return np.arange(probabilities.shape[1]), probabilities
    if (labels == labels[0]).all():
        return labels[:1], np.ones((len(labels), 1))
    names, index = np.unique(labels, return_inverse=True)
    return names, np.eye(len(names))[index]


def smooth_outlines(
    outlines: tuple[
        NDArray[np.float64],
        NDArray[np.int64],
        NDArray[np.float64],
        NDArray[np.int64],
        NDArray[np.float64] | None,
    ],
    kept: NDArray[np.bool_],
    spline: SmoothingSpline,
    cell_size: float,
) -> Polylines:
    """Gives the kept ones of `outline`'s polylines as smooth curves in pixels.

    Args:
        outlines: Points in cell units, where the points of each polyline begin, and scores, labels and
            class probabilities (None: no classes) of polylines.
        kept: Whether each polyline is kept.
        spline: Gives the curve through points in cell units.
        cell_size: Side of a cell in pixels.
    """
    points, offsets, scores, labels, shares = outlines
    chosen = np.flatnonzero(kept)
    curves, sizes = spline.smooth(points, offsets, chosen)
    probabilities = None if shares is None else shares[chosen]
    return Polylines(curves * cell_size, sizes, scores[chosen], labels[chosen], probabilities)


@compiled
@no_type_check
def outline(chains, endpoints, scores, votes):
    """Gives the points of polylines: midpoints and both outer end points of each chain (paper, appendix).

    Also: where the points of each begin, their length, the score, the column of `votes` that wins, and the
    mean of the votes by score and length. The score is the mean of the segments' scores by length, where gaps
    count as zero. Midpoints that do not lie ahead are left out.

    Args:
        chains: Offsets of the chains in the other arrays, and whether each is a ring.
        endpoints: Segments in the order and direction of their chains.
        scores: Their scores.
        votes: How much each is for each label.
    """
    offsets, rings = chains
    count = len(offsets) - 1
    points, starts = np.empty((len(endpoints) + 2 * count, 2)), np.zeros(count + 1, np.int64)
    arcs, means, winners = np.zeros(count), np.zeros(count), np.zeros(count, np.int64)
    shares = np.zeros((count, votes.shape[1]))
    filled = 0
    for c in range(count):
        first, stop = offsets[c], offsets[c + 1]
        filled = _collect(endpoints[first:stop], rings[c], points, filled)
        starts[c + 1] = filled
        for p in range(starts[c] + 1, filled):
            arcs[c] += np.sqrt(
                (points[p, 0] - points[p - 1, 0]) ** 2 + (points[p, 1] - points[p - 1, 1]) ** 2
            )
        total = 0.0
        for p in range(first, stop):
            length = np.sqrt(
                (endpoints[p, 1, 0] - endpoints[p, 0, 0]) ** 2
                + (endpoints[p, 1, 1] - endpoints[p, 0, 1]) ** 2
            )
            total += length
            means[c] += scores[p] * length
            for k in range(votes.shape[1]):
                shares[c, k] += scores[p] * length * votes[p, k]
        weight = means[c]
        means[c] /= max(total, arcs[c])
        for k in range(votes.shape[1]):
            if shares[c, k] > shares[c, winners[c]]:
                winners[c] = k
        for k in range(votes.shape[1]):
            shares[c, k] = shares[c, k] / weight if weight > 0 else 1 / votes.shape[1]
    return points[:filled], starts, arcs, means, winners, shares


@compiled
@no_type_check
def _collect(endpoints, ring, points, filled):
    """Writes the points of one chain behind the `filled` ones, and gives how many there are then."""
    last, at = 0, filled + 1
    for p in range(len(endpoints)):
        x, y = (endpoints[p, 0, 0] + endpoints[p, 1, 0]) / 2, (endpoints[p, 0, 1] + endpoints[p, 1, 1]) / 2
        if p > 0:
            tx = endpoints[p, 1, 0] - endpoints[p, 0, 0] + endpoints[last, 1, 0] - endpoints[last, 0, 0]
            ty = endpoints[p, 1, 1] - endpoints[p, 0, 1] + endpoints[last, 1, 1] - endpoints[last, 0, 1]
            ahead = (x - points[at - 1, 0]) * tx + (y - points[at - 1, 1]) * ty
            if ahead <= _PROGRESS * np.sqrt(tx * tx + ty * ty):
                continue
            last = p
        points[at, 0], points[at, 1] = x, y
        at += 1
    for k in range(2):
        points[filled, k], points[at, k] = endpoints[0, 0, k], endpoints[last, 1, k]
        if ring:
            points[filled, k] = points[at, k] = (points[filled, k] + points[at, k]) / 2
    at += 1
    kept = filled + 1
    for p in range(filled + 1, at):
        if abs(points[p, 0] - points[kept - 1, 0]) + abs(points[p, 1] - points[kept - 1, 1]) > _SAME:
            points[kept, 0], points[kept, 1] = points[p, 0], points[p, 1]
            kept += 1
    return kept
