"""Lines that reach their junctions, compiled."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled

_AHEAD = 0.05  # cells that the next point must lie ahead of the junction
_SAME = 1e-6  # cells
_WRAP = 8  # points


@compiled
@no_type_check
def extend_lines(lines, rings, alive, junctions):
    """Gives the lines that are alive from junction to junction, and how arc lengths change.

    What runs past a junction is cut off. A ring with junctions begins and ends at the first one.

    Args:
        lines: Points, their arc lengths, where those of each line begin.
        rings: Whether each line is closed.
        alive: Whether each line is there; changed where no length is left.
        junctions: Places, junction at each end, and passes (see `join_lines`).

    Returns:
        Points, where those of each line begin, and for each line what is added to an arc length; of a ring
        the result is taken modulo its length.
    """
    points, arcs, starts = lines
    spots, ends, passes = junctions
    longer, offsets = np.empty((len(points) + 2 * len(rings), 2)), np.zeros(len(rings) + 1, np.int64)
    shifts = np.zeros(len(rings))
    filled = at = 0
    for c in range(len(rings)):
        while at < len(passes[0]) and passes[0][at] < c:
            at += 1
        begin = filled
        if alive[c]:
            first, stop = starts[c], starts[c + 1]
            if rings[c] and at < len(passes[0]) and passes[0][at] == c:
                arc, spot = passes[1][at], spots[passes[2][at]]
                filled = _rotate((points, arcs), (first, stop), (arc, spot), longer, filled)
                shifts[c] = -arc
            else:
                filled, shifts[c] = _reach((points, arcs), (first, stop), (spots, ends, c), longer, filled)
            if filled - begin < 2:
                alive[c], filled = False, begin
        offsets[c + 1] = filled
    return longer[:filled], offsets, shifts


@compiled
@no_type_check
def wrap_rings(points, starts, rings):
    """Gives the lines with each ring running on over its seam at both ends, and how far, in arc length.

    So a curve through it is as smooth at the seam as anywhere.
    """
    wrapped, offsets = np.empty((len(points) + 2 * _WRAP * len(rings), 2)), np.zeros_like(starts)
    leads = np.zeros(len(rings))
    filled = 0
    for c in range(len(rings)):
        first, stop = starts[c], starts[c + 1]
        extra = min(_WRAP, stop - first - 2) if rings[c] and stop > first else 0
        for i in range(first - extra, stop + extra):
            j = i
            if i < first:
                j = i + stop - first - 1
                dx, dy = points[j + 1, 0] - points[j, 0], points[j + 1, 1] - points[j, 1]
                leads[c] += np.sqrt(dx * dx + dy * dy)
            elif i >= stop:
                j = i - (stop - first - 1)
            wrapped[filled, 0], wrapped[filled, 1] = points[j, 0], points[j, 1]
            filled += 1
        offsets[c + 1] = filled
    return wrapped[:filled], offsets, leads


@compiled
@no_type_check
def _put(longer, begin, filled, x, y):
    """Writes a point unless it is the last one again."""
    if filled > begin and abs(x - longer[filled - 1, 0]) + abs(y - longer[filled - 1, 1]) <= _SAME:
        return filled
    longer[filled, 0], longer[filled, 1] = x, y
    return filled + 1


@compiled
@no_type_check
def _rotate(line, span, pole, longer, filled):
    """Writes the points of a ring from an arc length on, with the junction there as first and last."""
    (points, arcs), (first, stop), (arc, spot), begin = line, span, pole, filled
    filled = _put(longer, begin, filled, spot[0], spot[1])
    cut = first + 1
    while cut < stop - 1 and arcs[cut] <= arc:
        cut += 1
    for k in range(stop - first - 1):
        i = cut + k
        if i >= stop:
            i -= stop - first - 1
        filled = _put(longer, begin, filled, points[i, 0], points[i, 1])
    if (
        filled > begin
        and abs(spot[0] - longer[filled - 1, 0]) + abs(spot[1] - longer[filled - 1, 1]) <= _SAME
    ):
        filled -= 1
    longer[filled, 0], longer[filled, 1] = spot[0], spot[1]
    return filled + 1


@compiled
@no_type_check
def _reach(line, span, goals, longer, filled):
    """Writes the points of a line from junction to junction; gives how many there are, and the shift."""
    (points, arcs), (first, stop), (spots, ends, c), begin = line, span, goals, filled
    low, high = first, stop - 1
    a, b = ends[2 * c], ends[2 * c + 1]
    if a >= 0:
        while low < high and not _is_ahead(points, low, low + 1, spots[a]):
            low += 1
        filled = _put(longer, begin, filled, spots[a, 0], spots[a, 1])
    if b >= 0:
        while high > low and not _is_ahead(points, high, high - 1, spots[b]):
            high -= 1
    if not (a >= 0 and b >= 0 and low == high):
        for i in range(low, high + 1):
            filled = _put(longer, begin, filled, points[i, 0], points[i, 1])
    if b >= 0:
        if filled - begin > 1 and (
            abs(spots[b, 0] - longer[filled - 1, 0]) + abs(spots[b, 1] - longer[filled - 1, 1]) <= _SAME
        ):
            filled -= 1
        filled = _put(longer, begin, filled, spots[b, 0], spots[b, 1])
    gained = 0.0
    if a >= 0:
        dx, dy = points[low, 0] - spots[a, 0], points[low, 1] - spots[a, 1]
        gained = np.sqrt(dx * dx + dy * dy)
    return filled, gained - arcs[low]


@compiled(inline=True)
@no_type_check
def _is_ahead(points, i, inner, spot):
    """Tells whether point i, next to the end, lies on the inner side of the junction."""
    tx, ty = points[inner, 0] - points[i, 0], points[inner, 1] - points[i, 1]
    norm = np.sqrt(tx * tx + ty * ty)
    return (points[i, 0] - spot[0]) * tx + (points[i, 1] - spot[1]) * ty > _AHEAD * norm
