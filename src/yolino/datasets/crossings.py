"""Polylines that cross, touch or run over themselves: a compiled sweep over their segments."""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from jaxtyping import Bool

from yolino.compiled import compiled
from yolino.types import Polylines


def overlap_themselves(polylines: Polylines) -> Bool[np.ndarray, " n"]:
    """Tells of each polyline whether two of its segments meet that are no neighbors, or neighbors fold back.

    Repeated vertices count once. A closed polyline, whose last vertex is the first, does not meet itself
    there. Compared exactly, without tolerance. The time grows with the number of segments that lie side by
    side, not with that of all pairs.

    Args:
        polylines: Polylines of finite vertices.
    """
    found = np.zeros(len(polylines), np.bool_)
    lines = _without_repeats(polylines)
    suspects = np.flatnonzero((np.diff(lines.offsets) > 2) & ~_are_monotone(lines))
    lines = lines[suspects]
    if len(lines) == 0:
        return found
    low, high = (
        reduce.reduceat(lines.vertices, lines.offsets[:-1], axis=0) for reduce in (np.minimum, np.maximum)
    )
    axis = (high - low).argmax(axis=1)[lines.owners]
    pieces = lines.endpoints
    along = np.take_along_axis(pieces, axis[:, None, None], axis=2)[:, :, 0]
    spans = np.sort(along, axis=1)
    order = np.lexsort((spans[:, 0], lines.owners))
    firsts = lines.offsets - np.arange(len(lines.offsets))
    found[suspects] = _overlap(pieces, spans, order, firsts)
    return found


def _without_repeats(polylines: Polylines) -> Polylines:
    """Gives the polylines without vertices that repeat the one before."""
    first = np.zeros(len(polylines.vertices) + 1, np.bool_)
    first[polylines.offsets] = True
    moved = (polylines.vertices[1:] != polylines.vertices[:-1]).any(axis=1)
    kept = first[:-1] | np.append(True, moved)[: len(polylines.vertices)]
    offsets = np.append(0, np.cumsum(kept))[polylines.offsets]
    return Polylines(polylines.vertices[kept], offsets)


def _are_monotone(polylines: Polylines) -> Bool[np.ndarray, " n"]:
    """Tells which polylines run steadily along an axis, so that they cannot come back to themselves."""
    delta = polylines.endpoints[:, 1] - polylines.endpoints[:, 0]
    owners, pieces = polylines.owners, np.diff(polylines.offsets) - 1
    ways = (delta[:, 0] > 0, delta[:, 0] < 0, delta[:, 1] > 0, delta[:, 1] < 0)
    steady = [np.bincount(owners[way], minlength=len(polylines)) == pieces for way in ways]
    return np.asarray(np.logical_or.reduce(steady))


@compiled
@no_type_check
def _overlap(pieces, spans, order, firsts):
    """Tells which polylines overlap themselves; `firsts` is the first piece of each, then their number."""
    found = np.zeros(len(firsts) - 1, np.bool_)
    for i in range(len(found)):
        start, stop = firsts[i], firsts[i + 1]
        first, last = pieces[start, 0], pieces[stop - 1, 1]
        closed = first[0] == last[0] and first[1] == last[1]
        found[i] = _folds_back(pieces, start, stop) or _meets(pieces, spans, order[start:stop], closed)
    return found


@compiled
@no_type_check
def _folds_back(pieces, start, stop):
    """Tells whether a piece runs back over the one before."""
    for k in range(start + 1, stop):
        a, b = pieces[k - 1], pieces[k]
        along = (a[1, 0] - a[0, 0]) * (b[1, 0] - b[0, 0]) + (a[1, 1] - a[0, 1]) * (b[1, 1] - b[0, 1])
        if along < 0 and _side(a, b[1]) == 0:
            return True
    return False


@compiled
@no_type_check
def _meets(pieces, spans, order, closed):
    """Tells whether pieces that are no neighbors have a point in common; `order` is that of their spans."""
    for p in range(len(order)):
        a = order[p]
        for q in range(p + 1, len(order)):
            b = order[q]
            if spans[b, 0] > spans[a, 1]:
                break
            apart = abs(a - b)
            neighbors = apart == 1 or (closed and apart == len(order) - 1)
            if not neighbors and _meet(pieces[a], pieces[b]):
                return True
    return False


@compiled
@no_type_check
def _meet(a, b):
    """Tells whether two pieces have a point in common."""
    for axis in range(2):
        if max(a[0, axis], a[1, axis]) < min(b[0, axis], b[1, axis]):
            return False
        if max(b[0, axis], b[1, axis]) < min(a[0, axis], a[1, axis]):
            return False
    # Boxes that meet, and no piece wholly on one side of the other: that holds for touching ones too.
    return _side(a, b[0]) * _side(a, b[1]) <= 0 and _side(b, a[0]) * _side(b, a[1]) <= 0


@compiled
@no_type_check
def _side(piece, point):
    """Gives 1 or -1 for a point on one or the other side of the line through a piece, 0 on it."""
    dx, dy = piece[1, 0] - piece[0, 0], piece[1, 1] - piece[0, 1]
    return np.sign(dx * (point[1] - piece[0, 1]) - dy * (point[0] - piece[0, 0]))


__all__ = ["overlap_themselves"]
