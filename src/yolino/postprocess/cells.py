"""Sparse grids of cells, compiled: points sorted by cell, and the runs of points in the cells around each."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from yolino.compiled import compiled

_MANY = 1024  # keys from which on fewer, longer digits sort faster


@compiled
@no_type_check
def sort_points(points, radius):
    """Gives the points sorted by cell, their order, the keys of their cells and the number of columns."""
    keys, columns = _cell_keys(points, radius)
    order = _radix_order(keys)
    rows, sorted_keys = np.empty_like(points), np.empty_like(keys)
    for p in range(len(order)):
        sorted_keys[p] = keys[order[p]]
        for k in range(points.shape[1]):
            rows[p, k] = points[order[p], k]
    return rows, order, sorted_keys, columns


@compiled
@no_type_check
def _cell_keys(points, radius):
    """Gives the cell of each point as `row * columns + column`, and the number of columns."""
    n, (a, b) = len(points), _widest(points)
    low_a = high_a = points[0, a]
    low_b = high_b = points[0, b]
    for i in range(n):
        low_a, high_a = min(low_a, points[i, a]), max(high_a, points[i, a])
        low_b, high_b = min(low_b, points[i, b]), max(high_b, points[i, b])
    # A little wider than radius: rounding must not put two neighbors two cells apart.
    scale = 1 / max(radius * (1 + 1e-6), max(high_a - low_a, high_b - low_b) * 2.0**-30)
    columns = np.int64((high_b - low_b) * scale) + 2  # one column stays empty, so that rows do not touch
    keys = np.empty(n, np.int64)
    for i in range(n):
        row, column = np.int64((points[i, a] - low_a) * scale), np.int64((points[i, b] - low_b) * scale)
        keys[i] = row * columns + column
    return keys, columns


@compiled
@no_type_check
def _widest(points):
    """Gives the two dimensions (or twice the one) in which a sample of the points spreads the most."""
    first = second = -1
    most = more = -1.0
    for k in range(points.shape[1]):
        low = high = points[0, k]
        for i in range(0, len(points), max(len(points) // 32, 1)):
            low, high = min(low, points[i, k]), max(high, points[i, k])
        if high - low > most:
            first, second, most, more = k, first, high - low, most
        elif high - low > more:
            second, more = k, high - low
    return first, max(second, 0)


@compiled
@no_type_check
def _radix_order(keys):
    """Gives the stable order that sorts keys from 0 on, digit by digit."""
    n = len(keys)
    order, other = np.arange(n), np.empty(n, np.int64)
    top = bits = 0
    for key in keys:
        top = max(top, key)
    while top >> bits:
        bits += 1
    rounds = (bits + 7) // 8 if n < _MANY else (bits + 10) // 11
    width = (bits + rounds - 1) // max(rounds, 1)
    for turn in range(rounds):
        shift, mask = turn * width, (1 << width) - 1
        places = np.zeros(mask + 2, np.int64)
        for i in range(n):
            places[((keys[i] >> shift) & mask) + 1] += 1
        for digit in range(mask):
            places[digit + 1] += places[digit]
        for i in order:
            digit = (keys[i] >> shift) & mask
            other[places[digit]] = i
            places[digit] += 1
        order, other = other, order
    return order


@compiled
@no_type_check
def windows(keys, columns):
    """Gives for each item the two runs `[start, stop)` of later items in the 3 x 3 cells around its own.

    Args:
        keys: Cell of each item as `row * columns + column`, sorted; the last column is empty.
        columns: Columns of the grid.
    """
    n = len(keys)
    runs = np.empty((n, 2, 2), np.int64)
    here = start = stop = 0
    for i in range(n):
        while here < n and keys[here] <= keys[i] + 1:
            here += 1
        while start < n and keys[start] < keys[i] + columns - 1:
            start += 1
        stop = max(stop, start)
        while stop < n and keys[stop] <= keys[i] + columns + 1:
            stop += 1
        runs[i, 0, 0], runs[i, 0, 1] = i + 1, here
        runs[i, 1, 0], runs[i, 1, 1] = start, stop
    return runs


@compiled
@no_type_check
def neighborhoods(keys, columns):
    """Gives for each item the three runs `[start, stop)` of all items in the 3 x 3 cells around its own.

    Arguments as in `windows`.
    """
    n = len(keys)
    runs = np.empty((n, 3, 2), np.int64)
    for row in range(3):
        start = stop = 0
        shift = (row - 1) * columns
        for i in range(n):
            while start < n and keys[start] < keys[i] + shift - 1:
                start += 1
            stop = max(stop, start)
            while stop < n and keys[stop] <= keys[i] + shift + 1:
                stop += 1
            runs[i, row, 0], runs[i, row, 1] = start, stop
    return runs
