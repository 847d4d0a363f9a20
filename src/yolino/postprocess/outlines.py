"""Chains of segments to polylines: points, score and label of each, and the smooth curve through them."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled
from yolino.postprocess.spline import smooth_chains

_PROGRESS = 0.1  # cells that a midpoint must lie ahead of the one before
_SAME = 1e-6  # cells


@compiled
@no_type_check
def class_votes(labels, probabilities):
    """Gives the labels there are, and how much each segment is for each of them; a label alone is certain."""
    if probabilities.shape[1]:
        return np.arange(probabilities.shape[1]), probabilities
    names = _distinct(labels)
    votes = np.zeros((len(labels), len(names)))
    for i in range(len(labels)):
        votes[i, _rank(names, len(names), labels[i])] = 1.0
    return names, votes


@compiled
@no_type_check
def _distinct(labels):
    """Gives the labels that there are, in order. Each that is new moves the larger ones: they are few."""
    names, count = np.empty(len(labels), np.int64), 0
    for label in labels:
        at = _rank(names, count, label)
        if at < count and names[at] == label:
            continue
        for i in range(count, at, -1):
            names[i] = names[i - 1]
        names[at] = label
        count += 1
    return names[:count]


@compiled
@no_type_check
def _rank(names, count, label):
    """Gives how many of the first names, which are in order, come before a label."""
    low, high = 0, count
    while low < high:
        middle = (low + high) // 2
        if names[middle] < label:
            low = middle + 1
        else:
            high = middle
    return low


@compiled
@no_type_check
def smooth_outlines(outlines, names, least, spline, cell_size):
    """Gives `outline`'s polylines as smooth curves: vertices in pixels, offsets, scores, labels, shares.

    Args:
        outlines: What `outline` gives.
        names: Labels that the columns of the votes are for.
        least: Smallest length and score; shorter or less sure ones, and those without length, are left out.
        spline: Rule of the `SmoothingSpline` through points in cell units.
        cell_size: Side of a cell in pixels.
    """
    points, starts, lengths, means, winners, shares = outlines
    chosen, count = np.empty(len(lengths), np.int64), 0
    for c in range(len(lengths)):
        if lengths[c] > 0 and lengths[c] >= least[0] and means[c] >= least[1]:
            chosen[count] = c
            count += 1
    chosen = chosen[:count]
    scores, labels, odds = np.empty(count), np.empty(count, np.int64), np.empty((count, shares.shape[1]))
    for i in range(count):
        scores[i], labels[i] = means[chosen[i]], names[winners[chosen[i]]]
        for k in range(odds.shape[1]):
            odds[i, k] = shares[chosen[i], k]
    curves, offsets = smooth_chains(points, starts, chosen, spline)
    for i in range(len(curves)):
        curves[i, 0], curves[i, 1] = curves[i, 0] * cell_size, curves[i, 1] * cell_size
    return curves, offsets, scores, labels, odds


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
            dx, dy = points[p, 0] - points[p - 1, 0], points[p, 1] - points[p - 1, 1]
            arcs[c] += np.sqrt(dx * dx + dy * dy)
        total = 0.0
        for p in range(first, stop):
            dx, dy = endpoints[p, 1, 0] - endpoints[p, 0, 0], endpoints[p, 1, 1] - endpoints[p, 0, 1]
            length = np.sqrt(dx * dx + dy * dy)
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
