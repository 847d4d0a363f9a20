"""Upper ends of lines at one height: where a camera looks along a flat road, lines end at the horizon."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled

_STRETCH = 2.0  # cells at the end of a line that say where it would go on
_STEEP = 0.125  # least sine of the angle between them and the rows of the image, for a line to go on
_ROUNDING = 1e-6  # pixels


@compiled
@no_type_check
def level_ends(vertices, offsets, reach, shortest, cell_size):
    """Gives vertices and offsets of lines whose upper ends are cut off, or extended straight, to one row.

    The row is the median of the upper ends of all lines that are not closed. Ends farther than the reach from
    it stay where they are, as do those of lines of which too little would be left, and of those that would go
    on nearly along it or out of the columns that the lines span. All stay where one half of them ends farther
    from the other than the reach.

    Args:
        vertices: `(v, 2)`, in pixels.
        offsets: `(n + 1,)`, where the vertices of each line begin.
        reach: Largest height that is cut off or added, in pixels.
        shortest: Least length of a line that was cut, in pixels.
        cell_size: Side of a cell in pixels.
    """
    ends = _upper_ends(vertices, offsets)
    heights = np.sort(vertices[ends[ends >= 0], 1])
    if len(heights) < 2:
        return vertices, offsets
    upper, lower = heights[(len(heights) - 1) // 2], heights[len(heights) // 2]
    if lower - upper > reach:  # two groups of lines, and no end between them
        return vertices, offsets
    row = (upper + lower) / 2
    left, right = vertices[:, 0].min(), vertices[:, 0].max()
    leveled, bounds = np.empty((len(vertices) + len(ends), 2)), np.zeros_like(offsets)
    for c in range(len(ends)):
        begin, stop, filled, x = offsets[c], offsets[c + 1], bounds[c], np.nan
        at_first = ends[c] == begin
        if ends[c] >= 0 and abs(vertices[ends[c], 1] - row) <= reach:
            kept, x = _meet(vertices[begin:stop], at_first, row, (shortest, _STRETCH * cell_size))
            if not left - _ROUNDING <= x <= right + _ROUNDING:
                x = np.nan
            elif at_first:
                begin = stop - kept
            else:
                stop = begin + kept
        if at_first and not np.isnan(x):
            leveled[filled, 0], leveled[filled, 1] = x, row
            filled += 1
        for p in range(begin, stop):
            leveled[filled, 0], leveled[filled, 1] = vertices[p, 0], vertices[p, 1]
            filled += 1
        if not at_first and not np.isnan(x):
            leveled[filled, 0], leveled[filled, 1] = x, row
            filled += 1
        bounds[c + 1] = filled
    return leveled[: bounds[-1]], bounds


@compiled
@no_type_check
def _upper_ends(vertices, offsets):
    """Gives the index of each line's upper end, or -1 if both are equally high, as in a closed line."""
    ends = np.full(len(offsets) - 1, -1)
    for c in range(len(ends)):
        first, last = offsets[c], offsets[c + 1] - 1
        if vertices[first, 1] != vertices[last, 1]:
            ends[c] = first if vertices[first, 1] < vertices[last, 1] else last
    return ends


@compiled
@no_type_check
def _meet(line, at_first, row, lengths):
    """Gives how many vertices are left of a line that is to end at the row, and x of its new end.

    NaN and all vertices where it has to stay as it is.
    """
    shortest, stretch = lengths
    end, step = (0, 1) if at_first else (len(line) - 1, -1)
    x, y, at, dx, dy = line[end, 0], line[end, 1], end, 0.0, 0.0
    if y >= row:
        while 0 <= at + step < len(line) and np.sqrt(dx * dx + dy * dy) < stretch:
            at += step
            dx, dy = x - line[at, 0], y - line[at, 1]
        if y == row or -dy < _STEEP * np.sqrt(dx * dx + dy * dy):
            return len(line), np.nan
        return len(line), x + dx * (row - y) / dy
    while 0 <= at < len(line) and line[at, 1] <= row:
        at += step
    if at < 0 or at == len(line):
        return len(line), np.nan
    dx, dy = line[at - step, 0] - line[at, 0], line[at - step, 1] - line[at, 1]
    share = (row - line[at, 1]) / dy
    left, p = share * np.sqrt(dx * dx + dy * dy), at
    while 0 <= p + step < len(line):
        dx, dy = line[p + step, 0] - line[p, 0], line[p + step, 1] - line[p, 1]
        left += np.sqrt(dx * dx + dy * dy)
        p += step
    if left < shortest:
        return len(line), np.nan
    return len(line) - abs(at - end), line[at, 0] + share * (line[at - step, 0] - line[at, 0])


__all__ = ["level_ends"]
