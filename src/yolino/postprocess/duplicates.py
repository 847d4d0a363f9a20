"""Which chains only repeat a stronger chain beside them, compiled."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled
from yolino.postprocess.cells import neighborhoods, sort_points
from yolino.postprocess.sorting import sort_rows


@compiled
@no_type_check
def find_originals(chains, endpoints, scores, directed, rule):
    """Tells which chains are kept: the strongest, and each that does not lie beside stronger kept ones.

    A segment lies beside another if its middle is within `radius` of the other's line and within half a
    cell of the other's stretch of it, and their angle has at least `straight` as cosine. A chain lies
    beside others if more than `share` of its length does, and no stretch of at least the length `core` does
    not: that would be a way of its own. Strength is the sum of score times length. The rule is `radius,
    straight, share, core`.
    """
    items, offsets = chains
    radius, straight, share, core = rule
    middles, ways, lengths = _measure(endpoints)
    owners, strengths, totals = _sum_up(items, offsets, lengths, scores)
    largest = 0.0
    for length in lengths:
        largest = max(largest, length)
    _, order, keys, columns = sort_points(middles, radius + largest / 2 + 0.5)
    runs = neighborhoods(keys, columns)
    places = np.empty(len(order), np.int64)
    for p in range(len(order)):
        places[order[p]] = p
    kept = np.zeros(len(totals), np.bool_)
    for c in sort_rows(-strengths.reshape(-1, 1)):
        covered = stretch = longest = 0.0
        for p in range(offsets[c], offsets[c + 1]):
            i = items[p]
            hit = False
            for row in range(3):
                for q in range(runs[places[i], row, 0], runs[places[i], row, 1]):
                    j = order[q]
                    if kept[owners[j]] and _beside(
                        (middles, ways, lengths), i, j, (radius, straight, directed)
                    ):
                        hit = True
                        break
                if hit:
                    break
            covered += lengths[i] if hit else 0.0
            stretch = 0.0 if hit else stretch + lengths[i]
            longest = max(longest, stretch)
        kept[c] = covered <= share * totals[c] or longest >= core
    return kept


@compiled
@no_type_check
def _measure(endpoints):
    """Gives middle, unit direction and length of each segment."""
    n = len(endpoints)
    middles, ways, lengths = np.empty((n, 2)), np.zeros((n, 2)), np.empty(n)
    for i in range(n):
        dx, dy = endpoints[i, 1, 0] - endpoints[i, 0, 0], endpoints[i, 1, 1] - endpoints[i, 0, 1]
        lengths[i] = np.sqrt(dx * dx + dy * dy)
        if lengths[i] > 0:
            ways[i, 0], ways[i, 1] = dx / lengths[i], dy / lengths[i]
        middles[i, 0], middles[i, 1] = endpoints[i, 0, 0] + dx / 2, endpoints[i, 0, 1] + dy / 2
    return middles, ways, lengths


@compiled
@no_type_check
def _sum_up(items, offsets, lengths, scores):
    """Gives the chain of each segment, and the strength and the length of each chain."""
    owners = np.empty(len(items), np.int64)
    strengths, totals = np.zeros(len(offsets) - 1), np.zeros(len(offsets) - 1)
    for c in range(len(totals)):
        for p in range(offsets[c], offsets[c + 1]):
            owners[items[p]] = c
            strengths[c] += scores[items[p]] * lengths[items[p]]
            totals[c] += lengths[items[p]]
    return owners, strengths, totals


@compiled(inline=True)
@no_type_check
def _beside(measures, i, j, rule):
    """Gives whether segment i lies beside segment j."""
    middles, ways, lengths = measures
    radius, straight, directed = rule
    cosine = ways[i, 0] * ways[j, 0] + ways[i, 1] * ways[j, 1]
    if (cosine if directed else abs(cosine)) < straight:
        return False
    x, y = middles[i, 0] - middles[j, 0], middles[i, 1] - middles[j, 1]
    along, beside = x * ways[j, 0] + y * ways[j, 1], y * ways[j, 0] - x * ways[j, 1]
    return abs(beside) <= radius and abs(along) <= lengths[j] / 2 + 0.5
