"""Chains to lines through their links: the vertices that a graph of polylines is made of, compiled.

A line is a run of `points` with the arc length `arcs` from its first one. Where two segments of a chain meet,
the point lies half way between their ends: for a perfect chain these are the vertices that were cut into
segments, and each is the mean of what two cells say.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled

_MEET = 0.5  # cells; ends nearer than this are one point, a larger gap is a straight piece
_AHEAD = 0.05  # cells that a point must lie ahead of the one before
_SAME = 1e-6  # cells


@compiled
@no_type_check
def trace_lines(offsets, rings, endpoints):
    """Gives the lines of chains: points, where those of each begin, and what each segment spans of them.

    Args:
        offsets: Where each chain begins in `endpoints`, and the last ends.
        rings: Whether each chain is closed; its last point is then its first.
        endpoints: Segments in cell units, in the order and direction of their chains.

    Returns:
        Points, offsets, and for each segment the indices of the points at its start and its end. A line
        without length has one point.
    """
    count = len(offsets) - 1
    points, starts = np.empty((2 * len(endpoints) + count, 2)), np.zeros(count + 1, np.int64)
    spans = np.empty((len(endpoints), 2), np.int64)
    filled = 0
    for c in range(count):
        first, stop, begin = offsets[c], offsets[c + 1], filled
        points[filled, 0], points[filled, 1] = endpoints[first, 0, 0], endpoints[first, 0, 1]
        filled += 1
        spans[first, 0] = begin
        for p in range(first + 1, stop):
            filled = _add_link(endpoints, p - 1, p, points, filled)
            spans[p - 1, 1] = spans[p, 0] = filled - 1
            if _gap(endpoints, p - 1, p) > _MEET and filled - begin > 1:
                spans[p - 1, 1] = max(filled - 2, spans[p - 1, 0])
        filled = _add_end(endpoints, stop - 1, points, begin, filled)
        spans[stop - 1, 1] = filled - 1
        if rings[c]:
            filled = _close(endpoints, (first, stop - 1), points, begin, filled)
        for p in range(first, stop):
            for k in range(2):
                spans[p, k] = min(spans[p, k], filled - 1)
        starts[c + 1] = filled
    return points[:filled], starts, spans


@compiled(inline=True)
@no_type_check
def _gap(endpoints, a, b):
    dx, dy = endpoints[b, 0, 0] - endpoints[a, 1, 0], endpoints[b, 0, 1] - endpoints[a, 1, 1]
    return np.sqrt(dx * dx + dy * dy)


@compiled
@no_type_check
def _add_link(endpoints, a, b, points, filled):
    """Writes the point (two across a gap) between segments a and b, and gives how many points there are."""
    tx = endpoints[a, 1, 0] - endpoints[a, 0, 0] + endpoints[b, 1, 0] - endpoints[b, 0, 0]
    ty = endpoints[a, 1, 1] - endpoints[a, 0, 1] + endpoints[b, 1, 1] - endpoints[b, 0, 1]
    if _gap(endpoints, a, b) <= _MEET:
        x = (endpoints[a, 1, 0] + endpoints[b, 0, 0]) / 2
        y = (endpoints[a, 1, 1] + endpoints[b, 0, 1]) / 2
        return _add(points, filled, (x, y), (tx, ty))
    filled = _add(points, filled, (endpoints[a, 1, 0], endpoints[a, 1, 1]), (tx, ty))
    return _add(points, filled, (endpoints[b, 0, 0], endpoints[b, 0, 1]), (tx, ty))


@compiled(inline=True)
@no_type_check
def _add(points, filled, place, way):
    """Writes the place behind the filled points if it lies ahead of the last one."""
    dx, dy = place[0] - points[filled - 1, 0], place[1] - points[filled - 1, 1]
    norm = np.sqrt(way[0] * way[0] + way[1] * way[1])
    if dx * way[0] + dy * way[1] <= _AHEAD * norm or abs(dx) + abs(dy) <= _SAME:
        return filled
    points[filled, 0], points[filled, 1] = place
    return filled + 1


@compiled
@no_type_check
def _add_end(endpoints, p, points, begin, filled):
    """Writes the end of the last segment in place of the points that do not lie before it."""
    tx, ty = endpoints[p, 1, 0] - endpoints[p, 0, 0], endpoints[p, 1, 1] - endpoints[p, 0, 1]
    norm = np.sqrt(tx * tx + ty * ty)
    x, y = endpoints[p, 1, 0], endpoints[p, 1, 1]
    while filled - begin > 1:
        dx, dy = x - points[filled - 1, 0], y - points[filled - 1, 1]
        if dx * tx + dy * ty > _AHEAD * norm and abs(dx) + abs(dy) > _SAME:
            break
        filled -= 1
    if abs(x - points[filled - 1, 0]) + abs(y - points[filled - 1, 1]) > _SAME:
        points[filled, 0], points[filled, 1] = x, y
        filled += 1
    return filled


@compiled
@no_type_check
def _close(endpoints, seam, points, begin, filled):
    """Makes the last point of a ring its first: half way between the ends, or across a gap the start."""
    first, last = seam
    if filled - begin < 3:
        return filled
    if _gap(endpoints, last, first) <= _MEET:
        for k in range(2):
            middle = (endpoints[last, 1, k] + endpoints[first, 0, k]) / 2
            points[begin, k] = points[filled - 1, k] = middle
        return filled
    for k in range(2):
        points[filled, k] = points[begin, k]
    return filled + 1


@compiled
@no_type_check
def arc_lengths(points, starts):
    """Gives the arc length from the first point of its line to each point."""
    arcs = np.zeros(len(points))
    for c in range(len(starts) - 1):
        for i in range(starts[c] + 1, starts[c + 1]):
            dx, dy = points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]
            arcs[i] = arcs[i - 1] + np.sqrt(dx * dx + dy * dy)
    return arcs


@compiled
@no_type_check
def place_at(points, arcs, first, stop, arc):
    """Gives the place at an arc length of the line `points[first:stop]`, its end beyond."""
    low, high = first, stop - 1
    while high - low > 1:
        middle = (low + high) // 2
        if arcs[middle] <= arc:
            low = middle
        else:
            high = middle
    length = arcs[high] - arcs[low]
    if length <= 0:
        return points[low, 0], points[low, 1]
    share = min(max((arc - arcs[low]) / length, 0.0), 1.0)
    if share == 1:  # exactly, so that a vertex stays where it is
        return points[high, 0], points[high, 1]
    x = points[low, 0] + share * (points[high, 0] - points[low, 0])
    return x, points[low, 1] + share * (points[high, 1] - points[low, 1])
