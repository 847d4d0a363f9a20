"""An order that does not depend on how things came in, compiled."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled


@compiled
@no_type_check
def sort_rows(rows):
    """Gives the stable order that sorts rows of numbers like words."""
    n = len(rows)
    order, other = np.arange(n), np.empty(n, np.int64)
    width = 1
    while width < n:
        for start in range(0, n, 2 * width):
            left, middle = start, min(start + width, n)
            right, stop = middle, min(start + 2 * width, n)
            for at in range(start, stop):
                if right == stop or (left < middle and not _precedes(rows, order[right], order[left])):
                    other[at] = order[left]
                    left += 1
                else:
                    other[at] = order[right]
                    right += 1
        order, other = other, order
        width *= 2
    return order


@compiled
@no_type_check
def _precedes(rows, i, j):
    for k in range(rows.shape[1]):
        if rows[i, k] != rows[j, k]:
            return rows[i, k] < rows[j, k]
    return False


@compiled
@no_type_check
def sort_segments(endpoints, scores, labels, votes, cell_size):
    """Gives end points in cell units, scores and votes of segments, sorted by these, scores and labels."""
    n = len(endpoints)
    rows = np.empty((n, 6))
    for i in range(n):
        for k in range(4):
            rows[i, k] = endpoints[i, k >> 1, k & 1] / cell_size
        rows[i, 4], rows[i, 5] = scores[i], labels[i]
    order = sort_rows(rows)
    new_endpoints, new_scores, new_votes = np.empty_like(endpoints), np.empty(n), np.empty_like(votes)
    for p in range(n):
        i = order[p]
        new_scores[p] = scores[i]
        for k in range(4):
            new_endpoints[p, k >> 1, k & 1] = rows[i, k]
        for k in range(votes.shape[1]):
            new_votes[p, k] = votes[i, k]
    return new_endpoints, new_scores, new_votes
