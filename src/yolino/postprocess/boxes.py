"""Boxes for the points of crowded cells, compiled: groups so small that all members of one are neighbors."""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from numba import njit

CROWD = 32  # points in one cell from which on boxes pay
_MIX = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio: spreads neighboring numbers


@njit(cache=True, error_model="numpy")
@no_type_check
def split_cells(rows, keys, order, epsilon):
    """Sorts the rows of crowded cells by box, and gives where each box starts (and the last stops)."""
    n = len(order)
    starts = np.empty(n + 1, np.int64)
    count = p = 0
    while p < n:
        stop = p + 1
        while stop < n and keys[stop] == keys[p]:
            stop += 1
        if stop - p > CROWD:
            sizes = _split_cell(rows[p:stop], order[p:stop], epsilon)
        else:
            sizes = np.ones(stop - p, np.int64)
        for size in sizes:
            starts[count] = p
            p += size
            count += 1
    starts[count] = n
    return starts[: count + 1]


@njit(cache=True, error_model="numpy")
@no_type_check
def _split_cell(rows, order, epsilon):
    """Sorts the rows of one cell (and their order) by box, and gives the sizes of the boxes."""
    n, d = rows.shape
    scale = (np.floor(np.sqrt(d)) + 1) / epsilon  # the diagonal of a box is shorter than epsilon
    table, steps = np.full(2 * n, -1, np.int64), np.empty((n, d), np.int64)
    boxes, sizes = np.empty(n, np.int64), np.zeros(n, np.int64)
    filled = 0
    for p in range(n):
        mix = np.uint64(0)
        for k in range(d):
            steps[filled, k] = np.int64(np.floor((rows[p, k] - rows[0, k]) * scale))
            mix = (mix ^ np.uint64(steps[filled, k])) * _MIX
        at = np.int64(mix >> np.uint64(20)) % len(table)
        while table[at] >= 0 and not (steps[table[at]] == steps[filled]).all():
            at = (at + 1) % len(table)
        if table[at] < 0:
            table[at] = filled
            filled += 1
        boxes[p] = table[at]
        sizes[boxes[p]] += 1
    places = np.cumsum(sizes) - sizes
    old_rows, old_order = rows.copy(), order.copy()
    for p in range(n):
        at = places[boxes[p]]
        places[boxes[p]] += 1
        order[at], rows[at] = old_order[p], old_rows[p]
    return sizes[:filled]


@njit(cache=True, error_model="numpy")
@no_type_check
def bounds(rows, starts):
    """Gives the low and the high corner of the points of each box."""
    lows, highs = rows[starts[:-1]], rows[starts[:-1]]
    for b in range(len(starts) - 1):
        for p in range(starts[b] + 1, starts[b + 1]):
            for k in range(rows.shape[1]):
                lows[b, k] = min(lows[b, k], rows[p, k])
                highs[b, k] = max(highs[b, k], rows[p, k])
    return lows, highs


@njit(cache=True, error_model="numpy", inline="always")
@no_type_check
def near(rows, p, q, limit):
    """Tells whether the squared distance of rows p and q is within the limit."""
    total = 0.0
    for k in range(rows.shape[1]):
        side = rows[p, k] - rows[q, k]
        total += side * side
    return total <= limit  # no way out earlier: a mispredicted branch costs more than the sum


@njit(cache=True, error_model="numpy", inline="always")
@no_type_check
def gaps(lows, highs, a, b):
    """Gives the squared smallest and largest distance that points of boxes a and b can have."""
    smallest = largest = 0.0
    for k in range(lows.shape[1]):
        low, high = lows[a, k] - highs[b, k], highs[a, k] - lows[b, k]
        gap, reach = max(low, -high, 0.0), max(-low, high)
        smallest += gap * gap
        largest += reach * reach
    return smallest, largest
